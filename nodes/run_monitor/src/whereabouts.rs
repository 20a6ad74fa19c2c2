//! How well a driver knows where its courier is: odometry against the truth.

use std::collections::VecDeque;

use nalgebra::Vector3;

/// Odometry messages kept until the truth of their time is heard, a tick or so later.
const WAITING: usize = 16;

/// How far odometry was off the truth so far, beside what the driver says of itself.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct OdometryScore {
    /// Odometry messages compared with the truth.
    pub compared: u32,
    /// Largest distance from the true position, m.
    pub error_m_max: f64,
    /// Largest difference from the true yaw, rad.
    pub error_rad_max: f64,
    /// Largest distance from the set point that the driver reported, m.
    pub tracking_m_max: f64,
    /// Largest yaw from the set point that the driver reported, rad.
    pub tracking_rad_max: f64,
    square_sum_m2: f64,
    square_sum_rad2: f64,
}

impl OdometryScore {
    /// Distance from the true position, m rms; 0 while nothing was compared.
    #[must_use]
    pub fn error_m_rms(&self) -> f64 {
        (self.square_sum_m2 / f64::from(self.compared.max(1))).sqrt()
    }

    /// Difference from the true yaw, rad rms; 0 while nothing was compared.
    #[must_use]
    pub fn error_rad_rms(&self) -> f64 {
        (self.square_sum_rad2 / f64::from(self.compared.max(1))).sqrt()
    }

    /// Both scores as one.
    #[must_use]
    pub fn with(&self, other: &Self) -> Self {
        Self {
            compared: self.compared + other.compared,
            error_m_max: self.error_m_max.max(other.error_m_max),
            error_rad_max: self.error_rad_max.max(other.error_rad_max),
            tracking_m_max: self.tracking_m_max.max(other.tracking_m_max),
            tracking_rad_max: self.tracking_rad_max.max(other.tracking_rad_max),
            square_sum_m2: self.square_sum_m2 + other.square_sum_m2,
            square_sum_rad2: self.square_sum_rad2 + other.square_sum_rad2,
        }
    }

    /// Takes in how far the driver says that it was off its set point.
    pub(crate) fn hear(&mut self, tracking_m: f64, tracking_rad: f64) {
        self.tracking_m_max = self.tracking_m_max.max(tracking_m.abs());
        self.tracking_rad_max = self.tracking_rad_max.max(tracking_rad.abs());
    }

    fn compare(&mut self, said: &Vector3<f64>, truth: &Vector3<f64>) {
        let (error_m, error_rad) = ((said - truth).xy().norm(), (said.z - truth.z).abs());
        self.compared += 1;
        self.error_m_max = self.error_m_max.max(error_m);
        self.error_rad_max = self.error_rad_max.max(error_rad);
        self.square_sum_m2 += error_m * error_m;
        self.square_sum_rad2 += error_rad * error_rad;
    }
}

/// Where a courier says it is, and where it is.
#[derive(Debug, Default)]
pub(crate) struct Whereabouts {
    /// Stamp (ns) and position of odometry whose truth is not known yet, oldest first.
    said: VecDeque<(u64, Vector3<f64>)>,
    /// Where the courier is, x, y (m) and yaw (rad).
    pub(crate) truth: Option<Vector3<f64>>,
    pub(crate) score: OdometryScore,
}

impl Whereabouts {
    /// Odometry says that the courier is there at this time.
    pub(crate) fn say(&mut self, stamp_ns: u64, position: Vector3<f64>) {
        self.said.push_back((stamp_ns, position));
        if self.said.len() > WAITING {
            self.said.pop_front();
        }
    }

    /// The courier is there at this time.
    pub(crate) fn learn(&mut self, stamp_ns: u64, position: Vector3<f64>) {
        self.truth = Some(position);
        while let Some((said_ns, said)) = self.said.pop_front_if(|(said_ns, _)| *said_ns <= stamp_ns) {
            if said_ns == stamp_ns {
                self.score.compare(&said, &position);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odometry_is_compared_with_the_truth_of_its_own_time() {
        let mut whereabouts = Whereabouts::default();
        let at = |x_m| Vector3::new(x_m, 0.0, 0.01);
        whereabouts.learn(0, at(0.0));
        whereabouts.say(10, at(0.103));
        whereabouts.say(20, at(0.204));
        whereabouts.say(30, at(0.9));
        // The truth of 10 was lost.
        whereabouts.learn(20, at(0.2));
        let score = whereabouts.score;
        assert_eq!(score.compared, 1);
        assert!((score.error_m_max - 0.004).abs() < 1e-12 && score.error_rad_max.abs() < 1e-12);
        whereabouts.learn(30, Vector3::new(0.9, 0.0, 0.0));
        let score = whereabouts.score;
        assert!((score.error_m_rms() - 0.004 / 2.0_f64.sqrt()).abs() < 1e-12, "{score:?}");
        assert!((score.error_rad_max - 0.01).abs() < 1e-12, "{score:?}");
    }

    #[test]
    fn of_odometry_whose_truth_does_not_come_only_the_latest_is_kept() {
        let mut whereabouts = Whereabouts::default();
        for stamp_ns in 1..=WAITING as u64 + 3 {
            whereabouts.say(stamp_ns, Vector3::zeros());
        }
        assert_eq!((whereabouts.said.len(), whereabouts.said[0].0), (WAITING, 4));
        whereabouts.learn(10, Vector3::new(1.0, 2.0, 3.0));
        assert_eq!(whereabouts.truth, Some(Vector3::new(1.0, 2.0, 3.0)));
        assert_eq!((whereabouts.said.len(), whereabouts.score.compared), (WAITING - 7, 1));
    }

    #[test]
    fn what_a_driver_says_of_its_errors_counts_by_size() {
        let mut score = OdometryScore::default();
        for (tracking_m, tracking_rad) in [(0.001, -0.02), (-0.003, 0.01), (0.002, 0.0)] {
            score.hear(tracking_m, tracking_rad);
        }
        assert_eq!((score.tracking_m_max, score.tracking_rad_max), (0.003, 0.02));
        assert_eq!((score.error_m_rms(), score.error_rad_rms()), (0.0, 0.0));
    }

    /// Two scores make one as if all had been compared by one of them.
    #[test]
    fn scores_of_couriers_become_one() {
        let compared = |errors: &[(f64, f64)]| {
            let mut score = OdometryScore::default();
            for (error_m, error_rad) in errors {
                score.compare(
                    &Vector3::new(3.0 * error_m, 4.0 * error_m, 1.0),
                    &Vector3::new(0.0, 0.0, 1.0 + error_rad),
                );
                score.hear(*error_rad, *error_m);
            }
            score
        };
        let (first, second) = (&[(0.25, -0.5), (0.5, 0.25)], &[(1.0, 0.125)]);
        let both = compared(&[first.as_slice(), second].concat());
        assert_eq!(compared(first).with(&compared(second)), both);
        assert_eq!(compared(second).with(&compared(first)), both);
        assert_eq!((both.compared, both.error_m_max, both.error_rad_max), (3, 5.0, 0.5));
        assert_eq!((both.tracking_m_max, both.tracking_rad_max), (0.5, 1.0));
        assert!((both.error_m_rms() - (25.0 * (0.0625 + 0.25 + 1.0) / 3.0_f64).sqrt()).abs() < 1e-12, "{both:?}");
        assert!((both.error_rad_rms() - ((0.25 + 0.0625 + 0.015_625) / 3.0_f64).sqrt()).abs() < 1e-12, "{both:?}");
    }
}
