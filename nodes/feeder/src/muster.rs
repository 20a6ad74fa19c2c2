//! A run over several hosts: what `feeder up` and `feeder join` say to each other, and the side of `feeder up`.
//!
//! `feeder up` says which nodes it leaves to others. Each `feeder join` offers some, again and again, until the run
//! begins; then it gets the plan and the loop's contract with its share, starts that, and says how it ended. Both are
//! words in JSON on two topics that `ros2 topic list` does not show.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail, ensure};
use feeder_runtime::cdr;
use feeder_runtime::dds::{Domain, NodeName, Participant, Qos, Reader, Writer};
use feeder_runtime::lockstep::LoopContract;
use feeder_runtime::patience::{Patience, share_of_machine};
use feeder_scenario::plan::{PlannedNode, RunPlan};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::crew::Leave;
use crate::table::{name_of, placed};

const RUN: &str = "/_feeder/run";
const CREW: &str = "/_feeder/crew";
const STRING: &str = "std_msgs::msg::dds_::String_";
/// Between reminders of who is waited for.
const REMINDER: Duration = Duration::from_secs(5);
/// How long an offer holds: it is made again more often.
const OFFER_HOLDS: Duration = Duration::from_secs(5);
/// How long a crew has to say how it ended.
const LAST_WORD_LIMIT: Duration = Duration::from_secs(10);
/// What programs that understand each other are.
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What `feeder up` says. The newest counts.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Call {
    /// It leaves these nodes to others.
    Wanted { version: String, nodes: BTreeSet<String> },
    /// The run begins: each crew starts its nodes.
    Go { crews: BTreeMap<u64, BTreeSet<String>>, plan: String, contract: Box<LoopContract>, digests: bool },
}

/// What `feeder join` says.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Word {
    /// It would start these nodes; all that are wanted, if it names none.
    Offer { crew: u64, host: String, version: String, nodes: BTreeSet<String> },
    /// A part of a digest that a node has left, in order.
    Digest { crew: u64, run_id: u64, file: String, text: String },
    /// Its nodes have left.
    Done { crew: u64, run_id: u64, error: Option<String> },
}

/// One side's ends of both topics.
pub(crate) struct Line {
    writer: Writer,
    _reader: Reader,
    participant: Participant,
}

impl Line {
    fn open<T: DeserializeOwned + Send + 'static>(
        domain: &Domain,
        node: &str,
        [says, hears]: [(&'static str, Qos); 2],
    ) -> anyhow::Result<(Self, Receiver<T>)> {
        let (sender, heard) = channel();
        let participant = Participant::secluded(domain, &NodeName::new("/", node)?)?;
        let reader = participant.reader(hears.0, STRING, &hears.1, move |sample| {
            let text: Result<String, _> = sample.decode();
            let said = text.map_err(|error| error.to_string());
            match said.and_then(|text| serde_json::from_str(&text).map_err(|error| error.to_string())) {
                // Nobody listens any more at the end of the command.
                Ok(word) => drop(sender.send(word)),
                Err(error) => tracing::warn!(writer = %sample.writer_guid, "not understood on {}: {error}", hears.0),
            }
        })?;
        let writer = participant.writer(says.0, STRING, &says.1)?;
        participant.meet_others();
        Ok((Self { writer, _reader: reader, participant }, heard))
    }

    /// The side of `feeder join`.
    pub(crate) fn of_crew(domain: &Domain) -> anyhow::Result<(Self, Receiver<Call>)> {
        Self::open(domain, "feeder_join", [(CREW, Qos::loop_edge()), (RUN, Qos::latched())])
    }

    pub(crate) fn say(&self, word: &impl Serialize) -> anyhow::Result<()> {
        Ok(self.writer.publish(cdr::encode(&serde_json::to_string(word)?)?)?)
    }

    /// Waits until everybody has what was said.
    pub(crate) fn is_heard(&self, patience: Duration) -> bool {
        self.writer.wait_acknowledged(patience)
    }

    /// Whether a `feeder up` that looks for others is there.
    pub(crate) fn has_caller(&self) -> bool {
        self.participant.discovered().writers_of(RUN).next().is_some()
    }
}

/// A crew on another host.
struct Crew {
    host: String,
    nodes: BTreeSet<String>,
    offered_at: Instant,
    /// How it ended, when it has.
    done: Option<Option<String>>,
}

/// The crews of other hosts, as `feeder up` sees them.
pub(crate) struct Muster {
    line: Line,
    words: Receiver<Word>,
    wanted: BTreeSet<String>,
    crews: BTreeMap<u64, Crew>,
    run_id: u64,
    digests: BTreeMap<String, String>,
}

impl Muster {
    /// Says which nodes of the plan are left to others.
    pub(crate) fn call(domain: &Domain, plan: &RunPlan, except: &[String]) -> anyhow::Result<Self> {
        let wanted = named(plan, except).context("--except")?;
        let (line, words) = Line::open(domain, "feeder_muster", [(RUN, Qos::latched()), (CREW, Qos::loop_edge())])?;
        line.say(&Call::Wanted { version: VERSION.to_owned(), nodes: wanted.clone() })?;
        Ok(Self { line, words, wanted, crews: BTreeMap::new(), run_id: 0, digests: BTreeMap::new() })
    }

    /// Whether a node is left to others.
    pub(crate) fn has(&self, node: &str) -> bool {
        self.wanted.contains(node)
    }

    /// Waits until every node is offered, and says whom it waits for.
    pub(crate) fn wait(&mut self, stop: &AtomicBool) -> anyhow::Result<()> {
        let mut reminded: Option<Instant> = None;
        loop {
            // Who has gone again offers nothing.
            self.crews.retain(|_, crew| crew.offered_at.elapsed() < OFFER_HOLDS);
            let missing = self.missing();
            if missing.is_empty() {
                return Ok(());
            }
            ensure!(!stop.load(Ordering::Relaxed), "stopped while waiting for {}", list(&missing));
            if reminded.is_none_or(|last| last.elapsed() >= REMINDER) {
                reminded = Some(Instant::now());
                tracing::info!("waiting for {}; on another host: feeder join {}", list(&missing), words(&missing));
            }
            match self.words.recv_timeout(Duration::from_millis(100)) {
                Ok(word) => self.hear(word),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => bail!("the DDS library has stopped"),
            }
        }
    }

    fn missing(&self) -> BTreeSet<String> {
        let offered: BTreeSet<&String> = self.crews.values().flat_map(|crew| &crew.nodes).collect();
        self.wanted.iter().filter(|node| !offered.contains(node)).cloned().collect()
    }

    fn hear(&mut self, word: Word) {
        match word {
            Word::Offer { crew, host, version, nodes } => self.consider(crew, host, &version, &nodes),
            Word::Digest { crew, run_id, file, text } if run_id == self.run_id && self.crews.contains_key(&crew) => {
                self.digests.entry(file).or_default().push_str(&text);
            }
            Word::Done { crew, run_id, error } if run_id == self.run_id => {
                if let Some(crew) = self.crews.get_mut(&crew) {
                    crew.done = Some(error);
                }
            }
            // Of a run that was.
            Word::Digest { .. } | Word::Done { .. } => {}
        }
    }

    fn consider(&mut self, crew: u64, host: String, version: &str, nodes: &BTreeSet<String>) {
        if let Some(known) = self.crews.get_mut(&crew) {
            known.offered_at = Instant::now();
            return;
        }
        if version != VERSION {
            tracing::warn!("{host} runs version {version}, this is {VERSION}: its offer is left out");
            return;
        }
        let missing = self.missing();
        let nodes: BTreeSet<String> = if nodes.is_empty() { missing } else { nodes & &missing };
        if !nodes.is_empty() {
            tracing::info!("{host} offers {}", list(&nodes));
            self.crews.insert(crew, Crew { host, nodes, offered_at: Instant::now(), done: None });
        }
    }

    /// Begins a run.
    pub(crate) fn go(&mut self, plan: &RunPlan, contract: &LoopContract, digests: bool) -> anyhow::Result<()> {
        self.run_id = contract.run_id;
        self.digests.clear();
        self.crews.values_mut().for_each(|crew| crew.done = None);
        let crews = self.crews.iter().map(|(id, crew)| (*id, crew.nodes.clone())).collect();
        self.line.say(&Call::Go { crews, plan: plan.to_yaml()?, contract: Box::new(contract.clone()), digests })
    }

    /// Finds crews whose nodes have left although the run goes on.
    pub(crate) fn check(&mut self) -> Result<(), String> {
        while let Ok(word) = self.words.try_recv() {
            self.hear(word);
        }
        let ended = |crew: &Crew| Some(format!("{}: {}", crew.host, crew.done.clone()??));
        self.crews.values().find_map(ended).map_or(Ok(()), Err)
    }

    /// Waits until the crews have said how it ended, and puts the digests of their nodes into `digests`.
    pub(crate) fn collect(&mut self, digests: &Path, leave: Leave) -> anyhow::Result<()> {
        let (since, mut patience) = (Instant::now(), Patience::default());
        let limit = if matches!(leave, Leave::InOrder) { LAST_WORD_LIMIT } else { Duration::from_secs(1) };
        while self.crews.values().any(|crew| crew.done.is_none())
            && patience.spent(since.elapsed(), share_of_machine) < limit
        {
            if let Ok(word) = self.words.recv_timeout(Duration::from_millis(50)) {
                self.hear(word);
            }
        }
        for (file, text) in &self.digests {
            // Only a name, whatever was sent.
            let name = Path::new(file).file_name().with_context(|| format!("{file:?} is no name of a digest"))?;
            std::fs::write(digests.join(name), text)?;
        }
        let fate = |crew: &Crew| match &crew.done {
            None => Some(format!("{} has not said how {} ended", crew.host, list(&crew.nodes))),
            Some(error) => error.as_ref().map(|error| format!("{}: {error}", crew.host)),
        };
        let failed: Vec<String> = self.crews.values().filter_map(fate).collect();
        if failed.is_empty() { Ok(()) } else { bail!(failed.join("; ")) }
    }
}

/// The nodes of a plan that are named by kind, namespace or full name.
pub(crate) fn named(plan: &RunPlan, names: &[String]) -> anyhow::Result<BTreeSet<String>> {
    let mut found = BTreeSet::new();
    for name in names {
        let is_meant = |planned: &PlannedNode| {
            [planned.node.kind(), &planned.namespace, &name_of(planned)].contains(&name.as_str())
        };
        let meant: Vec<String> =
            placed(plan).map(|(_, planned)| planned).filter(|p| is_meant(p)).map(name_of).collect();
        let all = || list(&placed(plan).map(|(_, planned)| name_of(planned)).collect());
        ensure!(!meant.is_empty(), "{name}: no such node in this run; there are {}", all());
        found.extend(meant);
    }
    Ok(found)
}

/// Names, for people.
pub(crate) fn list(names: &BTreeSet<String>) -> String {
    names.iter().map(String::as_str).collect::<Vec<_>>().join(", ")
}

/// Names, to be typed.
fn words(names: &BTreeSet<String>) -> String {
    names.iter().map(String::as_str).collect::<Vec<_>>().join(" ")
}
