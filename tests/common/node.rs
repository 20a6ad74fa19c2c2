//! A Node.js project with the packages that read bags, made by the first test that wants it.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest as _, Sha256};

const PACKAGE: &str = include_str!("../interop/package.json");
const LOCK: &str = include_str!("../interop/package-lock.json");
const READER: &str = include_str!("../interop/bag_reader.mjs");

/// The script `tests/interop/bag_reader.mjs` beside the packages of `tests/interop/package.json`. It lives in the target
/// folder under a name that says what is in it, so it is made once.
pub(crate) fn bag_reader() -> PathBuf {
    let base = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let hash: String =
        Sha256::digest([PACKAGE, LOCK, READER].concat()).iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    let project = base.join(format!("node-{hash}"));
    let script = project.join("bag_reader.mjs");
    // Held until this function returns: other tests, also of other processes, wait for the same project.
    let lock = File::create(base.join("node.lock")).unwrap();
    lock.lock().unwrap();
    if !script.exists() {
        if project.exists() {
            fs::remove_dir_all(&project).unwrap();
        }
        fs::create_dir(&project).unwrap();
        fs::write(project.join("package.json"), PACKAGE).unwrap();
        fs::write(project.join("package-lock.json"), LOCK).unwrap();
        let hint = "the tests with @mcap/core need Node.js 18 or later with npm (Debian, Ubuntu: apt install npm)";
        let mut npm = Command::new("npm");
        npm.args(["ci", "--ignore-scripts", "--no-audit", "--no-fund"]).current_dir(&project);
        let output = npm.output().unwrap_or_else(|error| panic!("{hint}: {npm:?}: {error}"));
        let said = || [&*output.stdout, &*output.stderr].map(String::from_utf8_lossy).concat();
        assert!(output.status.success(), "{hint}: {npm:?}: {}: {}", output.status, said());
        fs::write(&script, READER).unwrap();
    }
    script
}
