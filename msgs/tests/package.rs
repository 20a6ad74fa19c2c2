//! The package as ROS 2's build tools see it, and the documentation of its definitions.

use std::{collections::BTreeSet, fs, path::Path};

use ros2_msggen::{Arity, Catalogue, DefinitionFile, Element, Role};

const PACKAGE: &str = "minifactory_msgs";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn own() -> Vec<DefinitionFile> {
    DefinitionFile::read_package(PACKAGE, root()).expect("own definitions")
}

fn catalogue() -> Catalogue {
    let mut sources = own();
    sources.extend(DefinitionFile::read_packages(&root().join("standard")).expect("standard definitions"));
    Catalogue::new(&sources).expect("valid definitions")
}

fn read(file: &str) -> String {
    fs::read_to_string(root().join(file)).expect(file)
}

#[test]
fn cmake_generates_exactly_the_definitions_there_are() {
    let cmake = read("CMakeLists.txt");
    let listed: BTreeSet<_> =
        cmake.lines().filter_map(|line| line.trim().strip_prefix('"')?.strip_suffix('"')).collect();
    let files: Vec<_> =
        own().iter().map(|source| format!("{0}/{1}.{0}", source.namespace.as_str(), source.name)).collect();
    assert_eq!(listed, files.iter().map(String::as_str).collect());
}

#[test]
fn the_packages_that_are_used_are_declared() {
    let (cmake, manifest) = (read("CMakeLists.txt"), read("package.xml"));
    let dependencies =
        cmake.lines().find_map(|line| line.trim().strip_prefix("DEPENDENCIES ")).expect("a line of dependencies");
    let catalogue = catalogue();
    let used: BTreeSet<_> = catalogue
        .structures()
        .filter(|structure| structure.name.package == PACKAGE && structure.role == Role::Message)
        .flat_map(|structure| &structure.body.fields)
        .filter_map(|field| match &field.ty.element {
            Element::Nested(name) if name.package != PACKAGE => Some(name.package.as_str()),
            _ => None,
        })
        .collect();
    assert_eq!(dependencies.split(' ').collect::<BTreeSet<_>>(), used);
    for package in used {
        assert!(cmake.contains(&format!("find_package({package} REQUIRED)")), "{package}");
        assert!(manifest.contains(&format!("<depend>{package}</depend>")), "{package}");
    }
    assert!(manifest.contains("<build_type>ament_cmake</build_type>"));
    assert!(manifest.contains(&format!("<version>{}</version>", env!("CARGO_PKG_VERSION"))));
}

#[test]
fn every_field_and_constant_of_our_own_is_explained() {
    for structure in catalogue().structures() {
        if structure.name.package != PACKAGE || structure.role != Role::Message {
            continue;
        }
        let name = &structure.name;
        for field in &structure.body.fields {
            assert!(!field.doc.is_empty(), "{name}: {} has no comment", field.name);
            if field.ty.element == Element::Float64 {
                let doc = field.doc.join(" ").to_lowercase();
                let units = ["second", "metre", "m/s", "rad", "per minute", "number of", "share of"];
                let names_unit = units.iter().any(|unit| doc.contains(unit));
                assert!(names_unit, "{name}: the comment of {} has no unit", field.name);
            }
        }
        for constant in &structure.body.constants {
            assert!(!constant.doc.is_empty(), "{name}: {} has no comment", constant.name);
        }
    }
}

#[test]
fn standard_definitions_state_facts_only() {
    for source in DefinitionFile::read_packages(&root().join("standard")).expect("standard definitions") {
        assert!(!source.text.contains('#'), "{} has comments", source.file.display());
    }
    // Large arrays exist, so that their special treatment is under test.
    let catalogue = catalogue();
    let large = |arity| matches!(arity, Arity::Array(size) if size > 32);
    assert!(
        catalogue.structures().any(|structure| { structure.body.fields.iter().any(|field| large(field.ty.arity)) })
    );
}
