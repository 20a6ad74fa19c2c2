//! Pinhole camera with plumb-bob distortion, looking straight down at the platen.

use nalgebra::{Isometry3, Matrix2, Matrix3, Point2, Point3, Rotation3, Translation3, UnitQuaternion, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::spec::{CameraPose, CameraSpec, Distortion};
use crate::range::OutOfRange;

/// Newton steps after which a distortion that has not been undone counts as not invertible.
const UNDISTORT_ITERATIONS: usize = 20;
/// Residual at which undistortion stops, in normalised image coordinates (1e-12 × 1,500 px ≪ 1e-6 px).
const UNDISTORT_TOLERANCE: f64 = 1e-12;

/// A calibrated camera: which pixel sees which point of the platen frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "CameraSpec", into = "CameraSpec")]
pub struct CameraModel {
    width_px: u32,
    height_px: u32,
    focal_length_px: f64,
    #[schemars(with = "[f64; 2]")]
    principal_point_px: Vector2<f64>,
    distortion: Distortion,
    pose: CameraPose,
    /// Turns image directions (x right, y down) into platen directions; its own inverse's transpose.
    platen_from_image: Matrix2<f64>,
}

impl CameraModel {
    /// Checks a description.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if a number is out of range, if both or neither of `focal_length_px` and `platen_m_per_px` are
    /// given, or if the distortion folds the image over, so that a pixel would see two places.
    pub fn new(spec: CameraSpec) -> Result<Self, OutOfRange> {
        const SIZE: &str = "16 to 4096 px";
        let size_ok = |size| (16..=4096).contains(&size);
        OutOfRange::unless(size_ok(spec.width_px), "width_px", spec.width_px.into(), SIZE)?;
        OutOfRange::unless(size_ok(spec.height_px), "height_px", spec.height_px.into(), SIZE)?;
        let pose = spec.pose;
        for (field, value) in [("pose.x_m", pose.x_m), ("pose.y_m", pose.y_m), ("pose.yaw_rad", pose.yaw_rad)] {
            OutOfRange::unless(value.is_finite(), field, value, "a finite number")?;
        }
        let height_ok = pose.height_m > 0.0 && pose.height_m <= 100.0;
        OutOfRange::unless(height_ok, "pose.height_m", pose.height_m, "above 0 up to 100 m")?;
        let focal_length_px = match (spec.focal_length_px, spec.platen_m_per_px) {
            (Some(focal_length_px), None) => focal_length_px,
            (None, Some(platen_m_per_px)) => {
                let ok = platen_m_per_px > 0.0 && platen_m_per_px.is_finite();
                OutOfRange::unless(ok, "platen_m_per_px", platen_m_per_px, "above 0")?;
                pose.height_m / platen_m_per_px
            }
            (focal_length_px, _) => {
                return Err(OutOfRange::new(
                    "focal_length_px",
                    focal_length_px.unwrap_or(f64::NAN),
                    "given exactly if platen_m_per_px is not",
                ));
            }
        };
        let focal_ok = (1.0..=1e6).contains(&focal_length_px);
        OutOfRange::unless(focal_ok, "focal_length_px", focal_length_px, "1 to 1e6 px")?;
        let middle = [f64::from(spec.width_px - 1) / 2.0, f64::from(spec.height_px - 1) / 2.0];
        let principal_point_px = Vector2::from(spec.principal_point_px.unwrap_or(middle));
        for value in principal_point_px.iter() {
            OutOfRange::unless(value.abs() <= 1e5, "principal_point_px", *value, "-1e5 to 1e5 px")?;
        }
        let d = spec.distortion;
        for (field, value) in [
            ("distortion.k1", d.k1),
            ("distortion.k2", d.k2),
            ("distortion.p1", d.p1),
            ("distortion.p2", d.p2),
            ("distortion.k3", d.k3),
        ] {
            OutOfRange::unless(value.is_finite(), field, value, "a finite number")?;
        }
        let (sin, cos) = pose.yaw_rad.sin_cos();
        let camera = Self {
            width_px: spec.width_px,
            height_px: spec.height_px,
            focal_length_px,
            principal_point_px,
            distortion: d,
            pose,
            platen_from_image: Matrix2::new(cos, sin, sin, -cos),
        };
        camera.require_invertible()?;
        Ok(camera)
    }

    /// Every pixel of a coarse grid up to the border must undistort, without the lens folding over on the way.
    fn require_invertible(&self) -> Result<(), OutOfRange> {
        const STEPS: u32 = 16;
        for row in 0..=STEPS {
            for column in 0..=STEPS {
                let fraction = |step: u32, size: u32| f64::from(step) / f64::from(STEPS) * f64::from(size);
                let pixel = Point2::new(fraction(column, self.width_px) - 0.5, fraction(row, self.height_px) - 0.5);
                let invertible = self
                    .undistort(self.distorted_ray(pixel))
                    .is_some_and(|ray| self.distort(ray).1.determinant() > 0.0);
                OutOfRange::unless(
                    invertible,
                    "distortion.k1",
                    self.distortion.k1,
                    "coefficients that keep the image one-to-one",
                )?;
            }
        }
        Ok(())
    }

    /// The same camera above another place of the platen.
    #[must_use]
    pub fn shifted(&self, x_m: f64, y_m: f64) -> Self {
        let pose = CameraPose { x_m: self.pose.x_m + x_m, y_m: self.pose.y_m + y_m, ..self.pose };
        Self { pose, ..self.clone() }
    }

    /// Image width, px.
    #[must_use]
    pub fn width_px(&self) -> u32 {
        self.width_px
    }

    /// Image height, px.
    #[must_use]
    pub fn height_px(&self) -> u32 {
        self.height_px
    }

    /// Focal length, px.
    #[must_use]
    pub fn focal_length_px(&self) -> f64 {
        self.focal_length_px
    }

    /// Lens distortion.
    #[must_use]
    pub fn distortion(&self) -> Distortion {
        self.distortion
    }

    /// Where the camera hangs.
    #[must_use]
    pub fn pose(&self) -> CameraPose {
        self.pose
    }

    /// The intrinsic matrix K, px, as in `sensor_msgs/CameraInfo`.
    #[must_use]
    pub fn intrinsics_px(&self) -> Matrix3<f64> {
        let (f, c) = (self.focal_length_px, self.principal_point_px);
        Matrix3::new(f, 0.0, c.x, 0.0, f, c.y, 0.0, 0.0, 1.0)
    }

    /// Pose of the optical frame (x right, y down, z into the scene) in the platen frame.
    #[must_use]
    pub fn platen_from_camera(&self) -> Isometry3<f64> {
        let turn = Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), self.pose.yaw_rad)
            * Rotation3::from_axis_angle(&nalgebra::Vector3::x_axis(), std::f64::consts::PI);
        Isometry3::from_parts(
            Translation3::new(self.pose.x_m, self.pose.y_m, self.pose.height_m),
            UnitQuaternion::from_rotation_matrix(&turn),
        )
    }

    /// Size of a pixel on the plane `height_m` above the platen, m/px, on the optical axis.
    #[must_use]
    pub fn m_per_px(&self, height_m: f64) -> f64 {
        (self.pose.height_m - height_m) / self.focal_length_px
    }

    /// The pixel that sees a point given in the platen frame, in or out of the image; `None` for a point not below the camera.
    #[must_use]
    pub fn project(&self, point: Point3<f64>) -> Option<Point2<f64>> {
        let depth_m = self.pose.height_m - point.z;
        (depth_m > 0.0).then(|| {
            let offset = Vector2::new(point.x - self.pose.x_m, point.y - self.pose.y_m);
            let ray = self.platen_from_image.transpose() * offset / depth_m;
            Point2::from(self.distort(ray).0 * self.focal_length_px + self.principal_point_px)
        })
    }

    /// How the pixel that sees `point` moves with the point's x and y, px/m; `None` for a point not below the camera.
    #[must_use]
    pub fn projection_jacobian(&self, point: Point3<f64>) -> Option<Matrix2<f64>> {
        let depth_m = self.pose.height_m - point.z;
        (depth_m > 0.0).then(|| {
            let offset = Vector2::new(point.x - self.pose.x_m, point.y - self.pose.y_m);
            let image_from_platen = self.platen_from_image.transpose();
            let ray = image_from_platen * offset / depth_m;
            self.distort(ray).1 * image_from_platen * (self.focal_length_px / depth_m)
        })
    }

    /// The point (x, y) of the platen frame that a pixel sees on the plane `height_m` above the platen; `None` if the
    /// plane is not below the camera or the pixel lies where the distortion cannot be undone.
    #[must_use]
    pub fn back_project(&self, pixel: Point2<f64>, height_m: f64) -> Option<Point2<f64>> {
        let depth_m = self.pose.height_m - height_m;
        if depth_m <= 0.0 {
            return None;
        }
        let ray = self.ray(pixel)?;
        Some(Point2::new(self.pose.x_m, self.pose.y_m) + ray * depth_m)
    }

    /// Direction a pixel looks in: (x, y) in the platen frame gained per metre of descent.
    pub fn ray(&self, pixel: Point2<f64>) -> Option<Vector2<f64>> {
        Some(self.platen_from_image * self.undistort(self.distorted_ray(pixel))?)
    }

    /// Turns platen directions into image directions (x right, y down).
    pub fn image_from_platen(&self) -> Matrix2<f64> {
        self.platen_from_image.transpose()
    }

    fn distorted_ray(&self, pixel: Point2<f64>) -> Vector2<f64> {
        (pixel.coords - self.principal_point_px) / self.focal_length_px
    }

    /// The distorted place of an ideal normalised image point, and its Jacobian.
    fn distort(&self, ideal: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let Distortion { k1, k2, p1, p2, k3 } = self.distortion;
        let (x, y) = (ideal.x, ideal.y);
        let r2 = ideal.norm_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let radial_slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3));
        let distorted = Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = radial_slope * x * y + 2.0 * (p1 * x + p2 * y);
        let jacobian = Matrix2::new(
            radial + radial_slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + radial_slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (distorted, jacobian)
    }

    fn undistort(&self, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
        let mut ideal = distorted;
        for _ in 0..UNDISTORT_ITERATIONS {
            let (reached, jacobian) = self.distort(ideal);
            let miss = distorted - reached;
            if miss.norm() <= UNDISTORT_TOLERANCE {
                return Some(ideal);
            }
            ideal += jacobian.try_inverse()? * miss;
        }
        None
    }
}

impl TryFrom<CameraSpec> for CameraModel {
    type Error = OutOfRange;

    fn try_from(spec: CameraSpec) -> Result<Self, OutOfRange> {
        Self::new(spec)
    }
}

impl From<CameraModel> for CameraSpec {
    fn from(camera: CameraModel) -> Self {
        Self {
            width_px: camera.width_px,
            height_px: camera.height_px,
            focal_length_px: Some(camera.focal_length_px),
            platen_m_per_px: None,
            principal_point_px: Some(camera.principal_point_px.into()),
            distortion: camera.distortion,
            pose: camera.pose,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn spec() -> CameraSpec {
        CameraSpec {
            width_px: 640,
            height_px: 480,
            focal_length_px: None,
            platen_m_per_px: Some(0.000_43),
            principal_point_px: None,
            distortion: Distortion::default(),
            pose: CameraPose { x_m: 0.2, y_m: 0.1, height_m: 0.6, yaw_rad: 0.0 },
        }
    }

    #[test]
    fn looks_straight_down_with_x_right_and_platen_y_up() {
        let camera = CameraModel::new(spec()).unwrap();
        let right = camera.project(Point3::new(0.2 + 0.043, 0.1, 0.0)).unwrap();
        let up = camera.project(Point3::new(0.2, 0.1 + 0.043, 0.0)).unwrap();
        assert!((right - Point2::new(319.5 + 100.0, 239.5)).norm() < 1e-9);
        assert!((up - Point2::new(319.5, 239.5 - 100.0)).norm() < 1e-9);
        assert_eq!(camera.project(Point3::new(0.2, 0.1, 0.6)), None);
        assert_eq!(camera.back_project(Point2::new(3.0, 4.0), 0.7), None);
    }

    #[test]
    fn projection_agrees_with_the_optical_frame() {
        let mut turned = spec();
        turned.pose.yaw_rad = 0.7;
        let camera = CameraModel::new(turned).unwrap();
        let point = Point3::new(0.23, 0.07, 0.05);
        let in_camera = camera.platen_from_camera().inverse_transform_point(&point);
        let pixel = camera.intrinsics_px() * in_camera.coords / in_camera.z;
        assert!((camera.project(point).unwrap().coords - pixel.xy()).norm() < 1e-9);
    }

    #[test]
    fn bad_descriptions_are_refused_with_the_field() {
        let refused = |change: fn(&mut CameraSpec)| {
            let mut bad = spec();
            change(&mut bad);
            CameraModel::new(bad).unwrap_err().parameter
        };
        assert_eq!(refused(|s| s.width_px = 0), "width_px");
        assert_eq!(refused(|s| s.pose.height_m = -1.0), "pose.height_m");
        assert_eq!(refused(|s| s.pose.x_m = f64::NAN), "pose.x_m");
        assert_eq!(refused(|s| s.platen_m_per_px = None), "focal_length_px");
        assert_eq!(refused(|s| s.focal_length_px = Some(1000.0)), "focal_length_px");
        assert_eq!(refused(|s| s.platen_m_per_px = Some(0.0)), "platen_m_per_px");
        assert_eq!(refused(|s| s.principal_point_px = Some([f64::NAN, 0.0])), "principal_point_px");
        assert_eq!(refused(|s| s.distortion.k1 = -20.0), "distortion.k1");
        assert_eq!(refused(|s| s.distortion.p2 = f64::INFINITY), "distortion.p2");
    }

    proptest! {
        #[test]
        fn back_projection_undoes_projection(
            x_m in -0.12..0.12, y_m in -0.09..0.09, z_m in 0.0..0.1, yaw_rad in -3.2..3.2,
            k1 in -0.3..0.3, k2 in -0.2..0.2, p1 in -0.01..0.01, p2 in -0.01..0.01,
        ) {
            let mut spec = spec();
            spec.pose.yaw_rad = yaw_rad;
            spec.distortion = Distortion { k1, k2, p1, p2, k3: 0.01 };
            let camera = CameraModel::new(spec).unwrap();
            let point = Point3::new(0.2 + x_m, 0.1 + y_m, z_m);
            let pixel = camera.project(point).unwrap();
            let seen = camera.back_project(pixel, z_m).unwrap();
            prop_assert!((seen - point.xy()).norm() < 1e-9);
        }

        #[test]
        fn jacobian_is_the_slope_of_the_projection(x_m in -0.1..0.1, y_m in -0.1..0.1, k1 in -0.2..0.2, p1 in -0.01..0.01) {
            let mut spec = spec();
            spec.distortion = Distortion { k1, p1, ..Distortion::default() };
            spec.pose.yaw_rad = 0.4;
            let camera = CameraModel::new(spec).unwrap();
            let at = |dx: f64, dy: f64| camera.project(Point3::new(0.2 + x_m + dx, 0.1 + y_m + dy, 0.07)).unwrap();
            let jacobian = camera.projection_jacobian(Point3::new(0.2 + x_m, 0.1 + y_m, 0.07)).unwrap();
            let h = 1e-5;
            let numeric = Matrix2::from_columns(&[(at(h, 0.0) - at(-h, 0.0)) / (2.0 * h), (at(0.0, h) - at(0.0, -h)) / (2.0 * h)]);
            // Central differences: truncation of order h², far below 1e-2 of some 2,000 px/m.
            prop_assert!((numeric - jacobian).norm() < 1e-2);
        }
    }
}
