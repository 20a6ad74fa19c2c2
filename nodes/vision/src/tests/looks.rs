//! What two looks at a frame come to together.

use super::*;
use crate::candidate::{Judgement, judge};
use crate::detector::Detector;
use crate::modes::Light;
use crate::room::Room;

/// A coin that a look is sure of.
const SEEN: Candidate = Candidate {
    x_m: 0.0,
    y_m: -0.06,
    yaw_rad: Some(1.0),
    likeness: 0,
    pose: Some(0),
    confidence: 1.0,
    part_gap_m: 0.01,
    wall_gap_m: 0.01,
    on_plateau: true,
};

fn sight() -> Sight {
    let scene = scene(&catalogue("coin"), 2.0);
    Sight::new(&scene.camera, &scene.tray, &COIN)
}

/// A look that explains so much and sees one thing, with so much room to other parts and to what is nobody's.
fn look(explained_ratio: f64, candidate: Candidate, part_gap_m: f64, foreign_gap_m: f64) -> Judgement {
    let part_gaps_m = vec![part_gap_m];
    let room = Room { part_gaps_m, foreign_gaps_m: vec![foreign_gap_m], own_px: 0, foreign_px: 0 };
    let candidate = Candidate { part_gap_m: room.gap_m(0), ..candidate };
    let (in_view_ratio, covered_ratio, recognised) = (1.0, 0.1, usize::from(candidate.pose.is_some()));
    let health = FrameHealth { in_view_ratio, covered_ratio, explained_ratio, recognised, ..FrameHealth::default() };
    let (shares, miss_ratios, miss_ratio) = (vec![explained_ratio], vec![None; 2], None);
    Judgement { candidates: vec![candidate], shares, room, health, miss_ratios, miss_ratio, alike: vec![false; 2] }
}

/// What the looks make of the thing, in light that falls as it did when the part was taught or otherwise.
fn together(taught: Judgement, any: Judgement, as_taught: bool) -> Candidate {
    let light_change_ratio = Some(if as_taught { 0.0 } else { 0.01 });
    let any = Judgement { health: FrameHealth { light_change_ratio, hub_ratio: None, ..any.health }, ..any };
    let (candidates, _) = sight().together(taught, any, &SelectorConfig::default());
    assert_eq!(candidates.len(), 1);
    candidates[0]
}

#[test]
fn a_look_contradicts_another_in_pose_yaw_or_place() {
    let (sight, config) = (sight(), SelectorConfig::default());
    let contradicts = |other: Candidate| sight.contradicts(&SEEN, &other, &config);
    assert!(!contradicts(Candidate { x_m: 0.000_1, yaw_rad: Some(1.03), ..SEEN }));
    assert!(contradicts(Candidate { pose: Some(1), likeness: 1, ..SEEN }));
    assert!(contradicts(Candidate { likeness: 1, ..SEEN }));
    assert!(contradicts(Candidate { yaw_rad: Some(1.3), ..SEEN }));
    assert!(contradicts(Candidate { x_m: 0.000_4, ..SEEN }));
    // One look is sure of what the other only takes to be likeliest.
    assert!(sight.contradicts(&Candidate { pose: None, ..SEEN }, &SEEN, &config));
    // What is not sure, or another thing, contradicts nothing.
    assert!(!contradicts(Candidate { pose: None, yaw_rad: Some(1.3), ..SEEN }));
    assert!(!contradicts(Candidate { x_m: 0.006, yaw_rad: Some(1.3), ..SEEN }));
}

#[test]
fn what_the_other_look_sees_elsewhere_makes_a_thing_neither_surer_nor_more_beset() {
    let less_sure = Candidate { confidence: 0.6, ..SEEN };
    let lent = |other: Candidate| together(look(0.95, less_sure, 0.01, 0.01), look(0.9, other, 0.001, 0.01), true);
    let (same, elsewhere) = (lent(SEEN), lent(Candidate { x_m: 0.02, ..SEEN }));
    assert!(same.confidence > 0.99 && same.part_gap_m < 0.002, "{same:?}");
    assert!(elsewhere.confidence < 0.61 && elsewhere.part_gap_m > 0.009, "{elsewhere:?}");
}

#[test]
fn the_look_that_explains_more_counts_and_that_in_the_light_taught_only_where_it_explains_much() {
    let unsure = Candidate { pose: None, confidence: 0.0, ..SEEN };
    let pose = |taught_ratio: f64, any_ratio: f64| {
        together(look(taught_ratio, SEEN, 0.01, 0.01), look(any_ratio, unsure, 0.01, 0.01), true).pose
    };
    assert_eq!(pose(0.95, 0.9), Some(0));
    assert_eq!(pose(0.9, 0.95), None);
    assert_eq!(pose(0.7, 0.6), None);
}

/// Parts at a wall or on one another leave much unexplained in any light.
#[test]
fn the_look_in_the_light_taught_counts_where_parts_look_so_however_little_it_explains() {
    let unsure = Candidate { pose: None, confidence: 0.0, ..SEEN };
    let pose = |any_ratio: f64, miss_ratio: Option<f64>, light_change_ratio: Option<f64>| {
        let taught = look(0.5, SEEN, 0.01, 0.01);
        let health = FrameHealth { light_change_ratio, ..taught.health };
        let any = look(any_ratio, unsure, 0.01, 0.01);
        let taught = Judgement { health, miss_ratio, ..taught };
        sight().together(taught, any, &SelectorConfig::default()).0[0].pose
    };
    assert_eq!(pose(0.4, Some(0.2), Some(0.0)), Some(0));
    assert_eq!(pose(0.6, Some(0.2), Some(0.0)), None, "any light explains more");
    assert_eq!(pose(0.4, Some(0.5), Some(0.0)), None, "parts look otherwise");
    assert_eq!(pose(0.4, None, Some(0.0)), None, "too few parts tell");
    assert_eq!(pose(0.4, Some(0.2), Some(0.01)), None, "light falls otherwise");
    assert_eq!(pose(0.4, Some(0.2), None), Some(0), "light cannot be compared");
}

#[test]
fn a_lens_out_of_focus_is_told_whichever_look_counts() {
    let blurred = |explained_ratio: f64| {
        let look = look(explained_ratio, SEEN, 0.01, 0.01);
        Judgement { health: FrameHealth { blur_excess_px2: Some(1.2), ..look.health }, ..look }
    };
    for explained_ratio in [0.9, 0.96] {
        let taught = look(0.95, SEEN, 0.01, 0.01);
        let (_, health) = sight().together(taught, blurred(explained_ratio), &SelectorConfig::default());
        assert!(health.causes().contains(&HealthCause::Blurred), "{health:?}");
    }
}

#[test]
fn in_the_light_taught_a_pose_is_as_sure_as_either_look_is_and_not_at_all_where_they_differ() {
    let weak = Candidate { confidence: 0.6, ..SEEN };
    let taught = |seen: Candidate| look(0.95, seen, 0.01, 0.01);
    let any = |seen: Candidate| look(0.9, seen, 0.01, 0.01);
    assert!(together(taught(weak), any(SEEN), true).confidence > 0.99);
    assert!(together(taught(SEEN), any(weak), true).confidence > 0.99);
    let turned = together(taught(SEEN), any(Candidate { yaw_rad: Some(1.3), ..SEEN }), true);
    assert_eq!((turned.pose, turned.confidence), (None, 0.0));
    // What the look in the light taught does not recognise, the other does not make it.
    let unknown = Candidate { pose: None, confidence: 0.0, ..SEEN };
    let unsure = together(taught(unknown), any(Candidate { x_m: 0.000_1, confidence: 0.9, ..unknown }), true);
    assert_eq!((unsure.pose, unsure.confidence), (None, 0.0));
    // Nothing is taken back of what was not recognised.
    let (_, health) = sight().together(taught(unknown), any(SEEN), &SelectorConfig::default());
    assert!((health.explained_ratio - 0.95).abs() < 1e-9, "{health:?}");
}

#[test]
fn parts_that_either_look_sees_are_in_the_way_and_shade_that_either_knows_is_not() {
    let (near_m, clear_m) = (0.000_5, 0.01);
    // The look in the light taught counts: parts that the other sees are in the way too.
    let has_room = |taught: (f64, f64), any: (f64, f64)| {
        together(look(0.95, SEEN, taught.0, taught.1), look(0.9, SEEN, any.0, any.1), true).part_gap_m > 0.001
    };
    assert!(has_room((clear_m, clear_m), (clear_m, near_m)));
    assert!(!has_room((clear_m, clear_m), (near_m, clear_m)));
    assert!(!has_room((clear_m, near_m), (clear_m, clear_m)));
    // The other counts: what it takes for a thing may be the shade that was taught, while light falls so.
    let has_room = |taught: (f64, f64), any: (f64, f64), as_taught| {
        together(look(0.9, SEEN, taught.0, taught.1), look(0.95, SEEN, any.0, any.1), as_taught).part_gap_m > 0.001
    };
    assert!(has_room((clear_m, clear_m), (clear_m, near_m), true));
    assert!(!has_room((clear_m, clear_m), (clear_m, near_m), false));
    assert!(!has_room((clear_m, clear_m), (near_m, clear_m), true));
    assert!(!has_room((near_m, clear_m), (clear_m, near_m), true));
}

/// A light that leaves two poses looking alike leaves little unexplained when all of them are taken for one.
#[test]
fn what_looks_alike_in_any_light_is_not_sure_either_as_taught_unless_parts_look_as_they_did() {
    let alike_if = |own_miss_ratio: Option<f64>, pose: usize, miss_ratio: f64, light_change_ratio: f64| {
        let miss_ratios = vec![own_miss_ratio, None];
        let taught = Judgement { miss_ratios, ..look(0.95, SEEN, 0.01, 0.01) };
        let health = FrameHealth { miss_ratio, light_change_ratio: Some(light_change_ratio), ..taught.health };
        let any = look(0.0, Candidate { pose: None, confidence: 0.0, ..SEEN }, 0.01, 0.01);
        let alike = vec![pose == 0, pose == 1];
        let (candidates, health) =
            sight().together(Judgement { health, ..taught }, Judgement { alike, ..any }, &SelectorConfig::default());
        (candidates[0].pose, health.causes().contains(&HealthCause::LooksAlike), health.is_blind())
    };
    let alike = |pose, miss_ratio, light_change_ratio| alike_if(None, pose, miss_ratio, light_change_ratio);
    assert_eq!(alike(0, 0.2, 0.0), (Some(0), false, false), "foreign things alone made for the second look");
    assert_eq!(alike(0, 0.5, 0.0), (None, true, true), "parts look otherwise");
    assert_eq!(alike(0, 0.2, 0.01), (None, true, true), "light falls otherwise");
    assert_eq!(alike(1, 0.5, 0.01), (Some(0), true, false), "it is the other pose that is not told");
    assert_eq!(alike_if(Some(0.2), 0, 0.5, 0.0), (Some(0), false, false), "those of another pose look otherwise");
    assert_eq!(alike_if(Some(0.5), 0, 0.2, 0.0), (None, true, true), "those of its own pose do");
    assert_eq!(alike_if(Some(0.2), 0, 0.2, 0.01), (None, true, true), "light falls otherwise");
}

/// Three grommets cover two fifths of what they darken; the rest are their shadows.
#[test]
fn parts_of_a_size_have_the_same_share_in_what_lies_there() {
    let (scene, config) = (scene(&GROMMET, 2.0), SelectorConfig::default());
    let mut detector = Detector::new(&scene.camera, &scene.tray, &MODEL, Light::Taught);
    let image = simple_picture(&[at(0.06, 4.0, 0), at(0.06, 4.7, 0), at(0.06, 5.4, 0)]);
    let found = detector.find(&image, &over_camera(), config.contrast_min_levels, f32::MAX).unwrap();
    let judged = judge(&detector, &detector.view(&over_camera()), &config, &found);
    assert_eq!((judged.shares.len(), judged.health.recognised), (3, 3));
    assert!(judged.shares.iter().all(|share| (share - 0.13).abs() < 0.02), "{:?}", judged.shares);
}
