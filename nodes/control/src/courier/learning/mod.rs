//! Learning a periodic feed-forward: the plant is measured, and what would have removed the error is added to the command.
//!
//! With plain feedback, delay and lag leave errors of the waveform's own size, which decide whether parts climb or slide
//! back. They repeat every period, so they can be learned. Before a waveform runs for the first time a weak excitation
//! measures how the plant answers ([`excitation`]); a rigid plant is fitted to that and to all that follows ([`plant`]),
//! and where a harmonic answers otherwise a filter of its own knows it ([`harmonic`]). After every window of a few periods
//! each harmonic's command goes towards what the estimate says would follow, by a share that the estimate's uncertainty
//! allows, so that noise is averaged and not learned ([`lesson`]). What does worse than feedback alone is given up, and
//! the driver says so ([`watch`]).
//!
//! What feeds is the velocity at the ticks, and what is measured is the position. Near the Nyquist frequency the one
//! follows from the other only with the motion between the ticks, which depends on where in a tick the force arrives: the
//! fitted delay says where.

mod excitation;
mod harmonic;
mod lesson;
mod mode;
mod parameters;
mod plant;
mod projection;
mod report;
mod wanted;
mod watch;

use std::f64::consts::TAU;

use nalgebra::Vector3;

use self::excitation::Excitation;
use self::lesson::Lesson;
pub use self::parameters::LearningParameters;
use self::plant::{PlantEstimate, Seen};
pub use self::report::{LearningPhase, LearningReport, LearningWarning, MeasuredResponse};
use super::control::ControlParameters;
use super::fourier::Fourier;
use super::response::{LoopModel, PlantModel};
use feeder_model::motor::Wrench;
use feeder_model::range::OutOfRange;
use feeder_model::waveform::Waveform;

/// A vibration at one servo tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instant<'a> {
    pub(crate) waveform: &'a Waveform,
    pub(crate) fourier: &'a Fourier,
    /// Index of the axis that vibrates.
    pub(crate) axis: usize,
    /// Tick at which it began, which names this run of it.
    pub(crate) start_tick: u64,
    pub(crate) elapsed_s: f64,
    /// The envelope, 1 when steady.
    pub(crate) scale: f64,
    pub(crate) steady: bool,
}

/// What an excitation showed: the axis, the fundamental of its lines, and what was seen at each order of it.
#[derive(Clone, Debug)]
struct Measured {
    axis: usize,
    fundamental_rad_s: f64,
    seen: Vec<(usize, Seen)>,
}

/// What happens at a tick, from the force that is asked for to that which is given.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Tick {
    /// Nothing to learn from.
    #[default]
    Idle,
    /// The error, in an excitation.
    Excited(Vector3<f64>),
    /// The error, with a waveform that runs steadily.
    Steady(Vector3<f64>),
}

/// The learner of a driver: lessons by waveform, the least recently used one first.
#[derive(Clone, Debug)]
pub(crate) struct Learner {
    parameters: LearningParameters,
    control: ControlParameters,
    mass: Vector3<f64>,
    /// What the forcers give at most.
    wrench_max: Wrench,
    period_s: f64,
    /// The plant of each axis; delay and lag are those of the one that vibrates.
    plants: [PlantEstimate; 3],
    /// The axis that vibrated last.
    axis: usize,
    excitation: Option<Excitation>,
    measured: Option<Measured>,
    lessons: Vec<Lesson>,
    run: Option<u64>,
    tick: Tick,
    /// Ticks of the present window in which the command was cut, and windows in a row with many of them.
    cut_ticks: u32,
    window_ticks: u32,
    cut_windows: u32,
}

impl Learner {
    /// Lessons kept.
    const LESSONS_MAX: usize = 8;
    /// Rounds of a fit from scratch.
    const ROUNDS: u32 = 5;
    /// A window that is so much more off than expected, as a ratio of squares, is of a plant that has changed.
    const SURPRISE: f64 = 9.0;
    /// By how much its gain may have changed then, relative.
    const CHANGE: f64 = 0.3;
    /// By how much the gain at one place may differ from that over a period, relative.
    const PLACE: f64 = 0.1;
    /// Updates after which surprises count: before, all is new.
    const FIRST_UPDATES: u32 = 4;
    /// By how much a plant may differ from the fitted one where it is not measured, relative: at least, at most and before
    /// anything is measured, and in multiples of what the measured frequencies differ.
    const SPREAD_MIN: f64 = 0.05;
    const SPREAD_MAX: f64 = 0.3;
    const SPREAD_FACTOR: f64 = 2.0;
    /// Disturbances that need more than this share of the waveform's acceleration are none that a courier has.
    const PLAUSIBLE: f64 = 0.25;
    /// Updates after which a waveform that is not followed is said to be so.
    const TRUSTED_UPDATES: u32 = 6;
    /// Velocity off over velocity wanted that still feeds about as computed.
    const FOLLOWED: f64 = 0.05;
    /// Share of ticks in which the command is cut that learning may cause, in two windows in a row.
    const CUT_SHARE: f64 = 0.25;

    pub(crate) fn new(
        parameters: LearningParameters,
        control: ControlParameters,
        mass: Vector3<f64>,
        wrench_max: Wrench,
        period_s: f64,
    ) -> Result<Self, OutOfRange> {
        parameters.validate(period_s)?;
        let LearningParameters { nominal_delay_s, nominal_lag_s, mass_spread, delay_spread_s, .. } = parameters;
        let nominal = PlantModel { gain: 1.0, delay_s: nominal_delay_s, lag_s: nominal_lag_s };
        let plant = PlantEstimate::new(nominal, [mass_spread, delay_spread_s, delay_spread_s]);
        Ok(Self {
            parameters,
            control,
            mass,
            wrench_max,
            period_s,
            plants: [plant.clone(), plant.clone(), plant],
            axis: 2,
            excitation: None,
            measured: None,
            lessons: Vec::new(),
            run: None,
            tick: Tick::Idle,
            cut_ticks: 0,
            window_ticks: 0,
            cut_windows: 0,
        })
    }

    /// Takes another mass, mass and inertia, known to have become that: what is commanded is scaled by it at once, what was
    /// given up is tried again, and what was found stays.
    pub(crate) fn set_mass(&mut self, mass: Vector3<f64>) {
        let mut lessons = std::mem::take(&mut self.lessons);
        let before: Vec<_> = lessons.iter().map(|lesson| self.models(lesson.axis())).collect();
        for (axis, plant) in self.plants.iter_mut().enumerate() {
            // What comes on is known, what there was is as heavy as it was found to be.
            let gain = plant.model().gain;
            let moved = (self.mass[axis] / gain + mass[axis] - self.mass[axis]).max(0.1 * mass[axis]);
            plant.scale_gain(mass[axis] / moved / gain);
        }
        self.mass = mass;
        for (lesson, before) in lessons.iter_mut().zip(&before) {
            let axis = lesson.axis();
            lesson.rescale(&before[axis], &self.models(axis)[axis]);
            lesson.follow(&self.models(axis));
        }
        self.lessons = lessons;
    }

    /// Tries again what was given up.
    pub(crate) fn retry(&mut self) {
        let mut lessons = std::mem::take(&mut self.lessons);
        for lesson in &mut lessons {
            lesson.retry(&self.models(lesson.axis()));
        }
        self.lessons = lessons;
    }

    /// The plant as fitted on each axis: gains, delay (s), lag (s).
    pub(crate) fn plant(&self) -> (Vector3<f64>, f64, f64) {
        let PlantModel { delay_s, lag_s, .. } = self.plants[self.axis].model();
        (Vector3::from_fn(|axis, _| self.plants[axis].model().gain), delay_s, lag_s)
    }

    /// Whether a vibration may begin: the plant has been measured, cannot be now, or need not be. If not, an excitation
    /// runs.
    pub(crate) fn is_ready(&mut self, vibration: &Instant, disturbed: bool) -> bool {
        let LearningParameters { enabled, excitation_m_s2_max, excitation_rad_s2_max, .. } = self.parameters;
        let axis = vibration.axis;
        let peak = if axis < 2 { excitation_m_s2_max } else { excitation_rad_s2_max };
        if !enabled || peak <= 0.0 || self.is_measured(axis) || disturbed {
            self.excitation = None;
            return true;
        }
        if self.excitation.is_none() {
            let (fundamental_rad_s, orders) = (vibration.fourier.fundamental_rad_s(), vibration.fourier.len());
            self.axis = axis;
            self.excitation = Some(Excitation::new(axis, fundamental_rad_s, orders, peak, self.period_s));
        }
        false
    }

    /// Whether an excitation has shown how the axis answers.
    fn is_measured(&self, axis: usize) -> bool {
        self.measured.as_ref().is_some_and(|measured| measured.axis == axis)
    }

    /// Ends an excitation that nobody waits for.
    pub(crate) fn stop_exciting(&mut self) {
        self.excitation = None;
    }

    pub(crate) fn is_exciting(&self) -> bool {
        self.excitation.is_some()
    }

    /// The learned force at this tick, at which the courier is `error` off its set point. Nothing is learned while
    /// `disturbed` or while the vibration fades.
    pub(crate) fn force(&mut self, vibration: Option<Instant>, error: &Vector3<f64>, disturbed: bool) -> Wrench {
        self.tick = Tick::Idle;
        if let Some(excitation) = &mut self.excitation {
            self.tick = Tick::Excited(*error);
            return excitation.acceleration().component_mul(&self.mass);
        }
        let Some(vibration) = vibration.filter(|_| self.parameters.enabled) else {
            self.run = None;
            return Wrench::zeros();
        };
        if self.run != Some(vibration.start_tick) {
            self.run = Some(vibration.start_tick);
            self.recall(&vibration);
        }
        let Some(lesson) = self.lessons.last_mut() else { return Wrench::zeros() };
        if vibration.steady && !disturbed {
            self.tick = Tick::Steady(*error);
        }
        lesson.acceleration(vibration.elapsed_s).component_mul(&self.mass) * vibration.scale
    }

    /// Notes what was asked for at this tick, and what of it was commanded in the end.
    pub(crate) fn note_given(&mut self, asked: &Wrench, command: &Wrench) {
        let (in_full, cut) = (asked == command, (asked - command).component_div(&self.mass));
        let command = command.component_div(&self.mass);
        match std::mem::take(&mut self.tick) {
            Tick::Excited(error) => self.excited(&error, &command),
            Tick::Steady(error) => {
                self.window_ticks += 1;
                self.cut_ticks += u32::from(!in_full);
                if self.lessons.last_mut().is_some_and(|lesson| lesson.note(&error, &command, &cut)) {
                    self.update();
                }
            }
            Tick::Idle => {
                (self.window_ticks, self.cut_ticks) = (0, 0);
                if let Some(lesson) = self.lessons.last_mut() {
                    lesson.forget_window();
                }
            }
        }
    }

    fn excited(&mut self, error: &Vector3<f64>, command: &Vector3<f64>) {
        let Some(excitation) = &mut self.excitation else { return };
        excitation.note(error, command);
        if !excitation.is_over() {
            return;
        }
        let (axis, fundamental_rad_s, seen) = (excitation.axis(), excitation.fundamental_rad_s(), excitation.seen());
        self.excitation = None;
        let lines: Vec<Seen> = seen.iter().map(|(_, seen)| *seen).collect();
        self.plants[axis].fit(&lines, Self::ROUNDS, self.period_s);
        // At rest ripple makes the force of one place stronger or weaker than that of others.
        self.plants[axis].doubt_gain(Self::PLACE);
        self.measured = Some(Measured { axis, fundamental_rad_s, seen });
    }

    /// Learns from a full window.
    fn update(&mut self) {
        let Some(mut lesson) = self.lessons.pop() else { return };
        let axis = lesson.axis();
        let before = self.models(axis);
        let seen = lesson.seen();
        if lesson.updates() >= Self::FIRST_UPDATES && lesson.surprise(&seen) > Self::SURPRISE {
            self.plants[axis].doubt_gain(Self::CHANGE);
            lesson.doubt(&before);
        }
        let rounds = if self.is_measured(axis) || lesson.updates() > 0 { 1 } else { Self::ROUNDS };
        self.plants[axis].fit(&seen, rounds, self.period_s);
        let models = self.models(axis);
        lesson.rescale(&before[axis], &models[axis]);
        lesson.find_mode(&seen, &models[axis]);
        lesson.update(&models);
        let many_cut = f64::from(self.cut_ticks) > Self::CUT_SHARE * f64::from(self.window_ticks);
        self.cut_windows = if many_cut { self.cut_windows + 1 } else { 0 };
        if self.cut_windows >= 2 {
            lesson.give_up();
        }
        (self.window_ticks, self.cut_ticks) = (0, 0);
        self.lessons.push(lesson);
    }

    /// What the learner does and what is wrong.
    pub(crate) fn report(&self) -> LearningReport {
        let PlantModel { gain, delay_s, lag_s } = self.plants[self.axis].model();
        let lesson = self.lessons.last().filter(|_| self.run.is_some());
        let phase = match lesson {
            _ if self.excitation.is_some() => LearningPhase::Measuring,
            Some(lesson) if lesson.watch().is_given_up() => LearningPhase::GivenUp,
            Some(_) => LearningPhase::Learning,
            None => LearningPhase::Off,
        };
        LearningReport {
            phase,
            velocity_error: lesson.and_then(|lesson| lesson.watch().velocity_error()),
            warning: lesson.and_then(|lesson| self.warning(lesson)),
            gain,
            delay_s,
            lag_s,
        }
    }

    fn warning(&self, lesson: &Lesson) -> Option<LearningWarning> {
        let watch = lesson.watch();
        let velocity_error = watch.velocity_error()?;
        if watch.is_given_up() {
            return Some(LearningWarning::GivenUp { velocity_error });
        }
        let resonance =
            lesson.sure_mode().map(|mode| LearningWarning::Resonance { frequency_hz: mode.omega_rad_s() / TAU });
        if watch.windows() < Self::TRUSTED_UPDATES {
            return resonance;
        }
        if velocity_error > Self::FOLLOWED {
            return Some(LearningWarning::NotFollowed { velocity_error });
        }
        let share = lesson.disturbed();
        resonance.or((share > Self::PLAUSIBLE).then_some(LearningWarning::Implausible { share }))
    }

    /// How the plant answers as measured: by the lesson of the waveform that ran last, or by the excitation.
    pub(crate) fn measured_response(&self) -> Vec<MeasuredResponse> {
        let measured = |axis: usize, omega_rad_s: f64, position, uncertainty| MeasuredResponse {
            frequency_hz: omega_rad_s / TAU,
            position,
            uncertainty,
            rigid: self.models(axis)[axis].at(omega_rad_s).position,
        };
        match (self.lessons.last(), &self.measured) {
            (Some(lesson), _) => {
                let axis = lesson.axis();
                lesson.plant().map(|(omega, position, sure)| measured(axis, omega, position, sure)).collect()
            }
            (None, Some(Measured { axis, seen, .. })) => {
                let point = |(_, seen): &(usize, Seen)| {
                    let uncertainty = seen.variance.sqrt() / seen.position.norm();
                    measured(*axis, seen.omega_rad_s, seen.position / seen.command, uncertainty)
                };
                seen.iter().map(point).collect()
            }
            (None, None) => Vec::new(),
        }
    }

    /// The loops of all axes while `axis` vibrates.
    fn models(&self, axis: usize) -> [LoopModel; 3] {
        let PlantModel { delay_s, lag_s, .. } = self.plants[axis].model();
        let (control, period_s) = (self.control, self.period_s);
        [0, 1, 2].map(|of| {
            let plant = PlantModel { gain: self.plants[of].model().gain, delay_s, lag_s };
            LoopModel { control, plant, period_s }
        })
    }

    /// Makes the waveform's lesson the last one.
    fn recall(&mut self, vibration: &Instant) {
        self.axis = vibration.axis;
        let known = self.lessons.iter().position(|lesson| lesson.teaches(vibration.waveform));
        let lesson = match known {
            Some(index) => {
                let mut lesson = self.lessons.remove(index);
                if lesson.watch().is_given_up() {
                    lesson.retry(&self.models(self.axis));
                }
                lesson.forget_window();
                lesson
            }
            None => self.begin(vibration),
        };
        self.lessons.push(lesson);
        if self.lessons.len() > Self::LESSONS_MAX {
            self.lessons.remove(0);
        }
    }

    /// By how much the plant differs from a rigid one as far as the excitation shows, relative.
    fn spread(&self) -> f64 {
        let Some(Measured { axis, seen, .. }) = &self.measured else { return Self::SPREAD_MAX };
        let model = self.models(*axis)[*axis];
        let known = seen.iter().filter(|(_, seen)| seen.position.norm_sqr() > 100.0 * seen.variance);
        let off: Vec<f64> = known
            .map(|(_, seen)| {
                let rigid = model.at(seen.omega_rad_s).position * seen.command;
                ((seen.position - rigid) / rigid).norm_sqr()
            })
            .collect();
        let rms = (off.iter().sum::<f64>() / off.len().max(1) as f64).sqrt();
        (Self::SPREAD_FACTOR * rms).clamp(Self::SPREAD_MIN, Self::SPREAD_MAX)
    }

    fn begin(&self, vibration: &Instant) -> Lesson {
        let models = self.models(vibration.axis);
        let mut lesson = Lesson::new(
            vibration,
            &models,
            &self.mass,
            &self.wrench_max,
            self.parameters.lateral_cutoff_hz,
            self.spread(),
        );
        if let Some(Measured { axis, fundamental_rad_s, seen }) = &self.measured {
            let same = (vibration.fourier.fundamental_rad_s() / fundamental_rad_s - 1.0).abs() < 1e-9;
            if *axis == vibration.axis && same {
                lesson.take_measured(seen, &models);
            }
        }
        lesson
    }
}
