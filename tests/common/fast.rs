//! The peer that speaks through Fast DDS, compiled by the first test that wants it.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest as _, Sha256};

use super::install::{apt_install, run};

const SOURCE: &str = include_str!("../interop/fast/relay.cpp");
/// Debian's package of Fast DDS, and a file of it.
const PACKAGE: &str = "libfastrtps-dev";
const HEADER: &str = "/usr/include/fastdds/dds/domain/DomainParticipant.hpp";

/// The compiled `tests/interop/fast/relay.cpp`. It lives in the target folder under a name that says what is in it, so
/// it is made once. On Debian and Ubuntu, root installs what is missing; others are told what to install.
pub(crate) fn fast_relay() -> PathBuf {
    let base = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let hash: String = Sha256::digest(SOURCE).iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    let relay = base.join(format!("fast-relay-{hash}"));
    // Held until this function returns: other tests, also of other processes, wait for the same peer.
    let lock = File::create(base.join("fast.lock")).unwrap();
    lock.lock().unwrap();
    if !relay.exists() {
        let hint = "the interop tests need g++ and Fast DDS 2 (on Debian: apt install g++ libfastrtps-dev)";
        apt_install(Path::new(HEADER), &["g++", PACKAGE], hint);
        let source = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("tests/interop/fast/relay.cpp");
        let made = base.join(format!("fast-relay-{hash}.part"));
        let mut compile = Command::new("g++");
        compile.args(["-std=c++17", "-o"]).arg(&made).arg(source).args(["-lfastrtps", "-lfastcdr"]);
        run(&mut compile, hint);
        fs::rename(made, &relay).unwrap();
    }
    relay
}
