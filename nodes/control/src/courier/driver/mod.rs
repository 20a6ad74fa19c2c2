//! The driver itself: accepts commands, makes set points of them, closes the servo loop and reports how the courier moves.

mod servo;

use nalgebra::Vector3;

use super::config::CourierConfig;
use super::control::Controller;
use super::estimator::{Estimate, Estimator};
use super::learning::{Learner, MeasuredResponse};
use super::path::{Check, Path};
use super::rejection::Rejection;
use super::report::{Commander, DriverEvent, Fault, GoalHandle, GoalOutcome, VibrationPhase};
use super::safety::Supervisor;
use super::tolerance::{self, Allowed};
use super::trajectory::{self, Spline, State};
use super::vibrator::{Vibrator, prepare};
use crate::courier::limits::{CourierLimits, Extent};
use feeder_model::motor::Load;
use feeder_model::motor::PlanarMotor;
use feeder_model::range::OutOfRange;
use feeder_model::trajectory::{Tolerances, Trajectory, TrajectoryPoint};
use feeder_model::waveform::Waveform;

/// A goal being executed.
#[derive(Clone, Copy, Debug)]
struct Goal {
    handle: GoalHandle,
    client: u64,
    tolerances: Allowed,
    /// Tick by which the goal must be reached, once its path has ended.
    deadline_tick: Option<u64>,
}

/// The courier driver: a state machine that advances by servo ticks and never asks the time.
#[derive(Clone, Debug)]
pub struct Driver<P> {
    config: CourierConfig,
    motor: P,
    controller: Controller,
    learner: Learner,
    supervisor: Supervisor,
    estimator: Estimator,
    active: bool,
    tick: u64,
    /// What the sensor said at the last tick; nothing if it gave no number.
    measured: Option<Vector3<f64>>,
    /// Where the courier rests when no path is followed.
    hold: Vector3<f64>,
    path: Option<Path>,
    vibrator: Vibrator,
    /// Set point of the present tick, with the mean acceleration that led to it.
    present: State,
    nominal_acceleration: Vector3<f64>,
    goal: Option<Goal>,
    goals: u64,
    /// Latched until reset.
    fault: Option<Fault>,
    /// Latched when the courier has come to rest.
    coming_fault: Option<Fault>,
    events: Vec<DriverEvent>,
}

impl<P: PlanarMotor> Driver<P> {
    /// A driver of `motor`, which rests at the configured start.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn with_motor(config: CourierConfig, motor: P) -> Result<Self, OutOfRange> {
        config.validate()?;
        let mass = config.limits.moved(&config.load);
        let (control, learning, period_s) = (config.control, config.learning, config.servo_period_s);
        Ok(Self {
            controller: Controller::new(&control, mass, period_s)?,
            learner: Learner::new(learning, control, mass, config.limits.wrench_max(), period_s)?,
            supervisor: Supervisor::new(config.safety, config.limits, period_s),
            estimator: Estimator::new(&config.estimator, &config.start, period_s),
            active: true,
            config,
            motor,
            tick: 0,
            measured: Some(config.start),
            hold: config.start,
            path: None,
            vibrator: Vibrator::new(period_s),
            present: State { position: config.start, ..State::default() },
            nominal_acceleration: Vector3::zeros(),
            goal: None,
            goals: 0,
            fault: None,
            coming_fault: None,
            events: Vec::new(),
        })
    }

    /// The motor, to set its load or to inject faults.
    pub fn motor_mut(&mut self) -> &mut P {
        &mut self.motor
    }

    /// What the driver was set up with, and the load it now reckons with.
    pub fn config(&self) -> &CourierConfig {
        &self.config
    }

    /// How the courier answers to force on the axis that vibrated last, harmonic by harmonic, as measured so far.
    #[must_use]
    pub fn measured_response(&self) -> Vec<MeasuredResponse> {
        self.learner.measured_response()
    }

    /// Lets the courier move, or halts it and refuses commands from now on. It is active from the start.
    pub fn set_active(&mut self, active: bool) {
        if !active {
            self.halt();
        }
        self.active = active;
    }

    /// Notes that a commander is there. One that has been heard and then falls silent while the courier moves at its
    /// wish brings it to rest and the driver into fault.
    pub fn hear(&mut self, commander: Commander) {
        self.supervisor.hear(commander);
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
    /// A fault, an inactive driver, a waveform with a period out of range, or one that leaves the envelope, now or on the
    /// path being followed, even when faded in slowly.
    pub fn set_waveform(&mut self, waveform: &Waveform, enabled: bool) -> Result<(), Rejection> {
        if enabled {
            self.check_ready()?;
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
        let cutoff_hz = self.config.learning.set_point_cutoff_hz();
        let prepared = prepare(waveform, cutoff_hz, self.config.fade_periods, check)?;
        self.vibrator.set(prepared, enabled, self.tick);
        Ok(())
    }

    /// Begins a trajectory within the default tolerances; see [`Self::execute_within`].
    ///
    /// # Errors
    /// As [`Self::execute_within`].
    pub fn execute(&mut self, client: u64, trajectory: &Trajectory) -> Result<GoalHandle, Rejection> {
        self.execute_within(client, trajectory, &Tolerances::default())
    }

    /// Begins a trajectory at the present tick in place of the one of the same client, if there is one.
    ///
    /// # Errors
    /// A fault, an inactive driver, another client's goal, a malformed trajectory or tolerance, a start that is not where
    /// the courier is, or a motion that would leave the envelope at some servo tick, vibration included.
    pub fn execute_within(
        &mut self,
        client: u64,
        trajectory: &Trajectory,
        tolerances: &Tolerances,
    ) -> Result<GoalHandle, Rejection> {
        self.check_ready()?;
        if let Some(holder) = self.goal.map(|goal| goal.client).filter(|&holder| holder != client) {
            return Err(Rejection::Busy { holder });
        }
        trajectory::check(trajectory)?;
        let tolerances = tolerance::resolve(tolerances, &self.config)?;
        let present = self.nominal();
        check_start(trajectory, &present)?;
        let path = Path::new(Spline::new(trajectory, &present), self.tick, self.config.servo_period_s);
        path.check(&self.check(), self.tick, self.nominal_acceleration)?;

        self.end_goal(GoalOutcome::Preempted);
        self.path = Some(path);
        self.goals += 1;
        let handle = GoalHandle(self.goals);
        self.goal = Some(Goal { handle, client, tolerances, deadline_tick: None });
        Ok(handle)
    }

    /// Sends the courier to where it began, gently and straight.
    ///
    /// # Errors
    /// As [`Self::execute`].
    pub fn home(&mut self, client: u64) -> Result<GoalHandle, Rejection> {
        /// Peaks of speed and acceleration of a quintic from rest to rest over distance/time and distance/time².
        const SPEED_PEAK: f64 = 1.875;
        const ACCELERATION_PEAK: f64 = 5.774;
        let CourierConfig { limits, home_acceleration_m_s2, start, .. } = self.config;
        let way = start - self.nominal().position;
        let (m, rad) = (way.xy().norm(), way.z.abs());
        // Half of the speed allowed leaves room for the vibration.
        let duration_s = (SPEED_PEAK * m / (0.5 * limits.speed_m_s_max))
            .max((ACCELERATION_PEAK * m / home_acceleration_m_s2).sqrt())
            .max((ACCELERATION_PEAK * rad / (10.0 * home_acceleration_m_s2)).sqrt())
            .max(0.1);
        self.execute(client, &Trajectory { points: vec![TrajectoryPoint::at_rest(duration_s, start)] })
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

    /// Gives up everything and brakes with what the envelope allows; a fault until reset.
    pub fn emergency_stop(&mut self) {
        if self.fault.is_none() {
            self.enter_fault(Fault::EmergencyStop);
        }
    }

    /// Clears the latched fault; the courier, at standstill as far as the estimate goes (1 mm/s, 10 mrad/s), holds where it
    /// is.
    ///
    /// # Errors
    /// The fault, when the sensor gives no position or the courier still moves.
    pub fn reset_fault(&mut self) -> Result<(), Fault> {
        const STANDSTILL_M_S: f64 = 1e-3;
        // A millimetre a second at the tray's rim: the sensor tells yaw rates no better from noise.
        const STANDSTILL_RAD_S: f64 = 10e-3;
        if let Some(fault) = self.coming_fault.clone() {
            return Err(fault);
        }
        if let Some(fault) = self.fault.clone() {
            let measured = self.motor.measure();
            if !measured.iter().all(|value| value.is_finite()) {
                return Err(Fault::SensorLost);
            }
            let velocity = self.estimator.estimate().velocity;
            let stands = velocity.xy().norm() <= STANDSTILL_M_S && velocity.z.abs() <= STANDSTILL_RAD_S;
            if self.path.is_some() || !stands {
                return Err(fault);
            }
            self.fault = None;
            self.supervisor.reset();
            self.learner.retry();
            self.set_air(true);
            self.place(State { position: measured, ..State::default() });
        }
        Ok(())
    }

    /// Whether a command that moves the courier may be taken.
    fn check_ready(&self) -> Result<(), Rejection> {
        if let Some(fault) = self.fault.clone().or_else(|| self.coming_fault.clone()) {
            return Err(fault.into());
        }
        if self.active { Ok(()) } else { Err(Rejection::Inactive) }
    }

    fn nominal(&self) -> State {
        self.path.as_ref().map_or(State { position: self.hold, ..State::default() }, |path| path.at(self.tick))
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

    /// Puts the set point to where the courier is, and brakes it from there.
    fn place(&mut self, present: State) {
        let CourierLimits { torque_n_m_max, .. } = self.config.limits;
        let load = &self.config.load;
        let (m_s, rad_s) = (present.velocity.xy().norm(), present.velocity.z.abs());
        let brake_m_s2 = self.config.limits.translation_acceleration_m_s2_max(load);
        let brake_rad_s2 = 0.5 * torque_n_m_max / self.config.limits.moved(load).z;
        // The quintic that loses a speed v over a time T covers v T/2 and brakes with less than 2 v/T.
        let duration_s = (2.0 * m_s / brake_m_s2).max(2.0 * rad_s / brake_rad_s2);
        self.hold = present.position;
        self.path = (duration_s > self.config.servo_period_s).then(|| {
            let rest = present.position + present.velocity * (0.5 * duration_s);
            let stop = Trajectory { points: vec![TrajectoryPoint::at_rest(duration_s, rest)] };
            Path::new(Spline::new(&stop, &present), self.tick, self.config.servo_period_s)
        });
        self.present = present;
        self.nominal_acceleration = Vector3::zeros();
        if self.measured.is_some() {
            self.controller.reset();
        }
    }

    /// Gives up the set point that is not followed, and brakes from where the courier is.
    fn enter_fault(&mut self, fault: Fault) {
        self.vibrator.abort();
        self.learner.stop_exciting();
        let Estimate { position, velocity, .. } = self.estimator.estimate();
        self.place(State { position, velocity, ..State::default() });
        self.end_goal(GoalOutcome::Faulted(fault.clone()));
        self.latch(fault);
    }

    /// What the vibration does, the measurement that comes before it included.
    fn vibration(&self) -> VibrationPhase {
        match self.vibrator.phase(self.tick) {
            VibrationPhase::Off if self.learner.is_exciting() => VibrationPhase::Measuring,
            phase => phase,
        }
    }

    fn set_air(&mut self, on: bool) {
        self.motor.set_air(on);
        self.estimator.set_air(on);
    }

    fn latch(&mut self, fault: Fault) {
        self.events.push(DriverEvent::Fault(fault.clone()));
        self.coming_fault = None;
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
