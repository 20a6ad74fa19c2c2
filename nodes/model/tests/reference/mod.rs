//! Reads the reference tables under tests/data.

/// One row of a table.
pub(crate) struct Row {
    header: csv::StringRecord,
    record: csv::StringRecord,
}

pub(crate) fn table(text: &'static str) -> impl Iterator<Item = Row> {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header = reader.headers().unwrap().clone();
    reader.into_records().map(move |record| Row { header: header.clone(), record: record.unwrap() })
}

impl Row {
    pub(crate) fn text(&self, column: &str) -> &str {
        let index = self.header.iter().position(|name| name == column).unwrap_or_else(|| panic!("no column {column}"));
        &self.record[index]
    }

    /// The number in a column; NaN where it is empty.
    pub(crate) fn number(&self, column: &str) -> f64 {
        match self.text(column) {
            "" => f64::NAN,
            text => text.parse().unwrap_or_else(|_| panic!("{column} = {text} is no number")),
        }
    }
}

/// Fails unless `value` is within `tolerance` of `expected`, or both are NaN.
#[track_caller]
pub(crate) fn assert_close(value: f64, expected: f64, tolerance: f64, what: &str) {
    let close = (value - expected).abs() <= tolerance || (value.is_nan() && expected.is_nan());
    assert!(close, "{what}: {value} instead of {expected}, off by {} (allowed {tolerance})", value - expected);
}
