//! Node.js projects with the packages that tests need, made by the first test that wants one.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest as _, Sha256};

use super::install::run;

/// The script `tests/interop/bag_reader.mjs` beside the packages of `tests/interop/package.json`.
pub(crate) fn bag_reader() -> PathBuf {
    let (package, lock) = (include_str!("../interop/package.json"), include_str!("../interop/package-lock.json"));
    node_project("node", package, lock, "bag_reader.mjs", include_str!("../interop/bag_reader.mjs"))
}

/// A script beside the packages that it needs. It lives in the target folder under a name that says what is in it, so it
/// is made once.
pub(super) fn node_project(name: &str, package: &str, lock: &str, script_name: &str, script: &str) -> PathBuf {
    let base = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let digest = Sha256::digest([package, lock, script].concat());
    let hash: String = digest.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    let project = base.join(format!("{name}-{hash}"));
    let made = project.join(script_name);
    // Held until this function returns: other tests, also of other processes, wait for the same project.
    let guard = File::create(base.join(format!("{name}.lock"))).unwrap();
    guard.lock().unwrap();
    if !made.exists() {
        if project.exists() {
            fs::remove_dir_all(&project).unwrap();
        }
        fs::create_dir(&project).unwrap();
        fs::write(project.join("package.json"), package).unwrap();
        fs::write(project.join("package-lock.json"), lock).unwrap();
        let mut npm = Command::new("npm");
        npm.args(["ci", "--ignore-scripts", "--no-audit", "--no-fund"]).current_dir(&project);
        run(&mut npm, "the tests need Node.js 18 or later with npm (Debian, Ubuntu: apt install npm)");
        fs::write(&made, script).unwrap();
    }
    made
}
