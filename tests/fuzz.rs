//! What fuzzers found worth keeping, and a short walk from there: input damaged in every way.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read as _;
use std::path::Path;

use flate2::read::GzDecoder;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Inputs for each target, unless `FUZZ_INPUTS` says otherwise; with `FUZZ_SEED` they are others.
fn inputs(target: &str) -> u64 {
    match target {
        // These take a millisecond or more each.
        "bag" | "part_model" | "scenario" => 100,
        "part" | "picture" | "stl" => 500,
        _ => 5000,
    }
}

/// The inputs in `tests/data/corpora`, by target: an archive for each.
fn corpora() -> BTreeMap<String, Vec<Vec<u8>>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/corpora");
    let files = folder.read_dir().unwrap().map(|entry| entry.unwrap().path());
    let corpus = |file: &Path| {
        let packed = std::fs::File::open(file).unwrap();
        let mut archive = tar::Archive::new(GzDecoder::new(packed));
        let inputs =
            archive.entries().unwrap().map(Result::unwrap).filter(|entry| entry.header().entry_type().is_file());
        let read = |mut entry: tar::Entry<'_, _>| {
            let mut input = Vec::new();
            entry.read_to_end(&mut input).unwrap();
            input
        };
        inputs.map(read).collect()
    };
    let named = |file: &Path| file.file_name().unwrap().to_str().unwrap().strip_suffix(".tar.gz").unwrap().to_owned();
    files.map(|file| (named(&file), corpus(&file))).collect()
}

fn damage(input: &mut Vec<u8>, random: &mut Pcg64Mcg) {
    for _ in 0..random.random_range(1..4) {
        let at = random.random_range(0..=input.len());
        match random.random_range(0..6) {
            0 => input.truncate(at),
            1 => input.insert(at, random.random()),
            2 if at < input.len() => input[at] ^= 1 << random.random_range(0..8),
            // A length or a sequence number far from any that makes sense.
            3 if at + 4 <= input.len() => input[at..at + 4].fill(if random.random() { 0xff } else { 0x7f }),
            4 => input.extend_from_within(at..),
            _ => input.splice(at..at, random.random::<[u8; 8]>()).for_each(drop),
        }
        input.truncate(1 << 16);
    }
}

#[test]
fn no_decoder_panics_or_hangs_whatever_comes() {
    let told = |variable: &str| std::env::var(variable).ok().map(|number| number.parse::<u64>().unwrap());
    let corpora = corpora();
    let targets: BTreeSet<&str> = feeder_tests::targets().map(|(name, _)| name).collect();
    assert_eq!(corpora.keys().map(String::as_str).collect::<BTreeSet<_>>(), targets);
    for (name, target) in feeder_tests::targets() {
        let corpus = &corpora[name];
        assert!(!corpus.is_empty(), "{name} has no corpus");
        corpus.iter().for_each(|input| target(input));
        let mut random = Pcg64Mcg::seed_from_u64(told("FUZZ_SEED").unwrap_or(1));
        for _ in 0..told("FUZZ_INPUTS").unwrap_or_else(|| inputs(name)) {
            let mut input = corpus[random.random_range(0..corpus.len())].clone();
            damage(&mut input, &mut random);
            target(&input);
        }
    }
}

/// A decoder that cargo-fuzz does not know is not fuzzed.
#[test]
fn every_decoder_has_a_fuzz_target() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzzers");
    let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap();
    for (name, _) in feeder_tests::targets() {
        assert!(manifest.contains(&format!("name = \"{name}\"\npath = \"fuzz_targets/{name}.rs\"\n")), "{name}");
        let target = std::fs::read_to_string(folder.join(format!("fuzz_targets/{name}.rs"))).unwrap();
        assert!(target.contains(&format!("feeder_tests::target(\"{name}\")")), "{name}: {target}");
    }
}
