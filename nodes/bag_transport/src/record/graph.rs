//! The ROS graph: whatever is published, of types known or not.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use feeder_runtime::dds::{DdsError, Durability, Endpoint, Guid, Participant, Qos, Reader, Reliability, Sample};
use feeder_runtime::node::ns_of_stamp;
use minifactory_msgs::interface::standard::CLOCK;
use minifactory_msgs::rosgraph_msgs::msg::Clock;

use super::{described, with_header};
use ros2_bags::BagError;
use ros2_bags::BagWriter;
use ros2_bags::Selection;
use ros2_bags::qos::{self, History, QosProfile};
use ros2_bags::{Definitions, ros_type};

/// Between looks for new topics.
const DISCOVERY_PERIOD: Duration = Duration::from_millis(100);
/// Between calls that show how things stand.
const SHOW_PERIOD: Duration = Duration::from_millis(500);
/// Samples that may arrive while the thread that drains the reader is busy.
const READER_BACKLOG: u16 = 4096;
/// Bytes that may wait for the disk.
const WAITING_BYTES_MAX: usize = 256 << 20;

/// What is recorded, and how.
#[derive(Debug, Clone, Default)]
pub struct GraphSettings {
    /// The topics.
    pub selection: Selection,
    /// Times are those of `/clock`; nothing is recorded before the first of it.
    pub use_sim_time: bool,
    /// Only topics that are there at the start.
    pub no_discovery: bool,
}

/// How a topic is doing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicCount {
    /// Its name.
    pub topic: String,
    /// Messages recorded.
    pub recorded: u64,
    /// Messages that never arrived: gaps in the numbers that publishers give theirs.
    pub lost: u64,
    /// Messages that arrived and were dropped, as the disk was too slow.
    pub dropped: u64,
}

/// A recorder on the graph.
pub struct GraphRecorder {
    settings: GraphSettings,
    definitions: Definitions,
    writer: BagWriter,
    topics: BTreeMap<String, Recorded>,
    /// DDS types that could not be recorded, each said once.
    refused: BTreeSet<(String, String)>,
    sender: Sender<Arrived>,
    inbox: Receiver<Arrived>,
    waiting_bytes: Arc<AtomicUsize>,
    /// Simulated time, ns; zero before it is known.
    sim_ns: Arc<AtomicU64>,
}

struct Recorded {
    dds_type: String,
    qos: Qos,
    /// Its number in the bag.
    at: usize,
    recorded: u64,
    lost: Arc<AtomicU64>,
    dropped: Arc<AtomicU64>,
    reader: Option<Reader>,
}

struct Arrived {
    topic: Arc<str>,
    log_ns: u64,
    sample: Sample,
}

/// Why recording ended early.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The bag cannot be written.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// DDS refused.
    #[error(transparent)]
    Dds(#[from] DdsError),
}

impl GraphRecorder {
    /// A recorder that fills `writer`.
    #[must_use]
    pub fn new(writer: BagWriter, definitions: Definitions, settings: GraphSettings) -> Self {
        let (sender, inbox) = channel();
        Self {
            settings,
            definitions,
            writer,
            topics: BTreeMap::new(),
            refused: BTreeSet::new(),
            sender,
            inbox,
            waiting_bytes: Arc::default(),
            sim_ns: Arc::default(),
        }
    }

    /// Records what other participants publish until `stop` is set; calls `show` about twice a second.
    ///
    /// # Errors
    /// When the bag cannot be written, or DDS refuses a reader.
    pub fn run(
        &mut self,
        participant: &Participant,
        stop: &AtomicBool,
        mut show: impl FnMut(&[TopicCount], &BagWriter),
    ) -> Result<(), RecordError> {
        let clock = self.settings.use_sim_time.then(|| self.follow_clock(participant)).transpose()?;
        let mut look_at = Instant::now();
        let mut show_at = Instant::now() + SHOW_PERIOD;
        let mut data = Vec::new();
        while !stop.load(Ordering::Relaxed) {
            let now = Instant::now();
            if now >= look_at {
                look_at = now + DISCOVERY_PERIOD;
                // Without discovery the first look that finds something is the only one.
                if !self.settings.no_discovery || self.topics.is_empty() {
                    self.look_for_topics(participant)?;
                }
            }
            if now >= show_at {
                show_at = now + SHOW_PERIOD;
                show(&self.counts(), &self.writer);
            }
            match self.inbox.recv_timeout(look_at.saturating_duration_since(now)) {
                Ok(arrived) => self.take(&arrived, &mut data)?,
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => self.writer.flush_if_due()?,
            }
        }
        drop(clock);
        // Nothing new is heard from now on; what has arrived belongs to the bag.
        for topic in self.topics.values_mut() {
            topic.reader = None;
        }
        while let Ok(arrived) = self.inbox.try_recv() {
            self.take(&arrived, &mut data)?;
        }
        show(&self.counts(), &self.writer);
        Ok(())
    }

    /// How every topic is doing, by name.
    #[must_use]
    pub fn counts(&self) -> Vec<TopicCount> {
        let count = |(name, topic): (&String, &Recorded)| TopicCount {
            topic: name.clone(),
            recorded: topic.recorded,
            lost: topic.lost.load(Ordering::Relaxed),
            dropped: topic.dropped.load(Ordering::Relaxed),
        };
        self.topics.iter().map(count).collect()
    }

    /// The bag, to be finished.
    #[must_use]
    pub fn into_writer(self) -> BagWriter {
        self.writer
    }

    fn take(&mut self, arrived: &Arrived, data: &mut Vec<u8>) -> Result<(), BagError> {
        let Arrived { topic, log_ns, sample } = arrived;
        self.waiting_bytes.fetch_sub(sample.payload.len(), Ordering::Relaxed);
        let Some(topic) = self.topics.get_mut(&**topic) else { return Ok(()) };
        let published = sample.source_timestamp.filter(|_| !self.settings.use_sim_time).map(wall_ns);
        with_header(data, &sample.payload, sample.little_endian);
        topic.recorded += 1;
        self.writer.write(topic.at, *log_ns, published.unwrap_or(*log_ns), data)
    }

    fn follow_clock(&self, participant: &Participant) -> Result<Reader, DdsError> {
        let sim_ns = Arc::clone(&self.sim_ns);
        participant.topic_reader(&CLOCK, "", move |sample| {
            if let Ok(Clock { clock }) = sample.decode() {
                sim_ns.store(ns_of_stamp(&clock), Ordering::Relaxed);
            }
        })
    }

    /// Begins to record topics that are new, and asks anew where the publishers' quality of service has changed.
    fn look_for_topics(&mut self, participant: &Participant) -> Result<(), RecordError> {
        let mut offers: BTreeMap<(String, String), Vec<Endpoint>> = BTreeMap::new();
        for writer in participant.discovered().writers {
            if let Some(topic) = writer.topic.strip_prefix("rt").filter(|topic| topic.starts_with('/')) {
                offers.entry((topic.to_owned(), writer.dds_type.clone())).or_default().push(writer);
            }
        }
        for ((name, dds_type), writers) in offers {
            // A type that ROS did not name is recorded under its own name, as bytes.
            let ros_type = ros_type(&dds_type).unwrap_or_else(|| dds_type.clone());
            if !self.settings.selection.takes(&name, &ros_type) {
                continue;
            }
            let qos = weakest(&writers);
            match self.topics.get_mut(&name) {
                Some(known) if known.dds_type != dds_type => {
                    if self.refused.insert((name.clone(), dds_type.clone())) {
                        tracing::warn!(
                            "{name} is recorded as {}; its publisher of {dds_type} is left out",
                            known.dds_type
                        );
                    }
                }
                Some(known) if known.qos == qos => {}
                Some(known) => {
                    known.qos = qos;
                    known.reader = None;
                    let counters = (Arc::clone(&known.lost), Arc::clone(&known.dropped));
                    let reader = self.listen(participant, &name, &dds_type, &qos, counters)?;
                    if let Some(known) = self.topics.get_mut(&name) {
                        known.reader = Some(reader);
                    }
                }
                None => {
                    let mut profiles: Vec<QosProfile> = writers.iter().map(offered).collect();
                    profiles.sort();
                    profiles.dedup();
                    let at = self.writer.add_topic(described(&self.definitions, &name, &ros_type, profiles))?;
                    let counters = (Arc::default(), Arc::default());
                    let reader = self.listen(
                        participant,
                        &name,
                        &dds_type,
                        &qos,
                        (Arc::clone(&counters.0), Arc::clone(&counters.1)),
                    )?;
                    let (lost, dropped) = counters;
                    let reader = Some(reader);
                    self.topics.insert(name, Recorded { dds_type, qos, at, recorded: 0, lost, dropped, reader });
                }
            }
        }
        Ok(())
    }

    /// Hands over what arrives; only counts here, as this runs on the thread that drains all readers.
    fn listen(
        &self,
        participant: &Participant,
        name: &str,
        dds_type: &str,
        qos: &Qos,
        (lost, dropped): (Arc<AtomicU64>, Arc<AtomicU64>),
    ) -> Result<Reader, DdsError> {
        let topic: Arc<str> = Arc::from(name);
        let (sender, waiting, sim_ns) =
            (self.sender.clone(), Arc::clone(&self.waiting_bytes), Arc::clone(&self.sim_ns));
        let use_sim_time = self.settings.use_sim_time;
        let mut last: HashMap<Guid, i64> = HashMap::new();
        participant.reader(name, dds_type, qos, move |sample| {
            if let Some(last) = last.insert(sample.writer_guid, sample.sequence) {
                let missing = u64::try_from(sample.sequence.saturating_sub(last).saturating_sub(1)).unwrap_or(0);
                lost.fetch_add(missing, Ordering::Relaxed);
            }
            let log_ns = if use_sim_time { sim_ns.load(Ordering::Relaxed) } else { wall_ns(SystemTime::now()) };
            if use_sim_time && log_ns == 0 {
                return;
            }
            let bytes = sample.payload.len();
            if waiting.load(Ordering::Relaxed) + bytes > WAITING_BYTES_MAX {
                dropped.fetch_add(1, Ordering::Relaxed);
                return;
            }
            waiting.fetch_add(bytes, Ordering::Relaxed);
            // A closed inbox belongs to a recorder that has ended.
            let _ = sender.send(Arrived { topic: Arc::clone(&topic), log_ns, sample });
        })
    }
}

/// What every one of these writers serves.
fn weakest(writers: &[Endpoint]) -> Qos {
    let reliable = writers.iter().all(|writer| writer.reliability == Reliability::Reliable);
    let durable = writers.iter().all(|writer| writer.durability == Durability::TransientLocal);
    Qos {
        reliability: if reliable { Reliability::Reliable } else { Reliability::BestEffort },
        durability: if durable { Durability::TransientLocal } else { Durability::Volatile },
        depth: 64,
        backlog: READER_BACKLOG,
        lifespan_s: None,
    }
}

/// What a writer offers, as far as discovery tells.
fn offered(writer: &Endpoint) -> QosProfile {
    QosProfile {
        history: History::Unknown,
        depth: 0,
        reliability: match writer.reliability {
            Reliability::Reliable => qos::Reliability::Reliable,
            Reliability::BestEffort => qos::Reliability::BestEffort,
        },
        durability: match writer.durability {
            Durability::TransientLocal => qos::Durability::TransientLocal,
            Durability::Volatile => qos::Durability::Volatile,
        },
        ..QosProfile::default()
    }
}

fn wall_ns(time: SystemTime) -> u64 {
    // A clock before 1970 reads as 1970.
    u64::try_from(time.duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos()).unwrap_or(u64::MAX)
}
