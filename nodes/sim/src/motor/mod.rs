//! A simulated motor for the driver to drive.

mod body;
mod cable;
mod faults;
mod forcers;
mod parameters;
mod sensor;
mod slider;

use std::collections::VecDeque;

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use self::body::{Body, BodyState};
use self::cable::Cable;
pub use self::faults::{FaultHooks, SizedWindow, Window};
pub use self::parameters::MotorParameters;
use self::sensor::Sensor;
use self::slider::Slider;
use feeder_model::motion::{MotionBlock, MotionSample};
use feeder_model::motor::{Load, PlanarMotor, Wrench};
use feeder_model::range::OutOfRange;

/// A planar courier and its tray driven by saturating forcers, integrated exactly between servo ticks.
///
/// Within a tick the commanded force is constant; a delay that is no whole number of ticks splits the tick. Ripple and
/// the pull of tether and cables are taken at the position at which a stretch of constant command begins.
#[derive(Clone, Debug)]
pub struct SimulatedMotor {
    parameters: MotorParameters,
    body: Body,
    state: BodyState,
    sensor: Sensor,
    /// Command now at the forcers.
    command: Wrench,
    /// Commands under way with the time until they arrive, s.
    pending: VecDeque<(f64, Wrench)>,
    slider: Slider,
    cable: Cable,
    air: bool,
    losses: Pcg64Mcg,
    time_s: f64,
    /// True motion since it was last taken.
    block: MotionBlock,
}

impl SimulatedMotor {
    /// A plant at rest at `position` (x, y in m, yaw in rad), whose sensor noise is drawn from `seed`.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn new(parameters: MotorParameters, position: Vector3<f64>, seed: u64) -> Result<Self, OutOfRange> {
        parameters.validate()?;
        let mut state = BodyState::zeros();
        state.fixed_rows_mut::<3>(0).copy_from(&position);
        Ok(Self {
            parameters,
            body: Body::new(&parameters, &Load::default()),
            state,
            sensor: Sensor::new(seed),
            command: Wrench::zeros(),
            pending: VecDeque::new(),
            slider: Slider::new(),
            cable: Cable::at_rest(position),
            air: true,
            losses: Pcg64Mcg::seed_from_u64(!seed),
            time_s: 0.0,
            block: MotionBlock::default(),
        })
    }

    /// Puts a load on the tray, its centre of mass at the tray's centre.
    pub fn set_load(&mut self, load: &Load) {
        self.body = Body::new(&self.parameters, load);
    }

    /// Makes things go wrong from now on.
    pub fn set_faults(&mut self, faults: FaultHooks) {
        self.parameters.faults = faults;
    }

    /// Time since the plant's start, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// True position and velocity of the tray now, which no driver knows.
    #[must_use]
    pub fn motion(&self) -> (Vector3<f64>, Vector3<f64>) {
        let twist = Vector3::new(0.0, 0.0, self.state[9]);
        let twist_rate = Vector3::new(0.0, 0.0, self.state[10]);
        (self.position() + twist, self.velocity() + twist_rate)
    }

    /// True motion of the tray since it was last taken, a sample for each servo tick. Until taken it is kept.
    pub fn take_block(&mut self) -> MotionBlock {
        let sample_period_s = self.block.sample_period_s;
        std::mem::replace(&mut self.block, MotionBlock { sample_period_s, samples: Vec::new() })
    }

    /// Position and velocity of what the sensor sees.
    fn seen(&self) -> (Vector3<f64>, Vector3<f64>) {
        if self.parameters.sensor_on_tray { self.motion() } else { (self.position(), self.velocity()) }
    }

    fn position(&self) -> Vector3<f64> {
        self.state.fixed_rows::<3>(0).into()
    }

    fn velocity(&self) -> Vector3<f64> {
        self.state.fixed_rows::<3>(3).into()
    }

    /// Moves on by `duration_s` under the command at the forcers.
    fn advance(&mut self, duration_s: f64) {
        let MotorParameters { forcer_arm_m, forcer_force_n_max, faults, .. } = self.parameters;
        let force_n_max = forcer_force_n_max * faults.force_share(self.time_s);
        let forces_n = forcers::saturate(forcers::allocate(self.command, forcer_arm_m), force_n_max);
        let position = self.position();
        let given_n = forcers::lose(forces_n, &self.parameters);
        let target = forcers::combine(forcers::ripple(given_n, &position, &self.parameters), forcer_arm_m);
        let wrench = self.tether_pull(&position) + self.cable.pull(&position, &self.parameters);
        self.body.advance(&mut self.state, target, wrench, self.slider.reaction(), duration_s);
        if !self.air || faults.frozen(self.time_s) {
            self.state.fixed_rows_mut::<3>(0).copy_from(&position);
            self.state.fixed_rows_mut::<3>(3).fill(0.0);
        }
    }

    fn tether_pull(&self, position: &Vector3<f64>) -> Wrench {
        let MotorParameters { tether_anchor_m: [x_m, y_m], tether_tension_n, tether_stiffness_n_m, .. } =
            self.parameters;
        let span_m = Vector3::new(x_m - position.x, y_m - position.y, 0.0);
        let length_m = span_m.norm();
        let pull_n = tether_tension_n + tether_stiffness_n_m * length_m;
        if length_m > 0.0 { span_m * (pull_n / length_m) } else { Wrench::zeros() }
    }

    /// Sends a command on its way to the forcers.
    fn send(&mut self, command: Wrench) {
        let MotorParameters { delay_s, faults, .. } = self.parameters;
        let loss = faults.loss(self.time_s);
        if loss > 0.0 && self.losses.random::<f64>() < loss {
            return;
        }
        // What was sent later does not arrive earlier.
        let before_s = self.pending.back().map_or(0.0, |(arrival_s, _)| *arrival_s);
        self.pending.push_back(((delay_s + faults.extra_delay_s(self.time_s)).max(before_s), command));
    }
}

impl PlanarMotor for SimulatedMotor {
    fn step(&mut self, command: Wrench, duration_s: f64) {
        let (position, velocity) = self.motion();
        let (seen_position, seen_velocity) = self.seen();
        self.sensor.note(seen_position, seen_velocity, duration_s, self.parameters.sensor_delay_s);
        self.send(command);
        let mut now_s = 0.0;
        while let Some(&(arrival_s, arriving)) = self.pending.front() {
            if arrival_s >= duration_s {
                break;
            }
            self.advance(arrival_s - now_s);
            now_s = arrival_s;
            self.command = arriving;
            self.pending.pop_front();
        }
        self.advance(duration_s - now_s);
        for (arrival_s, _) in &mut self.pending {
            *arrival_s = (*arrival_s - duration_s).max(0.0);
        }
        let reached = self.motion().1;
        self.slider.follow(&reached, duration_s, &self.parameters);
        self.time_s += duration_s;
        let acceleration = (reached - velocity) / duration_s;
        self.block.sample_period_s = duration_s;
        self.block.samples.push(MotionSample { position, velocity, acceleration });
    }

    fn measure(&mut self) -> Vector3<f64> {
        let (position, velocity) = self.seen();
        let measured = self.sensor.read(position, velocity, &self.parameters);
        if self.parameters.faults.blind(self.time_s) { Vector3::repeat(f64::NAN) } else { measured }
    }

    fn set_air(&mut self, on: bool) {
        self.air = on;
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use feeder_model::gravity::STANDARD_GRAVITY_M_S2;

    const TICK_S: f64 = 0.5e-3;

    fn plant(parameters: MotorParameters) -> SimulatedMotor {
        SimulatedMotor::new(parameters, Vector3::zeros(), 1).unwrap()
    }

    #[test]
    fn verif_a_tray_on_a_soft_mounting_swings_at_its_frequency_about_the_common_motion() {
        let parameters = MotorParameters {
            tray_inertia_share: 0.2,
            tray_mode_hz: 100.0,
            tray_mode_damping: 0.0,
            ..MotorParameters::IDEAL
        };
        let mut plant = plant(parameters);
        let (torque_n_m, inertia_kg_m2) = (0.01, 0.005);
        plant.step(Wrench::new(0.0, 0.0, torque_n_m), TICK_S);
        for _ in 1..200 {
            plant.step(Wrench::new(0.0, 0.0, torque_n_m), TICK_S);
            let (time_s, omega_rad_s) = (plant.time_s(), TAU * 100.0);
            // The common motion is that of the rigid body. The mode is driven by −T/((1 − s) J) and swings about the twist
            // at which the spring carries the tray: −T/((1 − s) J ω²) (1 − cos ω t).
            let twist_rad =
                -torque_n_m / (0.8 * inertia_kg_m2 * omega_rad_s.powi(2)) * (1.0 - (omega_rad_s * time_s).cos());
            let common_rad = 0.5 * torque_n_m / inertia_kg_m2 * time_s * time_s;
            // The centre of inertia moves as the rigid body: tray = common + (1 − s) twist, courier = common − s twist.
            let tray_rad = plant.motion().0.z;
            assert!((tray_rad - common_rad - 0.8 * twist_rad).abs() < 1e-12, "{tray_rad}");
            assert!((plant.measure().z - common_rad + 0.2 * twist_rad).abs() < 1e-12);
        }
        plant.parameters.sensor_on_tray = true;
        assert!((plant.measure().z - plant.motion().0.z).abs() < 1e-15);
    }

    #[test]
    fn forces_near_the_peak_fall_short() {
        let mut plant = plant(MotorParameters { force_loss_at_peak: 0.2, ..MotorParameters::IDEAL });
        plant.step(Wrench::new(15.0, 30.0, 0.0), TICK_S);
        // Half of the peak lacks a quarter of 20 %, all of it 20 %.
        let (_, velocity) = plant.motion();
        assert!((velocity - Vector3::new(0.95 * 12.5, 0.8 * 25.0, 0.0) * TICK_S).norm() < 1e-12, "{velocity}");
    }

    #[test]
    fn verif_constant_force_moves_by_half_a_t_squared() {
        let mut plant = plant(MotorParameters::IDEAL);
        for _ in 0..200 {
            plant.step(Wrench::new(2.4, 0.0, 0.01), TICK_S);
        }
        // a = F/m = 2 m/s², α = 2 rad/s², t = 0.1 s. 200 additions leave rounding only.
        let (position, velocity) = plant.motion();
        assert!((position - Vector3::new(0.01, 0.0, 0.01)).norm() < 1e-15);
        assert!((velocity - Vector3::new(0.2, 0.0, 0.2)).norm() < 1e-14);
    }

    #[test]
    fn verif_delay_and_lag_shift_the_motion_by_their_sum() {
        // A step of force through delay d and lag τ tends to v = a (t - d - τ); after 20 ms exp(-t/τ) is below 1e-15.
        let parameters = MotorParameters { delay_s: 0.7e-3, lag_s: 0.5e-3, ..MotorParameters::IDEAL };
        let mut plant = plant(parameters);
        for _ in 0..40 {
            plant.step(Wrench::new(1.2, 0.0, 0.0), TICK_S);
        }
        let (_, velocity) = plant.motion();
        assert!((velocity.x - (0.020 - 0.0012)).abs() < 1e-14, "{}", velocity.x);
    }

    #[test]
    fn verif_pushing_off_the_center_of_mass_turns_the_courier() {
        // Free body: the centre of mass moves by F/m whatever the offset, and the body turns by F ρ_y / I about it.
        let parameters = MotorParameters { center_of_mass_offset_m: [0.0, 0.003], ..MotorParameters::IDEAL };
        let mut plant = plant(parameters);
        plant.step(Wrench::new(6.0, 0.0, 0.0), TICK_S);
        let (_, velocity) = plant.motion();
        let expected_turn_rad_s = 6.0 * 0.003 / 0.005 * TICK_S;
        assert!((velocity.z - expected_turn_rad_s).abs() < 1e-15);
        assert!((velocity.x - velocity.z * 0.003 - 5.0 * TICK_S).abs() < 1e-15);
    }

    #[test]
    fn a_command_beyond_the_peak_saturates() {
        let mut plant = plant(MotorParameters::IDEAL);
        plant.step(Wrench::new(1e6, -1e6, 0.0), TICK_S);
        let (_, velocity) = plant.motion();
        assert!((velocity - Vector3::new(25.0, -25.0, 0.0) * TICK_S).norm() < 1e-12);
    }

    #[test]
    fn verif_sensor_noise_has_the_stated_spread_and_repeats_with_its_seed() {
        let parameters = MotorParameters { sensor_noise_m_rms: 0.2e-6, ..MotorParameters::IDEAL };
        let mut plants = [plant(parameters), plant(parameters)];
        let mut square_m2 = 0.0;
        for _ in 0..10_000 {
            let [a, b] = plants.each_mut().map(PlanarMotor::measure);
            assert_eq!(a, b);
            square_m2 += a.x * a.x;
        }
        // The relative standard error of an rms of n draws is 1/√(2n) = 0.7 %; four of them.
        let rms_m = (square_m2 / 10_000.0).sqrt();
        assert!((rms_m / 0.2e-6 - 1.0).abs() < 0.03, "{rms_m}");
    }

    #[test]
    fn verif_drag_slows_exponentially_and_the_tether_pulls_home() {
        // Coasting with drag c: v = v0 e^(−c t/m), x = v0 m/c (1 − e^(−c t/m)).
        let parameters = MotorParameters { drag_n_s_m: 3.0, ..MotorParameters::IDEAL };
        let mut plant = plant(parameters);
        plant.step(Wrench::new(12.0, 0.0, 0.0), TICK_S);
        let (start, speed) = plant.motion();
        for _ in 0..400 {
            plant.step(Wrench::zeros(), TICK_S);
        }
        let left = (-3.0 * 0.2 / 1.2_f64).exp();
        let (position, velocity) = plant.motion();
        assert!((velocity.x - speed.x * left).abs() < 1e-14);
        assert!((position.x - start.x - speed.x * 0.4 * (1.0 - left)).abs() < 1e-14);

        let tethered = MotorParameters {
            tether_anchor_m: [0.0, 0.5],
            tether_tension_n: 0.2,
            tether_stiffness_n_m: 0.4,
            ..MotorParameters::IDEAL
        };
        let mut plant = self::plant(tethered);
        plant.step(Wrench::zeros(), TICK_S);
        // 0.2 N + 0.4 N/m · 0.5 m on 1.2 kg.
        assert!((plant.motion().1 - Vector3::new(0.0, 0.4 / 1.2 * TICK_S, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn verif_lag_and_drag_agree_with_a_thousandfold_finer_integration() {
        let parameters = MotorParameters {
            lag_s: 0.4e-3,
            delay_s: 0.7e-3,
            drag_n_s_m: 5.0,
            drag_n_m_s_rad: 0.01,
            center_of_mass_offset_m: [0.002, -0.003],
            ..MotorParameters::IDEAL
        };
        let mut plant = plant(parameters);
        let command = |tick: i32| {
            let (sin, cos) = (f64::from(tick) * 0.7).sin_cos();
            Wrench::new(5.0 * sin, 3.0 * cos, 0.4 * sin)
        };
        // The same body by half-implicit Euler steps of 0.5 µs; the delay is 1.4 ticks.
        let fine_s = 0.5e-6;
        let mut reference = Body::new(
            &MotorParameters { lag_s: 0.0, drag_n_s_m: 0.0, drag_n_m_s_rad: 0.0, ..parameters },
            &Load::default(),
        );
        let (mut state, mut force) = (BodyState::zeros(), Wrench::zeros());
        for tick in 0..40 {
            plant.step(command(tick), TICK_S);
            for fine in 0..1000 {
                let sent_tick = (f64::from(tick) + (f64::from(fine) + 0.5) * 1e-3 - 1.4).floor();
                #[expect(clippy::cast_possible_truncation, reason = "a whole number, at most 40")]
                let target = if sent_tick < 0.0 { Wrench::zeros() } else { command(sent_tick as i32) };
                force += (target - force) * (fine_s / parameters.lag_s);
                let velocity: Vector3<f64> = state.fixed_rows::<3>(3).into();
                let drag = velocity.component_mul(&Vector3::new(5.0, 5.0, 0.01));
                reference.advance(&mut state, force - drag, Wrench::zeros(), Wrench::zeros(), fine_s);
            }
        }
        let (position, velocity) = plant.motion();
        // First order in the step: 0.5 µs of 20 ms is 2.5e-5, a few times over.
        let fine_velocity: Vector3<f64> = state.fixed_rows::<3>(3).into();
        let fine_position: Vector3<f64> = state.fixed_rows::<3>(0).into();
        assert!((velocity - fine_velocity).norm() < 3e-3 * velocity.norm(), "{velocity} {fine_velocity}");
        assert!((position - fine_position).norm() < 3e-3 * position.norm(), "{position} {fine_position}");
    }

    #[test]
    fn the_sensor_lags_and_is_out_of_calibration_as_stated() {
        let parameters = MotorParameters { sensor_delay_s: 0.8e-3, sensor_scale_error: 1e-3, ..MotorParameters::IDEAL };
        let mut plant = plant(parameters);
        plant.step(Wrench::new(12.0, 0.0, 0.0), TICK_S);
        for _ in 0..20 {
            plant.step(Wrench::zeros(), TICK_S);
            plant.measure();
        }
        let (position, velocity) = plant.motion();
        let expected = (position.x - velocity.x * 0.8e-3) * 1.001;
        assert!((plant.measure().x - expected).abs() < 1e-15, "{}", plant.measure().x);
    }

    #[test]
    fn verif_sliding_parts_drag_the_tray_a_block_later() {
        let parameters = MotorParameters {
            sliding_mass_kg: 0.05,
            sliding_radius_m: 0.08,
            sliding_friction: 0.2,
            sliding_block_s: 0.01,
            ..MotorParameters::IDEAL
        };
        let mut plant = plant(parameters);
        let mut speeds = vec![0.0];
        for _ in 0..60 {
            // 10 m/s² and more than friction can give the parts in rotation.
            plant.step(Wrench::new(12.0, 0.0, 0.5), TICK_S);
            speeds.push(plant.motion().1.x);
        }
        let acceleration = |tick: usize| (speeds[tick + 1] - speeds[tick]) / TICK_S;
        // Nothing is known in the first block of 20 ticks; then the parts pull back by μ m g.
        assert!((acceleration(19) - 10.0).abs() < 1e-9);
        let drag_m_s2 = 0.2 * STANDARD_GRAVITY_M_S2 * 0.05 / 1.2;
        assert!((acceleration(21) - (10.0 - drag_m_s2)).abs() < 1e-9, "{}", acceleration(21));
        let turned = plant.motion().1.z - 100.0 * 0.03;
        let drag_rad_s2 = 0.2 * STANDARD_GRAVITY_M_S2 * 0.05 * 0.08 / 0.005;
        assert!((turned + drag_rad_s2 * 0.02).abs() < 1e-9, "{turned}");
    }

    #[test]
    fn faults_come_and_go_with_their_windows() {
        let window = Window { from_s: 0.01, to_s: 0.02 };
        let sized = |size| Some(SizedWindow { from_s: 0.01, to_s: 0.02, size });
        let acceleration = |faults: FaultHooks, from: usize| {
            let mut plant = plant(MotorParameters { faults, ..MotorParameters::IDEAL });
            let mut speeds = vec![0.0];
            for _ in 0..60 {
                plant.step(Wrench::new(24.0, 0.0, 0.0), TICK_S);
                speeds.push(plant.motion().1.x);
            }
            (speeds[from + 1] - speeds[from]) / TICK_S
        };
        // Ticks 20 to 39 lie in the window.
        let near = |value: f64, expected: f64| assert!((value - expected).abs() < 1e-9, "{value} {expected}");
        near(acceleration(FaultHooks { freeze: Some(window), ..FaultHooks::NONE }, 30), 0.0);
        near(acceleration(FaultHooks { freeze: Some(window), ..FaultHooks::NONE }, 50), 20.0);
        near(acceleration(FaultHooks { saturation: sized(0.1), ..FaultHooks::NONE }, 30), 2.5);
        near(acceleration(FaultHooks { message_loss: sized(1.0), ..FaultHooks::NONE }, 30), 20.0);
        let mut blind = plant(MotorParameters {
            faults: FaultHooks { sensor_dropout: Some(window), ..FaultHooks::NONE },
            ..MotorParameters::IDEAL
        });
        for tick in 0..50 {
            assert_eq!(blind.measure().x.is_nan(), (20..40).contains(&tick), "{tick}");
            blind.step(Wrench::zeros(), TICK_S);
        }
    }
}
