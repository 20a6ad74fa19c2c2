//! The commands that look at pictures in files.

use std::path::{Path, PathBuf};

use feeder_vision::decode;
use image::DynamicImage;
use image::imageops::FilterType;
use serde_json::Value;
use tempfile::TempDir;

use crate::common::feeder;

const OTHER_LIGHT: &str = "the light differs from the one taught";
const PICTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/pictures");

/// A picture of another renderer.
fn traced(name: &str) -> PathBuf {
    Path::new(PICTURES).join(name)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// What a command prints and what it says beside, and whether it succeeded.
fn said(arguments: &[&str]) -> (String, String, bool) {
    let output = feeder().args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (text(&output.stdout), text(&output.stderr), output.status.success())
}

/// The lines that `feeder look` prints of pictures, without their names, and whether it succeeded.
fn looked(arguments: &[&str], pictures: &[&Path]) -> (Vec<Value>, bool) {
    let pictures: Vec<&str> = pictures.iter().map(|picture| text(picture)).collect();
    let (out, error, succeeded) = said(&[&["look"], arguments, &pictures].concat());
    let mut lines: Vec<Value> = out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), pictures.len(), "{error}");
    for (line, picture) in lines.iter_mut().zip(pictures) {
        assert_eq!(line.as_object_mut().unwrap().remove("picture"), Some(picture.into()));
    }
    (lines, succeeded)
}

#[test]
fn the_same_picture_in_other_formats_and_sizes_shows_the_same() {
    let work = TempDir::new().unwrap();
    let original = traced("crowd_ring.jpg");
    let grey = DynamicImage::ImageLuma8(decode(&std::fs::read(&original).unwrap()).unwrap());
    let large = DynamicImage::ImageLuma8(image::imageops::resize(&grey.to_luma8(), 1280, 960, FilterType::Nearest));
    let copies = [
        ("grey.png", grey.clone()),
        ("colours.png", grey.to_rgb8().into()),
        ("deep.png", grey.to_luma16().into()),
        ("large.png", large),
    ];
    let files: Vec<PathBuf> = copies.iter().map(|(name, _)| work.path().join(name)).collect();
    copies.iter().zip(&files).for_each(|((_, copy), file)| copy.save(file).unwrap());
    let all: Vec<&Path> = std::iter::once(&original).chain(&files).map(PathBuf::as_path).collect();
    let (lines, succeeded) = looked(&[], &all);
    assert!(succeeded);
    lines[1..].iter().for_each(|line| assert_eq!(line, &lines[0]));
    for seen in lines[0]["candidates"].as_array().unwrap() {
        for key in ["x_m", "y_m", "confidence", "free_gap_m", "wall_gap_m"] {
            assert!(seen[key].is_f64(), "{key} in {seen}");
        }
        assert!(seen["may_be_picked"].is_boolean() && seen["yaw_rad"].is_null(), "{seen}");
    }
    // The scenario's model was taught from the drawing, under another light.
    assert_eq!(lines[0]["doubts"], Value::from(vec![OTHER_LIGHT]), "{}", lines[0]["doubts"]);
}

#[test]
fn a_tray_beside_its_place_makes_the_picture_doubtful_and_nothing_in_it_may_be_picked() {
    let picture = traced("crowd_ring.jpg");
    for (tray, doubt) in [
        ("-0.1,0,0", None),
        ("-0.0995,0,0", Some("0.5")),
        ("-0.098,0,0", Some("allowed: 1.00 mm; places are up to 2.0")),
    ] {
        let (lines, succeeded) = looked(&["--tray", tray], &[&picture]);
        let doubts = lines[0]["doubts"].as_array().unwrap().iter().filter(|doubt| **doubt != OTHER_LIGHT);
        let doubts: Vec<&Value> = doubts.collect();
        assert!(succeeded);
        assert_eq!(doubts.len(), usize::from(doubt.is_some()), "{tray}: {doubts:?}");
        let told = doubts.iter().all(|said| said.as_str().unwrap().contains(doubt.unwrap_or_default()));
        assert!(told, "{tray}: {doubts:?}");
    }
    let (lines, _) = looked(&["--tray", "-0.098,0,0"], &[&picture]);
    let picked = |seen: &&Value| seen["may_be_picked"] == true;
    assert_eq!(lines[0]["candidates"].as_array().unwrap().iter().find(picked), None);
}

#[test]
fn what_is_no_picture_of_the_camera_is_named_and_the_others_are_looked_at() {
    let work = TempDir::new().unwrap();
    let (corrupt, small, missing) =
        (work.path().join("corrupt.jpg"), work.path().join("small.png"), work.path().join("missing.png"));
    let bytes = std::fs::read(traced("bare_side.jpg")).unwrap();
    std::fs::write(&corrupt, &bytes[..bytes.len() / 3]).unwrap();
    DynamicImage::new_luma8(320, 240).save(&small).unwrap();
    let good = traced("bare_side.jpg");
    let (lines, succeeded) = looked(&[], &[&corrupt, &small, &missing, &good]);
    assert!(!succeeded);
    for (line, says) in lines.iter().zip(["corrupt.jpg", "320x240 px; the camera has 640x480 px", "missing.png"]) {
        let doubt = line["doubts"][0].as_str().unwrap();
        assert!(doubt.contains(says), "{doubt:?} does not say {says:?}");
    }
    // A bare plateau under a lamp never taught, whose hub throws a long shadow: that is said, and nothing is seen.
    assert_eq!(lines[3]["candidates"], Value::Array(Vec::new()));
    let doubts = lines[3]["doubts"].to_string();
    assert!(doubts.contains("the light differs") && doubts.contains("nothing there is recognised"), "{doubts}");
}

#[test]
fn a_calibration_that_a_picture_gave_is_a_section_of_a_scenario() {
    let picture = traced("nuts_ring.jpg");
    let (section, told, succeeded) = said(&["calibrate", "--tray", "-0.097,0.002,0", text(&picture)]);
    assert!(succeeded, "{told}");
    // Told that the tray stands 3 mm further right and 2 mm further up, it finds the camera there.
    let model: Value = serde_saphyr::from_str(&section).unwrap();
    let pose = &model["camera"]["model"]["pose"];
    let off = |key: &str, expected_m: f64| (pose[key].as_f64().unwrap() - expected_m).abs();
    assert!(off("x_m", -0.1 + 0.003) < 2e-4 && off("y_m", -0.045 + 0.002) < 2e-4, "{section}");
    let (_, refused, succeeded) = said(&["calibrate", "--tray", "0.1,0,0", text(&picture)]);
    assert!(!succeeded && refused.contains("nuts_ring.jpg"), "{refused}");
}

#[test]
fn labels_that_make_no_sense_are_refused_by_line() {
    let work = TempDir::new().unwrap();
    let table = work.path().join("labels.csv");
    for (lines, says) in [
        (
            "crowd_ring.jpg,300,300,hole_up\ncrowd_ring.jpg,300,300,hole\n",
            "line 3: label \"hole\"; allowed: hole_up, boss_up, other, foreign",
        ),
        ("crowd_dome.jpg,300,300,hole_up\n", "line 2: picture \"crowd_dome.jpg\" is none of the 3 pictures"),
        ("crowd_ring.jpg,700,300,hole_up\n", "line 2: x_px = 700 lies outside the picture of 640x480 px"),
        ("crowd_ring.jpg,300,300,\n", "nothing is labelled"),
    ] {
        std::fs::write(&table, format!("picture,x_px,y_px,label\n{lines}")).unwrap();
        let (_, refused, succeeded) = said(&["teach", "--pictures", PICTURES, "--labels", text(&table)]);
        assert!(!succeeded && refused.contains("labels.csv") && refused.contains(says), "{refused}");
    }
    let (_, refused, succeeded) = said(&["teach", "--pictures", PICTURES]);
    assert!(!succeeded && refused.contains("--propose"), "{refused}");
}
