//! What is wanted of the courier at one harmonic, where its tray may swing on it.

use nalgebra::Complex;

use super::super::response::Response;
use super::harmonic::Harmonic;

/// One harmonic of the set point and what is to be commanded for it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted {
    pub(super) response: Response,
    /// The set point.
    pub(super) set_point: Complex<f64>,
    /// The position at the ticks of a courier whose tray has the set point's velocity at the ticks.
    pub(super) position: Complex<f64>,
    /// The command by which a rigid courier would go there.
    pub(super) rigid: Complex<f64>,
    /// Motion of the tray over that which the sensor sees.
    pub(super) tray_over_seen: Complex<f64>,
    /// What of the motion is asked for: what a tray does of which too little is known is not asked of it.
    pub(super) share: f64,
    /// What the controller adds for the set point's acceleration.
    feed_forward: Complex<f64>,
}

impl Wanted {
    /// What is wanted where the tray moves `tray_over_seen` times as much as the sensor sees, which is known but for
    /// `uncertainty`, relative.
    pub(super) fn new(
        set_point: Complex<f64>,
        response: Response,
        feed_forward: bool,
        (tray_over_seen, uncertainty): (Complex<f64>, f64),
    ) -> Self {
        let velocity = Complex::new(0.0, response.omega_rad_s) * set_point;
        let feed_forward = if feed_forward { velocity * response.difference } else { Complex::from(0.0) };
        // On average no other share leaves less of the error.
        let share = (1.0 + uncertainty * uncertainty).recip();
        let rigid = velocity / response.velocity * share;
        let position = rigid * response.position / tray_over_seen;
        Self { response, set_point, position, rigid, tray_over_seen, share, feed_forward }
    }

    /// The acceleration to add so that `command` is what the plant gets, if it then goes to `reached`.
    pub(super) fn learned(&self, command: Complex<f64>, reached: Complex<f64>) -> Complex<f64> {
        command - self.feed_forward - self.response.feedback * (self.set_point - reached)
    }

    /// Where feedback and feed-forward alone would bring it.
    pub(super) fn without_learning(&self, harmonic: &Harmonic) -> Complex<f64> {
        let pushed = self.feed_forward + self.response.feedback * self.set_point;
        harmonic.predict(pushed) / (1.0 + harmonic.plant() * self.response.feedback)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::super::control::ControlParameters;
    use super::super::super::response::{LoopModel, PlantModel};
    use super::*;

    const SET_POINT: Complex<f64> = Complex::new(1e-4, -2e-5);

    fn response() -> Response {
        let plant = PlantModel { gain: 0.9, delay_s: 0.45e-3, lag_s: 0.55e-3 };
        LoopModel { control: ControlParameters::default(), plant, period_s: 0.5e-3 }.at(TAU * 180.0)
    }

    fn wanted(tray_over_seen: Complex<f64>, uncertainty: f64) -> Wanted {
        Wanted::new(SET_POINT, response(), true, (tray_over_seen, uncertainty))
    }

    #[test]
    fn verif_the_tray_gets_the_velocity_of_the_set_point() {
        let tray = Complex::new(1.8, 0.3);
        let wanted = wanted(tray, 0.0);
        // The velocity at the ticks of a rigid plant that moves as much as the courier, times what the tray does more.
        let command = wanted.position / response().position;
        let velocity = command * response().velocity * tray;
        let asked = Complex::new(0.0, TAU * 180.0) * SET_POINT;
        assert!((velocity - asked).norm() < 1e-12 * asked.norm());
    }

    #[test]
    fn verif_no_other_share_leaves_less_of_the_error_on_average_over_the_uncertainty() {
        // A tray that moves (1 + ε) times as much as reckoned, ε of a standard deviation σ: asked for the share s of the
        // motion, s (1 + ε) of it comes.
        for uncertainty in [0.1, 0.5, 1.0, 3.0] {
            let share = wanted(Complex::from(1.0), uncertainty).share;
            let left = |share: f64| (1.0 - share).powi(2) + (share * uncertainty).powi(2);
            for other in [0.9 * share, 1.1 * share] {
                assert!(left(share) < left(other), "{uncertainty}: {share} {other}");
            }
        }
    }

    #[test]
    fn less_is_asked_of_a_tray_of_which_less_is_known() {
        let positions = [0.0, 0.3, 1.0, 3.0].map(|sigma| wanted(Complex::new(0.5, 1.0), sigma).position.norm());
        assert!(positions.is_sorted_by(|more, less| more > less), "{positions:?}");
        assert!((positions[2] / positions[0] - 0.5).abs() < 1e-12);
    }

    #[test]
    fn verif_what_is_learned_makes_up_the_command_with_feedback_and_feed_forward() {
        let wanted = wanted(Complex::from(1.0), 0.0);
        let (command, reached) = (Complex::new(3.0, 1.0), Complex::new(0.9e-4, 0.0));
        let feedback = response().feedback * (SET_POINT - reached);
        let sum = wanted.learned(command, reached) + feedback + wanted.feed_forward;
        assert!((sum - command).norm() < 1e-9);
    }
}
