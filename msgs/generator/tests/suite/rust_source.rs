//! The emitted source. That it compiles and encodes as it should is tested where it is used.

use crate::common::{source, with_needed};
use ros2_msggen::{Catalogue, DefinitionFile, PackageFolder, emit};

fn emitted(text: &str) -> String {
    emit_all(&[source(PackageFolder::Msg, "Spot", text)])
}

fn emit_all(sources: &[DefinitionFile]) -> String {
    emit(&Catalogue::new(sources).expect("valid definitions"), "demo_msgs").expect("Rust source")
}

#[test]
fn fields_become_plain_rust() {
    let rust = emitted(
        "uint8[] data\nbyte[<=9] few\nfloat64[36] many\nchar[32] some\nstring<=3[] texts\nint16 type\nbool self\n",
    );
    for expected in [
        "#[serde(with = \"serde_bytes\")]\npub data: ::std::vec::Vec<u8>,",
        "#[serde(with = \"serde_bytes\")]\npub few: ::std::vec::Vec<u8>,",
        "#[serde(with = \"serde_big_array::BigArray\")]\npub many: [f64; 36],",
        "`char[32] some`\npub some: [u8; 32],",
        "pub texts: ::std::vec::Vec<::std::string::String>,",
        "pub r#type: i16,",
        "pub self_: bool,",
    ] {
        assert!(rust.contains(expected), "{expected} not in\n{rust}");
    }
}

#[test]
fn defaults_are_derived_unless_they_differ_from_those_of_rust() {
    for derived in ["int8 a 0", "bool a false", "string a ''", "int8[] a []", "float64[2] a [0, 0]", "int8[32] a"] {
        assert!(!emitted(derived).contains("impl ::core::default::Default"), "{derived}");
    }
    for (written, value) in [
        ("int8 a -1", "a: -1,"),
        ("bool a true", "a: true,"),
        ("float64 a 1", "a: 1.0,"),
        ("float64 a -0.0", "a: -0.0,"),
        ("string a \"x\\\"y\"", "a: ::std::string::String::from(\"x\\\"y\"),"),
        ("int8[] a [0]", "a: ::std::vec![0],"),
        ("int8[2] a [1,2]", "a: [1, 2],"),
        ("int8[33] a", "a: ::core::array::from_fn("),
    ] {
        let rust = emitted(written);
        assert!(rust.contains("impl ::core::default::Default for Spot"), "{written}");
        assert!(rust.contains(value), "{written}:\n{rust}");
    }
}

#[test]
fn only_what_lies_in_place_is_copied() {
    let copy = "#[derive(Clone, Copy, Debug";
    assert!(emitted("int8 a\nfloat64[3] b").contains(copy));
    assert!(!emitted("string a").contains(copy));
    assert!(!emitted("int8[<=2] a").contains(copy));
}

#[test]
fn comments_become_documentation_and_cannot_break_out_of_it() {
    let rust = emitted("# Head.\n\n# A \u{b}strange\u{2028} */ one.\nint8 a\nuint8 B=1\nstring C=x\ry\n");
    assert!(rust.contains("/// `demo_msgs/msg/Spot`\n/// \n/// Head.\n"), "{rust}");
    assert!(rust.contains("/// A  strange"), "{rust}");
    assert!(rust.contains("/// `uint8 B=1`\npub const B: u8 = 1;"), "{rust}");
    assert!(rust.contains("pub const C: &str = \"x\\ry\";"), "{rust}");
}

#[test]
fn rust_names_must_differ() {
    let sources =
        with_needed([source(PackageFolder::Srv, "Do", "---\n"), source(PackageFolder::Srv, "DoRequest", "---\n")]);
    let found = Catalogue::new(&sources).expect_err("two types of one Rust name");
    assert!(found.to_string().contains("would both be called `DoRequest` in Rust"), "{found}");
}
