//! A part as the camera draws it.

use nalgebra::UnitQuaternion;

use feeder_model::geometry::{PartMesh, StablePose};
use feeder_model::range::OutOfRange;

/// A part as a solid that lies in one of some poses.
#[derive(Clone, Debug, PartialEq)]
pub struct PartSolid {
    /// Its surface; the part's place is that of the centre of mass.
    pub mesh: PartMesh,
    /// For each resting pose, the turn from the part's frame to the frame in which it lies, z up, yaw 0.
    pub poses: Vec<UnitQuaternion<f64>>,
}

impl PartSolid {
    /// The part in its stable poses.
    #[must_use]
    pub fn new(mesh: PartMesh, poses: &[StablePose]) -> Self {
        Self { mesh, poses: poses.iter().map(|pose| pose.orientation).collect() }
    }

    /// A part of the catalogue.
    #[cfg(test)]
    pub(crate) fn of_catalogue(name: &str) -> Self {
        let part = feeder_scenario::PartSource::Name(name.to_owned()).part_type().unwrap();
        Self::new(part.mesh, &part.poses)
    }

    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming the field out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        OutOfRange::unless(!self.poses.is_empty(), "part.poses", 0.0, "at least one")?;
        let reach_m = self.mesh.radius_m();
        OutOfRange::unless((2.5e-4..=0.1).contains(&reach_m), "part.radius_m", reach_m, "2.5e-4 to 0.1 m")
    }

    /// Height of the highest point in any pose, m.
    pub(super) fn height_m_max(&self) -> f64 {
        let extent = |pose: &UnitQuaternion<f64>| {
            let heights = self.mesh.vertices().iter().map(|vertex| (pose * vertex).z);
            heights.clone().fold(f64::NEG_INFINITY, f64::max) - heights.fold(f64::INFINITY, f64::min)
        };
        self.poses.iter().map(extent).fold(0.0, f64::max)
    }
}

/// A part where it is, in the tray frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartView {
    /// Place of the centre of mass, x, m.
    pub x_m: f64,
    /// Place of the centre of mass, y, m.
    pub y_m: f64,
    /// Underside above the foot of the ramp, m.
    pub z_m: f64,
    /// Turn about the vertical, rad.
    pub yaw_rad: f64,
    /// Resting pose, an index into [`PartSolid::poses`].
    pub pose: usize,
    /// Velocity relative to the tray, x, m/s.
    pub vx_m_s: f64,
    /// Velocity relative to the tray, y, m/s.
    pub vy_m_s: f64,
}
