//! Thirty times a second: what was heard becomes what is shown.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};
use tokio::time::{MissedTickBehavior, interval};

use minifactory_msgs::msg::Waveform;

use crate::Shared;
use crate::description::{Feeder, waveform_fields};
use crate::events::{Event, Level};
use crate::frame::{FeederMemory, graph_fields, newest_time_s};
use crate::motion::{MotionLog, servo_message};
use crate::numbers::{coarse, seconds};
use crate::pictures::PictureShow;
use crate::status::{Health, status};
use crate::story::{Known, tell};

/// Between two frames.
const BEAT: Duration = Duration::from_millis(33);
/// Beats between two messages of what changes slowly.
const STATUS_BEATS: u64 = 15;
/// Beats between two looks at what was heard while nobody looks.
const IDLE_BEATS: u64 = 10;
/// Beats between two messages of a tray's motion.
const MOTION_BEATS: u64 = 3;
/// Beats between two pictures of a camera.
const PICTURE_BEATS: u64 = 3;
/// Most blocks of servo samples that are sent in a wall second: more cannot be looked at.
const SERVO_BLOCKS_MAX: usize = 30;
/// Wall time over which the pace of the run is taken.
const PACE_OVER: Duration = Duration::from_secs(2);
/// Wall time without a word after which a run that is not paused counts as ended.
const SILENT: Duration = Duration::from_secs(2);
/// A stamp that is older than the last by more belongs to another run, s.
const ANOTHER_RUN_S: f64 = 0.5;

/// How simulated time passes.
#[derive(Default)]
struct Pace {
    /// When which time was heard, over the last while.
    heard: VecDeque<(Instant, f64)>,
}

impl Pace {
    fn hear(&mut self, now: Instant, time_s: f64) {
        if self.heard.back().is_none_or(|(_, last_s)| *last_s < time_s) {
            self.heard.push_back((now, time_s));
        }
        while self.heard.len() > 2 && now.duration_since(self.heard[1].0) > PACE_OVER {
            self.heard.pop_front();
        }
    }

    fn last_s(&self) -> Option<f64> {
        self.heard.back().map(|(_, time_s)| *time_s)
    }

    /// Simulated seconds per wall second of late.
    fn factor(&self, now: Instant) -> Option<f64> {
        let ((first, first_s), (_, last_s)) = (self.heard.front()?, self.heard.back()?);
        let wall_s = now.duration_since(*first).as_secs_f64();
        (wall_s > 0.2).then(|| (last_s - first_s) / wall_s)
    }

    fn silent(&self, now: Instant) -> bool {
        self.heard.back().is_some_and(|(at, _)| now.duration_since(*at) > SILENT)
    }
}

/// What is shown of a feeder to those who ask for it.
struct Close {
    motion: MotionLog,
    motion_is_new: bool,
    /// When the last blocks of motion were heard.
    blocks: VecDeque<Instant>,
    waveform: Option<Waveform>,
    pictures: PictureShow,
}

/// What turns what is heard into what is shown.
pub(crate) struct Pump {
    shared: Arc<Shared>,
    memories: Vec<FeederMemory>,
    known: Vec<Known>,
    close: Vec<Close>,
    health: Health,
    pace: Pace,
    beats: u64,
    sequence: u64,
    /// The last frame, but for its number.
    shown: Map<String, Value>,
}

impl Pump {
    pub(crate) fn new(shared: Arc<Shared>) -> Self {
        let feeders = shared.cell.feeders.len();
        let close = |feeder: &Feeder| Close {
            motion: MotionLog::new(&feeder.waveform, feeder.servo_period_s),
            motion_is_new: false,
            blocks: VecDeque::new(),
            waveform: None,
            pictures: PictureShow::default(),
        };
        Self {
            close: shared.cell.feeders.iter().map(close).collect(),
            memories: (0..feeders).map(|_| FeederMemory::default()).collect(),
            known: (0..feeders).map(|_| Known::default()).collect(),
            health: Health::default(),
            pace: Pace::default(),
            beats: 0,
            sequence: 0,
            shown: Map::new(),
            shared,
        }
    }

    /// Runs until it is dropped.
    pub(crate) async fn run(mut self) {
        let mut beats = interval(BEAT);
        beats.set_missed_tick_behavior(MissedTickBehavior::Skip);
        loop {
            beats.tick().await;
            self.beats += 1;
            let interest = self.shared.viewers.interest();
            let watched = interest.watched;
            if watched || self.beats.is_multiple_of(IDLE_BEATS) {
                self.listen();
            }
            if watched {
                self.show(Instant::now());
            }
            for feeder in interest.motion {
                self.show_motion(feeder, Instant::now());
            }
            let due = self.beats.is_multiple_of(PICTURE_BEATS);
            for feeder in interest.picture.into_iter().filter(|_| due) {
                self.show_picture(feeder);
            }
        }
    }

    fn listen(&mut self) {
        let Shared { cell, heard, events, .. } = &*self.shared;
        tell(cell, heard, &mut self.memories, &mut self.known, events);
        self.health.hear(heard);
    }

    fn show(&mut self, now: Instant) {
        let shared = Arc::clone(&self.shared);
        let time_s = newest_time_s(&shared.heard);
        if let (Some(last_s), Some(time_s)) = (self.pace.last_s(), time_s)
            && time_s < last_s - ANOTHER_RUN_S
        {
            self.begin_anew(time_s);
        }
        if let Some(time_s) = time_s {
            self.pace.hear(now, time_s);
        }
        shared.clockwork.set_now_s(time_s);
        let (speed, paused) = shared.clockwork.pace().unwrap_or_default();
        let mut fields = graph_fields(&shared.cell, &shared.heard, &mut self.memories);
        let factor = self.pace.factor(now);
        fields.insert("type".to_owned(), json!("frame"));
        fields.insert("time_s".to_owned(), json!(time_s.map(seconds)));
        fields.insert("speed".to_owned(), json!(speed));
        fields.insert("paused".to_owned(), json!(paused));
        fields.insert("ended".to_owned(), json!(!paused && self.pace.silent(now)));
        fields.insert("real_time_factor".to_owned(), json!(factor.map(coarse)));
        if fields != self.shown {
            self.sequence += 1;
            self.shown = fields.clone();
            fields.insert("sequence".to_owned(), json!(self.sequence));
            shared.board.frame.send_replace(Some(Value::Object(fields).to_string().into()));
        }
        if self.beats.is_multiple_of(STATUS_BEATS) {
            let message = status(&shared.cell, &shared.heard, &self.health, time_s, shared.viewers.count());
            shared.board.status.send_replace(Some(message.to_string().into()));
        }
    }

    fn show_motion(&mut self, index: usize, now: Instant) {
        let (feeder, heard) = (&self.shared.cell.feeders[index], &self.shared.heard.feeders[index]);
        let (board, close) = (&self.shared.board.feeders[index], &mut self.close[index]);
        if let Some(message) = heard.waveform.latest()
            && close.waveform.as_ref().map(|known| (known.sequence, known.enabled))
                != Some((message.sequence, message.enabled))
            && let Ok(waveform) = feeder_wire::waveform::from_message(&message)
        {
            close.motion.expect(&waveform);
            let mut fields = waveform_fields(&waveform);
            fields["type"] = json!("waveform");
            fields["feeder"] = json!(feeder.name);
            fields["sequence"] = json!(message.sequence);
            fields["name"] = json!(message.name);
            fields["enabled"] = json!(message.enabled);
            board.waveform.send_replace(Some(fields.to_string().into()));
            close.waveform = Some(message);
        }
        close.blocks.retain(|at| now.duration_since(*at) < Duration::from_secs(1));
        for message in heard.motion.take() {
            close.motion_is_new |= close.motion.hear(&message);
            close.blocks.push_back(now);
            if close.blocks.len() <= SERVO_BLOCKS_MAX && board.servo.receiver_count() > 0 {
                // Whoever listened may have left meanwhile.
                let _ = board.servo.send(servo_message(&feeder.name, &message).to_string().into());
            }
        }
        if close.motion_is_new && self.beats.is_multiple_of(MOTION_BEATS) {
            close.motion_is_new = false;
            board.motion.send_replace(close.motion.message(&feeder.name).map(|message| message.to_string().into()));
        }
    }

    fn show_picture(&mut self, index: usize) {
        let (feeder, heard) = (&self.shared.cell.feeders[index], &self.shared.heard.feeders[index]);
        let (pictures, odometry) = (heard.pictures.all(), heard.odometry.all());
        let shown = self.close[index].pictures.next(feeder, &pictures, heard.candidates.latest().as_ref(), &odometry);
        if let Some(picture) = shown {
            self.shared.board.feeders[index].picture.send_replace(Some(picture));
        }
    }

    /// Forgets the run that was.
    fn begin_anew(&mut self, time_s: f64) {
        self.shared.heard.begin_anew();
        self.shared.board.begin_anew();
        self.memories.iter_mut().for_each(|memory| *memory = FeederMemory::default());
        self.known.iter_mut().for_each(|known| *known = Known::default());
        for (close, feeder) in self.close.iter_mut().zip(&self.shared.cell.feeders) {
            close.motion = MotionLog::new(&feeder.waveform, feeder.servo_period_s);
            close.waveform = None;
            close.pictures = PictureShow::default();
        }
        self.health = Health::default();
        self.pace = Pace::default();
        self.shown = Map::new();
        self.shared.events.add(Event::new(
            "run",
            Level::Info,
            Some(time_s),
            "time has gone back: another run has begun",
        ));
    }
}
