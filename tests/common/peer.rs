//! Peers of other DDS implementations that relay raw CDR: whatever a test wants sent, in their wire form of services.

use std::collections::VecDeque;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use feeder_runtime::cdr;
use minifactory_msgs::{Message, Service};

use super::{fast_relay, python};

/// Longest wait for anything that a peer says. It only keeps a failing test from hanging.
const PATIENCE: Duration = Duration::from_secs(60);
/// Plain CDR, little endian.
pub(crate) const ENCAPSULATION: &str = "00010000";

/// Which implementation a peer stands on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// PyPI's Cyclone DDS; requests and replies as rmw_cyclonedds makes them.
    Cyclone,
    /// Debian's Fast DDS; requests and replies as rmw_fastrtps makes them.
    Fast,
}

impl Kind {
    pub(crate) const BOTH: [Self; 2] = [Self::Cyclone, Self::Fast];
}

/// Something a peer has received.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Received {
    /// Encapsulation header and body, in hexadecimal digits.
    pub(crate) hex: String,
}

impl Received {
    #[track_caller]
    pub(crate) fn decode<M: Message>(&self) -> M {
        let body = self.hex.strip_prefix(ENCAPSULATION).unwrap_or_else(|| panic!("no plain CDR: {self:?}"));
        cdr::decode(&bytes(body), true).unwrap_or_else(|error| panic!("{self:?}: {error}"))
    }
}

/// A message as encapsulation header and body, in hexadecimal digits.
pub(crate) fn hex<M: Message>(message: &M) -> String {
    let body = cdr::encode(message).unwrap();
    body.iter().fold(ENCAPSULATION.to_owned(), |text, byte| format!("{text}{byte:02x}"))
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn cyclone_relay() -> Command {
    let mut command = Command::new(python());
    command.arg(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("tests/interop/relay.py"));
    command
}

/// A running peer.
pub(crate) struct Peer {
    child: Child,
    input: ChildStdin,
    lines: Receiver<String>,
    /// Read from it, but not yet asked for.
    waiting: VecDeque<String>,
}

impl Peer {
    pub(crate) fn start(kind: Kind, domain: u16) -> Self {
        match kind {
            Kind::Cyclone => Self::run(cyclone_relay().env_remove("CYCLONEDDS_URI"), domain),
            Kind::Fast => Self::run(&mut Command::new(fast_relay()), domain),
        }
    }

    /// A peer on Cyclone DDS that others forget when they have not heard of it for so long, instead of 10 s.
    pub(crate) fn with_lease(lease_s: u32, domain: u16) -> Self {
        let settings = format!("<Discovery><LeaseDuration>{lease_s}s</LeaseDuration></Discovery>");
        Self::run(cyclone_relay().env("CYCLONEDDS_URI", settings), domain)
    }

    fn run(command: &mut Command, domain: u16) -> Self {
        let mut child = command.arg(domain.to_string()).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Self { child, input, lines, waiting: VecDeque::new() }
    }

    /// Tells the peer something in its own words; see `tests/interop/relay.py`.
    pub(crate) fn tell(&mut self, line: &str) {
        writeln!(self.input, "{line}").unwrap();
    }

    /// Opens a client of a service under a name of the test's choice, and waits until both ends have found each other.
    pub(crate) fn client<S: Service>(&mut self, name: &str, service: &str) {
        let (request, response) = (S::Request::INFO.dds_type(), S::Response::INFO.dds_type());
        self.tell(&format!("client {name} rq{service}Request {request} rr{service}Reply {response}"));
        self.wait_until_matched(name);
    }

    pub(crate) fn call<M: Message>(&mut self, name: &str, number: u32, request: &M) {
        self.tell(&format!("call {name} {number} {}", hex(request)));
    }

    /// Waits for the reply to a request.
    #[track_caller]
    pub(crate) fn reply(&mut self, name: &str, number: u32) -> Received {
        let what = format!("reply {name} {number} ");
        let line = self.line(&what, |line| line.starts_with(&what));
        Received { hex: line[what.len()..].to_owned() }
    }

    /// Waits for the next sample of a topic.
    #[track_caller]
    pub(crate) fn sample(&mut self, name: &str) -> Received {
        let what = format!("sample {name} ");
        let line = self.line(&what, |line| line.starts_with(&what));
        Received { hex: line[what.len()..].to_owned() }
    }

    /// Whether the peer has been sent a reply to a request that it has not made, up to now.
    pub(crate) fn has_stray_replies(&mut self) -> bool {
        self.waiting.extend(self.lines.try_iter());
        self.waiting.iter().any(|line| line.starts_with("stray"))
    }

    /// Ends the peer as a crash would: nobody is told.
    pub(crate) fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    #[track_caller]
    pub(crate) fn wait_until_matched(&mut self, name: &str) {
        let what = format!("matched {name}");
        self.line(&what, |line| line == what);
    }

    /// Takes the next line that is wanted.
    #[track_caller]
    fn line(&mut self, what: &str, wanted: impl Fn(&str) -> bool) -> String {
        let give_up = Instant::now() + PATIENCE;
        loop {
            if let Some(at) = self.waiting.iter().position(|line| wanted(line)) {
                return self.waiting.remove(at).unwrap();
            }
            match self.lines.recv_timeout(give_up.saturating_duration_since(Instant::now())) {
                Ok(line) => self.waiting.push_back(line),
                Err(error) => panic!("waited in vain for {what:?}: {error}; it has said {:?}", self.waiting),
            }
        }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // It has ended already where a test has killed it.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
