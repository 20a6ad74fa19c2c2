//! The project's own rules: who may depend on whom, and what lies where.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::common::output;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
/// What the rooms under the nodes may use of ours; every other package but the tops is a node.
const LIBRARIES: &[(&str, &[&str])] = &[
    ("ros2_msggen", &[]),
    ("minifactory_msgs", &["ros2_msggen"]),
    ("ros2_bags", &["ros2_msggen"]),
    ("feeder_model", &[]),
    ("feeder_control", &["feeder_model"]),
    ("feeder_vision", &["feeder_model"]),
    ("feeder_sim", &["feeder_model"]),
    ("feeder_scenario", &["feeder_model", "feeder_control", "feeder_vision", "feeder_sim"]),
    ("feeder_wire", &["feeder_model", "minifactory_msgs"]),
    ("feeder_runtime", &["minifactory_msgs"]),
    ("feeder_bag_transport", &["ros2_bags", "feeder_runtime", "minifactory_msgs"]),
    (
        "feeder_view",
        &["feeder_model", "feeder_control", "feeder_scenario", "feeder_wire", "feeder_runtime", "minifactory_msgs"],
    ),
    ("feeder_top", &["feeder_view"]),
];
const NODE_USES: &[&str] = &[
    "feeder_model",
    "feeder_control",
    "feeder_vision",
    "feeder_sim",
    "feeder_scenario",
    "feeder_wire",
    "feeder_runtime",
    "minifactory_msgs",
];
/// The commands and what tests them: they may use everything below them.
const TOPS: &[&str] = &["feeder", "feeder_lab", "feeder_tests"];

struct Package {
    name: String,
    folder: String,
    dependencies: BTreeSet<String>,
}

/// The packages of the workspace, as cargo tells of them.
fn metadata() -> Vec<Value> {
    let arguments = ["metadata", "--format-version", "1", "--no-deps", "--offline"];
    let output = Command::new(env!("CARGO")).args(arguments).current_dir(ROOT).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    serde_json::from_value(metadata["packages"].take()).unwrap()
}

fn text(value: &Value) -> String {
    value.as_str().unwrap().to_owned()
}

/// The folder of a package, from the top level.
fn folder(package: &Value) -> String {
    let root = Path::new(ROOT).canonicalize().unwrap();
    let manifest = Path::new(package["manifest_path"].as_str().unwrap()).strip_prefix(root).unwrap();
    manifest.parent().unwrap().to_str().unwrap().to_owned()
}

/// Every dependency of every package: the package, its folder with a slash at the end, and what it depends on.
fn dependencies() -> Vec<(String, String, String)> {
    let of = |package: Value| {
        let (name, folder) = (text(&package["name"]), format!("{}/", folder(&package)));
        let used: Vec<String> =
            package["dependencies"].as_array().unwrap().iter().map(|used| text(&used["name"])).collect();
        used.into_iter().map(move |used| (name.clone(), folder.clone(), used))
    };
    metadata().into_iter().flat_map(of).collect()
}

/// The packages of the workspace with all they need to be built; what their tests use is left out.
fn packages() -> Vec<Package> {
    let package = |package: &Value| Package {
        name: text(&package["name"]),
        folder: folder(package),
        dependencies: package["dependencies"]
            .as_array()
            .unwrap()
            .iter()
            .filter(|used| used["kind"] != "dev")
            .map(|used| text(&used["name"]))
            .collect(),
    };
    metadata().iter().map(package).collect()
}

#[test]
fn dependencies_point_one_way() {
    let packages = packages();
    let ours: BTreeSet<&str> = packages.iter().map(|package| package.name.as_str()).collect();
    for library in LIBRARIES.iter().map(|(library, _)| library).chain(TOPS) {
        assert!(ours.contains(library), "{library} is gone from {ours:?}: this test must follow");
    }
    for Package { name, dependencies, .. } in &packages {
        let used = dependencies.iter().map(String::as_str).filter(|used| ours.contains(used));
        if TOPS.contains(&name.as_str()) {
            let above =
                |used: &&str| TOPS.iter().position(|top| top == used) >= TOPS.iter().position(|top| top == name);
            assert_eq!(
                used.filter(|used| TOPS.contains(used)).find(above),
                None,
                "{name} depends on a command above it"
            );
            continue;
        }
        let library = LIBRARIES.iter().find(|(library, _)| library == name);
        let allowed = library.map_or(NODE_USES, |(_, allowed)| allowed);
        for used in used {
            assert!(allowed.contains(&used), "{name} depends on {used}; it may on {allowed:?}");
        }
    }
}

#[test]
fn the_runtime_alone_knows_the_middleware() {
    for library in ["ros2-client", "rustdds"] {
        let packages = packages();
        let users = packages.iter().filter(|package| package.dependencies.contains(library));
        let users: Vec<&str> = users.map(|package| package.name.as_str()).collect();
        assert!(users.iter().all(|user| *user == "feeder_runtime"), "{library} is used by {users:?}");
    }
}

#[test]
fn the_command_does_not_pay_for_the_laboratory() {
    let arguments = ["tree", "--package", "feeder", "--edges", "normal", "--prefix", "none", "--offline", "--locked"];
    let output = Command::new(env!("CARGO")).args(arguments).current_dir(ROOT).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let tree = String::from_utf8(output.stdout).unwrap();
    let linked: BTreeSet<&str> = tree.lines().filter_map(|line| line.split(' ').next()).collect();
    assert!(linked.contains("feeder_runtime"), "{linked:?}");
    for heavy in ["feeder_lab", "rapier3d-f64", "plotters", "argmin", "rsruckig"] {
        assert!(!linked.contains(heavy), "the command links {heavy}");
    }
}

/// Crates that are of use without the feeder.
const ALONE: &[&str] = &["ros2_msggen", "ros2_bags", "feeder_model"];

fn cargo_package(arguments: &[&str]) -> (String, String) {
    let common = ["package", "--allow-dirty", "--offline", "--locked"];
    let output = Command::new(env!("CARGO")).args(common).args(arguments).current_dir(ROOT).output().unwrap();
    let [told, said] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    assert!(output.status.success(), "{arguments:?}: {said}");
    (told, said)
}

#[test]
fn crates_that_others_can_take_carry_what_they_need() {
    let packages = metadata();
    let ours: BTreeSet<String> = packages.iter().map(|package| text(&package["name"])).collect();
    for package in packages.iter().filter(|package| ALONE.contains(&package["name"].as_str().unwrap())) {
        let (name, folder) = (text(&package["name"]), Path::new(ROOT).join(folder(package)));
        let (listed, _) = cargo_package(&["--list", "--package", &name]);
        let listed: BTreeSet<&str> = listed.lines().collect();
        for needed in ["README.md", "LICENSE", "src/lib.rs"] {
            assert!(listed.contains(needed), "{name} is packed without {needed}");
        }
        assert!(listed.iter().any(|file| file.starts_with("examples/")), "{name} is packed without an example");
        let readme = std::fs::read_to_string(folder.join("README.md")).unwrap();
        for link in readme.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            assert!(
                link.contains("://") || listed.contains(link),
                "{name}: its front page leads to {link}, which is not packed"
            );
        }
        for picture in listed.iter().filter_map(|file| file.strip_prefix("pictures/")) {
            let [packed, drawn] = [folder.join("pictures"), Path::new(ROOT).join("docs/pictures/concepts")]
                .map(|folder| std::fs::read(folder.join(picture)).unwrap());
            assert!(packed == drawn, "{name}: {picture} is not the one of the book");
        }
        for used in package["dependencies"]
            .as_array()
            .unwrap()
            .iter()
            .filter(|used| ours.contains(used["name"].as_str().unwrap()))
        {
            let (used_name, is_needed) = (text(&used["name"]), used["kind"] != "dev");
            // What tests alone need has no version, and cargo leaves it out of the package.
            let is_fit = if is_needed { ALONE.contains(&used_name.as_str()) } else { used["req"] == "*" };
            assert!(is_fit, "{name} cannot be taken without {used_name}");
        }
    }
    let together: Vec<&str> = ALONE.iter().flat_map(|name| ["--package", name]).collect();
    let (_, said) = cargo_package(&[&["--no-verify"], &*together].concat());
    // Where they are published nobody has said, and tests that need the workspace stay behind.
    let meant = ["documentation, homepage or repository", "is not included in the published package"];
    let is_meant = |line: &&str| meant.iter().any(|end| line.ends_with(end));
    let warnings = said.lines().filter(|line| line.starts_with("warning") && !is_meant(line));
    assert_eq!(warnings.collect::<Vec<_>>(), Vec::<&str>::new());
}

#[test]
fn nodes_live_under_their_name() {
    for Package { name, folder, .. } in packages() {
        let is_node = LIBRARIES.iter().all(|(library, _)| *library != name) && !TOPS.contains(&name.as_str());
        assert!(!is_node || folder == format!("nodes/{name}"), "{name} lives in {folder}");
    }
}

#[test]
fn no_test_is_left_out() {
    let tests = Path::new(ROOT).join("tests");
    let [suite, manifest] = ["suite.rs", "Cargo.toml"].map(|file| std::fs::read_to_string(tests.join(file)).unwrap());
    for entry in std::fs::read_dir(tests).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap();
        let is_file = path.extension().is_some_and(|extension| extension == "rs") && name != "suite";
        let is_target = manifest.contains(&format!("[[test]]\nname = \"{name}\"\n"));
        let is_module = is_file && !is_target || path.join("mod.rs").exists();
        assert!(!is_module || suite.contains(&format!("\nmod {name};\n")), "suite.rs does not name {name}");
    }
}

/// Paths of all files under version control.
fn files() -> Vec<String> {
    let output = Command::new("git").args(["ls-files", "-z"]).current_dir(ROOT).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    text.split_terminator('\0').map(str::to_owned).collect()
}

/// The source files, each with its text.
fn sources() -> impl Iterator<Item = (String, String)> {
    let sources = files().into_iter().filter(|file| file.ends_with(".rs"));
    // One that is deleted, but not yet in a commit, has no text.
    sources.filter_map(|file| std::fs::read_to_string(Path::new(ROOT).join(&file)).ok().map(|text| (file, text)))
}

#[test]
fn every_module_says_what_it_is() {
    for (file, text) in sources() {
        assert!(text.starts_with("//! "), "{file} begins with no //! line");
    }
}

#[test]
fn a_module_with_modules_of_its_own_is_a_mod_rs() {
    let files: BTreeSet<String> = sources().map(|(file, _)| file).collect();
    for file in &files {
        let folder = format!("{}/", file.trim_end_matches(".rs"));
        let inside = files.range(folder.clone()..).next().filter(|other| other.starts_with(&folder));
        assert_eq!(inside, None, "{file} lies beside a folder of its name: it must be {folder}mod.rs");
    }
}

#[test]
fn every_dependency_is_used() {
    // Wanted for a feature of another crate.
    let unnamed = [
        ("feeder_lab", "argmin-math"),
        // In a file of the bags' tests that it shares.
        ("feeder_bag_transport", "serde"),
    ];
    let sources: Vec<(String, String)> = sources().collect();
    for (package, folder, name) in dependencies() {
        let used = |(file, text): &&(String, String)| {
            let is_word = |at: usize, word: &str| {
                let is_part = |c: char| c.is_alphanumeric() || c == '_';
                !text[..at].ends_with(is_part) && !text[at + word.len()..].starts_with(is_part)
            };
            let word = name.replace('-', "_");
            file.starts_with(&folder) && text.match_indices(&word).any(|(at, word)| is_word(at, word))
        };
        let is_excused = unnamed.contains(&(package.as_str(), name.as_str()));
        assert_ne!(sources.iter().any(|source| used(&source)), is_excused, "{package} and its dependency on {name}");
    }
}

#[test]
fn the_top_level_is_the_agreed_one() {
    let agreed = [
        "Cargo.toml",
        "Cargo.lock",
        "LICENSE",
        "README.md",
        "nodes",
        "msgs",
        "launch_configs",
        "bags",
        "tests",
        "docs",
    ];
    for file in files() {
        let top = file.split('/').next().unwrap();
        assert!(top.starts_with('.') || agreed.contains(&top), "{top} does not belong to the top level");
    }
}

#[test]
fn every_scenario_can_run() {
    let scenarios: Vec<_> = std::fs::read_dir(Path::new(ROOT).join("launch_configs"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "yaml"))
        .collect();
    assert!(!scenarios.is_empty());
    for scenario in scenarios {
        let checked = output(["check".as_ref(), scenario.as_os_str()]);
        assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
    }
}

#[test]
fn no_file_knows_the_machine_it_was_written_on() {
    // Written apart, so that this file does not hold them.
    let places = ["home", "root", "work", "tmp", "Users", "mnt"].map(|folder| format!("/{folder}/"));
    for file in files() {
        let Ok(text) = std::fs::read_to_string(Path::new(ROOT).join(&file)) else { continue };
        for (number, line) in (1..).zip(text.lines()) {
            let starts = places.iter().flat_map(|place| line.match_indices(place.as_str()));
            // As part of a relative path or an address such a folder is harmless.
            let absolute = |at: usize| !line[..at].ends_with(|c: char| c.is_alphanumeric() || "._-~}>".contains(c));
            for (at, place) in starts {
                assert!(!absolute(at), "{file}:{number} names a place of one machine, {place}");
            }
        }
    }
}
