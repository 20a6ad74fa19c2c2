//! The pictures of the documentation: small enough to be loaded, and the animation moves.

use std::path::Path;

/// Largest picture that a reader of README should have to load, bytes.
const BYTES_MAX: u64 = 2_000_000;
/// Pictures of the animation at least: those of two seconds at 25 a second.
const PICTURES_MIN: usize = 50;
/// What README and the page's own documentation show.
const OF_THE_PAGE: [&str; 6] = ["page", "page-dark", "page-help", "page-light", "page-phone", "page-whole"];

#[test]
fn no_picture_of_the_documentation_is_too_large_and_the_animation_moves() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/pictures"));
    for entry in std::fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let bytes = entry.metadata().unwrap().len();
        assert!(bytes < BYTES_MAX, "{:?}: {bytes} bytes, allowed are fewer than {BYTES_MAX}", entry.path());
    }
    for name in OF_THE_PAGE {
        let file = std::fs::read(folder.join(name).with_extension("webp")).unwrap();
        assert_eq!((&file[..4], &file[8..12]), (&b"RIFF"[..], &b"WEBP"[..]), "{name}");
        let pictures = file.windows(4).filter(|chunk| chunk == b"ANMF").count();
        assert!(name != "page" || pictures >= PICTURES_MIN, "{pictures} pictures in the animation");
    }
}
