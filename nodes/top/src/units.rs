//! Numbers as people read them, with units.

use serde_json::Value;

/// What is not known.
pub(crate) const UNKNOWN: &str = "–";

/// A number with three significant digits and a prefix for its unit.
pub(crate) fn si(value: &Value, unit: &str) -> String {
    let Some(number) = value.as_f64() else { return UNKNOWN.to_owned() };
    let size = number.abs();
    let (factor, prefix) = match size {
        0.0 => (1.0, ""),
        _ if size < 1e-3 => (1e6, "µ"),
        _ if size < 1.0 => (1e3, "m"),
        _ => (1.0, ""),
    };
    let scaled = number * factor;
    let digits = match scaled.abs() {
        _ if number == 0.0 => 0,
        size if size < 10.0 => 2,
        size if size < 100.0 => 1,
        _ => 0,
    };
    format!("{scaled:.digits$} {prefix}{unit}")
}

/// A number with this many decimals and a unit.
pub(crate) fn fixed(value: &Value, decimals: usize, unit: &str) -> String {
    value.as_f64().map_or_else(|| UNKNOWN.to_owned(), |number| format!("{number:.decimals$}{unit}"))
}

/// A whole number.
pub(crate) fn count(value: &Value) -> String {
    value.as_u64().map_or_else(|| UNKNOWN.to_owned(), |number| number.to_string())
}

/// A share in percent.
pub(crate) fn percent(value: &Value) -> String {
    value.as_f64().map_or_else(|| UNKNOWN.to_owned(), |share| format!("{:.0} %", 100.0 * share))
}

/// A text; nothing where there is none.
pub(crate) fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

/// A word of the messages as people write it.
pub(crate) fn words(value: &Value) -> String {
    text(value).replace('_', " ")
}

/// A text in lines of at most so many characters, broken between words; a longer word is left as it is.
pub(crate) fn folded(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_carry_units_and_what_is_not_known_says_so() {
        for (value, shown) in [
            (json!(1.234e-5), "12.3 µm"),
            (json!(-0.0123), "-12.3 mm"),
            (json!(0.000_999), "999 µm"),
            (json!(2.5), "2.50 m"),
            (json!(0.0), "0 m"),
            (json!(null), "–"),
            (json!("much"), "–"),
        ] {
            assert_eq!(si(&value, "m"), shown);
        }
        assert_eq!((count(&json!(7)), count(&json!(null))), ("7".to_owned(), "–".to_owned()));
        assert_eq!(
            (percent(&json!(0.456)), fixed(&json!(1.26), 1, " /min")),
            ("46 %".to_owned(), "1.3 /min".to_owned())
        );
    }

    #[test]
    fn long_texts_are_folded_between_words() {
        assert_eq!(folded("the tray is another", 11), ["the tray is", "another"]);
        assert_eq!(folded("extraordinarily long", 4), ["extraordinarily", "long"]);
        assert_eq!(folded("", 10), [""; 0]);
    }
}
