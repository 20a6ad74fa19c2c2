//! Parts, lamps and lenses that differ a little from those taught.

use super::*;
use crate::align::Fit;
use crate::candidate::{is_recognised, judge};
use crate::detector::{Detector, belief_of_light};
use crate::modes::{Belief, Light, MODES, OTHER_LIGHTS, WHOLE_LIGHTS};
use crate::template::{Aspect, LitPicture, Plane, direction_factors};
use feeder_model::geometry::PartMesh;
use feeder_model::geometry::apart::distance_m;

/// A part that gives back so many times the light.
fn lit(scene: &mut Scene, ratio: f64) {
    let mesh = &scene.part.mesh;
    let reflectance = mesh.reflectance().iter().map(|share| share * ratio).collect();
    scene.part.mesh = PartMesh::new(mesh.vertices().to_vec(), mesh.triangles().to_vec(), reflectance).unwrap();
}

/// Which share of the parts with room may be picked in a world that differs from the one taught, when none else may.
fn recall(part: &PartType, model: &PartModel, change: impl Fn(&mut Scene), blur_px: f32) -> f64 {
    let mut world = scene(part, 2.0);
    change(&mut world);
    let mut renderer = Renderer::new(&world).unwrap();
    recall_in(part, model, |parts, random| {
        let image = shoot(&mut renderer, &over_camera(), parts, random);
        if blur_px > 0.0 { image::imageops::blur(&image, blur_px) } else { image }
    })
}

/// The same in pictures taken otherwise.
fn recall_in(
    part: &PartType,
    model: &PartModel,
    mut shoot: impl FnMut(&[LaidPart], &mut Pcg64Mcg) -> GrayImage,
) -> f64 {
    let believed = scene(part, 2.0);
    let mut selector = Selector::new(SelectorConfig::default(), &believed.camera, &believed.tray, model).unwrap();
    let mut random = Pcg64Mcg::seed_from_u64(21);
    let (mut free, mut selected) = (0, 0);
    for _ in 0..3 {
        let parts = strewn(part, None, 40, 2.0 * part.outline_radius_m(), &mut random);
        let image = shoot(&parts, &mut random);
        let seen = selector.detect(&image, &over_camera()).unwrap();
        for candidate in seen.iter().filter(|candidate| selector.admits(candidate)) {
            let truth = parts.iter().find(|laid| (laid.place - candidate.centre()).norm() < 0.000_5);
            assert_eq!(truth.map(|laid| laid.pose), candidate.pose, "{candidate:?}");
        }
        for (index, laid) in parts.iter().enumerate() {
            let others = parts.iter().enumerate().filter(|(other, _)| *other != index);
            let apart_m = others.map(|(_, other)| (other.place - laid.place).norm()).fold(f64::INFINITY, f64::min);
            if apart_m - 2.0 * part.outline_radius_m() >= 0.001_25 {
                free += 1;
                let near = |candidate: &&Candidate| (candidate.centre() - laid.place).norm() < 0.000_5;
                selected += u32::from(seen.iter().find(near).is_some_and(|candidate| selector.admits(candidate)));
            }
        }
    }
    assert!(free > 40, "too few parts to judge by: {free}");
    f64::from(selected) / f64::from(free)
}

#[test]
fn parts_a_little_darker_or_brighter_or_blurred_are_as_sure_as_those_taught() {
    for ratio in [0.97, 1.03] {
        let recall = recall(&GROMMET, &MODEL, |scene| lit(scene, ratio), 0.0);
        assert!(recall >= 0.95, "{ratio}: {recall}");
    }
    let recall = recall(&GROMMET, &MODEL, |_| (), 0.87);
    assert!(recall >= 0.95, "blurred: {recall}");
}

#[test]
fn shadows_of_a_lamp_that_stands_lower_are_in_the_way_of_none() {
    let lower = |scene: &mut Scene| scene.light.elevation_rad = 45_f64.to_radians();
    let recall = recall(&catalogue("coin"), &COIN, lower, 0.0);
    assert!(recall >= 0.95, "{recall}");
}

/// A wall at one end of a bracket shades a strip beside it at some yaws only, and the lamp may stand a little elsewhere than taught.
/// What else lies there, be it in that strip, is in the way.
#[test]
fn a_shadow_that_turns_with_the_part_is_its_own_and_what_lies_in_it_is_not() {
    let mut bracket = catalogue("bracket");
    bracket.poses.truncate(1);
    let believed = scene(&bracket, 2.0);
    let mut selector =
        Selector::new(SelectorConfig::default(), &believed.camera, &believed.tray, &taught(&bracket)).unwrap();
    let mut world = scene(&bracket, 2.0);
    world.light.elevation_rad -= 2_f64.to_radians();
    let mut renderer = Renderer::new(&world).unwrap();
    let mut random = Pcg64Mcg::seed_from_u64(5);
    let (mut shown, mut free, mut beset) = (0, 0, 0);
    let mut has_room = |image: &GrayImage, laid: &LaidPart| {
        let seen = selector.detect(image, &over_camera()).unwrap();
        let near = |candidate: &&Candidate| (candidate.centre() - laid.place).norm() < 0.000_5;
        seen.iter().find(near).map_or(0, |candidate| u32::from(candidate.part_gap_m >= 0.001))
    };
    for _ in 0..3 {
        let parts = strewn(&bracket, Some(0), 8, 0.016, &mut random);
        let image = shoot(&mut renderer, &over_camera(), &parts, &mut random);
        for (index, laid) in parts.iter().enumerate() {
            shown += 1;
            free += has_room(&image, laid);
            let direction_rad = TAU * (index as f64) / 8.0;
            for level in [20, 240] {
                beset += has_room(&with_thing_beside(&image, &believed, (&bracket, laid), direction_rad, level), laid);
            }
        }
    }
    assert!(f64::from(free) >= 0.95 * f64::from(shown), "{free} of {shown} have room");
    assert_eq!(beset, 0, "of {shown} beside a dark thing and beside a bright one");
}

/// A picture with a thing of 2 mm painted 0.6 mm beside a part's outline, in a direction of the tray.
fn with_thing_beside(
    image: &GrayImage,
    scene: &Scene,
    (part, laid): (&PartType, &LaidPart),
    direction_rad: f64,
    level: u8,
) -> GrayImage {
    let outline = part.poses[laid.pose].outline.at(&Isometry2::new(laid.place.coords, laid.yaw_rad));
    let along = Vector2::new(direction_rad.cos(), direction_rad.sin());
    let steps = || (-90..=90).map(|step| f64::from(step) * 0.000_1);
    let places = steps().flat_map(|y_m| steps().map(move |x_m| laid.place + Vector2::new(x_m, y_m)));
    let is_thing = |place: &Point2<f64>| {
        (place - laid.place).angle(&along) < 0.3 && (0.000_6..0.002_6).contains(&distance_m(&outline, place))
    };
    let mut image = image.clone();
    paint(&mut image, scene, places.filter(is_thing), level);
    image
}

/// What falls to one side of a part does not tell what it is: a dome takes it away. Light that falls otherwise across the plateau
/// shows that it is another.
#[test]
fn parts_whose_shadow_is_gone_are_known() {
    let dome = |scene: &mut Scene| {
        scene.light.diffuse_ratio = 0.95;
        scene.light.gradient_right_ratio += 0.05;
    };
    let recall = recall(&catalogue("hex_nut"), &NUT, dome, 0.0);
    assert!(recall >= 0.8, "{recall}");
}

/// Between the lights from all sides that are taught lie others: in the lesson none stands at this height.
#[test]
fn parts_in_steep_light_from_all_sides_are_known() {
    for (part, model, least) in [(&catalogue("hex_nut"), &*NUT, 0.8), (&*GROMMET, &*MODEL, 0.95)] {
        let mut ring = AllRound::afar(&scene(part, 2.0), 1.15).unwrap();
        let recall = recall_in(part, model, |parts, random| shoot_all_round(&mut ring, parts, random));
        assert!(recall >= least, "{}: {recall}", part.name);
    }
}

/// The lamp taught stands high at 126°; the lesson shows low lamps, none of which stands at this azimuth and height. Parts are nowhere near
/// as far beside as half a millimetre then, although the bare plateau looks as it did.
#[test]
fn parts_under_a_low_lamp_on_another_side_are_known() {
    let low_lamp = |scene: &mut Scene| {
        scene.light = LightModel { azimuth_rad: -0.6, elevation_rad: 0.55, diffuse_ratio: 0.5, ..scene.light };
    };
    let recall = recall(&GROMMET, &MODEL, low_lamp, 0.0);
    assert!(recall >= 0.85, "{recall}");
}

#[test]
fn light_from_a_side_lights_that_side_of_a_part_however_it_is_turned() {
    let template = &NUT.poses[1];
    for turns in 0..8 {
        let yaw_rad = TAU * f64::from(turns) / 8.0;
        let [from_x, from_y, ..] = template.lit_from_sides(&Aspect { yaw_rad, slant: Vector2::zeros() });
        // Beside the part, on the side from which light comes less the other.
        let lit = |added: &[f32], towards_rad: f64| {
            let side = |turn_rad: f64| {
                let place = 0.004
                    * Vector2::new((towards_rad + turn_rad - yaw_rad).cos(), (towards_rad + turn_rad - yaw_rad).sin());
                let nearest = |index: &usize| (template.place_m(*index) - place).norm_squared();
                let index = (0..added.len()).min_by(|a, b| nearest(a).total_cmp(&nearest(b))).unwrap();
                added[index]
            };
            side(0.0) - side(TAU / 2.0)
        };
        let (x, y) = (lit(&from_x, 0.0), lit(&from_y, TAU / 4.0));
        assert!(x > 0.1 && y > 0.1, "{yaw_rad} rad: {x} {y}");
        assert!(lit(&from_x, TAU / 2.0) < -0.1, "{yaw_rad} rad");
    }
}

/// A turned part in light from some side looks, in its own directions, as one that is not in light from as much less.
#[test]
fn light_from_a_side_turns_against_a_part_that_is_turned() {
    let template = &NUT.poses[1];
    let looks = |yaw_rad: f64, lamp_rad: f64| {
        let sides = template.lit_from_sides(&Aspect { yaw_rad, slant: Vector2::zeros() });
        let factors = direction_factors(lamp_rad);
        let texels = 0..sides[0].len();
        let looks =
            |texel: usize| sides.iter().zip(factors).map(|(side, factor)| f64::from(side[texel]) * factor).sum();
        texels.map(looks).collect::<Vec<f64>>()
    };
    for (yaw_rad, lamp_rad) in [(0.4, 0.0), (2.5, 1.0), (4.0, -1.2)] {
        let off = |(turned, lit): (&f64, &f64)| (turned - lit).abs();
        let (turned, lit) = (looks(yaw_rad, lamp_rad), looks(0.0, lamp_rad - yaw_rad));
        assert!(turned.iter().zip(&lit).map(off).fold(0.0, f64::max) < 1e-4, "{yaw_rad} {lamp_rad}");
    }
}

#[test]
fn parts_that_lie_in_one_light_tell_of_it_if_they_are_enough() {
    let fit = |amount: f32, cost: f32| {
        let mut amounts = [0.0; MODES];
        amounts[OTHER_LIGHTS].fill(amount);
        amounts[0] = amount;
        Fit { centre: Point2::origin(), yaw_rad: 0.0, cost, evidence: 1.0, amounts }
    };
    let open = Belief::open();
    let told = [fit(0.9, 1.0), fit(1.1, 1.0), fit(1.0, 2.0), fit(-2.0, 1.0), fit(5.0, 9.0)];
    let belief = belief_of_light(&told, &open).unwrap();
    for mode in OTHER_LIGHTS {
        assert!((0.9..=1.1).contains(&belief.middle[mode]) && belief.spread[mode] < 0.2, "{belief:?}");
    }
    // What is of each part alone stays open.
    assert_eq!((belief.middle[0], belief.spread[0]), (0.0, 1.0));
    assert!(belief_of_light(&told[1..], &open).is_none(), "three that fit and one that does not");
}

/// Two units of the mode of another light are the whole way to it, as it is drawn under the same yaw and slant.
#[test]
fn a_part_wholly_in_another_light_looks_as_drawn_in_it() {
    let scene = scene(&GROMMET, 2.0);
    let detector = Detector::new(&scene.camera, &scene.tray, &MODEL, Light::Any);
    let (template, aspect) = (&detector.sought[0].template, Aspect { yaw_rad: 0.0, slant: Vector2::new(0.12, -0.07) });
    for (mode, lit) in WHOLE_LIGHTS.zip(template.in_other_lights(&aspect)) {
        let mut amounts = [0.0; MODES];
        amounts[mode] = 2.0;
        let fitted = detector.sought[0].fitted(&aspect, &amounts);
        let off = fitted.iter().zip(&lit).map(|(fitted, lit)| (fitted - lit).abs()).fold(0.0, f32::max);
        assert!(off < 1e-5, "light {mode}: {off}");
    }
    let low = |light: usize| template.in_other_lights(&aspect).nth(light).unwrap().iter().copied().fold(0.0, f32::min);
    // The lower the lamps, the darker the hole and the foot of the part.
    assert!(low(2) < low(0) - 0.1, "{} {}", low(2), low(0));
}

/// Of so many grommets, how many are recognised by a look in any light; all of them must lie within a tenth of a millimetre of where they do.
fn seen_in_place(model: &PartModel, light: LightModel) -> (usize, usize) {
    let scene = Scene { light, ..scene(&GROMMET, 2.0) };
    let parts = strewn(&GROMMET, None, 30, 3.0 * RADIUS_M, &mut Pcg64Mcg::seed_from_u64(7));
    let mut renderer = Renderer::new(&scene).unwrap();
    let image = shoot(&mut renderer, &over_camera(), &parts, &mut Pcg64Mcg::seed_from_u64(11));
    let mut detector = Detector::new(&scene.camera, &scene.tray, model, Light::Any);
    let config = SelectorConfig::default();
    let found = detector.find(&image, &over_camera(), config.contrast_min_levels, f32::MAX).unwrap();
    let known = found.iter().filter(|part| is_recognised(&detector, part, &config));
    let in_place = known.map(|part| {
        let laid = parts.iter().filter(|laid| laid.pose == part.pose);
        let off_m = laid.map(|laid| (laid.place - part.fit.centre).norm()).fold(f64::INFINITY, f64::min);
        assert!(off_m < 0.000_1, "{off_m}: {part:?}");
    });
    (in_place.count(), parts.len())
}

/// What was taught under a ring round the lens has neither shadows nor the same edges: parts lie where the frame's own light has them.
#[test]
fn a_part_taught_in_another_light_lies_where_it_is_seen() {
    let mut model = MODEL.clone();
    for pose in &mut model.poses {
        let drawn = LitPicture { at_yaws: pose.at_yaws.clone(), slant: pose.slant_planes().map(Plane::clone) };
        let ring = std::mem::replace(&mut pose.lights[0], drawn);
        pose.at_yaws = ring.at_yaws;
        [pose.slant_x, pose.slant_y, pose.slant_xx, pose.slant_xy, pose.slant_yy] = ring.slant;
    }
    // Light falls otherwise across the plateau, too.
    model.plateau_light[1] += 5.0;
    let (known, of) = seen_in_place(&model, LightModel::default());
    assert!(known + 2 >= of, "{known} of {of}");
}

/// A far lamp that stands elsewhere leaves the bare plateau as it was: parts alone tell of it.
#[test]
fn tall_parts_under_a_far_lamp_on_another_side_lie_where_they_are_seen() {
    let light = LightModel { azimuth_rad: -0.6, elevation_rad: 0.55, diffuse_ratio: 0.5, ..LightModel::default() };
    let (known, of) = seen_in_place(&MODEL, light);
    assert!(known + 3 >= of, "{known} of {of}");
}

#[test]
fn parts_much_darker_than_those_taught_are_known_by_their_pattern() {
    let recall = recall(&catalogue("hex_nut"), &NUT, |scene| lit(scene, 0.8), 0.0);
    assert!(recall >= 0.9, "{recall}");
}

/// In any light a bright part could be as bright as the floor, and lie wherever none is seen.
#[test]
fn bare_floor_is_no_part_whatever_the_light() {
    let block = catalogue("block");
    let recall = recall(&block, &taught(&block), |scene| lit(scene, 1.03), 0.0);
    assert!(recall >= 0.8, "{recall}");
}

/// A white part lights the floor beside it; few parts in a frame cannot tell that all of them do.
#[test]
fn few_parts_are_known_where_the_floor_beside_them_is_brighter_than_taught() {
    let scene = scene(&GROMMET, 2.0);
    let mut detector = Detector::new(&scene.camera, &scene.tray, &MODEL, Light::Any);
    let parts = [at(0.06, 4.2, 0), at(0.06, 4.8, 0), at(0.07, 5.4, 0)];
    let mut image = simple_picture(&parts);
    let height_m = scene.tray.plateau_height_m();
    let m_per_px = scene.camera.m_per_px(height_m);
    for part in &parts {
        let place = over_camera() * part.place;
        let middle = scene.camera.project(nalgebra::Point3::new(place.x, place.y, height_m)).unwrap();
        for (x, y, pixel) in image.enumerate_pixels_mut() {
            let aside_m = (Vector2::new(f64::from(x), f64::from(y)) - middle.coords).norm() * m_per_px;
            if (RADIUS_M..RADIUS_M + 0.002).contains(&aside_m) {
                pixel.0[0] = feeder_model::camera::grey_level(f32::from(pixel.0[0]) * 1.2);
            }
        }
    }
    let config = SelectorConfig::default();
    let found = detector.find(&image, &over_camera(), config.contrast_min_levels, f32::MAX).unwrap();
    let known = found.iter().filter(|part| part.pose == 0 && is_recognised(&detector, part, &config)).count();
    assert_eq!(known, 3, "{found:?}");
}

#[test]
fn how_blurred_and_how_large_parts_are_seen_is_told() {
    let parts: Vec<LaidPart> = (0..7_u32).map(|i| at(0.065, 3.5 + 0.4 * f64::from(i), 0)).collect();
    let believed = scene(&GROMMET, 2.0);
    let mut detector = Detector::new(&believed.camera, &believed.tray, &MODEL, Light::Any);
    let mut seen = |image: &GrayImage| {
        let config = SelectorConfig::default();
        let found = detector.find(image, &over_camera(), config.contrast_min_levels, f32::MAX).unwrap();
        let health = judge(&detector, &detector.view(&over_camera()), &config, &found).health;
        assert_eq!(health.recognised, parts.len());
        (health.blur_excess_px2.unwrap(), health.size_excess_ratio.unwrap())
    };
    let mut world = scene(&GROMMET, 2.0);
    let (sharp_px2, blurred_px2) = (-0.05..0.05, 0.32..0.64);
    for (scale, blur_px, told_px2) in
        [(1.0, 0.0, &sharp_px2), (1.0, 0.8, &blurred_px2), (1.02, 0.0, &sharp_px2), (0.98, 0.0, &sharp_px2)]
    {
        let mesh = &GROMMET.mesh;
        let vertices = mesh.vertices().iter().map(|vertex| vertex * scale).collect();
        world.part.mesh = PartMesh::new(vertices, mesh.triangles().to_vec(), mesh.reflectance().to_vec()).unwrap();
        let sharp = shoot(&mut Renderer::new(&world).unwrap(), &over_camera(), &parts, &mut Pcg64Mcg::seed_from_u64(9));
        let image = if blur_px > 0.0 { image::imageops::blur(&sharp, blur_px) } else { sharp };
        let (blur_px2, size_ratio) = seen(&image);
        // Of a variance of 0.64 px² a third is put down to chance.
        assert!(told_px2.contains(&blur_px2), "{blur_px} px: {blur_px2} px²");
        assert!((size_ratio - (scale - 1.0)).abs() < 0.008, "{size_ratio} {scale}");
    }
}
