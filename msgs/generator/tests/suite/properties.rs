//! Whatever text comes in, the outcome is types or an error that names a line.

use crate::common::{parse, source, with_needed};
use proptest::prelude::*;
use ros2_msggen::{Catalogue, Error, PackageFolder, emit};

/// Text made of the language's own pieces, which gets further into the parser than any text does.
fn pieces() -> impl Strategy<Value = String> {
    let piece = prop_oneof![
        "(bool|byte|char|float64|int8|uint64|string|wstring|Point|a_b/C)",
        "[a-zA-Z_][a-z0-9_]{0,4}",
        "-?[0-9]{1,25}",
        Just("[".to_owned()),
        Just("]".to_owned()),
        Just("[<=".to_owned()),
        Just("<=".to_owned()),
        Just("=".to_owned()),
        Just(" ".to_owned()),
        Just("\t".to_owned()),
        Just("\n".to_owned()),
        Just("\r\n".to_owned()),
        Just("---\n".to_owned()),
        Just("# é".to_owned()),
        Just("'".to_owned()),
        Just("\\\"".to_owned()),
        Just("0x".to_owned()),
        Just(",".to_owned()),
    ];
    prop::collection::vec(piece, 0..40).prop_map(|pieces| pieces.concat())
}

fn check(text: &str) -> Result<(), TestCaseError> {
    for namespace in [PackageFolder::Msg, PackageFolder::Srv, PackageFolder::Action] {
        match Catalogue::new(&with_needed([source(namespace, "Spot", text)])) {
            Ok(catalogue) => {
                for structure in catalogue.structures() {
                    let hash = catalogue.type_hash(structure);
                    prop_assert_eq!(hash.len(), "RIHS01_".len() + 64);
                    prop_assert!(catalogue.schema(structure).starts_with(&structure.text));
                }
                // Wide strings have no Rust type, so both outcomes are right.
                let _ = emit(&catalogue, "demo_msgs");
            }
            Err(Error::Definition { line, .. }) => {
                prop_assert!((1..=text.lines().count().max(1)).contains(&line), "line {line}");
            }
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        }
    }
    Ok(())
}

/// A valid field or constant, with `@` for a number that makes its name unique.
fn valid_line() -> impl Strategy<Value = String> {
    let arity = prop_oneof![
        Just(String::new()),
        Just("[]".to_owned()),
        (1_u32..99).prop_map(|size| format!("[{size}]")),
        (1_u32..99).prop_map(|bound| format!("[<={bound}]")),
    ];
    prop_oneof![
        ("(bool|byte|char|float32|float64|u?int(8|16|32|64)|string|string<=7|Point)", arity)
            .prop_map(|(element, arity)| format!("{element}{arity} f@")),
        any::<i32>().prop_map(|value| format!("int32 f@ {value}")),
        any::<u64>().prop_map(|value| format!("uint64 C@={value}")),
        any::<f64>().prop_filter("finite", |value| value.is_finite()).prop_map(|value| format!("float64 f@ {value:?}")),
        "[a-z ]{0,5}[a-z]".prop_map(|value| format!("string C@={value}")),
    ]
}

proptest! {
    #[test]
    fn any_text_is_types_or_an_error(text in any::<String>()) {
        check(&text)?;
    }

    #[test]
    fn pieces_of_the_language_are_types_or_an_error(text in pieces()) {
        check(&text)?;
    }

    #[test]
    fn valid_lines_are_accepted_in_any_number(lines in prop::collection::vec(valid_line(), 0..20)) {
        let text: String = lines
            .iter()
            .enumerate()
            .map(|(index, line)| line.replace('@', &index.to_string()) + "\n")
            .collect();
        let spot = parse(&text).map_err(|error| TestCaseError::fail(format!("{error} in\n{text}")))?;
        let empty = usize::from(!lines.iter().any(|line| line.contains(" f@")));
        prop_assert_eq!(spot.body.fields.len() + spot.body.constants.len(), lines.len() + empty);
    }
}
