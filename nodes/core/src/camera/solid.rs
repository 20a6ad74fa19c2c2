//! A part as the camera draws it.

use nalgebra::{Point3, UnitQuaternion};

use super::{InvalidValue, require};

/// A part as a solid that lies in one of some poses.
#[derive(Clone, Debug, PartialEq)]
pub struct PartSolid {
    /// Corners, m; the part's place is that of the origin.
    pub vertices: Vec<Point3<f64>>,
    /// Triangles, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle the share of light that comes back, 0 to 1.
    pub reflectance: Vec<f64>,
    /// For each resting pose, the turn from the part's frame to the frame in which it lies, z up, yaw 0.
    pub poses: Vec<UnitQuaternion<f64>>,
}

impl PartSolid {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] naming the field out of range.
    pub fn validate(&self) -> Result<(), InvalidValue> {
        require(!self.poses.is_empty(), "part.poses", 0.0, "at least one")?;
        require(!self.triangles.is_empty(), "part.triangles", 0.0, "at least one")?;
        let shares = self.reflectance.iter().filter(|share| (0.0..=1.0).contains(*share)).count();
        let each = shares == self.triangles.len() && shares == self.reflectance.len();
        require(each, "part.reflectance", shares as f64, "0 to 1 for each triangle")?;
        for corner in self.triangles.iter().flatten() {
            let known = (*corner as usize) < self.vertices.len();
            require(known, "part.triangles", f64::from(*corner), "an index of part.vertices")?;
        }
        let reach_m = self.vertices.iter().map(|vertex| vertex.coords.norm()).fold(0.0, f64::max);
        let finite = self.vertices.iter().all(|vertex| vertex.coords.iter().all(|x| x.is_finite()));
        let sized = finite && (2.5e-4..=0.1).contains(&reach_m);
        require(sized, "part.vertices", reach_m, "within 0.25 to 100 mm of the origin")
    }

    /// Height of the highest point in any pose, m.
    pub(super) fn height_m_max(&self) -> f64 {
        let extent = |pose: &UnitQuaternion<f64>| {
            let heights = self.vertices.iter().map(|vertex| (pose * vertex).z);
            heights.clone().fold(f64::NEG_INFINITY, f64::max) - heights.fold(f64::INFINITY, f64::min)
        };
        self.poses.iter().map(extent).fold(0.0, f64::max)
    }
}

/// A part where it is, in the tray frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartView {
    /// Place, x, m.
    pub x_m: f64,
    /// Place, y, m.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_solids_are_refused_by_name() {
        let solid = PartSolid {
            vertices: vec![Point3::new(1e-3, 0.0, 0.0)],
            triangles: vec![[0, 0, 0]],
            reflectance: vec![0.5],
            poses: vec![UnitQuaternion::identity()],
        };
        assert_eq!(solid.validate(), Ok(()));
        let refused = |change: fn(&mut PartSolid)| {
            let mut bad = solid.clone();
            change(&mut bad);
            bad.validate().unwrap_err().field
        };
        assert_eq!(refused(|s| s.triangles[0][1] = 1), "part.triangles");
        assert_eq!(refused(|s| s.vertices[0].x = f64::NAN), "part.vertices");
        assert_eq!(refused(|s| s.poses.clear()), "part.poses");
        assert_eq!(refused(|s| s.reflectance[0] = 1.5), "part.reflectance");
    }
}
