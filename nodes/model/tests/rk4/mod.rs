//! The equations of motion on the annular tray in two dimensions, integrated by fourth-order Runge-Kutta in small steps:
//! slow, but with nothing in common with the engines it checks.

use feeder_model::motion::MotionSample;
use feeder_model::tray::TrayGeometry;

pub(crate) struct Rk4 {
    pub(crate) tray: TrayGeometry,
    pub(crate) friction: f64,
    pub(crate) gravity_m_s2: f64,
}

/// r (m), ψ (rad), ṙ (m/s), ψ̇ (rad/s).
pub(crate) type State = [f64; 4];

/// Motion of the tray: yaw (rad), its rate (rad/s) and its acceleration (rad/s²), and the acceleration of the tray's centre
/// in the platen frame (m/s²).
#[derive(Clone, Copy)]
struct Motion {
    yaw: [f64; 3],
    centre_m_s2: [f64; 2],
}

impl Rk4 {
    /// Follows one sample of the tray's motion for `duration_s` in steps of at most `step_s`.
    pub(crate) fn follow(&self, mut state: State, sample: &MotionSample, duration_s: f64, step_s: f64) -> State {
        let (start, rate, acceleration) = (sample.position.z, sample.velocity.z, sample.acceleration);
        let motion = |t: f64| Motion {
            yaw: [start + t * (rate + t * acceleration.z / 2.0), rate + t * acceleration.z, acceleration.z],
            centre_m_s2: [acceleration.x, acceleration.y],
        };
        let steps = (duration_s / step_s).ceil();
        let h = duration_s / steps;
        let mut i = 0.0;
        while i < steps {
            state = self.step(state, h, |t| motion(i * h + t));
            i += 1.0;
        }
        state
    }

    fn step(&self, s: State, h: f64, motion: impl Fn(f64) -> Motion) -> State {
        let (drive, normal, cos) = self.forces(s, motion(h / 2.0));
        let [w1, w2] = [s[2], s[0] * s[3] / cos];
        // At rest as soon as friction can stop the part within the step and hold it.
        if w1.hypot(w2) <= self.friction * normal * h && drive[0].hypot(drive[1]) <= self.friction * normal {
            return [s[0], s[1], 0.0, 0.0];
        }
        let add = |s: State, k: State, h: f64| -> State { std::array::from_fn(|i| s[i] + h * k[i]) };
        let k1 = self.derivative(s, motion(0.0));
        let k2 = self.derivative(add(s, k1, h / 2.0), motion(h / 2.0));
        let k3 = self.derivative(add(s, k2, h / 2.0), motion(h / 2.0));
        let k4 = self.derivative(add(s, k3, h), motion(h));
        std::array::from_fn(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
    }

    /// What drives (r̈ − ṙψ̇-free part, and r ψ̈/cos φ) without friction, N, and cos φ.
    fn forces(&self, [r, psi, r_dot, psi_dot]: State, motion: Motion) -> ([f64; 2], f64, f64) {
        let Motion { yaw: [theta, theta_dot, theta_ddot], centre_m_s2: [x, y] } = motion;
        let pitch = if psi < self.tray.ramp_angle_rad { self.tray.pitch_m_per_rad() } else { 0.0 };
        let (sin, cos) = (pitch / r).atan().sin_cos();
        let (s, c) = (psi + theta).sin_cos();
        let centre = [x * c + y * s, y * c - x * s];
        let omega = psi_dot + theta_dot;
        let push = r * theta_ddot + 2.0 * r_dot * omega + centre[1];
        let g = self.gravity_m_s2;
        let drive = [r * omega * omega - centre[0], -g * sin - cos * push];
        (drive, g * cos - sin * push, cos)
    }

    fn derivative(&self, s: State, motion: Motion) -> State {
        let (drive, normal, cos) = self.forces(s, motion);
        let [w1, w2] = [s[2], s[0] * s[3] / cos];
        let speed = w1.hypot(w2);
        let heading = if speed > 0.0 {
            [w1 / speed, w2 / speed]
        } else {
            let d = drive[0].hypot(drive[1]);
            [drive[0] / d, drive[1] / d]
        };
        let friction = self.friction * normal;
        [s[2], s[3], drive[0] - friction * heading[0], (drive[1] - friction * heading[1]) * cos / s[0]]
    }
}
