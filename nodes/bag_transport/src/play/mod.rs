//! Giving a bag back to the ROS graph, at its own pace or at that of an external `/clock`.
//!
//! Messages go out as the bytes they were recorded as, so no types are needed. A [`Player`] obeys [`Control`]s, which come
//! from the services that rosbag2's player has ([`serve`]), from a keyboard, or from anywhere else.

mod control;
mod outlets;
mod services;
mod source;
mod timeline;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use feeder_runtime::dds::{DdsError, Participant, Reader, Writer};
use feeder_runtime::node::{ns_of_stamp, stamp_of_ns};
use minifactory_msgs::interface::standard::CLOCK;
use minifactory_msgs::rosgraph_msgs::msg::Clock;

pub use control::{Control, Done};
pub use services::serve;
pub use timeline::Lateness;

use outlets::Outlets;
use ros2_bags::Selection;
use ros2_bags::qos::QosOverride;
use ros2_bags::{Bag, RecordedMessage};
use source::BagSource;
use timeline::Timeline;

/// How long reliable readers may take to acknowledge the last messages.
const LAST_WORD_LIMIT: Duration = Duration::from_secs(2);
/// Longest wait for a control or for time to pass.
const POLL: Duration = Duration::from_millis(200);

/// How a bag is played.
#[derive(Debug, Clone, Default)]
pub struct PlaySettings {
    /// The topics.
    pub selection: Selection,
    /// Seconds of the bag per second.
    pub rate: Option<f64>,
    /// From the start again when the end is reached, for ever.
    pub repeat: bool,
    /// Begin in pause.
    pub start_paused: bool,
    /// Skip so much of the beginning, ns.
    pub start_offset_ns: u64,
    /// Stop at this time in the bag, ns since its epoch.
    pub until_ns: Option<u64>,
    /// Wait so long before each beginning.
    pub delay: Duration,
    /// Publish `/clock` so often, Hz; that of the bag is left out then.
    pub clock_hz: Option<f64>,
    /// Time is that of a `/clock` that somebody else publishes; that of the bag is left out.
    pub follow_clock: bool,
    /// Topic → name under which it is published.
    pub remaps: BTreeMap<String, String>,
    /// Topic, by its name in the bag → what replaces the bag's quality of service.
    pub qos_overrides: BTreeMap<String, QosOverride>,
}

/// How playing went.
#[derive(Debug, Clone, Default)]
pub struct Played {
    /// Messages published.
    pub messages: u64,
    /// Messages that could not be published, with reasons, counted.
    pub failed: BTreeMap<String, u64>,
    /// How late messages went out; those played step by step or after a seek do not count.
    pub lateness: Lateness,
}

/// Why playing cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    /// DDS refused.
    #[error(transparent)]
    Dds(#[from] DdsError),
    /// Nothing would be played.
    #[error("nothing to play: {0}")]
    Nothing(String),
}

/// Plays one bag.
pub struct Player {
    bag: Arc<Bag>,
    settings: PlaySettings,
    outlets: Outlets,
    source: BagSource,
    timeline: Timeline,
    controls: Receiver<Control>,
    /// Start and end in the bag, ns.
    start_ns: u64,
    end_ns: u64,
    clock: Option<Writer>,
    clock_due: Instant,
    _followed: Option<Reader>,
    stopped: bool,
    played: Played,
}

impl Player {
    /// A player of `bag` that obeys `controls`; `sender` is their other end.
    ///
    /// # Errors
    /// When nothing is chosen, or DDS refuses a writer.
    pub fn new(
        participant: &Participant,
        bag: Arc<Bag>,
        settings: PlaySettings,
        sender: &Sender<Control>,
        controls: Receiver<Control>,
    ) -> Result<Self, PlayError> {
        let mut settings = settings;
        if settings.clock_hz.is_some() || settings.follow_clock {
            settings.selection.exclude_topics.push(CLOCK.name_in(""));
        }
        let Some((first_ns, last_ns)) = bag.bounds_ns() else {
            return Err(PlayError::Nothing("the bag holds no message".to_owned()));
        };
        let start_ns = first_ns.saturating_add(settings.start_offset_ns);
        let end_ns = settings.until_ns.map_or(last_ns, |until| until.min(last_ns));
        if start_ns > end_ns {
            let reason = format!("it would begin at {start_ns} ns and end at {end_ns} ns");
            return Err(PlayError::Nothing(reason));
        }
        let outlets = Outlets::open(participant, &bag, &settings)?;
        if outlets.topics().is_empty() {
            return Err(PlayError::Nothing("no topic is chosen".to_owned()));
        }
        let clock = settings.clock_hz.map(|_| participant.topic_writer(&CLOCK, "")).transpose()?;
        let followed = settings
            .follow_clock
            .then(|| {
                let sender = sender.clone();
                participant.topic_reader(&CLOCK, "", move |sample| {
                    if let Ok(Clock { clock }) = sample.decode() {
                        // A closed inbox belongs to a player that has ended.
                        let _ = sender.send(Control::Time(ns_of_stamp(&clock)));
                    }
                })
            })
            .transpose()?;
        let source = BagSource::start(&bag, outlets.topics().clone(), start_ns, end_ns);
        let mut timeline = Timeline::new(start_ns, settings.rate.unwrap_or(1.0), Instant::now());
        if settings.start_paused || settings.follow_clock {
            timeline.pause(Instant::now());
        }
        Ok(Self {
            bag,
            settings,
            outlets,
            source,
            timeline,
            controls,
            start_ns,
            end_ns,
            clock,
            clock_due: Instant::now(),
            _followed: followed,
            stopped: false,
            played: Played::default(),
        })
    }

    /// Plays to the end, or until it is stopped. `show` is told the position in the bag, ns, and whether it is paused,
    /// after every control and a few times a second.
    pub fn run(mut self, mut show: impl FnMut(u64, bool)) -> Played {
        self.wait(self.settings.delay);
        self.timeline.restart(self.start_ns, Instant::now());
        let mut show_at = Instant::now();
        while !self.stopped {
            let now = Instant::now();
            if now >= show_at {
                show_at = now + POLL;
                show(self.timeline.position_ns(now).min(self.end_ns), self.timeline.is_paused());
            }
            self.publish_clock(now);
            let next_ns = self.source.peek().map(|message| message.log_ns);
            let due = match next_ns {
                Some(_) if self.timeline.is_paused() => None,
                Some(log_ns) => Some(self.timeline.due(log_ns)),
                // In pause one may still seek back; who follows a clock comes to an end with the bag.
                None if self.timeline.is_paused() && !self.settings.follow_clock => None,
                None if self.settings.repeat => {
                    self.wait(self.settings.delay);
                    self.go_to(self.start_ns);
                    continue;
                }
                None => break,
            };
            let wake = due.unwrap_or(now + POLL).min(self.clock_wake(now)).min(now + POLL);
            match self.controls.recv_timeout(wake.saturating_duration_since(Instant::now())) {
                Ok(control) => {
                    self.obey(control);
                    show_at = Instant::now();
                }
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
            }
            if let Some(due) = due {
                self.publish_due(due);
            }
        }
        self.played.failed.extend(self.source.take_errors());
        for (reason, count) in self.outlets.close(LAST_WORD_LIMIT) {
            *self.played.failed.entry(reason).or_default() += count;
        }
        self.played
    }

    /// Lets time pass, and obeys meanwhile.
    fn wait(&mut self, duration: Duration) {
        let until = Instant::now() + duration;
        while !self.stopped && Instant::now() < until {
            if let Ok(control) = self.controls.recv_timeout(until.saturating_duration_since(Instant::now()).min(POLL)) {
                self.obey(control);
            }
        }
    }

    /// Publishes the next message if it is due, as it was when `due` was computed.
    fn publish_due(&mut self, due: Instant) {
        let now = Instant::now();
        if self.timeline.is_paused() || now < due {
            return;
        }
        let Some(message) = self.source.peek() else { return };
        // A control may have changed what is due.
        let due = self.timeline.due(message.log_ns);
        if now < due {
            return;
        }
        if let Some(message) = self.source.next() {
            self.played.lateness.add(now - due);
            self.publish(&message);
        }
    }

    fn publish(&mut self, message: &RecordedMessage) {
        match self.outlets.publish(message) {
            Ok(()) => self.played.messages += 1,
            Err(reason) => *self.played.failed.entry(reason).or_default() += 1,
        }
    }

    fn clock_wake(&self, now: Instant) -> Instant {
        if self.clock.is_some() { self.clock_due } else { now + POLL }
    }

    fn publish_clock(&mut self, now: Instant) {
        let (Some(writer), Some(hz)) = (&self.clock, self.settings.clock_hz) else { return };
        if now < self.clock_due {
            return;
        }
        let period = Duration::from_secs_f64(1.0 / hz);
        self.clock_due = (self.clock_due + period).max(now);
        let clock = stamp_of_ns(self.timeline.position_ns(now).min(self.end_ns));
        if let Ok(payload) = feeder_runtime::cdr::encode(&Clock { clock }) {
            // Best effort: who misses one gets the next.
            let _ = writer.publish(payload);
        }
    }

    fn go_to(&mut self, position_ns: u64) {
        self.source = BagSource::start(&self.bag, self.outlets.topics().clone(), position_ns, self.end_ns);
        self.timeline.restart(position_ns, Instant::now());
    }

    fn obey(&mut self, control: Control) {
        let now = Instant::now();
        match control {
            Control::Pause(done) => {
                self.timeline.pause(now);
                done.call(());
            }
            Control::Resume(done) => {
                if !self.settings.follow_clock {
                    self.timeline.resume(now);
                }
                done.call(());
            }
            Control::TogglePaused(done) => {
                if self.timeline.is_paused() && !self.settings.follow_clock {
                    self.timeline.resume(now);
                } else {
                    self.timeline.pause(now);
                }
                done.call(());
            }
            Control::IsPaused(done) => done.call(self.timeline.is_paused()),
            Control::SetRate(rate, done) => {
                let good = rate.is_finite() && rate > 0.0;
                if good {
                    self.timeline.set_rate(rate, now);
                }
                done.call(good);
            }
            Control::ScaleRate(factor) => self.timeline.set_rate(self.timeline.rate() * factor, now),
            Control::GetRate(done) => done.call(self.timeline.rate()),
            Control::PlayNext(done) => {
                let next = if self.timeline.is_paused() { self.source.next() } else { None };
                if let Some(message) = &next {
                    self.publish(message);
                    self.timeline.restart(message.log_ns, now);
                }
                done.call(next.is_some());
            }
            Control::Burst(count, done) => {
                let mut burst = 0;
                while self.timeline.is_paused() && (count == 0 || burst < count) {
                    let Some(message) = self.source.next() else { break };
                    self.publish(&message);
                    self.timeline.restart(message.log_ns, now);
                    burst += 1;
                }
                done.call(burst);
            }
            Control::Seek(position_ns, done) => {
                let first_ns = self.bag.bounds_ns().map_or(0, |(first, _)| first);
                let good = (first_ns..=self.end_ns).contains(&position_ns);
                if good {
                    self.go_to(position_ns);
                }
                done.call(good);
            }
            Control::SeekBy(offset_ns) => {
                let first_ns = self.bag.bounds_ns().map_or(0, |(first, _)| first);
                let position_ns = self.timeline.position_ns(now).saturating_add_signed(offset_ns);
                self.go_to(position_ns.clamp(first_ns, self.end_ns));
            }
            Control::Time(position_ns) => {
                if position_ns < self.timeline.position_ns(now) {
                    self.go_to(position_ns);
                }
                while self.source.peek().is_some_and(|message| message.log_ns <= position_ns) {
                    if let Some(message) = self.source.next() {
                        self.publish(&message);
                    }
                }
                self.timeline.restart(position_ns, now);
            }
            Control::Stop(done) => {
                self.stopped = true;
                done.call(());
            }
        }
    }
}
