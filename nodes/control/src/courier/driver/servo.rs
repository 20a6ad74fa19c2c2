//! What the driver does at every servo tick.

use nalgebra::Vector3;

use super::super::control::SetPoint;
use super::super::estimator::Estimate;
use super::super::report::VibrationPhase;
use super::super::report::{Commander, DriverStatus, Fault, GoalOutcome, StepOutput};
use super::super::safety::Seen;
use super::super::tolerance::violation;
use super::super::trajectory::State;
use super::Driver;
use feeder_model::motor::PlanarMotor;

impl<P: PlanarMotor> Driver<P> {
    /// Runs `ticks` servo ticks.
    pub fn step(&mut self, ticks: usize) -> StepOutput {
        let (mut peak, mut square) = (Vector3::zeros(), Vector3::zeros());
        let mut saturated_ticks = 0;
        for _ in 0..ticks {
            let (error, saturated) = self.servo_tick();
            peak = error.abs().sup(&peak);
            square += error.component_mul(&error);
            saturated_ticks += usize::from(saturated);
        }
        let Estimate { position, velocity, position_variance, velocity_variance } = self.estimator.estimate();
        let status = DriverStatus {
            time_s: self.tick as f64 * self.config.servo_period_s,
            position,
            velocity,
            position_variance,
            velocity_variance,
            set_point: self.present.position,
            set_point_velocity: self.present.velocity,
            nominal_position: self.nominal().position,
            vibration: self.vibration(),
            moving: self.path.is_some(),
            goal: self.goal.map(|goal| goal.handle),
            tracking_error_peak: peak,
            tracking_error_rms: (square / ticks.max(1) as f64).map(f64::sqrt),
            saturated_ticks,
            learning: self.learner.report(),
            fault: self.fault.clone().or_else(|| self.coming_fault.clone()),
        };
        StepOutput { status, events: std::mem::take(&mut self.events) }
    }

    /// Runs a servo tick: how far the courier was off its set point, and whether its command was cut.
    fn servo_tick(&mut self) -> (Vector3<f64>, bool) {
        let period_s = self.config.servo_period_s;
        let measured = Some(self.motor.measure()).filter(|measured| measured.iter().all(|value| value.is_finite()));
        self.measured = measured;
        if let Some(measured) = &measured {
            self.estimator.observe(measured);
        }
        let estimate = self.estimator.estimate();
        let off_set_point = self.present.position - estimate.position;
        self.supervise(measured, &estimate.velocity);
        self.finish(measured.is_some(), &estimate);

        let next = self.set_point(self.tick + 1);
        let acceleration = (next.velocity - self.present.velocity) / period_s;
        let set_point = SetPoint { position: self.present.position, velocity: self.present.velocity, acceleration };
        let wanted = match measured {
            Some(measured) => {
                let error = set_point.position - measured;
                let learned = self.learner.force(self.vibrator.instant(self.tick), &error, self.path.is_some());
                self.controller.command(&set_point, &measured) + learned
            }
            // Without a sensor the courier does what it was about to do, and then coasts.
            None => self.controller.blind_command(&set_point),
        };
        let command = self.config.limits.saturate(wanted);
        let in_full = command == wanted;
        self.controller.note_given(in_full);
        self.supervisor.note_given(in_full);
        self.learner.note_given(&wanted, &command);

        self.motor.step(command, period_s);
        let mass = self.config.limits.moved(&self.config.load);
        let (gains, delay_s, lag_s) = self.learner.plant();
        let acceleration = command.component_div(&mass).component_mul(&gains);
        self.estimator.predict(&acceleration, delay_s, lag_s);
        self.tick += 1;
        self.present = next;
        (off_set_point, !in_full)
    }

    /// Stops the courier where something is wrong.
    fn supervise(&mut self, measured: Option<Vector3<f64>>, velocity: &Vector3<f64>) {
        let seen = Seen { measured, set_point: self.present.position, velocity: *velocity };
        let found = self.supervisor.watch(&seen);
        if self.fault.is_some() {
            // What does not brake as told is clamped; without a sensor nothing is told but to brake once.
            let braking_blindly = found == Some(Fault::SensorLost) && self.path.is_some();
            if found.is_some() && !braking_blindly {
                self.set_air(false);
            }
            return;
        }
        if let Some(fault) = found {
            return self.enter_fault(fault);
        }
        let vibrating = self.vibration() != VibrationPhase::Off;
        let asked_by = [vibrating.then_some(Commander::Generator), self.goal.is_some().then_some(Commander::Planner)];
        let silence = self.supervisor.silence(asked_by.into_iter().flatten());
        if let Some(fault) = silence.filter(|_| self.coming_fault.is_none()) {
            self.vibrator.disable(self.tick);
            self.stop_path();
            self.end_goal(GoalOutcome::Faulted(fault.clone()));
            self.coming_fault = Some(fault);
        }
        self.keep_path_tolerance(measured, velocity);
    }

    /// Ends a goal from whose path the courier strays.
    fn keep_path_tolerance(&mut self, measured: Option<Vector3<f64>>, velocity: &Vector3<f64>) {
        let (Some(goal), Some(measured), true) = (self.goal, measured, self.path.is_some()) else { return };
        let errors = [
            ("position", self.present.position - measured, goal.tolerances.path_position),
            ("velocity", self.present.velocity - velocity, goal.tolerances.path_velocity),
        ];
        let found = errors.iter().find_map(|(quantity, error, allowed)| {
            violation(error, allowed).map(|axis| (*quantity, axis, error[axis], allowed[axis]))
        });
        if let Some((quantity, axis, error, allowed)) = found {
            self.stop_path();
            self.end_goal(GoalOutcome::PathViolated { quantity, axis, error, allowed });
        }
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

    /// Ends what ends at this tick: the vibration, the path, and with it the goal.
    fn finish(&mut self, is_measured: bool, estimate: &Estimate) {
        self.vibrator.end(self.tick);
        let disturbed = self.path.is_some();
        let learner = &mut self.learner;
        match self.vibrator.waiting_instant(self.tick) {
            Some(waiting) if !learner.is_ready(&waiting, disturbed) => {}
            _ => {
                learner.stop_exciting();
                self.vibrator.start(self.tick);
            }
        }
        if let Some(path) = self.path.take_if(|path| path.ended(self.tick)) {
            self.hold = path.at(self.tick).position;
        }
        if self.path.is_none()
            && self.vibration() == VibrationPhase::Off
            && let Some(fault) = self.coming_fault.take()
        {
            self.latch(fault);
        }
        let Some(goal) = self.goal.as_mut().filter(|_| is_measured && self.path.is_none()) else { return };
        let grace_ticks = (goal.tolerances.goal_time_s / self.config.servo_period_s).ceil();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 600 s")]
        let deadline_tick = *goal.deadline_tick.get_or_insert(self.tick + grace_ticks as u64);
        let tolerances = goal.tolerances;
        let error = self.present.position - estimate.position;
        let drift = self.present.velocity - estimate.velocity;
        let missed =
            violation(&error, &tolerances.goal_position).or_else(|| violation(&drift, &tolerances.goal_velocity));
        if missed.is_none() {
            self.end_goal(GoalOutcome::Succeeded);
        } else if self.tick >= deadline_tick {
            self.end_goal(GoalOutcome::ToleranceViolated { error });
        }
    }
}
