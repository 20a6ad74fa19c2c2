//! The suite over several hosts, which are network namespaces: as root, or in namespaces of its own user.

use std::path::Path;
use std::process::{Command, Output};

use crate::common::{apt_install, feeder, python};

/// Runs a script of `hosts/` where it may make namespaces.
fn script(name: &str, arguments: &[&str]) -> Output {
    apt_install(Path::new("/sbin/ip"), &["iproute2"], "this test makes network namespaces with `ip`, of iproute2");
    let shell = "mount -t tmpfs tmpfs /run && mkdir -p /run/netns && ip link set lo up && exec \"$@\"";
    let mut command = Command::new("unshare");
    command.args(["--user", "--map-root-user", "--mount", "--net", "sh", "-c", shell, "sh"]).arg(python());
    command.arg(format!("{}/../tests/hosts/{name}", env!("CARGO_MANIFEST_DIR")));
    command.arg("--feeder").arg(feeder().get_program()).args(arguments).output().unwrap()
}

#[test]
fn a_run_over_two_hosts_without_multicast_is_the_run_of_one() {
    let outcome = script("hosts.py", &["--simulated", "3", "5,0.01,nomulticast"]);
    let printed = String::from_utf8_lossy(&outcome.stdout);
    let error = String::from_utf8_lossy(&outcome.stderr);
    assert!(outcome.status.success(), "{printed}{error}");
    let row = printed.lines().last().unwrap_or_default();
    assert!(row.contains("[0, 0]") && row.contains("same"), "{printed}{error}");
}
