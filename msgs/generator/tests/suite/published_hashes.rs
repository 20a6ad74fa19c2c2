//! Type hashes that ROS 2 Jazzy itself computes, as found in its installed packages and on its wires.

use std::path::Path;

use ros2_msggen::{Catalogue, DefinitionFile, PackageFolder, TypeName};

fn source(package: &str, namespace: PackageFolder, name: &str, text: &str) -> DefinitionFile {
    DefinitionFile {
        package: package.to_owned(),
        namespace,
        name: name.to_owned(),
        file: name.into(),
        text: text.to_owned(),
    }
}

fn catalogue() -> Catalogue {
    let standard = Path::new(env!("CARGO_MANIFEST_DIR")).join("../standard");
    let mut sources = DefinitionFile::read_packages(&standard).expect("standard definitions");
    sources.push(source("example_interfaces", PackageFolder::Srv, "AddTwoInts", "int64 a\nint64 b\n---\nint64 sum\n"));
    sources.push(source(
        "action_tutorials_interfaces",
        PackageFolder::Action,
        "Fibonacci",
        "int32 order\n---\nint32[] sequence\n---\nint32[] partial_sequence\n",
    ));
    Catalogue::new(&sources).expect("valid definitions")
}

#[test]
fn hashes_equal_those_of_ros_2() {
    let published = [
        ("std_msgs/msg/String", "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        ("rcl_interfaces/msg/Log", "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac"),
        (
            "rcl_interfaces/msg/ParameterEvent",
            "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204",
        ),
        ("action_msgs/msg/GoalStatusArray", "RIHS01_6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e"),
        ("action_msgs/srv/CancelGoal", "RIHS01_573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a"),
        (
            "example_interfaces/srv/AddTwoInts",
            "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a",
        ),
        (
            "rcl_interfaces/srv/DescribeParameters",
            "RIHS01_845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
        ),
        ("rcl_interfaces/srv/GetParameters", "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc"),
        (
            "rcl_interfaces/srv/GetParameterTypes",
            "RIHS01_da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
        ),
        (
            "rcl_interfaces/srv/ListParameters",
            "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
        ),
        ("rcl_interfaces/srv/SetParameters", "RIHS01_56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0"),
        (
            "rcl_interfaces/srv/SetParametersAtomically",
            "RIHS01_0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
        ),
        (
            "action_tutorials_interfaces/action/Fibonacci_SendGoal",
            "RIHS01_a0603060ed69fe2dfbd1a6f3b982a1749957ef346e4a4d2b311a05e305ec37bb",
        ),
        (
            "action_tutorials_interfaces/action/Fibonacci_GetResult",
            "RIHS01_8b47e383f1e31f6d8df6417ab54957e7d5ea24dad315646ad711ac3fdea81d58",
        ),
        (
            "action_tutorials_interfaces/action/Fibonacci_FeedbackMessage",
            "RIHS01_50fc26b9cac313652ecbeab3adf9b5414d59fd4d4d5f9058ddcc7525169927f1",
        ),
    ];
    let catalogue = catalogue();
    for (name, expected) in published {
        let structure = catalogue.structures().find(|structure| structure.name.to_string() == name).expect(name);
        assert_eq!(catalogue.type_hash(structure), expected, "{name}");
    }
}

#[test]
fn names_order_as_their_text_does() {
    // The hash is over referenced types in the order of their text, which the order of the parts must not change.
    let catalogue = catalogue();
    let names: Vec<&TypeName> = catalogue.structures().map(|structure| &structure.name).collect();
    assert!(names.is_sorted_by_key(ToString::to_string));
}
