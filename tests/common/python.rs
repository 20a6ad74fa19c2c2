//! A Python with the packages that interop tests need, made by the first test that wants one.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest as _, Sha256};

use super::install::run;

const REQUIREMENTS: &str = include_str!("../interop/requirements.txt");

/// The interpreter of an environment with everything in `tests/interop/requirements.txt`. It lives in the target
/// folder under a name that says what is in it, so it is made once.
pub(crate) fn python() -> PathBuf {
    let base = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let hash: String = Sha256::digest(REQUIREMENTS).iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    let environment = base.join(format!("python-{hash}"));
    let ready = environment.join("ready");
    let python = environment.join("bin/python");
    // Held until this function returns: other tests, also of other processes, wait for the same environment.
    let lock = File::create(base.join("python.lock")).unwrap();
    lock.lock().unwrap();
    if !ready.exists() {
        if environment.exists() {
            fs::remove_dir_all(&environment).unwrap();
        }
        let hint =
            "the interop tests need Python 3.10 to 3.13 with venv (on Debian and Ubuntu: apt install python3-venv)";
        run(Command::new("python3").args(["-m", "venv"]).arg(&environment), hint);
        let requirements = base.join("requirements.txt");
        fs::write(&requirements, REQUIREMENTS).unwrap();
        let pip =
            ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary=:all:", "--requirement"];
        run(
            Command::new(&python).args(pip).arg(&requirements),
            "the packages of tests/interop/requirements.txt are needed",
        );
        fs::write(ready, "").unwrap();
    }
    python
}
