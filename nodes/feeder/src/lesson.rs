//! The teaching session: parts are laid on the plateau, pictures taken, and the selector learns from those.

use std::f64::consts::TAU;

use feeder_model::geometry::StablePose;
use feeder_sim::camera::{AllRound, PartView, Renderer, Scene, TrayShot};
use feeder_vision::{LIGHTS_ALL_ROUND, LaidPart, OtherLights, PartModel, PoseSpec, TeachFrame, TeachSpec, teach};
use image::GrayImage;
use nalgebra::{Isometry2, Point2};
use rand::{Rng, RngExt};

/// Pictures of the bare plateau, of each pose that looks the same from all sides, and of each other one: it must be shown at
/// all yaws.
const BARE_FRAMES: usize = 6;
const FRAMES_OF_ROUND: usize = 16;
const FRAMES_OF_TURNED: usize = 40;
/// Pictures of each pose, and of the bare plateau, in each light from all sides: no yaw matters there.
const FRAMES_OF_LIT: usize = 16;
const BARE_FRAMES_LIT: usize = 3;
/// The same for each lamp of the low ring.
const FRAMES_OF_LAMP: usize = 4;
/// Parts laid for each picture at most.
const PARTS_PER_FRAME: usize = 9;
/// Free room round a part that is shown, m: its shadow must fall on no other.
const ROOM_M: f64 = 0.004;

/// A picture, and the parts laid for it.
type Shown = (GrayImage, Vec<LaidPart>);

/// Shows the selector pictures of a part, as `scene` yields them with the tray at `platen_from_tray`.
pub fn taught(
    scene: &Scene,
    poses: &[StablePose],
    platen_from_tray: &Isometry2<f64>,
    contrast_min_levels: f64,
    random: &mut impl Rng,
) -> anyhow::Result<PartModel> {
    let mut renderer = Renderer::new(scene)?;
    let mut shots: Vec<Shown> = Vec::new();
    let shot = TrayShot::still(*platen_from_tray);
    let views = |parts: &[LaidPart]| -> Vec<PartView> { parts.iter().map(|part| view(part, scene)).collect() };
    let mut shoot = |parts: Vec<LaidPart>, random: &mut _| -> anyhow::Result<()> {
        let mut image = GrayImage::default();
        renderer.render(&shot, &views(&parts), random, &mut image)?;
        shots.push((image, parts));
        Ok(())
    };
    for _ in 0..BARE_FRAMES {
        shoot(Vec::new(), random)?;
    }
    for (pose, stable) in poses.iter().enumerate() {
        let frames = if stable.yaw_symmetry == 0 { FRAMES_OF_ROUND } else { FRAMES_OF_TURNED };
        for _ in 0..frames {
            let parts = laid_out(scene, pose, stable, random);
            shoot(parts, random)?;
        }
    }
    let mut lit: [Vec<Shown>; LIGHTS_ALL_ROUND] = std::array::from_fn(|_| Vec::new());
    let shown = |frames: usize| {
        let bare = std::iter::repeat_n(None, BARE_FRAMES_LIT);
        bare.chain(poses.iter().enumerate().flat_map(move |pose| std::iter::repeat_n(Some(pose), frames)))
    };
    let laid = |pose: Option<(usize, &StablePose)>, random: &mut _| {
        pose.map_or_else(Vec::new, |(pose, stable)| laid_out(scene, pose, stable, random))
    };
    let mut rings = AllRound::of_lessons(scene)?;
    for (shots, ring) in lit.iter_mut().zip(&mut rings) {
        for pose in shown(FRAMES_OF_LIT) {
            let parts = laid(pose, random);
            let mut image = GrayImage::default();
            ring.render(&shot, &views(&parts), random, &mut image)?;
            shots.push((image, parts));
        }
    }
    let mut from_side: Vec<(f64, Vec<Shown>)> = Vec::new();
    let [.., low] = &mut rings;
    for (azimuth_rad, lamp) in low.lamps() {
        let mut shots: Vec<Shown> = Vec::new();
        for pose in shown(FRAMES_OF_LAMP) {
            let parts = laid(pose, random);
            let mut image = GrayImage::default();
            lamp.render(&shot, &views(&parts), random, &mut image)?;
            shots.push((image, parts));
        }
        from_side.push((azimuth_rad, shots));
    }
    let spec = TeachSpec {
        poses: poses
            .iter()
            .map(|pose| PoseSpec {
                height_m: pose.height_m,
                outline_m: pose.outline.corners_m.clone(),
                yaw_symmetry: pose.yaw_symmetry,
            })
            .collect(),
        contrast_min_levels,
    };
    let other_lights = OtherLights {
        all_round: std::array::from_fn(|light| frames(&lit[light], platen_from_tray)),
        from_side: from_side
            .iter()
            .map(|(azimuth_rad, shots)| (*azimuth_rad, frames(shots, platen_from_tray)))
            .collect(),
    };
    Ok(teach(&frames(&shots, platen_from_tray), &other_lights, &scene.camera, &scene.tray, &spec)?)
}

/// Pictures as a lesson takes them.
fn frames<'a>(shots: &'a [Shown], platen_from_tray: &Isometry2<f64>) -> Vec<TeachFrame<'a>> {
    let frame = |(image, parts): &'a Shown| TeachFrame { image, platen_from_tray: *platen_from_tray, parts };
    shots.iter().map(frame).collect()
}

/// A laid part as the camera sees it.
pub fn view(part: &LaidPart, scene: &Scene) -> PartView {
    PartView {
        x_m: part.place.x,
        y_m: part.place.y,
        z_m: scene.tray.geometry.rise_m,
        yaw_rad: part.yaw_rad,
        pose: part.pose,
        ..PartView::default()
    }
}

/// Parts of one pose strewn over the plateau with room between them, turned at random. They lie at the walls too, where the
/// walls hide some of them: that is where vibration takes them.
fn laid_out(scene: &Scene, pose: usize, stable: &StablePose, random: &mut impl Rng) -> Vec<LaidPart> {
    const TRIES: usize = 400;
    let tray = &scene.tray.geometry;
    let outline = &stable.outline;
    let reach_m = outline.radius_m;
    let walls_m = tray.inner_radius_m..tray.outer_radius_m;
    // What is not round touches a wall nearer to it than it reaches when it is turned.
    let margin_m = if outline.round { reach_m } else { 0.0 };
    let mut parts: Vec<LaidPart> = Vec::new();
    for _ in 0..TRIES {
        let radius_m = random.random_range(walls_m.start + margin_m..walls_m.end - margin_m);
        let angle_rad = random.random_range(tray.ramp_angle_rad..TAU);
        let place = Point2::new(radius_m * angle_rad.cos(), radius_m * angle_rad.sin());
        let free = parts.iter().all(|part| (part.place - place).norm() > 2.0 * reach_m + ROOM_M);
        if free && scene.tray.inside_sector_m(place) > reach_m && parts.len() < PARTS_PER_FRAME {
            let yaw_rad = random.random_range(0.0..TAU);
            let corners = outline.at(&Isometry2::new(place.coords, yaw_rad));
            if corners.iter().all(|corner| walls_m.contains(&corner.coords.norm())) {
                parts.push(LaidPart { pose, place, yaw_rad });
            }
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use feeder_model::seed::generator;
    use feeder_scenario::{PartSource, Scenario};

    use super::*;

    /// A clip that lies along a wall is nearer to it than one that is turned may be.
    #[test]
    fn parts_are_taught_at_the_walls_too_and_none_in_them() {
        let part = PartSource::Name("clip".to_owned());
        let scenario = Scenario { part, part_model: None, ..Scenario::default() };
        let part = scenario.part_type().unwrap();
        let (scene, pose) = (scenario.scene(&part), &part.poses[0]);
        let tray = &scene.tray.geometry;
        let mut random = generator(1, "lesson");
        let laid: Vec<LaidPart> = (0..200).flat_map(|_| laid_out(&scene, 0, pose, &mut random)).collect();
        let radius_m = |part: &LaidPart| part.place.coords.norm();
        let outer = laid.iter().filter(|part| radius_m(part) > tray.outer_radius_m - pose.outline.radius_m).count();
        let inner = laid.iter().filter(|part| radius_m(part) < tray.inner_radius_m + pose.outline.radius_m).count();
        assert!(outer > laid.len() / 100 && inner > 0, "{outer} and {inner} of {}", laid.len());
        let walls_m = tray.inner_radius_m..tray.outer_radius_m;
        for part in &laid {
            let corners = pose.outline.at(&Isometry2::new(part.place.coords, part.yaw_rad));
            assert!(corners.iter().all(|corner| walls_m.contains(&corner.coords.norm())), "{part:?}");
        }
    }
}
