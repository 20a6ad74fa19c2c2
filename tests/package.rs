//! The suite as a package of a colcon workspace: what it installs, and where ROS 2 looks for it.

use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

use crate::common::{apt_install, feeder};

const SOURCE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../launch_configs");
/// Where Debian's package puts it.
const AMENT: &str = "/usr/share/ament_cmake";
/// Its Python modules are those of Debian's own Python.
const PATH: &str = "/usr/bin:/bin";

/// Installs the package as colcon does, with the command under test in place of one that cargo would build.
fn installed(work: &Path) -> PathBuf {
    apt_install(Path::new(AMENT), &["cmake", "make", "ament-cmake"], "the test of the package needs ament-cmake");
    let (build, prefix) = (work.join("build"), work.join("install"));
    let cmake = |arguments: &[&str]| {
        let output = Command::new("/usr/bin/cmake").args(arguments).env("PATH", PATH).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    let path = |path: &Path| path.to_str().unwrap().to_owned();
    let command = format!("-DFEEDER_COMMAND={}", path(Path::new(feeder().get_program())));
    cmake(&["-S", SOURCE, "-B", &path(&build), &command]);
    cmake(&["--build", &path(&build)]);
    cmake(&["--install", &path(&build), "--prefix", &path(&prefix)]);
    prefix
}

#[test]
fn the_package_has_the_command_its_scenarios_and_launch_files_where_ros_2_looks() {
    let work = TempDir::new().unwrap();
    let prefix = installed(work.path());
    let share = prefix.join("share/minifactory_feeder");
    assert!(prefix.join("share/ament_index/resource_index/packages/minifactory_feeder").is_file());
    for launch in ["feeder.launch.py", "feeder.launch.xml", "feeder.launch.yaml", "managed.launch.py"] {
        assert!(share.join("launch").join(launch).is_file(), "{launch}");
    }
    let scenarios = std::fs::read_dir(SOURCE).unwrap().map(|entry| entry.unwrap().file_name());
    let scenarios: Vec<_> =
        scenarios.filter(|name| Path::new(name).extension().is_some_and(|it| it == "yaml")).collect();
    assert!(scenarios.len() > 5, "{scenarios:?}");
    // One on the path, for the launch files, and one for `ros2 run`.
    for command in ["bin/feeder", "lib/minifactory_feeder/feeder"] {
        for scenario in &scenarios {
            let output = Command::new(prefix.join(command)).arg("check").arg(share.join(scenario)).output().unwrap();
            assert!(output.status.success(), "{command} {scenario:?}: {}", String::from_utf8_lossy(&output.stderr));
        }
    }
}

#[test]
fn the_package_has_the_version_of_the_command() {
    let package = std::fs::read_to_string(Path::new(SOURCE).join("package.xml")).unwrap();
    let version = format!("<version>{}</version>", env!("CARGO_PKG_VERSION"));
    assert!(package.contains(&version), "{version}: {package}");
}
