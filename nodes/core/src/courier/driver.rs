//! The driver itself: accepts commands, makes set points of them, closes the servo loop and reports the tray's motion.

use nalgebra::Vector3;

use super::config::CourierConfig;
use super::control::{Controller, SetPoint};
use super::learning::Learner;
use super::limits::{Extent, Load};
use super::path::{Check, Path};
use super::plant::{Plant, SimulatedPlant, Wrench};
use super::rejection::Rejection;
use super::report::{DriverEvent, DriverStatus, Fault, GoalHandle, GoalOutcome, StepOutput};
use super::trajectory::{Spline, State, Trajectory};
use super::vibrator::Vibrator;
use crate::motion::{MotionBlock, MotionSample};
use crate::range::OutOfRange;
use crate::waveform::Waveform;

/// A goal being executed.
#[derive(Clone, Copy, Debug)]
struct Goal {
    handle: GoalHandle,
    client: u64,
    /// Tick by which the goal must be reached, once its path has ended.
    deadline_tick: Option<u64>,
}

/// The courier driver: a state machine that advances by servo ticks and never asks the time.
#[derive(Clone, Debug)]
pub struct CourierDriver<P = SimulatedPlant> {
    config: CourierConfig,
    plant: P,
    controller: Controller,
    learner: Learner,
    tick: u64,
    /// Where the courier rests when no path is followed.
    hold: Vector3<f64>,
    path: Option<Path>,
    vibrator: Vibrator,
    /// Set point of the present tick, with the mean acceleration that led to it.
    present: State,
    nominal_acceleration: Vector3<f64>,
    goal: Option<Goal>,
    goals: u64,
    fault: Option<Fault>,
    events: Vec<DriverEvent>,
}

impl CourierDriver<SimulatedPlant> {
    /// A driver of the simulated plant of `config`, whose sensor noise is drawn from `seed`.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn simulated(config: CourierConfig, seed: u64) -> Result<Self, OutOfRange> {
        config.validate()?;
        let mut plant = SimulatedPlant::new(config.plant, config.start, seed)?;
        plant.set_load(&config.load);
        Self::with_plant(config, plant)
    }
}

impl<P: Plant> CourierDriver<P> {
    /// A driver of `plant`, which rests at the configured start.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn with_plant(config: CourierConfig, plant: P) -> Result<Self, OutOfRange> {
        config.validate()?;
        let mass = config.limits.moved(&config.load);
        let (control, learning, period_s) = (config.control, config.learning, config.servo_period_s);
        let cutoff_hz = learning.enabled.then_some(learning.cutoff_hz);
        Ok(Self {
            controller: Controller::new(&control, mass, period_s)?,
            learner: Learner::new(learning, control, mass, period_s)?,
            config,
            plant,
            tick: 0,
            hold: config.start,
            path: None,
            vibrator: Vibrator::new(period_s, cutoff_hz),
            present: State { position: config.start, ..State::default() },
            nominal_acceleration: Vector3::zeros(),
            goal: None,
            goals: 0,
            fault: None,
            events: Vec::new(),
        })
    }

    /// The plant, to set its load or to inject faults.
    pub fn plant_mut(&mut self) -> &mut P {
        &mut self.plant
    }

    /// Takes another load into account.
    ///
    /// # Errors
    /// A value out of its range, or a load under which what is wanted now would leave the envelope.
    pub fn set_load(&mut self, load: Load) -> Result<(), Rejection> {
        load.validate()?;
        let check = Check { load: &load, ..self.check() };
        match &self.path {
            Some(path) => path.check(&check, self.tick, self.nominal_acceleration)?,
            None => {
                let rest = Extent { position: self.hold, ..Extent::default() };
                check.limits.check(&rest, &check.vibration, &load, 0.0)?;
            }
        }
        let mass = self.config.limits.moved(&load);
        self.config.load = load;
        self.controller.set_mass(mass);
        self.learner.set_mass(mass);
        Ok(())
    }

    /// The waveform last accepted, and whether it is to run.
    #[must_use]
    pub fn waveform(&self) -> Option<(&Waveform, bool)> {
        self.vibrator.wanted()
    }

    /// Takes a waveform to run, or to keep ready when not `enabled`. What runs now ends at the end of one of its periods
    /// before anything else begins. The same waveform again changes nothing but `enabled`.
    ///
    /// # Errors
    /// A fault, a waveform with a period out of range, or one that leaves the envelope, now or on the path being
    /// followed, even when faded in slowly.
    pub fn set_waveform(&mut self, waveform: &Waveform, enabled: bool) -> Result<(), Rejection> {
        if let Some(fault) = self.fault.clone().filter(|_| enabled) {
            return Err(fault.into());
        }
        let check = |vibration: Extent| {
            let check = Check { limits: &self.config.limits, vibration, load: &self.config.load };
            match &self.path {
                Some(path) => path.check(&check, self.tick, self.nominal_acceleration),
                None => {
                    let rest = Extent { position: self.hold, ..Extent::default() };
                    check.limits.check(&rest, &vibration, check.load, 0.0)
                }
            }
        };
        let prepared = self.vibrator.prepare(waveform, self.config.fade_periods, check)?;
        self.vibrator.set(prepared, enabled, self.tick);
        Ok(())
    }

    /// Begins a trajectory at the present tick in place of the one of the same client, if there is one.
    ///
    /// # Errors
    /// A fault, another client's goal, a malformed trajectory, a start that is not where the courier is, or a motion
    /// that would leave the envelope at some servo tick, vibration included.
    pub fn execute(&mut self, client: u64, trajectory: &Trajectory) -> Result<GoalHandle, Rejection> {
        if let Some(fault) = self.fault.clone() {
            return Err(fault.into());
        }
        if let Some(holder) = self.goal.map(|goal| goal.client).filter(|&holder| holder != client) {
            return Err(Rejection::Busy { holder });
        }
        trajectory.validate()?;
        let present = self.nominal();
        check_start(trajectory, &present)?;
        let path = Path::new(Spline::new(trajectory, &present), self.tick, self.config.servo_period_s);
        path.check(&self.check(), self.tick, self.nominal_acceleration)?;

        self.end_goal(GoalOutcome::Preempted);
        self.path = Some(path);
        self.goals += 1;
        let handle = GoalHandle(self.goals);
        self.goal = Some(Goal { handle, client, deadline_tick: None });
        Ok(handle)
    }

    /// Ends a goal before its end: the courier comes to rest on its path. Says whether the goal was being executed.
    pub fn cancel(&mut self, handle: GoalHandle) -> bool {
        let executing = self.goal.is_some_and(|goal| goal.handle == handle);
        if executing {
            self.stop_path();
            self.end_goal(GoalOutcome::Halted);
        }
        executing
    }

    /// Brings the courier to rest: on its path, and the vibration at the end of a period. Vibration stays off until a
    /// waveform is enabled anew.
    pub fn halt(&mut self) {
        self.vibrator.disable(self.tick);
        self.stop_path();
        self.end_goal(GoalOutcome::Halted);
    }

    /// Clears the latched fault; the courier, at standstill (1 mm/s, 1 mrad/s), holds where it is.
    ///
    /// # Errors
    /// The fault, when the sensor gives no position or the courier still moves.
    pub fn reset_fault(&mut self) -> Result<(), Fault> {
        const STANDSTILL: f64 = 1e-3;
        if let Some(fault) = self.fault.clone() {
            let measured = self.plant.measure();
            if !measured.iter().all(|value| value.is_finite()) {
                return Err(Fault::SensorLost);
            }
            if self.plant.motion().1.norm() > STANDSTILL {
                return Err(fault);
            }
            self.fault = None;
            self.hold_at(measured);
        }
        Ok(())
    }

    /// Runs `ticks` servo ticks.
    pub fn step(&mut self, ticks: usize) -> StepOutput {
        let mut samples = Vec::with_capacity(ticks);
        let (mut peak, mut square) = (Vector3::zeros(), Vector3::zeros());
        let mut saturated_ticks = 0;
        for _ in 0..ticks {
            let position = self.plant.motion().0;
            let error = self.present.position - position;
            peak = error.abs().sup(&peak);
            square += error.component_mul(&error);
            let (sample, saturated) = self.servo_tick();
            samples.push(sample);
            saturated_ticks += usize::from(saturated);
        }
        let (position, velocity) = self.plant.motion();
        let status = DriverStatus {
            time_s: self.tick as f64 * self.config.servo_period_s,
            position,
            velocity,
            nominal_position: self.nominal().position,
            vibration: self.vibrator.phase(self.tick),
            moving: self.path.is_some(),
            goal: self.goal.map(|goal| goal.handle),
            tracking_error_peak: peak,
            tracking_error_rms: (square / ticks.max(1) as f64).map(f64::sqrt),
            saturated_ticks,
            fault: self.fault.clone(),
        };
        let block = MotionBlock { sample_period_s: self.config.servo_period_s, samples };
        StepOutput { block, status, events: std::mem::take(&mut self.events) }
    }

    fn servo_tick(&mut self) -> (MotionSample, bool) {
        let period_s = self.config.servo_period_s;
        let measured = self.plant.measure();
        let fault = self.tracking_fault(&measured);
        if let Some(fault) = fault.filter(|_| self.fault.is_none()) {
            self.enter_fault(fault, &measured);
        }
        self.finish(&measured);

        let next = self.set_point(self.tick + 1);
        let acceleration = (next.velocity - self.present.velocity) / period_s;
        let set_point = SetPoint { position: self.present.position, velocity: self.present.velocity, acceleration };
        let wanted = if self.fault == Some(Fault::SensorLost) {
            Wrench::zeros()
        } else {
            let error = set_point.position - measured;
            let learned = self.learner.force(self.vibrator.instant(self.tick), &error, self.path.is_some());
            self.controller.command(&set_point, &measured) + learned
        };
        let wrench_max = self.config.limits.wrench_max();
        let command = wanted.sup(&-wrench_max).inf(&wrench_max);

        let (position, velocity) = self.plant.motion();
        self.plant.step(command, period_s);
        let acceleration = (self.plant.motion().1 - velocity) / period_s;
        self.tick += 1;
        self.present = next;
        (MotionSample { position, velocity, acceleration }, command != wanted)
    }

    /// Set point at the tick that follows, which becomes the present one.
    fn set_point(&mut self, tick: u64) -> State {
        let nominal_velocity = self.nominal().velocity;
        let nominal = match &self.path {
            Some(path) => path.at(tick),
            None => State { position: self.hold, ..State::default() },
        };
        self.nominal_acceleration = (nominal.velocity - nominal_velocity) / self.config.servo_period_s;
        let (position, velocity) = self.vibrator.at(tick);
        nominal + State { position, velocity, ..State::default() }
    }

    fn nominal(&self) -> State {
        self.path.as_ref().map_or(State { position: self.hold, ..State::default() }, |path| path.at(self.tick))
    }

    /// Ends what ends at this tick: the vibration, the path, and with it the goal.
    fn finish(&mut self, measured: &Vector3<f64>) {
        self.vibrator.advance(self.tick);
        if let Some(path) = self.path.take_if(|path| path.ended(self.tick)) {
            self.hold = path.at(self.tick).position;
        }
        let Some(goal) = self.goal.as_mut().filter(|_| self.path.is_none()) else {
            return;
        };
        let grace_ticks = (self.config.goal_time_tolerance_s / self.config.servo_period_s).ceil();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "validated to 0..=600,000 ticks")]
        let deadline_tick = *goal.deadline_tick.get_or_insert(self.tick + grace_ticks as u64);
        let error = self.present.position - measured;
        let reached =
            error.xy().norm() <= self.config.goal_tolerance_m && error.z.abs() <= self.config.goal_tolerance_rad;
        if reached {
            self.end_goal(GoalOutcome::Succeeded);
        } else if self.tick >= deadline_tick {
            self.end_goal(GoalOutcome::ToleranceViolated { error });
        }
    }

    fn check(&self) -> Check<'_> {
        Check { limits: &self.config.limits, vibration: self.vibrator.extent(), load: &self.config.load }
    }

    fn stop_path(&mut self) {
        let mut path = self.path.take();
        if let Some(path) = &mut path {
            path.stop(&self.check(), self.tick, self.nominal_acceleration);
        }
        self.path = path;
    }

    fn end_goal(&mut self, outcome: GoalOutcome) {
        if let Some(goal) = self.goal.take() {
            self.events.push(DriverEvent::GoalEnded(goal.handle, outcome));
        }
    }

    fn hold_at(&mut self, position: Vector3<f64>) {
        self.hold = position;
        self.path = None;
        self.present = State { position, ..State::default() };
        self.controller.reset();
    }

    fn tracking_fault(&self, measured: &Vector3<f64>) -> Option<Fault> {
        let error = self.present.position - measured;
        if !error.iter().all(|value| value.is_finite()) {
            return Some(Fault::SensorLost);
        }
        let (m, rad) = (self.config.tracking_error_m_max, self.config.tracking_error_rad_max);
        [m, m, rad].into_iter().enumerate().find_map(|(axis, allowed)| {
            let error = error[axis];
            (error.abs() > allowed).then_some(Fault::TrackingError { axis, error, allowed })
        })
    }

    /// Gives up the set point that is not followed and brakes with all force about where the courier is.
    fn enter_fault(&mut self, fault: Fault, measured: &Vector3<f64>) {
        self.vibrator.abort();
        if fault != Fault::SensorLost {
            self.hold_at(*measured);
        } else {
            self.hold_at(self.present.position);
        }
        self.end_goal(GoalOutcome::Faulted(fault.clone()));
        self.events.push(DriverEvent::Fault(fault.clone()));
        self.fault = Some(fault);
    }
}

/// Checks that a stated start is where the courier is and as fast.
fn check_start(trajectory: &Trajectory, present: &State) -> Result<(), Rejection> {
    // 0.5 mm and 0.5 mrad cover what odometry may be off; a jump of velocity would be a jerk at the first tick.
    const POSITION_TOLERANCE: f64 = 0.5e-3;
    const VELOCITY_TOLERANCE: f64 = 1e-4;
    let Some(first) = trajectory.points.first().filter(|point| point.time_s <= 0.0) else {
        return Ok(());
    };
    let position = first.position - present.position;
    let velocity = first.velocity.unwrap_or_default() - present.velocity;
    for (quantity, difference, allowed) in
        [("position", position, POSITION_TOLERANCE), ("velocity", velocity, VELOCITY_TOLERANCE)]
    {
        if let Some(axis) = (0..3).find(|&axis| difference[axis].abs() > allowed) {
            return Err(Rejection::Start { quantity, axis, difference: difference[axis], allowed });
        }
    }
    Ok(())
}
