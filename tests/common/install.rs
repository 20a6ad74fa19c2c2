//! What tests need of the system, installed by the first test that wants it.

use std::fs::File;
use std::path::Path;
use std::process::Command;

/// Installs Debian packages where a file of theirs is missing. Root gets them installed; others are told by `hint` what
/// to install.
#[track_caller]
pub(crate) fn apt_install(file: &Path, packages: &[&str], hint: &str) {
    // Held until this function returns: one apt-get at a time.
    let lock = File::create(Path::new(env!("CARGO_TARGET_TMPDIR")).join("apt.lock")).unwrap();
    lock.lock().unwrap();
    if file.exists() {
        return;
    }
    assert!(rustix::process::geteuid().is_root(), "{hint}");
    let apt = |arguments: &[&str]| {
        let mut command = Command::new("apt-get");
        command.args(arguments).env("DEBIAN_FRONTEND", "noninteractive");
        command
    };
    run(&mut apt(&["update", "--quiet"]), hint);
    run(apt(&["install", "--quiet", "--yes", "--no-install-recommends"]).args(packages), hint);
}

/// Runs a command, which must succeed.
#[track_caller]
pub(super) fn run(command: &mut Command, hint: &str) {
    let output = command.output().unwrap_or_else(|error| panic!("{hint}: {command:?}: {error}"));
    let said = || [&*output.stdout, &*output.stderr].map(String::from_utf8_lossy).concat();
    assert!(output.status.success(), "{hint}: {command:?}: {}: {}", output.status, said());
}
