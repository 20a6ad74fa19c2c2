//! Scenes, pictures of them, and what is taught from these.

use std::sync::LazyLock;

use super::*;
use feeder_model::camera::{CameraPose, CameraSpec, Distortion};
use feeder_model::tray::TrayGeometry;
use feeder_scenario::PartSource;
use feeder_sim::camera::{PartSolid, PartView, SensorModel, TrayAppearance, TrayShot};

/// Radius of the grommet's flange, m.
pub(super) const RADIUS_M: f64 = 0.002_5;

pub(super) static GROMMET: LazyLock<PartType> = LazyLock::new(|| catalogue("grommet"));

pub(super) fn catalogue(name: &str) -> PartType {
    PartSource::Name(name.to_owned()).part_type().unwrap()
}

pub(crate) fn camera() -> CameraModel {
    CameraModel::new(CameraSpec {
        width_px: 640,
        height_px: 480,
        focal_length_px: Some((0.6 - 0.07) / 0.000_4),
        platen_m_per_px: None,
        principal_point_px: None,
        distortion: Distortion { k1: -0.05, p1: 0.000_5, ..Distortion::default() },
        pose: CameraPose { x_m: 0.3, y_m: 0.3, height_m: 0.6, yaw_rad: 0.0 },
    })
    .unwrap()
}

pub(super) fn scene(part: &PartType, noise_sigma_levels: f64) -> Scene {
    Scene {
        camera: camera(),
        tray: MountedTray::new(TrayGeometry::PAPER),
        tray_appearance: TrayAppearance::default(),
        part: PartSolid::new(part.mesh.clone(), &part.poses),
        light: LightModel::default(),
        sensor: SensorModel { noise_sigma_levels, ..SensorModel::default() },
    }
}

pub(crate) fn at(radius_m: f64, psi_rad: f64, pose: usize) -> LaidPart {
    LaidPart { pose, place: Point2::new(radius_m * psi_rad.cos(), radius_m * psi_rad.sin()), yaw_rad: 0.0 }
}

pub(crate) fn over_camera() -> Isometry2<f64> {
    Isometry2::new(Vector2::new(0.3, 0.34), 0.0)
}

pub(super) fn views(parts: &[LaidPart]) -> Vec<PartView> {
    let view = |part: &LaidPart| PartView {
        x_m: part.place.x,
        y_m: part.place.y,
        z_m: TrayGeometry::PAPER.height_m(part.place.y.atan2(part.place.x)),
        yaw_rad: part.yaw_rad,
        pose: part.pose,
        ..PartView::default()
    };
    parts.iter().map(view).collect()
}

pub(super) fn shoot(
    renderer: &mut Renderer,
    pose: &Isometry2<f64>,
    parts: &[LaidPart],
    noise: &mut Pcg64Mcg,
) -> GrayImage {
    let mut image = GrayImage::default();
    renderer.render(&TrayShot::still(*pose), &views(parts), noise, &mut image).unwrap();
    image
}

/// Paints places of the plateau of a tray under the camera.
pub(super) fn paint(image: &mut GrayImage, scene: &Scene, places: impl Iterator<Item = Point2<f64>>, level: u8) {
    let view = view::View { camera: &scene.camera, tray: &scene.tray, platen_from_tray: over_camera() };
    for place in places {
        let pixel = view.pixel(place, scene.tray.plateau_height_m()).unwrap();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the image")]
        image.put_pixel(pixel.x.round() as u32, pixel.y.round() as u32, Luma([level]));
    }
}

/// A picture of grommets with little noise and the tray under the camera.
pub(crate) fn simple_picture(parts: &[LaidPart]) -> GrayImage {
    shoot(&mut Renderer::new(&scene(&GROMMET, 2.0)).unwrap(), &over_camera(), parts, &mut Pcg64Mcg::seed_from_u64(11))
}

/// A picture of the tray there, with nothing in it and no noise.
pub(crate) fn empty_tray(pose: &Isometry2<f64>) -> GrayImage {
    shoot(&mut Renderer::new(&scene(&GROMMET, 0.0)).unwrap(), pose, &[], &mut Pcg64Mcg::seed_from_u64(11))
}

/// Parts strewn over the plateau, `apart_m` from centre to centre at least.
pub(super) fn strewn(
    part: &PartType,
    pose: Option<usize>,
    count: usize,
    apart_m: f64,
    random: &mut Pcg64Mcg,
) -> Vec<LaidPart> {
    let reach_m = part.outline_radius_m();
    let tray = MountedTray::new(TrayGeometry::PAPER);
    let mut parts: Vec<LaidPart> = Vec::new();
    for _ in 0..2_000 {
        let radius_m = random.random_range(0.030 + reach_m..0.090 - reach_m);
        let laid = LaidPart {
            yaw_rad: random.random_range(0.0..TAU),
            ..at(
                radius_m,
                random.random_range(-TAU / 2.0..0.0),
                pose.unwrap_or(random.random_range(0..part.poses.len())),
            )
        };
        let free = parts.iter().all(|other| (other.place - laid.place).norm() >= apart_m);
        if parts.len() < count && free && tray.inside_sector_m(laid.place) > reach_m {
            parts.push(laid);
        }
    }
    parts
}

pub(super) fn drawing(part: &PartType) -> TeachSpec {
    let pose = |pose: &feeder_model::geometry::StablePose| PoseSpec {
        height_m: pose.height_m,
        outline_m: pose.outline.corners_m.clone(),
        yaw_symmetry: pose.yaw_symmetry,
    };
    TeachSpec { poses: part.poses.iter().map(pose).collect(), contrast_min_levels: 10.0 }
}

pub(super) fn taught(part: &PartType) -> PartModel {
    let scene = scene(part, 2.0);
    let mut renderer = Renderer::new(&scene).unwrap();
    let mut random = Pcg64Mcg::seed_from_u64(42);
    let mut lessons: Vec<Vec<LaidPart>> = vec![Vec::new(); 6];
    for pose in 0..part.poses.len() {
        let apart_m = 2.0 * part.outline_radius_m() + 0.004;
        lessons.extend((0..16).map(|_| strewn(part, Some(pose), 9, apart_m, &mut random)));
    }
    let images: Vec<GrayImage> =
        lessons.iter().map(|parts| shoot(&mut renderer, &over_camera(), parts, &mut random)).collect();
    let lit = Lit::new(&scene, &lessons, &mut random);
    teach(&frames(&images, &lessons), &lit.frames(), &scene.camera, &scene.tray, &drawing(part)).unwrap()
}

/// Pictures of parts in other lights.
pub(super) struct Lit {
    all_round: [Vec<GrayImage>; LIGHTS_ALL_ROUND],
    from_side: Vec<(f64, Vec<GrayImage>)>,
    lessons: Vec<Vec<LaidPart>>,
    /// Those shown in light from each side.
    from_side_lessons: Vec<Vec<LaidPart>>,
}

impl Lit {
    pub(super) fn new(scene: &Scene, lessons: &[Vec<LaidPart>], noise: &mut Pcg64Mcg) -> Self {
        let mut rings = AllRound::of_lessons(scene).unwrap();
        let all_round = std::array::from_fn(|light| {
            lessons.iter().map(|parts| shoot_all_round(&mut rings[light], parts, noise)).collect()
        });
        // Of many, a few for each of the six lamps are enough.
        let every = if lessons.len() > 20 { 4 } else { 1 };
        let from_side_lessons: Vec<Vec<LaidPart>> = lessons.iter().step_by(every).cloned().collect();
        let [.., low] = &mut rings;
        let from_side = low.lamps().map(|(azimuth_rad, lamp)| {
            (azimuth_rad, from_side_lessons.iter().map(|parts| shoot(lamp, &over_camera(), parts, noise)).collect())
        });
        let from_side = from_side.collect();
        Self { all_round, from_side, lessons: lessons.to_vec(), from_side_lessons }
    }

    pub(super) fn frames(&self) -> OtherLights<'_> {
        OtherLights {
            all_round: std::array::from_fn(|light| frames(&self.all_round[light], &self.lessons)),
            from_side: self
                .from_side
                .iter()
                .map(|(azimuth_rad, images)| (*azimuth_rad, frames(images, &self.from_side_lessons)))
                .collect(),
        }
    }
}

/// A picture under a ring of lamps, the tray under the camera.
pub(super) fn shoot_all_round(ring: &mut AllRound, parts: &[LaidPart], noise: &mut Pcg64Mcg) -> GrayImage {
    let mut image = GrayImage::default();
    ring.render(&TrayShot::still(over_camera()), &views(parts), noise, &mut image).unwrap();
    image
}

pub(super) fn frames<'a>(images: &'a [GrayImage], lessons: &'a [Vec<LaidPart>]) -> Vec<TeachFrame<'a>> {
    let frame = |(image, parts)| TeachFrame { image, platen_from_tray: over_camera(), parts };
    images.iter().zip(lessons.iter().map(Vec::as_slice)).map(frame).collect()
}

pub(super) static MODEL: LazyLock<PartModel> = LazyLock::new(|| taught(&GROMMET));
pub(super) static COIN: LazyLock<PartModel> = LazyLock::new(|| taught(&catalogue("coin")));
pub(super) static NUT: LazyLock<PartModel> = LazyLock::new(|| taught(&catalogue("hex_nut")));

pub(super) fn selector() -> Selector {
    let scene = scene(&GROMMET, 2.0);
    Selector::new(SelectorConfig::default(), &scene.camera, &scene.tray, &MODEL).unwrap()
}
