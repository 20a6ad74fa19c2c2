//! What is heard of the graph, kept as it came and read when it is wanted.
//!
//! A run that is faster than real time sends thousands of messages a second, of which a page shows thirty: what nobody
//! looks at is never decoded.

use std::collections::VecDeque;
use std::marker::PhantomData;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use feeder_runtime::dds::{DdsError, Participant, Reader, Sample};
use feeder_wire::topics;
use minifactory_msgs::Message;
use minifactory_msgs::diagnostic_msgs::msg::DiagnosticArray;
use minifactory_msgs::interface::TopicSpec;
use minifactory_msgs::msg::{
    AreaLeases, CourierState, DeliveryState, Factsheet, FeedMetrics, FeederState, PartCandidates, PartStates,
    PickEvent, RunProgress, TrayMotion, Waveform,
};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::rcl_interfaces::msg::Log;
use minifactory_msgs::sensor_msgs::msg::{CompressedImage, JointState};
use minifactory_msgs::visualization_msgs::msg::MarkerArray;

use crate::description::Description;
use crate::viewers::Interest;

/// The newest samples of a topic, at most so many.
#[derive(Clone)]
pub(crate) struct Inbox<M> {
    samples: Arc<Mutex<VecDeque<Sample>>>,
    capacity: usize,
    message: PhantomData<fn() -> M>,
}

impl<M: Message> Inbox<M> {
    fn new(capacity: usize) -> Self {
        Self { samples: Arc::default(), capacity, message: PhantomData }
    }

    fn samples(&self) -> MutexGuard<'_, VecDeque<Sample>> {
        self.samples.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn put(&self, sample: Sample) {
        let mut samples = self.samples();
        if samples.len() == self.capacity {
            samples.pop_front();
        }
        samples.push_back(sample);
    }

    /// The newest message; nothing too where it cannot be read.
    pub(crate) fn latest(&self) -> Option<M> {
        let sample = self.samples().back().cloned();
        sample.and_then(|sample| read(&sample))
    }

    /// All messages that are kept, oldest first.
    pub(crate) fn all(&self) -> Vec<M> {
        let samples: Vec<Sample> = self.samples().iter().cloned().collect();
        samples.iter().filter_map(read).collect()
    }

    /// Takes all messages out, oldest first.
    pub(crate) fn take(&self) -> Vec<M> {
        let samples = std::mem::take(&mut *self.samples());
        samples.iter().filter_map(read).collect()
    }

    fn clear(&self) {
        self.samples().clear();
    }
}

fn read<M: Message>(sample: &Sample) -> Option<M> {
    // A publisher of something else under this name: others on the graph say so loudly enough.
    sample.decode().inspect_err(|error| tracing::debug!("{}: {error}", M::INFO.ros_type())).ok()
}

/// What is heard of a feeder.
pub(crate) struct FeederHeard {
    /// The newest second or so, to know where the courier was when a picture was taken.
    pub(crate) odometry: Inbox<Odometry>,
    pub(crate) courier_state: Inbox<CourierState>,
    pub(crate) parts: Inbox<PartStates>,
    pub(crate) candidates: Inbox<PartCandidates>,
    pub(crate) deliveries: Inbox<DeliveryState>,
    pub(crate) picks: Inbox<PickEvent>,
    pub(crate) waveform: Inbox<Waveform>,
    pub(crate) progress: Inbox<RunProgress>,
    pub(crate) metrics: Inbox<FeedMetrics>,
    pub(crate) state: Inbox<FeederState>,
    pub(crate) motion: Inbox<TrayMotion>,
    pub(crate) pictures: Inbox<CompressedImage>,
    pub(crate) factsheet: Inbox<Factsheet>,
    pub(crate) tray: Inbox<MarkerArray>,
}

/// What is heard of the graph.
pub(crate) struct Heard {
    pub(crate) feeders: Vec<FeederHeard>,
    pub(crate) tools: Vec<Inbox<JointState>>,
    pub(crate) leases: Inbox<AreaLeases>,
    pub(crate) diagnostics: Inbox<DiagnosticArray>,
    pub(crate) log: Inbox<Log>,
}

impl Heard {
    /// Nothing yet, of what a description names.
    pub(crate) fn new(description: &Description) -> Self {
        let feeder = |_| FeederHeard {
            odometry: Inbox::new(128),
            courier_state: Inbox::new(1),
            parts: Inbox::new(1),
            candidates: Inbox::new(1),
            deliveries: Inbox::new(256),
            picks: Inbox::new(256),
            waveform: Inbox::new(1),
            progress: Inbox::new(1),
            metrics: Inbox::new(1),
            state: Inbox::new(1),
            motion: Inbox::new(512),
            pictures: Inbox::new(8),
            factsheet: Inbox::new(1),
            tray: Inbox::new(1),
        };
        Self {
            feeders: description.feeders.iter().map(feeder).collect(),
            tools: description.stations.iter().map(|_| Inbox::new(1)).collect(),
            leases: Inbox::new(1),
            diagnostics: Inbox::new(512),
            log: Inbox::new(1000),
        }
    }

    /// Forgets all but what made it clear that another run has begun: the new odometry, and what is latched.
    pub(crate) fn begin_anew(&self) {
        for feeder in &self.feeders {
            let newest = feeder.odometry.samples().pop_back();
            feeder.odometry.clear();
            newest.into_iter().for_each(|sample| feeder.odometry.put(sample));
            feeder.courier_state.clear();
            feeder.parts.clear();
            feeder.candidates.clear();
            feeder.progress.clear();
            feeder.metrics.clear();
            feeder.motion.clear();
            feeder.pictures.clear();
        }
    }
}

/// When a topic is heard.
#[derive(Clone, Copy)]
enum When {
    /// Whenever the server runs: what comes seldom and would be missed in the timeline.
    Always,
    /// While there is a viewer.
    Watched,
    /// While a viewer wants the motion of this feeder's tray.
    Motion(usize),
    /// While a viewer wants the pictures of this feeder's camera.
    Picture(usize),
}

type Open = Box<dyn Fn(&Participant) -> Result<Reader, DdsError> + Send>;

/// A topic, open or not.
struct Ear {
    when: When,
    open: Open,
    reader: Option<Reader>,
}

/// All topics that are heard, each while it is wanted. What publishers send only while somebody looks stays unsent.
pub(crate) struct Ears {
    participant: Participant,
    ears: Vec<Ear>,
}

impl Ears {
    /// Opens what is always heard.
    ///
    /// # Errors
    /// When DDS refuses a reader.
    pub(crate) fn open(participant: &Participant, cell: &Description, heard: &Heard) -> Result<Self, DdsError> {
        let mut ears = Self { participant: participant.clone(), ears: Vec::new() };
        let global = [
            ear(When::Always, &topics::ROSOUT, "", &heard.log),
            ear(When::Always, &topics::LEASES, "/platen", &heard.leases),
            ear(When::Watched, &topics::DIAGNOSTICS, "", &heard.diagnostics),
        ];
        ears.ears.extend(global);
        for (index, (feeder, inboxes)) in cell.feeders.iter().zip(&heard.feeders).enumerate() {
            let here = feeder.namespace.as_str();
            ears.ears.extend([
                ear(When::Always, &topics::DELIVERY_STATE, here, &inboxes.deliveries),
                ear(When::Always, &topics::PICKS, here, &inboxes.picks),
                ear(When::Always, &topics::WAVEFORM, here, &inboxes.waveform),
                ear(When::Always, &topics::STATE, here, &inboxes.state),
                ear(When::Always, &topics::FACTSHEET, here, &inboxes.factsheet),
                ear(When::Always, &topics::TRAY_MARKERS, here, &inboxes.tray),
                ear(When::Watched, &topics::ODOMETRY, here, &inboxes.odometry),
                ear(When::Watched, &topics::COURIER_STATE, here, &inboxes.courier_state),
                ear(When::Watched, &topics::PARTS, here, &inboxes.parts),
                ear(When::Watched, &topics::PART_CANDIDATES, here, &inboxes.candidates),
                ear(When::Watched, &topics::PROGRESS, here, &inboxes.progress),
                ear(When::Watched, &topics::FEED_METRICS, here, &inboxes.metrics),
                ear(When::Motion(index), &topics::TRAY_MOTION, here, &inboxes.motion),
                ear(When::Picture(index), &topics::IMAGE_COMPRESSED, here, &inboxes.pictures),
            ]);
        }
        for (station, inbox) in cell.stations.iter().zip(&heard.tools) {
            ears.ears.push(ear(When::Watched, &topics::TOOL_JOINT_STATES, &station.namespace, inbox));
        }
        ears.follow(&Interest::default())?;
        Ok(ears)
    }

    /// Opens what is wanted now and closes the rest.
    ///
    /// # Errors
    /// When DDS refuses a reader.
    pub(crate) fn follow(&mut self, interest: &Interest) -> Result<(), DdsError> {
        for ear in &mut self.ears {
            let wanted = match ear.when {
                When::Always => true,
                When::Watched => interest.watched,
                When::Motion(feeder) => interest.motion.contains(&feeder),
                When::Picture(feeder) => interest.picture.contains(&feeder),
            };
            if !wanted {
                ear.reader = None;
            } else if ear.reader.is_none() {
                ear.reader = Some((ear.open)(&self.participant)?);
            }
        }
        Ok(())
    }
}

fn ear<M: Message>(when: When, topic: &TopicSpec<M>, namespace: &str, inbox: &Inbox<M>) -> Ear {
    let (topic, namespace, inbox) = (*topic, namespace.to_owned(), inbox.clone());
    let open = move |participant: &Participant| {
        let inbox = inbox.clone();
        participant.topic_reader(&topic, &namespace, move |sample| inbox.put(sample))
    };
    Ear { when, open: Box::new(open), reader: None }
}
