//! What is shown: the newest messages of the view, and the lines that would otherwise go to the terminal.

use std::collections::VecDeque;

use feeder_view::Sight;
use serde_json::Value;

use crate::units::text;

/// Most events and lines that are kept.
const KEPT: usize = 500;

/// What is shown.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    pub(crate) hello: Value,
    pub(crate) frame: Value,
    pub(crate) status: Value,
    pub(crate) motion: Value,
    /// Oldest first.
    pub(crate) events: VecDeque<Value>,
    /// What nodes and this process have logged, oldest first.
    pub(crate) lines: VecDeque<String>,
    /// Where the page is, or how to get one.
    pub(crate) note: String,
    pub(crate) focus: usize,
}

impl Picture {
    /// Nothing yet. `note` is shown at the bottom.
    #[must_use]
    pub fn new(note: &str) -> Self {
        Self { note: note.to_owned(), ..Self::default() }
    }

    /// Takes in what is seen now.
    pub fn take(&mut self, sight: Sight) {
        let Sight { hello, frame, status, motion, events } = sight;
        (self.hello, self.frame, self.status, self.motion) = (hello, frame, status, motion);
        for event in events {
            push(&mut self.events, event);
        }
    }

    /// Takes in a line of the log.
    pub fn line(&mut self, line: &str) {
        push(&mut self.lines, without_colours(line));
    }

    /// Says something at the bottom, in place of what stood there.
    pub(crate) fn say(&mut self, note: &str) {
        note.clone_into(&mut self.note);
    }

    /// Shows the next feeder, or the one before; returns its index.
    pub fn turn(&mut self, forwards: bool) -> usize {
        let feeders = self.names().count().max(1);
        self.focus = (self.focus + if forwards { 1 } else { feeders - 1 }) % feeders;
        self.focus
    }

    /// Names of all feeders.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.hello["feeders"].as_array().into_iter().flatten().map(|feeder| text(&feeder["name"]))
    }

    /// The name of the feeder that is shown.
    pub(crate) fn feeder(&self) -> &str {
        self.names().nth(self.focus).unwrap_or_default()
    }

    /// What the newest frame says of the feeder that is shown.
    pub(crate) fn now(&self) -> &Value {
        &self.frame["feeders"][self.feeder()]
    }

    /// How what runs is not what is shown, of the feeder that is shown or the first of which it is so.
    pub(crate) fn mismatch(&self) -> Option<&str> {
        let of = |feeder: &str| self.status["feeders"][feeder]["mismatch"].as_str();
        of(self.feeder()).or_else(|| self.names().find_map(of))
    }

    /// What the newest status says of the feeder that is shown.
    pub(crate) fn scores(&self) -> &Value {
        &self.status["feeders"][self.feeder()]
    }
}

fn push<T>(kept: &mut VecDeque<T>, new: T) {
    if kept.len() == KEPT {
        kept.pop_front();
    }
    kept.push_back(new);
}

/// A line without what would colour or move anything.
fn without_colours(line: &str) -> String {
    let mut plain = String::with_capacity(line.len());
    let mut rest = line.chars();
    while let Some(character) = rest.next() {
        match character {
            // A sequence of control ends with a letter.
            '\u{1b}' => _ = rest.by_ref().skip_while(|c| *c == '[').find(char::is_ascii_alphabetic),
            '\t' => plain.push(' '),
            character if character.is_control() => {}
            character => plain.push(character),
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_log_can_colour_and_move_nothing() {
        let mut picture = Picture::default();
        picture.line("\u{1b}[2m12:00\u{1b}[0m \u{1b}[31mERROR\u{1b}[0m a\tb\r\u{1b}[2Jc\u{7}");
        assert_eq!(picture.lines, ["12:00 ERROR a bc"]);
        for number in 0..2 * KEPT {
            picture.line(&number.to_string());
        }
        assert_eq!((picture.lines.len(), picture.lines[0].as_str()), (KEPT, "500"));
    }
}
