//! Who plans moves: one tray on one courier among what is around it, and where that courier may be.

use std::f64::consts::TAU;

use nalgebra::{Vector2, Vector3};

use super::gentle::GentleParameters;
use super::plan_error::PlanError;
use super::surroundings::Surroundings;
use crate::courier::CourierLimits;
use feeder_model::motor::Load;
use feeder_model::range::{OutOfRange, check_range};
use feeder_model::tray::TrayGeometry;

/// Plans moves for one feeder: one tray, one courier, one kind of contact.
#[derive(Clone, Debug)]
pub struct MovePlanner {
    pub(super) gentle: GentleParameters,
    pub(super) tray: TrayGeometry,
    pub(super) limits: CourierLimits,
    pub(super) load: Load,
    pub(super) around: Surroundings,
    /// What friction holds of a part on the plateau, or of those that are always protected: the mean over all directions of
    /// what speeding up and braking come to, m/s².
    pub(super) typical_m_s2: f64,
}

impl MovePlanner {
    /// A planner for a tray on a courier with nothing around.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn new(
        gentle: GentleParameters,
        tray: TrayGeometry,
        limits: CourierLimits,
        load: Load,
    ) -> Result<Self, OutOfRange> {
        gentle.validate()?;
        limits.validate()?;
        load.validate()?;
        let typical_m_s2 = gentle.friction * gentle.gravity_m_s2;
        Ok(Self { gentle, tray, limits, load, around: Surroundings::default(), typical_m_s2 })
    }

    /// The same planner where the parts at these places in the tray (m) are always protected, for its estimates.
    #[must_use]
    pub fn protecting(self, parts_in_tray: &[Vector2<f64>]) -> Self {
        const DIRECTIONS: u32 = 16;
        let held_m_s2 = (0..DIRECTIONS).map(|index| {
            let (sin, cos) = (TAU * f64::from(index) / f64::from(DIRECTIONS)).sin_cos();
            // One that slides where it lies is not held, whatever is done.
            self.weakest(parts_in_tray, |_| Vector2::new(cos, sin)).unwrap_or(0.0)
        });
        let held_m_s2: Vec<f64> = held_m_s2.collect();
        let (half, count) = (held_m_s2.len() / 2, f64::from(DIRECTIONS));
        // A way takes as long as with the harmonic mean of both.
        let opposite = |index: usize| 2.0 / (1.0 / held_m_s2[index] + 1.0 / held_m_s2[(index + half) % (2 * half)]);
        let typical_m_s2 = (0..held_m_s2.len()).map(opposite).sum::<f64>() / count;
        Self { typical_m_s2, ..self }
    }

    /// The same planner for parts with another friction than was believed.
    #[must_use]
    pub fn believing(mut self, friction: f64) -> Self {
        self.typical_m_s2 *= friction / self.gentle.friction;
        self.gentle.friction = friction;
        self
    }

    /// Whether friction holds the parts at these places in the tray (m) while the courier stands.
    pub(super) fn holds_at_rest(&self, parts_in_tray: &[Vector2<f64>]) -> bool {
        self.weakest(parts_in_tray, |_| Vector2::x()).is_ok()
    }

    /// The same planner among obstacles.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn among(self, around: Surroundings) -> Result<Self, OutOfRange> {
        around.validate()?;
        Ok(Self { around, ..self })
    }

    /// The tray that is moved.
    #[must_use]
    pub fn tray(&self) -> &TrayGeometry {
        &self.tray
    }

    /// What is around the courier.
    #[must_use]
    pub fn around(&self) -> &Surroundings {
        &self.around
    }

    /// Whether the courier may stand at `position`.
    ///
    /// # Errors
    /// The first coordinate outside its bounds, the tether, or a keep-out area.
    pub fn check_stand(&self, position: &Vector3<f64>) -> Result<(), PlanError> {
        self.check_reach(position)?;
        self.around.check(&position.xy())
    }

    /// Whether the courier may stand at `to` and a way leads there from `from`.
    ///
    /// # Errors
    /// As [`check_stand`](Self::check_stand), or no way round the keep-out areas.
    pub fn check_way(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> Result<(), PlanError> {
        self.check_stand(to)?;
        if self.around.keep_out.is_empty() {
            return Ok(());
        }
        let may_stand = |corner: &Vector2<f64>| self.check_reach(&Vector3::new(corner.x, corner.y, to.z)).is_ok();
        self.around.route(from.xy(), to.xy(), may_stand).map(|_| ())
    }

    /// Whether `position` is within the courier's bounds.
    ///
    /// # Errors
    /// The first coordinate outside its bounds.
    pub fn check_reach(&self, position: &Vector3<f64>) -> Result<(), OutOfRange> {
        let (min, max) = (self.limits.position_min(), self.limits.position_max());
        let names = ["courier_x (m)", "courier_y (m)", "courier_yaw (rad)"];
        (0..3).try_for_each(|axis| check_range(names[axis], position[axis], min[axis], max[axis]))
    }

    /// Distance from a point of the platen to the nearest place where the courier's centre may be, m.
    #[must_use]
    pub fn distance_to_reach_m(&self, point_m: &Vector2<f64>) -> f64 {
        let (min, max) = (self.limits.position_min().xy(), self.limits.position_max().xy());
        (point_m - point_m.sup(&min).inf(&max)).norm()
    }
}
