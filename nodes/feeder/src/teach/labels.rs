//! How somebody sorted what lies in pictures: a table of clicks, as text with commas between.
//!
//! The columns are `picture,x_px,y_px,label`. A label is the name of a pose, `other` for the part in a pose that is not asked
//! about, or `foreign` for what is no such part; without one the thing is not sorted yet, and counts as unknown. A column
//! `number` may stand before them, by which a contact sheet shows the thing.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use serde::{Deserialize, Serialize};

/// The label of the part in another pose than those that have a name.
pub(crate) const OTHER: &str = "other";
/// The label of what is no part.
pub(crate) const FOREIGN: &str = "foreign";

/// What somebody says that a thing is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Label {
    /// The part in this pose.
    Pose(usize),
    /// The part in another pose.
    Other,
    /// No part, or not this one.
    Foreign,
}

/// A thing in a picture that somebody has sorted.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Click {
    /// Line of the table, counted from 1 with the heading.
    pub(crate) line: u64,
    /// Which of the pictures.
    pub(crate) picture: usize,
    /// Where in the picture, px; the middle of the first pixel is (0, 0).
    pub(crate) x_px: f64,
    pub(crate) y_px: f64,
    pub(crate) label: Label,
}

/// A line of the table.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Row {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) number: Option<u32>,
    pub(crate) picture: String,
    pub(crate) x_px: f64,
    pub(crate) y_px: f64,
    pub(crate) label: String,
}

/// Reads a table of clicks in `pictures` of a part with these poses.
pub(crate) fn read(file: &Path, pictures: &[PathBuf], poses: &[String]) -> anyhow::Result<Vec<Click>> {
    let text = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    parse(&text, pictures, poses).with_context(|| file.display().to_string())
}

fn parse(text: &[u8], pictures: &[PathBuf], poses: &[String]) -> anyhow::Result<Vec<Click>> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text);
    let mut clicks = Vec::new();
    let headers = reader.headers()?.clone();
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record)? {
        let line = record.position().map_or(0, |position| line_of(text, position));
        let row: Row = record.deserialize(Some(&headers)).with_context(|| format!("line {line}"))?;
        if !row.label.is_empty() {
            clicks.push(click(line, &row, pictures, poses).with_context(|| format!("line {line}"))?);
        }
    }
    ensure!(!clicks.is_empty(), "nothing is labelled; allowed labels: {}", allowed(poses));
    Ok(clicks)
}

/// Reads any bytes as a table of clicks; for fuzzers.
pub fn fuzz(input: &[u8]) {
    let _ = parse(input, &["a.png", "b/c.jpg"].map(PathBuf::from), &["flat".to_owned()]);
}

/// The line of the record that was read from here on: what is skipped before it counts too.
fn line_of(text: &[u8], position: &csv::Position) -> u64 {
    let rest = usize::try_from(position.byte()).ok().and_then(|byte| text.get(byte..)).unwrap_or_default();
    let lines = rest.split(|byte| *byte == b'\n');
    let skipped = lines.take_while(|line| matches!(*line, b"" | b"\r") || line.starts_with(b"#")).count();
    position.line() + skipped as u64
}

fn click(line: u64, row: &Row, pictures: &[PathBuf], poses: &[String]) -> anyhow::Result<Click> {
    let Row { picture, x_px, y_px, label, .. } = row;
    let label = match label.as_str() {
        OTHER => Label::Other,
        FOREIGN => Label::Foreign,
        name => match poses.iter().position(|pose| pose == name) {
            Some(pose) => Label::Pose(pose),
            None => bail!("label {name:?}; allowed: {}", allowed(poses)),
        },
    };
    let index = pictures.iter().position(|path| path.ends_with(picture));
    let index = index.with_context(|| format!("picture {picture:?} is none of the {} pictures", pictures.len()))?;
    Ok(Click { line, picture: index, x_px: *x_px, y_px: *y_px, label })
}

impl Click {
    /// Refuses a click outside of its picture, of this width and height, px.
    pub(crate) fn require_inside(&self, (width, height): (u32, u32)) -> anyhow::Result<()> {
        for (key, value, size) in [("x_px", self.x_px, width), ("y_px", self.y_px, height)] {
            let inside = value >= -0.5 && value <= f64::from(size) - 0.5;
            ensure!(inside, "line {}: {key} = {value} lies outside the picture of {width}x{height} px", self.line);
        }
        Ok(())
    }
}

fn allowed(poses: &[String]) -> String {
    format!("{}, {OTHER}, {FOREIGN}", poses.join(", "))
}

/// Writes a table.
pub(crate) fn write(file: &Path, rows: &[Row]) -> anyhow::Result<()> {
    let written = || -> Result<(), csv::Error> {
        let mut writer = csv::Writer::from_path(file)?;
        rows.iter().try_for_each(|row| writer.serialize(row))?;
        Ok(writer.flush()?)
    };
    written().with_context(|| format!("cannot write {}", file.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> anyhow::Result<Vec<Click>> {
        let pictures = ["day/a.jpg", "day/b.png"].map(PathBuf::from);
        parse(text.as_bytes(), &pictures, &["heads".to_owned(), "tails".to_owned()])
    }

    #[test]
    fn clicks_are_read_whatever_the_order_of_the_columns() {
        let clicks =
            read("label,picture,y_px,x_px\nheads,a.jpg,2.5,1\n\n# later\nother, b.png ,4,3\nforeign,a.jpg,0,0\n");
        let clicks = clicks.unwrap();
        let click = |line, picture, x_px, y_px, label| Click { line, picture, x_px, y_px, label };
        let expected = [
            click(2, 0, 1.0, 2.5, Label::Pose(0)),
            click(5, 1, 3.0, 4.0, Label::Other),
            click(6, 0, 0.0, 0.0, Label::Foreign),
        ];
        assert_eq!(clicks, expected);
    }

    #[test]
    fn what_is_not_sorted_is_left_out() {
        let clicks = read("number,picture,x_px,y_px,label\n7,a.jpg,1,2,\n8,a.jpg,3,4,tails\n").unwrap();
        assert_eq!(clicks.iter().map(|click| (click.x_px, click.label)).collect::<Vec<_>>(), [(3.0, Label::Pose(1))]);
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_its_line() {
        for (text, says) in [
            ("", "nothing is labelled; allowed labels: heads, tails, other, foreign"),
            ("picture,x_px,y_px,label\na.jpg,1,2,\n", "nothing is labelled"),
            ("picture,x_px,y_px\na.jpg,1,2\n", "missing field `label`"),
            ("picture,x_px,y_px,label,colour\na.jpg,1,2,heads,red\n", "unknown field `colour`"),
            (
                "picture,x_px,y_px,label\na.jpg,1,2,heads\na.jpg,1,2,head\n",
                "line 3: label \"head\"; allowed: heads, tails",
            ),
            ("picture,x_px,y_px,label\nc.jpg,1,2,heads\n", "line 2: picture \"c.jpg\" is none of the 2 pictures"),
            ("picture,x_px,y_px,label\na.jpg,1,two,heads\n", "line 2"),
            ("picture,x_px,y_px,label\na.jpg,1,heads\n", "3 fields"),
        ] {
            let refused = format!("{:#}", read(text).unwrap_err());
            assert!(refused.contains(says), "{text:?} says {refused:?}, not {says:?}");
        }
    }

    #[test]
    fn a_click_outside_of_its_picture_is_refused() {
        let refused = |x_px: &str, y_px: &str| {
            let click = read(&format!("picture,x_px,y_px,label\na.jpg,{x_px},{y_px},heads\n")).unwrap().remove(0);
            click.require_inside((640, 480)).err().map(|error| error.to_string())
        };
        assert_eq!((refused("-0.5", "0"), refused("639.5", "479.5")), (None, None));
        let outside = "lies outside the picture of 640x480 px";
        assert_eq!(refused("640", "2"), Some(format!("line 2: x_px = 640 {outside}")));
        assert_eq!(refused("6", "-1"), Some(format!("line 2: y_px = -1 {outside}")));
        assert_eq!(refused("NaN", "2"), Some(format!("line 2: x_px = NaN {outside}")));
    }

    #[test]
    fn what_is_written_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("labels.csv");
        let row = Row { number: Some(3), picture: "a.jpg".to_owned(), x_px: 1.5, y_px: 2.0, label: "tails".to_owned() };
        write(&file, &[row]).unwrap();
        let text = std::fs::read_to_string(&file).unwrap();
        assert_eq!(text, "number,picture,x_px,y_px,label\n3,a.jpg,1.5,2.0,tails\n");
        assert_eq!(read(&text).unwrap().len(), 1);
    }
}
