//! A headless Chromium with a driver that takes commands, made by the first test that wants one.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

use serde_json::{Value, json};

use super::PATIENCE;
use super::install::apt_install;
use super::node::node_project;

const PACKAGE: &str = include_str!("../browser/package.json");
const LOCK: &str = include_str!("../browser/package-lock.json");
const DRIVER: &str = include_str!("../browser/driver.mjs");
/// Where Debian's package of Chromium puts it.
const CHROMIUM: &str = "/usr/bin/chromium";

/// A browser with a page. Dropped, it is closed.
pub(crate) struct Browser {
    child: Child,
    output: BufReader<ChildStdout>,
}

impl Browser {
    /// Starts it; on Debian and Ubuntu root installs what is missing, others are told what to install.
    pub(crate) fn start() -> Self {
        let mut command = Command::new("node");
        command.arg(driver()).arg(CHROMIUM).arg(PATIENCE.as_millis().to_string());
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        Self { child, output }
    }

    #[track_caller]
    fn command(&mut self, command: &Value) -> Value {
        writeln!(self.child.stdin.as_mut().unwrap(), "{command}").unwrap();
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        let mut answer: Value =
            serde_json::from_str(&line).unwrap_or_else(|error| panic!("{command}: {error}: {line:?}"));
        assert!(answer["error"].is_null(), "{}", answer["error"]);
        answer["value"].take()
    }

    /// Opens a page in place of the one before.
    #[track_caller]
    pub(crate) fn open(&mut self, url: &str) {
        self.command(&json!({ "do": "open", "url": url }));
    }

    /// Waits until an expression is true in the page, and returns its value.
    #[track_caller]
    pub(crate) fn until(&mut self, js: &str) -> Value {
        self.command(&json!({ "do": "until", "js": js }))
    }

    /// The value of an expression in the page.
    #[track_caller]
    pub(crate) fn value(&mut self, js: &str) -> Value {
        self.command(&json!({ "do": "eval", "js": js }))
    }

    #[track_caller]
    pub(crate) fn click(&mut self, selector: &str) {
        self.command(&json!({ "do": "click", "selector": selector }));
    }

    #[track_caller]
    pub(crate) fn press(&mut self, key: &str) {
        self.command(&json!({ "do": "press", "key": key }));
    }

    #[track_caller]
    pub(crate) fn resize(&mut self, width_px: u32, height_px: u32) {
        self.command(&json!({ "do": "resize", "width": width_px, "height": height_px }));
    }

    /// What the page has written on its console as warning or error, and what it has thrown.
    #[track_caller]
    pub(crate) fn complaints(&mut self) -> Value {
        self.command(&json!({ "do": "complaints" }))
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Waiting closes the driver's standard input, at whose end it closes Chromium and leaves.
        let _ = self.child.wait();
    }
}

/// The driver beside the packages it needs.
fn driver() -> PathBuf {
    let hint = "the tests of the page need Chromium (on Debian: apt install chromium)";
    apt_install(Path::new(CHROMIUM), &["chromium"], hint);
    node_project("browser", PACKAGE, LOCK, "driver.mjs", DRIVER)
}
