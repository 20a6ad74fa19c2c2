//! The plateau as the camera sees it at one pose of the tray.

use std::f64::consts::TAU;

use nalgebra::{Isometry2, Matrix2, Point2, Point3, Vector2};

use feeder_model::camera::{CameraModel, MountedTray, grey_level};

/// Pixels at the border of the image that are never looked at, so that filters need no border of their own.
pub(super) const BORDER_PX: usize = 2;
/// Points taken on each arc of the plateau's outline to find what part of the image it fills.
const OUTLINE_STEPS: u32 = 48;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Window {
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

impl Window {
    pub(super) fn len(&self) -> usize {
        self.width * self.height
    }

    /// A pixel and those that touch it, diagonals too.
    pub(super) fn about(&self, index: usize) -> impl Iterator<Item = usize> + use<> {
        let Self { width, height, .. } = *self;
        let near = |at: usize, size: usize| at.saturating_sub(1)..(at + 2).min(size);
        let columns = near(index % width.max(1), width);
        near(index / width.max(1), height).flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }
}

/// Camera, tray and pose together: from pixels to the tray frame and back.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    pub camera: &'a CameraModel,
    pub tray: &'a MountedTray,
    pub platen_from_tray: Isometry2<f64>,
}

impl View<'_> {
    /// The point of the tray frame that a pixel sees on the plane `height_m` above the platen.
    pub(super) fn tray_point(&self, pixel: Point2<f64>, height_m: f64) -> Option<Point2<f64>> {
        let on_platen = self.camera.back_project(pixel, height_m)?;
        Some(self.platen_from_tray.inverse_transform_point(&on_platen))
    }

    /// The pixel that sees a point of the tray frame on the plane `height_m` above the platen.
    pub(super) fn pixel(&self, point: Point2<f64>, height_m: f64) -> Option<Point2<f64>> {
        self.camera.project(self.in_platen(point, height_m))
    }

    /// How the pixel moves with the point, px/m.
    pub(super) fn px_from_tray(&self, point: Point2<f64>, height_m: f64) -> Option<Matrix2<f64>> {
        let px_from_platen = self.camera.projection_jacobian(self.in_platen(point, height_m))?;
        Some(px_from_platen * self.platen_from_tray.rotation.to_rotation_matrix().matrix())
    }

    /// Where a point of the tray frame is from below the camera, platen frame, m.
    pub(super) fn beside_camera_m(&self, point: Point2<f64>) -> Vector2<f64> {
        let pose = self.camera.pose();
        (self.platen_from_tray * point).coords - Vector2::new(pose.x_m, pose.y_m)
    }

    /// How far outwards, in the platen frame, the line of sight through a point leads per metre of descent.
    pub(super) fn slant(&self, point: Point2<f64>, height_m: f64) -> Vector2<f64> {
        self.beside_camera_m(point) / (self.camera.pose().height_m - height_m)
    }

    fn in_platen(&self, point: Point2<f64>, height_m: f64) -> Point3<f64> {
        let on_platen = self.platen_from_tray * point;
        Point3::new(on_platen.x, on_platen.y, height_m)
    }

    /// Points on the plateau's outline, tray frame, m.
    pub(super) fn outline_of_plateau(tray: &MountedTray) -> Vec<Point2<f64>> {
        let geometry = &tray.geometry;
        let at = |step: u32| {
            let share = f64::from(step) / f64::from(OUTLINE_STEPS);
            let (sin, cos) = (geometry.ramp_angle_rad + share * (TAU - geometry.ramp_angle_rad)).sin_cos();
            [geometry.inner_radius_m, geometry.outer_radius_m].map(|radius_m| Point2::new(cos, sin) * radius_m)
        };
        (0..=OUTLINE_STEPS).flat_map(at).collect()
    }

    /// The pixels that may see the plateau; `None` if none does.
    pub(super) fn plateau_window(&self) -> Option<Window> {
        let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        for place in Self::outline_of_plateau(self.tray) {
            let pixel = self.pixel(place, self.tray.plateau_height_m())?;
            low = low.inf(&pixel.coords);
            high = high.sup(&pixel.coords);
        }
        let range = |low: f64, high: f64, size: u32| {
            let last = size as usize - 1 - BORDER_PX;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
            let (low, high) = (low.floor() as usize, high.ceil().max(0.0) as usize);
            let (low, high) = (low.max(BORDER_PX), high.min(last));
            (low <= high).then(|| (low, high + 1 - low))
        };
        let (left, width) = range(low.x, high.x, self.camera.width_px())?;
        let (top, height) = range(low.y, high.y, self.camera.height_px())?;
        Some(Window { left, top, width, height })
    }
}

/// Directions of sight of all pixels, to map whole rows quickly.
#[derive(Clone, Debug)]
pub(super) struct RayTable {
    width: usize,
    /// Per metre of descent, in the platen frame; NaN where the lens cannot be undone.
    x: Vec<f32>,
    y: Vec<f32>,
}

impl RayTable {
    pub(super) fn new(camera: &CameraModel) -> Self {
        let (mut x, mut y) = (Vec::new(), Vec::new());
        for row in 0..camera.height_px() {
            for column in 0..camera.width_px() {
                let ray = camera.ray(Point2::new(f64::from(column), f64::from(row)));
                let ray = ray.unwrap_or(Vector2::repeat(f64::NAN)).map(feeder_model::camera::single);
                x.push(ray.x);
                y.push(ray.y);
            }
        }
        Self { width: camera.width_px() as usize, x, y }
    }

    /// For each pixel of a row of the window: 0 off the plateau and where the hub or the outer wall hides it, otherwise 1 +
    /// the distance from the inner wall in units of `bin_m`; what the walls make of the light there, as `profile` tells by
    /// this bin; and the direction from the tray's centre, in the platen's axes.
    #[expect(clippy::too_many_arguments, reason = "two inputs and three outputs, row by row")]
    pub(super) fn plateau_row(
        &self,
        view: &View,
        window: Window,
        row: usize,
        bin_m: f64,
        profile: &[[f32; 3]],
        bins: &mut [u8],
        shades: &mut [f32],
        outwards: &mut [[f32; 2]],
    ) {
        let single = feeder_model::camera::single;
        let geometry = &view.tray.geometry;
        let pose = view.camera.pose();
        let eye = view.platen_from_tray.inverse_transform_point(&Point2::new(pose.x_m, pose.y_m)).map(single);
        let depth_m = pose.height_m - view.tray.plateau_height_m();
        let yaw = view.platen_from_tray.rotation;
        let (cos, sin) = (single(yaw.re * depth_m), single(yaw.im * depth_m));
        // A line of sight passes the top of the walls this share of the way to the plateau.
        let wall_share = single((pose.height_m - view.tray.wall_top_m()) / depth_m);
        let (ramp_sin, ramp_cos) = geometry.ramp_angle_rad.sin_cos();
        let (ramp_sin, ramp_cos) = (single(ramp_sin), single(ramp_cos));
        let wide = geometry.ramp_angle_rad < std::f64::consts::PI;
        let (inner, outer) = (single(geometry.inner_radius_m), single(geometry.outer_radius_m));
        let bins_per_m = single(1.0 / bin_m);
        let start = (window.top + row) * self.width + window.left;
        let rays = self.x[start..start + window.width].iter().zip(&self.y[start..start + window.width]);
        let (yaw_cos, yaw_sin) = (single(yaw.re), single(yaw.im));
        for ((bin, outward), (ray_x, ray_y)) in bins.iter_mut().zip(&mut *outwards).zip(rays) {
            let (along_x, along_y) = (cos * ray_x + sin * ray_y, cos * ray_y - sin * ray_x);
            let (x, y) = (eye.x + along_x, eye.y + along_y);
            let radius = (x * x + y * y).sqrt();
            let (top_x, top_y) = (eye.x + wall_share * along_x, eye.y + wall_share * along_y);
            let top_radius = (top_x * top_x + top_y * top_y).sqrt();
            let beyond_ramp = ramp_cos * y - ramp_sin * x;
            let sector = if wide { (-y).max(beyond_ramp) } else { (-y).min(beyond_ramp) };
            let between = |radius: f32| (radius > inner) & (radius < outer);
            let inside = (sector > 0.0) & between(radius) & between(top_radius);
            // The nearest whole number to half a bin further on is 1 + the bins that are full.
            let number = grey_level((radius - inner) * bins_per_m + 0.5).max(1);
            *bin = if inside { number } else { 0 };
            // The direction from the tray's centre, in the platen's axes.
            let per_m = 1.0 / radius.max(1e-6);
            *outward = [(yaw_cos * x - yaw_sin * y) * per_m, (yaw_sin * x + yaw_cos * y) * per_m];
        }
        for ((shade, bin), [x, y]) in shades.iter_mut().zip(bins).zip(outwards) {
            let [constant, cos, sin] = profile.get(usize::from(*bin)).copied().unwrap_or([1.0, 0.0, 0.0]);
            *shade = constant + cos * *x + sin * *y;
        }
    }
}
