//! The equations of motion on the annular tray in two dimensions, integrated by fourth-order Runge-Kutta in small steps:
//! slow, but with nothing in common with the engines it checks.

use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::Waveform;

pub(crate) struct Rk4<'a> {
    pub(crate) tray: TrayGeometry,
    pub(crate) waveform: &'a Waveform,
    pub(crate) friction: f64,
    pub(crate) gravity_m_s2: f64,
    /// Acceleration of the tray's centre in the platen frame, m/s².
    pub(crate) centre_m_s2: [f64; 2],
}

/// r (m), ψ (rad), ṙ (m/s), ψ̇ (rad/s).
pub(crate) type State = [f64; 4];

/// Motion of the tray: yaw (rad), its rate (rad/s) and its acceleration (rad/s²).
type Yaw = [f64; 3];

impl Rk4<'_> {
    /// Integrates for `periods` periods in steps of at most `step_s`, which end with the segments of the waveform.
    pub(crate) fn run(&self, mut state: State, periods: u32, step_s: f64) -> State {
        for _ in 0..periods {
            let mut start_s = 0.0;
            for segment in self.waveform.segments() {
                let start = self.waveform.state_at(start_s + 1e-12 * segment.duration_s);
                let yaw = |t: f64| -> Yaw {
                    let a = segment.acceleration;
                    [start.position + t * (start.velocity + t * a / 2.0), start.velocity + t * a, a]
                };
                let steps = (segment.duration_s / step_s).ceil();
                let h = segment.duration_s / steps;
                let mut i = 0.0;
                while i < steps {
                    state = self.step(state, h, |t| yaw(i * h + t));
                    i += 1.0;
                }
                start_s += segment.duration_s;
            }
        }
        state
    }

    fn step(&self, s: State, h: f64, yaw: impl Fn(f64) -> Yaw) -> State {
        let (drive, normal, cos) = self.forces(s, yaw(h / 2.0));
        let [w1, w2] = [s[2], s[0] * s[3] / cos];
        // At rest as soon as friction can stop the part within the step and hold it.
        if w1.hypot(w2) <= self.friction * normal * h && drive[0].hypot(drive[1]) <= self.friction * normal {
            return [s[0], s[1], 0.0, 0.0];
        }
        let add = |s: State, k: State, h: f64| -> State { std::array::from_fn(|i| s[i] + h * k[i]) };
        let k1 = self.derivative(s, yaw(0.0));
        let k2 = self.derivative(add(s, k1, h / 2.0), yaw(h / 2.0));
        let k3 = self.derivative(add(s, k2, h / 2.0), yaw(h / 2.0));
        let k4 = self.derivative(add(s, k3, h), yaw(h));
        std::array::from_fn(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
    }

    /// What drives (r̈ − ṙψ̇-free part, and r ψ̈/cos φ) without friction, N, and cos φ.
    fn forces(&self, [r, psi, r_dot, psi_dot]: State, [theta, theta_dot, theta_ddot]: Yaw) -> ([f64; 2], f64, f64) {
        let pitch = if psi < self.tray.ramp_angle_rad { self.tray.pitch_m_per_rad() } else { 0.0 };
        let (sin, cos) = (pitch / r).atan().sin_cos();
        let (s, c) = (psi + theta).sin_cos();
        let centre =
            [self.centre_m_s2[0] * c + self.centre_m_s2[1] * s, self.centre_m_s2[1] * c - self.centre_m_s2[0] * s];
        let omega = psi_dot + theta_dot;
        let push = r * theta_ddot + 2.0 * r_dot * omega + centre[1];
        let g = self.gravity_m_s2;
        let drive = [r * omega * omega - centre[0], -g * sin - cos * push];
        (drive, g * cos - sin * push, cos)
    }

    fn derivative(&self, s: State, yaw: Yaw) -> State {
        let (drive, normal, cos) = self.forces(s, yaw);
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
