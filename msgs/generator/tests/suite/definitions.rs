//! The language of definitions, good ones and bad ones.

use std::{fs, path::Path};

use crate::common::{parse, source};
use ros2_msggen::{Arity, Catalogue, DefinitionFile, Element, FieldType, Literal, PackageFolder, TypeName, emit};

fn error(text: &str) -> String {
    parse(text).expect_err(text).to_string()
}

#[test]
fn all_kinds_of_types_are_understood() {
    let unbounded = Element::String { bound: None };
    let cases = [
        ("bool", Element::Bool, Arity::One),
        ("byte[]", Element::Byte, Arity::Sequence { bound: None }),
        ("char", Element::Char, Arity::One),
        ("float32[3]", Element::Float32, Arity::Array(3)),
        ("float64[<=3]", Element::Float64, Arity::Sequence { bound: Some(3) }),
        ("int8", Element::Int8, Arity::One),
        ("uint8", Element::UInt8, Arity::One),
        ("int16", Element::Int16, Arity::One),
        ("uint16", Element::UInt16, Arity::One),
        ("int32", Element::Int32, Arity::One),
        ("uint32", Element::UInt32, Arity::One),
        ("int64", Element::Int64, Arity::One),
        ("uint64", Element::UInt64, Arity::One),
        ("string", unbounded.clone(), Arity::One),
        ("string<=5", Element::String { bound: Some(5) }, Arity::One),
        ("string<=5[2]", Element::String { bound: Some(5) }, Arity::Array(2)),
        ("string<=5[<=2]", Element::String { bound: Some(5) }, Arity::Sequence { bound: Some(2) }),
        ("string[]", unbounded, Arity::Sequence { bound: None }),
        ("wstring", Element::WString { bound: None }, Arity::One),
        ("wstring<=7", Element::WString { bound: Some(7) }, Arity::One),
        ("Point", Element::Nested(TypeName::message("demo_msgs", "Point")), Arity::One),
        ("demo_msgs/Point[4]", Element::Nested(TypeName::message("demo_msgs", "Point")), Arity::Array(4)),
    ];
    for (declared, element, arity) in cases {
        let spot = parse(&format!("{declared}   value")).expect(declared);
        assert_eq!(spot.body.fields[0].ty, FieldType { element, arity }, "{declared}");
        assert_eq!(spot.body.fields[0].declared, declared);
    }
}

#[test]
fn defaults_are_understood() {
    let text = |text: &str| Literal::Text(text.to_owned());
    let cases = [
        ("bool", "TRUE", Literal::Bool(true)),
        ("bool", "0", Literal::Bool(false)),
        ("int8", "-128", Literal::Integer(-128)),
        ("uint64", "18446744073709551615", Literal::Integer(u64::MAX.into())),
        ("uint8", "0xfF", Literal::Integer(255)),
        ("int16", "-0b101", Literal::Integer(-5)),
        ("char", "0o17", Literal::Integer(15)),
        ("float64", "-1.5e-3", Literal::Float64(-1.5e-3)),
        ("float32", "2", Literal::Float32(2.0)),
        ("string", "plain text", text("plain text")),
        ("string", "\" quoted \"", text(" quoted ")),
        ("string", r#""say \"so\"""#, text("say \"so\"")),
        ("string", r#"'it\'s "so"'"#, text("it's \"so\"")),
        ("int32[]", "[1, -2,3]", Literal::List(vec![Literal::Integer(1), Literal::Integer(-2), Literal::Integer(3)])),
        ("int32[]", "[]", Literal::List(Vec::new())),
        ("bool[2]", "[true, false]", Literal::List(vec![Literal::Bool(true), Literal::Bool(false)])),
        ("string[<=3]", r#"["a, b", 'c', d]"#, Literal::List(vec![text("a, b"), text("c"), text("d")])),
    ];
    for (ty, written, value) in cases {
        let spot = parse(&format!("{ty} value {written}")).expect(written);
        assert_eq!(spot.body.fields[0].default, Some(value), "{ty} {written}");
    }
}

#[test]
fn constants_are_understood() {
    let spot = parse("uint8 A=1\nint32 B_2 = -7 # less\nstring NAME='x' \nfloat32 HALF=.5\n").expect("constants");
    let constants = &spot.body.constants;
    let found: Vec<_> = constants.iter().map(|constant| (constant.name.as_str(), constant.value.clone())).collect();
    assert_eq!(
        found,
        [
            ("A", Literal::Integer(1)),
            ("B_2", Literal::Integer(-7)),
            ("NAME", Literal::Text("x".to_owned())),
            ("HALF", Literal::Float32(0.5)),
        ]
    );
    assert_eq!(constants[1].doc, ["less"]);
}

#[test]
fn comments_belong_to_what_they_stand_at() {
    let text = "# About all.\n#\n# More.\n\n# Above.\nint8 a # Beside.\n  # Below.\n\n# One.\n\n# Two.\nuint8 B=1\n# Nowhere.\n";
    let spot = parse(text).expect("comments");
    assert_eq!(spot.body.doc, ["About all.", "", "More."]);
    assert_eq!(spot.body.fields[0].doc, ["Above.", "Beside.", "Below."]);
    assert_eq!(spot.body.constants[0].doc, ["One.", "Two."]);
    assert_eq!(spot.text, text);
}

#[test]
fn an_empty_message_gets_the_field_that_ros_gives_it() {
    let spot = parse("# Nothing.\nuint8 A=1\n").expect("a message without fields");
    assert_eq!(spot.body.fields.len(), 1);
    assert_eq!(spot.body.fields[0].name, "structure_needs_at_least_one_member");
    assert!(!spot.text.contains("structure_needs"));
}

#[test]
fn line_endings_do_not_matter() {
    assert_eq!(parse("int8 a\r\nint8\tb\r\n").expect("carriage returns").body.fields.len(), 2);
}

#[test]
fn bad_lines_are_refused_with_file_and_line() {
    let cases = [
        ("int8", "expected a type and a name, found `int8`"),
        (" int8 a", "expected a type and a name, found ` int8 a`"),
        ("int8 A", "`A` cannot name a field: small letters"),
        ("int8 a__b", "`a__b` cannot name a field"),
        ("int8 a_", "`a_` cannot name a field"),
        ("int8 1a", "`1a` cannot name a field"),
        ("int8 ä", "`ä` cannot name a field"),
        ("int8 a=1", "`a` cannot name a constant: capitals"),
        ("int8 A__B=1", "`A__B` cannot name a constant"),
        ("int7 a", "`int7` is no type"),
        ("float a", "`float` is no type"),
        ("a/b/C a", "`a/b/C` is no type"),
        ("Foo_Bar a", "`Foo_Bar` is no type"),
        ("int8] a", "`int8]` is no type"),
        ("int8[][] a", "`int8[]` is no type"),
        ("int8[0] a", "size or bound `0` must be a whole number from 1 to 4294967295"),
        ("int8[-1] a", "size or bound `-1`"),
        ("int8[<=4294967296] a", "size or bound `4294967296`"),
        ("string<= a", "size or bound ``"),
        ("int8<=3 a", "`int8<=3` is no type"),
        ("int8 a 128", "`128` is no value for int8: expected a whole number from -128 to 127"),
        ("uint8 a -1", "`-1` is no value for uint8"),
        ("uint8 a 0x-1", "`0x-1` is no value for uint8"),
        ("uint8 a 1.0", "`1.0` is no value for uint8"),
        ("int64 a 99999999999999999999999999999999999999999", "is no value for int64"),
        ("bool a yes", "`yes` is no value for bool: expected true, false, 1 or 0"),
        ("float32 a 1e39", "`1e39` is no value for float32: expected a finite number"),
        ("float64 a nan", "`nan` is no value for float64"),
        ("string a \"open", "the quotes do not match"),
        ("string a \"in\"side\"", "the quotes do not match"),
        ("string a \"", "the quotes do not match"),
        ("string<=2 a abc", "expected at most 2 bytes, found 3"),
        ("int8[2] a [1]", "expected 2 to 2 elements, found 1"),
        ("int8[<=2] a [1,2,3]", "expected 0 to 2 elements, found 3"),
        ("int8[] a 1", "expected `[`, elements with commas between them, `]`"),
        ("int8[] a [1,]", "`[1,]` is no value for int8[]"),
        ("Point a 1", "a field of type `Point` cannot have a default value"),
        ("Point A=1", "a constant cannot have the type `Point`"),
        ("int8[] A=[1]", "a constant cannot have the type `int8[]`"),
        ("int8 A=", "`` is no value for int8"),
        ("int8 first", "`first` is defined twice"),
        ("Missing a", "type demo_msgs/msg/Missing is not defined"),
        ("other_msgs/Point a", "type other_msgs/msg/Point is not defined"),
        ("Spot[] a", "demo_msgs/msg/Spot contains itself"),
    ];
    for (line, problem) in cases {
        let found = error(&format!("# A comment.\nint8 first\n{line}\n"));
        assert!(found.starts_with("msg/Spot.msg:3: "), "{line}: {found}");
        assert!(found.contains(problem), "{line}: {found}");
    }
}

#[test]
fn names_of_files_are_checked() {
    let found = Catalogue::new(&[source(PackageFolder::Msg, "spot", "")]).expect_err("a small letter");
    assert_eq!(found.to_string(), "msg/spot.msg:1: `spot` cannot name a message: letters and digits, a capital first");
    let twice = [source(PackageFolder::Msg, "Spot", ""), source(PackageFolder::Msg, "Spot", "")];
    let found = Catalogue::new(&twice).expect_err("two of one name");
    assert!(found.to_string().contains("`demo_msgs/msg/Spot` is defined twice"));
}

#[test]
fn types_must_not_contain_each_other() {
    let sources = [source(PackageFolder::Msg, "A", "int8 x\nB b"), source(PackageFolder::Msg, "B", "A[] a")];
    let found = Catalogue::new(&sources).expect_err("a circle");
    assert_eq!(found.to_string(), "msg/A.msg:2: demo_msgs/msg/A contains itself");
}

#[test]
fn services_and_actions_need_their_sections() {
    let cases = [
        (PackageFolder::Srv, "int8 a\n", 0, 1),
        (PackageFolder::Srv, "---\n---\n", 2, 1),
        (PackageFolder::Action, "---\n", 1, 2),
        (PackageFolder::Action, "---\n---\n---\n", 3, 2),
    ];
    for (namespace, text, found, expected) in cases {
        let error = Catalogue::new(&[source(namespace, "Do", text)]).expect_err(text);
        let expected = format!(":1: found {found} lines `---`, expected {expected}");
        assert!(error.to_string().ends_with(&expected), "{error}");
    }
}

#[test]
fn lines_are_counted_through_sections() {
    let found = Catalogue::new(&[source(PackageFolder::Srv, "Do", "int8 a\n---\n\nint8 B\n")]).expect_err("a bad name");
    assert!(found.to_string().starts_with("srv/Do.srv:4: "), "{found}");
}

#[test]
fn wide_strings_have_no_rust_type() {
    let catalogue = Catalogue::new(&[source(PackageFolder::Msg, "Spot", "\nwstring text\n")]).expect("a wide string");
    let found = emit(&catalogue, "demo_msgs").expect_err("a wide string");
    assert!(found.to_string().starts_with("msg/Spot.msg:2: `wstring` has no wire form"), "{found}");
}

#[test]
fn folders_are_read_in_order_and_strangers_refused() {
    let root = Path::new(env!("CARGO_TARGET_TMPDIR")).join("demo_msgs");
    let folder = root.join("msg");
    fs::create_dir_all(&folder).expect("a folder");
    for name in ["B.msg", "A.msg"] {
        fs::write(folder.join(name), "int8 a\n").expect("a file");
    }
    let stranger = folder.join("notes.txt");
    let _ = fs::remove_file(&stranger);
    let sources = DefinitionFile::read_package("demo_msgs", &root).expect("two definitions");
    let names: Vec<_> = sources.iter().map(|source| source.name.as_str()).collect();
    assert_eq!(names, ["A", "B"]);

    fs::write(&stranger, "").expect("a file");
    let found = DefinitionFile::read_package("demo_msgs", &root).expect_err("a stranger");
    assert!(found.to_string().ends_with("notes.txt: only .msg files belong here"), "{found}");

    let found = DefinitionFile::read_packages(&root.join("absent")).expect_err("no folder");
    assert!(found.to_string().contains("absent: "), "{found}");
}
