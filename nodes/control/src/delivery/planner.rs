//! Who plans moves: one tray on one courier among what is around it, and where that courier may be.

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
    /// Where the courier comes from, and the corners that it can come to from there, m; empty: that is not asked.
    reached_m: Vec<Vector2<f64>>,
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
        Ok(Self { gentle, tray, limits, load, around: Surroundings::default(), reached_m: Vec::new() })
    }

    /// The same planner among obstacles.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn among(self, around: Surroundings) -> Result<Self, OutOfRange> {
        around.validate()?;
        Ok(Self { around, ..self })
    }

    /// The same planner for a courier that sets out from `home`.
    #[must_use]
    pub fn from_home(self, home: &Vector3<f64>) -> Self {
        let may_stand = |corner: &Vector2<f64>| self.check_reach(&corner.push(home.z)).is_ok();
        Self { reached_m: self.around.reached_m(home.xy(), may_stand), ..self }
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

    /// Whether the courier may stand at `position` and a way leads there from home.
    ///
    /// # Errors
    /// As of [`check_stand`](Self::check_stand), or that there is no way.
    pub fn check_way(&self, position: &Vector3<f64>) -> Result<(), PlanError> {
        self.check_stand(position)?;
        let to_m = position.xy();
        match self.reached_m.first() {
            Some(home_m) if !self.reached_m.iter().any(|reached_m| self.around.is_clear(*reached_m, to_m)) => {
                Err(PlanError::NoRoute { from_m: (*home_m).into(), to_m: to_m.into() })
            }
            _ => Ok(()),
        }
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
