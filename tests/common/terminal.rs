//! A command in a pseudo-terminal, with somebody who reads and types.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdout, Command, Stdio};

use serde::Deserialize;
use serde_json::{Value, json};

use super::{PATIENCE, Process};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/terminal/terminal.py");

/// A terminal of 80 by 24 cells in which a command runs. Dropped, the command is killed.
pub(crate) struct Terminal {
    child: Child,
    output: BufReader<ChildStdout>,
}

/// How a terminal is.
#[derive(Debug, Deserialize)]
pub(crate) struct Look {
    /// All that was written on the first screen.
    pub(crate) first: String,
    pub(crate) is_other_screen: bool,
    pub(crate) has_cursor: bool,
    /// Something was coloured since the beginning.
    pub(crate) has_colours: bool,
    /// The command's process.
    id: u32,
    /// It treats what is typed as it did before the command.
    pub(crate) is_as_before: bool,
    /// The command's exit code, negative for a signal, if it has ended.
    #[serde(default)]
    pub(crate) status: Option<i32>,
}

impl Look {
    /// Nothing of what the command did to the terminal is left.
    #[track_caller]
    pub(crate) fn assert_given_back(&self) {
        assert!(!self.is_other_screen && self.has_cursor && self.is_as_before, "{self:?}");
    }
}

impl Terminal {
    /// Runs it, with the environment it states.
    pub(crate) fn start(command: &Command) -> Self {
        let mut script = Command::new("python3");
        script.arg(SCRIPT).arg(PATIENCE.as_secs().to_string()).arg(command.get_program()).args(command.get_args());
        script.env("TERM", "xterm-256color").env_remove("NO_COLOR");
        for (name, value) in command.get_envs() {
            match value {
                Some(value) => script.env(name, value),
                None => script.env_remove(name),
            };
        }
        let mut child = script.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        Self { child, output }
    }

    #[track_caller]
    fn order(&mut self, order: &Value) -> Value {
        writeln!(self.child.stdin.as_mut().unwrap(), "{order}").unwrap();
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        let mut answer: Value =
            serde_json::from_str(&line).unwrap_or_else(|error| panic!("{order}: {error}: {line:?}"));
        assert!(answer["error"].is_null(), "{}", answer["error"].as_str().unwrap());
        answer["value"].take()
    }

    /// Waits until a regular expression is seen, and returns its groups.
    #[track_caller]
    pub(crate) fn until(&mut self, pattern: &str) -> Vec<String> {
        serde_json::from_value(self.order(&json!({ "do": "until", "pattern": pattern }))).unwrap()
    }

    #[track_caller]
    pub(crate) fn keys(&mut self, keys: &str) {
        self.order(&json!({ "do": "keys", "keys": keys }));
    }

    #[track_caller]
    pub(crate) fn resize(&mut self, columns: u16, rows: u16) {
        self.order(&json!({ "do": "size", "columns": columns, "rows": rows }));
    }

    /// Sends a signal, by its name.
    #[track_caller]
    pub(crate) fn signal(&mut self, signal: &str) {
        self.order(&json!({ "do": "signal", "signal": signal }));
    }

    /// Waits for the command's end.
    #[track_caller]
    pub(crate) fn ended(&mut self) -> Look {
        serde_json::from_value(self.order(&json!({ "do": "ended" }))).unwrap()
    }

    /// The processes that the command has started.
    #[track_caller]
    pub(crate) fn nodes(&mut self) -> Vec<Process> {
        Process::new(self.look().id).children()
    }

    /// How it is now.
    #[track_caller]
    pub(crate) fn look(&mut self) -> Look {
        serde_json::from_value(self.order(&json!({ "do": "look" }))).unwrap()
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // Waiting closes its standard input, at whose end it ends the command and leaves.
        let _ = self.child.wait();
    }
}
