//! A figure: where it is found in what a command prints, and how far two of it may lie apart.

use anyhow::{Context as _, Result, anyhow};
use regex::RegexBuilder;
use serde::Deserialize;

/// Which match of several counts.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub(super) enum Take {
    #[default]
    First,
    Last,
    Min,
    Max,
}

/// How a figure is found.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Figure {
    /// A regular expression with one group; `^` and `$` match at lines.
    find: String,
    #[serde(default)]
    take: Take,
    /// Factor to the unit shown.
    times: Option<f64>,
    /// Decimals shown; as printed without.
    digits: Option<usize>,
    /// How far a later measurement may be off, in the unit shown.
    #[serde(default)]
    pub(super) within: f64,
}

impl Figure {
    /// The figure as the page shows it.
    pub(super) fn find(&self, text: &str) -> Result<String> {
        let pattern = RegexBuilder::new(&self.find).multi_line(true).build()?;
        let matches: Vec<&str> =
            pattern.captures_iter(text).filter_map(|found| found.get(1)).map(|group| group.as_str()).collect();
        let by_value = |a: &&&str, b: &&&str| number(a).total_cmp(&number(b));
        let taken = match self.take {
            Take::First => matches.first(),
            Take::Last => matches.last(),
            Take::Min => matches.iter().min_by(by_value),
            Take::Max => matches.iter().max_by(by_value),
        };
        let taken = taken.ok_or_else(|| anyhow!("nothing matches {}", self.find))?;
        if self.times.is_none() && self.digits.is_none() {
            return Ok((*taken).to_owned());
        }
        let value: f64 = taken.parse().with_context(|| format!("{taken} is no number"))?;
        let digits = self.digits.unwrap_or(3);
        Ok(format!("{:.digits$}", value * self.times.unwrap_or(1.0)))
    }
}

fn number(text: &str) -> f64 {
    text.parse().unwrap_or(f64::NAN)
}

/// What is wrong when `now` was measured where `last` stands on the page, if they are farther apart than `within`.
pub(super) fn difference(last: &str, now: &str, within: f64) -> Option<String> {
    let (a, b) = (number(last), number(now));
    // A last digit that was rounded is no difference.
    let same = if a.is_finite() && b.is_finite() { (a - b).abs() <= within * (1.0 + 1e-9) } else { last == now };
    (!same).then(|| format!("the page says {last}, now it is {now}; allowed is {within} to either side"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(find: &str, take: Take) -> Figure {
        Figure { find: find.to_owned(), take, times: None, digits: None, within: 0.0 }
    }

    #[test]
    fn a_figure_is_the_match_asked_for_in_the_unit_asked_for() {
        let text = "feed 3.25\nfeed 10.5\nfeed 1.0\n";
        for (take, expected) in [(Take::First, "3.25"), (Take::Last, "1.0"), (Take::Min, "1.0"), (Take::Max, "10.5")] {
            assert_eq!(figure("^feed ([0-9.]+)$", take).find(text).unwrap(), expected);
        }
        let scaled = Figure { times: Some(1e3), digits: Some(1), ..figure("^feed ([0-9.]+)", Take::First) };
        assert_eq!(scaled.find(text).unwrap(), "3250.0");
        assert!(figure("none ([0-9]+)", Take::First).find(text).is_err());
    }

    #[test]
    fn figures_differ_when_they_are_farther_apart_than_allowed() {
        assert_eq!(difference("12.25", "12.27", 0.02), None);
        assert!(difference("12.25", "12.28", 0.02).unwrap().contains("12.25"));
        assert_eq!(difference("3 of 4", "3 of 4", 0.0), None);
        assert!(difference("3 of 4", "4 of 4", 1.0).is_some());
        assert!(difference("nothing", "1", 5.0).is_some());
    }
}
