//! What tells a part from another pose of it, from the same turned, from a blank, and from one beside.

use super::*;
use crate::align::{AtYaw, Fit, Laid, Owners, detail_seen, lead_due};
use crate::detector::{Detector, Found};
use crate::modes::{Belief, Light};
use crate::template::Plane;
use feeder_model::geometry::PartMesh;
use feeder_sim::camera::SensorModel;

/// Two pictures of a grommet, one a little beside the other, laid over each other: it may lie in either place.
#[test]
fn a_thing_that_may_as_well_lie_a_little_beside_leads_that_by_nothing() {
    let scene = scene(&GROMMET, 2.0);
    let config = SelectorConfig::default();
    let mut detector = Detector::new(&scene.camera, &scene.tray, &MODEL, Light::Any);
    let mut lead = |aside_px: f64| {
        let here = at(0.06, 4.7, 0);
        let aside_m = Vector2::new(aside_px * scene.camera.m_per_px(scene.tray.plateau_height_m()), 0.0);
        let mut image = simple_picture(&[here]);
        let beside = simple_picture(&[LaidPart { place: here.place + aside_m, ..here }]);
        for (pixel, other) in image.iter_mut().zip(beside.iter()) {
            *pixel = (*pixel).min(*other);
        }
        let found = detector.find(&image, &over_camera(), config.contrast_min_levels, f32::MAX).unwrap();
        found.iter().map(|part| part.beside_lead).fold(f32::INFINITY, f32::min)
    };
    let least = feeder_model::camera::single(config.evidence_lead_min);
    assert!(lead(0.0) > 5.0 * least, "{}", lead(0.0));
    assert!(lead(3.5) < least, "{}", lead(3.5));
}

/// A blank has the part's outline.
#[test]
fn a_part_shows_all_of_its_detail_and_a_blank_none() {
    let coin = catalogue("coin");
    let scene = scene(&coin, 2.0);
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let coins = strewn(&coin, Some(0), 8, 3.0 * coin.outline_radius_m(), &mut random);
    let image = shoot(&mut Renderer::new(&scene).unwrap(), &over_camera(), &coins, &mut random);
    let reach_m = coin.outline_radius_m() - 0.000_3;
    let steps = || (-60..=60).map(|step| f64::from(step) / 60.0 * reach_m);
    let disc = steps().flat_map(|x_m| steps().map(move |y_m| Vector2::new(x_m, y_m)));
    let disc: Vec<Vector2<f64>> = disc.filter(|aside| aside.norm() <= reach_m).collect();
    let mut blanks = image.clone();
    for laid in &coins {
        paint(&mut blanks, &scene, disc.iter().map(|aside| laid.place + aside), 190);
    }
    let contrast_min_levels = SelectorConfig::default().contrast_min_levels;
    let noise_max = [Light::Taught, Light::Any].map(|light| {
        let mut detector = Detector::new(&scene.camera, &scene.tray, &COIN, light);
        let found = detector.find(&image, &over_camera(), contrast_min_levels, f32::MAX).unwrap();
        assert!(found.len() >= 6 && found.iter().all(|part| part.detail_seen.unwrap() > 0.9), "{found:?}");
        detector.look(&blanks, &over_camera(), contrast_min_levels).unwrap();
        let nobody = vec![0; detector.segmentation.bins.len()];
        let owners = Owners { of: &nobody, own: 0, beside_sigma: 0.1 };
        for part in &found {
            let (view, sought) = (detector.view(&over_camera()), &detector.sought[part.pose]);
            let seen = detail_seen(&detector.segmentation, &view, sought, &part.fit, &owners).unwrap();
            assert!(seen.abs() < 0.2, "{light:?}: {seen}");
        }
        // What slant would add tells nothing.
        let part = &found[0];
        let (view, mut sought) = (detector.view(&over_camera()), detector.sought[part.pose].clone());
        let picture = sought.template.picture(&sought.aspect(&view, &part.fit)).into_iter().map(|level| 20.0 * level);
        sought.template.slant_x = Plane::new(sought.template.side(), picture.collect());
        assert_eq!(detail_seen(&detector.segmentation, &view, &sought, &part.fit, &owners), None);
        // Up to which noise it tells.
        let view = view::View { camera: &scene.camera, tray: &scene.tray, platen_from_tray: over_camera() };
        let tells = |sigma: &f32| {
            detector.segmentation.sigma = *sigma;
            let sought = &detector.sought[part.pose];
            detail_seen(&detector.segmentation, &view, sought, &part.fit, &owners).is_some()
        };
        (1..1000).map(|step| 0.01 * 1.02_f32.powi(step)).take_while(tells).last().unwrap()
    });
    let [in_light_taught, in_any] = noise_max;
    assert!((0.6..0.8).contains(&(in_light_taught / in_any)), "twice as sure in the light taught: {noise_max:?}");
}

/// From above a grommet that is half as high differs by its shadow alone.
#[test]
fn what_is_half_as_high_as_the_others_is_told_by_its_shadow() {
    let scene = scene(&GROMMET, 2.0);
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let grommets = strewn(&GROMMET, Some(0), 10, 5.0 * RADIUS_M, &mut random);
    let (low, high) = grommets.split_at(3);
    let mut image = shoot(&mut Renderer::new(&scene).unwrap(), &over_camera(), high, &mut random);
    let mut of_low = Scene { sensor: SensorModel { noise_sigma_levels: 0.0, ..scene.sensor }, ..scene.clone() };
    let up = GROMMET.poses[0].orientation.inverse() * nalgebra::Vector3::z();
    let halved = GROMMET.mesh.vertices().iter().map(|vertex| vertex - 0.5 * vertex.coords.dot(&up) * up).collect();
    let (triangles, reflectance) = (GROMMET.mesh.triangles().to_vec(), GROMMET.mesh.reflectance().to_vec());
    of_low.part.mesh = PartMesh::new(halved, triangles, reflectance).unwrap();
    let low_alone = shoot(&mut Renderer::new(&of_low).unwrap(), &over_camera(), low, &mut random);
    for ((pixel, low), bare) in image.iter_mut().zip(low_alone.iter()).zip(empty_tray(&over_camera()).iter()) {
        if low != bare {
            *pixel = *low;
        }
    }
    let config = SelectorConfig::default();
    for light in [Light::Taught, Light::Any] {
        let mut detector = Detector::new(&scene.camera, &scene.tray, &MODEL, light);
        let found = detector.find(&image, &over_camera(), config.contrast_min_levels, f32::MAX).unwrap();
        for (index, grommet) in grommets.iter().enumerate() {
            let lies = |part: &&Found| (part.fit.centre - grommet.place).norm() < 0.000_5;
            let height = found.iter().find(lies).unwrap().height_seen.unwrap();
            assert!(if index < 3 { height < 0.5 } else { height > 0.8 }, "{light:?}, {index}: {height}");
        }
    }
}

/// Coins that show tails look somewhat like heads in another light.
#[test]
fn a_part_leads_another_pose_by_what_the_templates_say() {
    let coin = catalogue("coin");
    let scene = scene(&coin, 2.0);
    let config = SelectorConfig::default();
    let mut detector = Detector::new(&scene.camera, &scene.tray, &COIN, Light::Any);
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let coins = strewn(&coin, Some(1), 12, 3.0 * coin.outline_radius_m(), &mut random);
    let image = shoot(&mut Renderer::new(&scene).unwrap(), &over_camera(), &coins, &mut random);
    let found = detector.find(&image, &over_camera(), config.contrast_min_levels, f32::MAX).unwrap();
    let shares: Vec<f32> = found.iter().filter_map(|part| Some(part.lead / part.lead_due?)).collect();
    assert!(shares.len() >= 6 && shares.iter().all(|share| (0.7..1.5).contains(share)), "{shares:?}");
    // It leads itself by nothing.
    let (view, belief) = (detector.view(&over_camera()), Belief::open());
    let laid = || Laid { sought: &detector.sought[1], fit: &found[0].fit, belief: &belief };
    let nobody = vec![0; detector.segmentation.bins.len()];
    let due = |of: &[u16], part: &Laid, other: &Laid| {
        lead_due(&detector.segmentation, &view, part, other, &Owners { of, own: 1, beside_sigma: 0.1 }).unwrap()
    };
    let lead = due(&nobody, &laid(), &laid());
    assert!(lead.abs() < 1e-4, "{lead}");
    // Of a part that others cover by half, half is asked.
    let (pose, rival) = found[0].rival.unwrap();
    let rival = Laid { sought: &detector.sought[pose], fit: &rival, belief: &belief };
    let window = detector.segmentation.window;
    let middle = view.pixel(found[0].fit.centre, detector.sought[1].plane_m).unwrap().y - window.top as f64;
    let half: Vec<u16> =
        (0..nobody.len()).map(|pixel| if ((pixel / window.width) as f64) < middle { 2 } else { 0 }).collect();
    let share = due(&half, &laid(), &rival) / due(&nobody, &laid(), &rival);
    assert!((0.35..0.65).contains(&share), "{share}");
}

/// The search looks from afar, where a coin turned by half looks much the same.
#[test]
fn a_part_that_was_taken_for_one_turned_by_half_is_righted_and_leads_by_what_is_seen_of_it() {
    let coin = catalogue("coin");
    let scene = scene(&coin, 2.0);
    let config = SelectorConfig::default();
    for light in [Light::Taught, Light::Any] {
        let mut detector = Detector::new(&scene.camera, &scene.tray, &COIN, light);
        let mut random = Pcg64Mcg::seed_from_u64(4);
        let coins = strewn(&coin, Some(0), 12, 3.0 * coin.outline_radius_m(), &mut random);
        let image = shoot(&mut Renderer::new(&scene).unwrap(), &over_camera(), &coins, &mut random);
        let found = detector.find(&image, &over_camera(), config.contrast_min_levels, f32::MAX).unwrap();
        let (view, nobody) = (detector.view(&over_camera()), vec![0; detector.segmentation.bins.len()]);
        let mut turned: Vec<Found> = found.clone();
        // Most must lie as they seem to: what all show is put down to the frame.
        for part in turned.iter_mut().take(3) {
            part.fit.yaw_rad += std::f64::consts::PI;
            (part.fit.cost, part.fit.evidence, part.lead) = (9.0, 0.0, 0.0);
        }
        detector.fit_again(&view, &mut turned);
        for (part, again) in found.iter().zip(&turned) {
            assert!(!detector.yaws_differ(0, part.fit.yaw_rad, again.fit.yaw_rad), "{light:?} {part:?} {again:?}");
            assert!((part.fit.cost - again.fit.cost).abs() < 0.05 && again.turned > Some(0.5), "{light:?} {again:?}");
            assert!(
                again.first_cost < 1.0 && again.first_lead > 1.0,
                "as if it had been found so: {light:?} {again:?}"
            );
        }
        // Of a part of which others cover half, that half is not asked; of one that is hidden, nothing tells.
        let (sought, fit) = (&detector.sought[0], &found[0].fit);
        let other = Fit { yaw_rad: fit.yaw_rad + std::f64::consts::PI, cost: fit.cost + 1.0, ..*fit };
        let (belief, frame) = (Belief::open(), &detector.segmentation);
        let share = |of: &[u16]| {
            let owners = Owners { of, own: 1, beside_sigma: 0.1 };
            AtYaw::new(frame, &view, Laid { sought, fit, belief: &belief }, &owners)
                .unwrap()
                .lead_share(&other)
                .unwrap()
        };
        let middle = view.pixel(fit.centre, sought.plane_m).unwrap().y - frame.window.top as f64;
        let below = |pixel: usize| ((pixel / frame.window.width) as f64) < middle;
        let half = |hidden: bool| -> Vec<u16> {
            (0..nobody.len()).map(|pixel| if below(pixel) == hidden { 2 } else { 0 }).collect()
        };
        let due = [half(true), half(false), nobody.clone()].map(|of| 1.0 / share(&of));
        assert!((due[0] + due[1] - 2.0 * due[2]).abs() < 0.1 * due[2], "{light:?} {due:?}");
        assert!((due[0] - due[1]).abs() > 0.05 * due[2], "{light:?} {due:?}: its halves differ");
        let hidden = share(&vec![2; nobody.len()]);
        assert!(hidden.abs() < 1e-6, "{hidden}");
    }
}
