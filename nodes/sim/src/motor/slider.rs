//! What the parts that slide on the tray do to it.

use nalgebra::{Vector2, Vector3};

use crate::motor::MotorParameters;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::friction::{Grip, Swerve};
use feeder_model::motor::Wrench;

/// All sliding parts lumped into a ring on the tray, held by Coulomb friction alone, in translation and in rotation.
///
/// Its reaction on the tray is known a block late, as it would be from a simulation of the parts that integrates block by
/// block: the mean over one block acts throughout the next.
#[derive(Clone, Debug)]
pub(super) struct Slider {
    velocity_m_s: Vector2<f64>,
    turn_rad_s: f64,
    /// Impulse given to the tray so far in this block, and the time it took.
    impulse: Wrench,
    elapsed_s: f64,
    reaction: Wrench,
}

impl Slider {
    pub(super) fn new() -> Self {
        Self {
            velocity_m_s: Vector2::zeros(),
            turn_rad_s: 0.0,
            impulse: Wrench::zeros(),
            elapsed_s: 0.0,
            reaction: Wrench::zeros(),
        }
    }

    /// Force and torque on the tray now.
    pub(super) fn reaction(&self) -> Wrench {
        self.reaction
    }

    /// Lets the ring slide for `duration_s` on a tray that is now as fast as `tray`.
    pub(super) fn follow(&mut self, tray: &Vector3<f64>, duration_s: f64, parameters: &MotorParameters) {
        let MotorParameters { sliding_mass_kg, sliding_radius_m, sliding_friction, sliding_block_s, .. } = *parameters;
        if sliding_mass_kg == 0.0 {
            return;
        }
        let grip = Grip::uniform(sliding_friction * STANDARD_GRAVITY_M_S2);
        let slip_m_s: [f64; 2] = (self.velocity_m_s - tray.xy()).into();
        let dragged_m_s = Vector2::from(slip_m_s)
            - Vector2::from(grip.slide(slip_m_s, [0.0; 2], duration_s, Swerve::Followed).velocity_m_s);
        self.velocity_m_s -= dragged_m_s;
        // The ring turns at its own radius, so its speed there is what friction brakes.
        let slip_m_s = (self.turn_rad_s - tray.z) * sliding_radius_m;
        let [kept_m_s] = grip.slide([slip_m_s], [0.0], duration_s, Swerve::Followed).velocity_m_s;
        let turned_m_s = slip_m_s - kept_m_s;
        self.turn_rad_s -= turned_m_s / sliding_radius_m;
        let wrench = Wrench::new(dragged_m_s.x, dragged_m_s.y, sliding_radius_m * turned_m_s);
        self.impulse += wrench * sliding_mass_kg;
        self.elapsed_s += duration_s;
        if self.elapsed_s >= sliding_block_s {
            self.reaction = self.impulse / self.elapsed_s;
            (self.impulse, self.elapsed_s) = (Wrench::zeros(), 0.0);
        }
    }
}
