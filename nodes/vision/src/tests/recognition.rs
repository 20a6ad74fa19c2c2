//! What of the things found in a frame is recognised, and how surely.

use std::sync::LazyLock;

use super::*;
use crate::align::Fit;
use crate::candidate::{Judgement, is_recognised, judge, looks_alike};
use crate::detector::{Detector, Found};
use crate::modes::{Light, MODES, SCALE, SCALE_SPREAD};

pub(crate) static IN_ANY_LIGHT: LazyLock<Detector> = LazyLock::new(|| detector(Light::Any));
static IN_LIGHT_TAUGHT: LazyLock<Detector> = LazyLock::new(|| detector(Light::Taught));

/// Has looked at a bare plateau.
fn detector(light: Light) -> Detector {
    let scene = scene(&GROMMET, 2.0);
    let mut detector = Detector::new(&scene.camera, &scene.tray, &MODEL, light);
    let contrast_min_levels = SelectorConfig::default().contrast_min_levels;
    detector.look(&simple_picture(&[]), &over_camera(), contrast_min_levels).unwrap();
    detector
}

fn judged(detector: &Detector, found: &[Found]) -> Judgement {
    judge(detector, &detector.view(&over_camera()), &SelectorConfig::default(), found)
}

/// Fits well, and as taught.
const FIT: Fit =
    Fit { centre: Point2::new(0.0, -0.06), yaw_rad: 0.0, cost: 0.05, evidence: 1.0, amounts: [0.0; MODES] };

/// A grommet that stands out as taught and is like nothing else, and what is otherwise about it.
fn grommet_but(change: impl FnOnce(&mut Found)) -> Found {
    let mut found = Found::new(0, FIT);
    found.evidence_per_texel = 1.1 * IN_ANY_LIGHT.sought[0].template.evidence_min;
    change(&mut found);
    found
}

/// Whether such a one is recognised.
fn recognised(change: impl FnOnce(&mut Found)) -> bool {
    is_recognised(&IN_ANY_LIGHT, &grommet_but(change), &SelectorConfig::default())
}

/// A washer among nuts has as even a picture as a nut has, and half of its contrast.
#[test]
fn a_part_that_stands_out_less_than_taught_must_do_so_as_its_like_in_the_frame_do() {
    let recognised = |evidence_ratio: Option<f32>, evidence: f32, cost: f32| {
        recognised(|part| {
            (part.evidence_ratio, part.fit.cost) = (evidence_ratio, cost);
            part.evidence_per_texel = evidence * IN_ANY_LIGHT.sought[0].template.evidence_min;
        })
    };
    assert!(recognised(Some(0.77), 0.9, 0.05), "its like are as dim");
    assert!(!recognised(Some(0.73), 0.9, 0.05) && recognised(Some(0.5), 1.1, 0.05));
    assert!(recognised(None, 0.9, 0.05), "alone, its pattern is all there");
    // What its pattern leaves unexplained of its contrast with bare floor, whose square is twice the evidence and the miss.
    let evidence = 0.9 * IN_ANY_LIGHT.sought[0].template.evidence_min;
    let cost = |unexplained: f32| 2.0 * evidence * unexplained / (1.0 - unexplained);
    assert!(recognised(None, 0.9, cost(0.095)) && !recognised(None, 0.9, cost(0.105)), "not all of its pattern");
    let among_others = |unexplained: f32| recognised(Some(1.0), 0.9, cost(unexplained));
    assert!(among_others(0.19) && !among_others(0.21), "its like tell of the light");
    assert!(recognised(None, 1.1, 0.5), "as much as taught");
    let is_thing = |evidence_ratio: Option<f32>, evidence: f32| {
        IN_ANY_LIGHT.is_thing(&grommet_but(|part| {
            (part.evidence_ratio, part.fit.evidence) = (evidence_ratio, evidence);
        }))
    };
    assert!(is_thing(None, f32::MAX) && is_thing(Some(0.6), f32::MAX));
    assert!(!is_thing(Some(0.4), f32::MAX), "it is none of them");
    assert!(!is_thing(None, f32::NEG_INFINITY), "it fits in no light that the frame may have");
}

#[test]
fn what_is_seen_much_darker_than_the_part_is_none_and_what_looked_as_much_like_another_pose_is_not_sure() {
    // A unit of the first mode is a quarter of the part's brightness.
    let darker = |ratio: f32| recognised(|part| part.fit.amounts[0] = -ratio / 0.25);
    assert!(darker(0.3) && darker(-0.5), "of another colour");
    assert!(!darker(0.45), "a shadow");
    let least = feeder_model::camera::single(SelectorConfig::default().evidence_lead_min);
    let (more, less) = (1.1 * least, 0.9 * least);
    let first = |lead: f32| recognised(|part| part.first_lead = lead);
    assert!(first(more) && !first(less), "before the light was known");
    assert!(
        recognised(|part| (part.first_lead, part.evidence_ratio) = (less, Some(1.0))),
        "its like tell of the light"
    );
    let beside = |lead: f32| recognised(|part| part.beside_lead = lead);
    assert!(beside(more) && !beside(less), "a little beside");
    let led = |due: Option<f32>, lead: f32| recognised(|part| (part.lead_due, part.lead) = (due, lead));
    assert!(led(None, more) && !led(None, less), "by no other pose that comes near");
    assert!(led(Some(2.0), 1.12) && !led(Some(2.0), 1.08), "half of what the templates say");
    assert!(led(Some(0.1), more) && !led(Some(0.1), less), "they say little");
}

#[test]
fn a_part_of_another_size_is_another_one_and_those_of_a_frame_may_share_more_of_it() {
    let sized = |evidence_ratio: Option<f32>, larger: f32| {
        recognised(|part| (part.evidence_ratio, part.fit.amounts[SCALE]) = (evidence_ratio, larger / SCALE_SPREAD))
    };
    for sign in [1.0, -1.0] {
        assert!(sized(None, 0.04 * sign) && !sized(None, 0.05 * sign), "alone");
        assert!(sized(Some(1.0), 0.07 * sign) && !sized(Some(1.0), 0.09 * sign), "in company");
    }
}

#[test]
fn what_fits_no_better_than_it_may_or_as_well_at_another_yaw_is_not_recognised() {
    let miss_max = IN_ANY_LIGHT.sought[0].miss_max();
    let missed = |share: f32| recognised(|part| part.fit.cost = share * miss_max);
    assert!(missed(0.99) && !missed(1.01));
    let first = |cost: f32| recognised(|part| part.first_cost = cost);
    assert!(first(1.75) && !first(1.85), "before what parts of the frame have in common was known");
    let shown = |share: f32| recognised(|part| part.detail_seen = Some(share));
    assert!(shown(0.56) && !shown(0.54), "a blank");
    let high = |height: f32| recognised(|part| part.height_seen = Some(height));
    assert!(high(0.61) && !high(0.59), "half as high");
    let turned = |share: f32| recognised(|part| part.turned = Some(share));
    let at_other_yaw = |share: f32| recognised(|part| part.yaw_lead = Some(share));
    for is_known in [turned, at_other_yaw] {
        assert!(is_known(0.21) && !is_known(0.19));
    }
}

#[test]
fn a_pose_is_surer_the_better_it_fits_and_alone_the_more_it_leads() {
    let miss_max = IN_ANY_LIGHT.sought[0].miss_max();
    let lead_min = feeder_model::camera::single(SelectorConfig::default().evidence_lead_min);
    let sure = |change: &dyn Fn(&mut Found)| judged(&IN_ANY_LIGHT, &[grommet_but(change)]).candidates[0].confidence;
    let fits = |share: f32| sure(&|part| part.fit.cost = share * miss_max);
    let leads = |times: f32| sure(&|part| part.lead = times * lead_min);
    let among = |times: f32| sure(&|part| (part.evidence_ratio, part.lead) = (Some(1.0), times * lead_min));
    for (confidence, wanted) in [
        (fits(0.4), 1.0),
        (fits(0.75), 0.75),
        (fits(1.0), 0.5),
        (fits(1.01), 0.0),
        (leads(2.5), 1.0),
        (leads(1.5), 0.75),
        (leads(1.0), 0.5),
        (leads(0.99), 0.0),
        (among(1.01), 1.0),
        (among(0.99), 0.0),
    ] {
        assert!((confidence - wanted).abs() < 0.01, "{confidence} {wanted}");
    }
}

/// A fifth lighter than taught: of a lighter batch if it is alone, and another thing among those that are not.
#[test]
fn a_part_alone_may_be_seen_further_from_taught_than_one_among_its_like_from_them() {
    let recognised = |evidence_ratio: Option<f32>, unlike: f32| {
        recognised(|part| (part.evidence_ratio, part.unlike) = (evidence_ratio, unlike))
    };
    assert!(recognised(Some(1.0), 1.75) && !recognised(Some(1.0), 1.85));
    assert!(recognised(None, 3.7) && !recognised(None, 3.9));
}

/// A blank without the part's figure may look as the part would in a light that is not the frame's.
#[test]
fn what_seems_to_lie_in_another_light_than_its_like_is_none_of_them_and_the_less_the_nearer_it_comes_to_another_pose() {
    let lit = |lead_due: Option<f32>, unlike: f32| {
        recognised(|part| (part.lead_due, part.unlike_in_light) = (lead_due, unlike))
    };
    assert!(lit(None, 4.4) && !lit(None, 4.6));
    assert!(lit(Some(1.0), 2.3) && !lit(Some(1.0), 2.5), "another pose comes near");
}

/// Of things that may lie in either of two poses, so many were led by next to nothing, and so many lie as well the other way round.
#[test]
fn where_light_leaves_two_poses_or_yaws_looking_alike_for_some_none_is_sure_of_them() {
    let alike = |detector: &Detector, things: usize, untold: usize, turned: usize, rivals: usize| {
        let thing = |index: usize| Found {
            first_lead: if index < untold { 0.1 } else { 0.5 },
            turned: (index < turned).then_some(0.29),
            rival: (index < rivals).then_some((1, FIT)),
            ..Found::new(0, FIT)
        };
        let found: Vec<Found> = (0..things).map(thing).collect();
        looks_alike(detector, &SelectorConfig::default(), &found)
    };
    assert_eq!(alike(&IN_ANY_LIGHT, 10, 1, 0, 10), [false, false], "one is no rule");
    assert_eq!(alike(&IN_ANY_LIGHT, 11, 4, 0, 11), [true, true]);
    assert_eq!(alike(&IN_ANY_LIGHT, 12, 4, 0, 12), [false, false], "four of twelve are few");
    assert_eq!(alike(&IN_ANY_LIGHT, 12, 4, 0, 11), [true, true], "of eleven they are not");
    assert_eq!(alike(&IN_ANY_LIGHT, 11, 4, 0, 1), [false, false], "only one of them may lie in the other pose");
    assert_eq!(alike(&IN_ANY_LIGHT, 11, 0, 4, 0), [false, false], "most show which way round they lie");
    assert_eq!(alike(&IN_ANY_LIGHT, 10, 0, 4, 0), [true, false]);
    assert_eq!(
        alike(&IN_LIGHT_TAUGHT, 10, 10, 10, 10),
        [false, false],
        "in the light taught each part tells for itself"
    );
}

/// Foreign things lie between poses that the light tells apart well: they say nothing of that.
#[test]
fn what_leads_by_far_less_than_its_templates_say_does_not_tell_that_poses_look_alike() {
    let alike = |due: f32| {
        let thing = |index: usize| Found {
            first_lead: if index < 5 { 0.1 } else { 2.0 },
            rival: Some((1, FIT)),
            lead_due: Some(if index < 5 { due } else { 2.0 }),
            ..Found::new(0, FIT)
        };
        let found: Vec<Found> = (0..10).map(thing).collect();
        looks_alike(&IN_ANY_LIGHT, &SelectorConfig::default(), &found)
    };
    assert_eq!(alike(0.44), [true, true]);
    assert_eq!(alike(0.46), [false, false]);
}

#[test]
fn what_looks_alike_in_two_poses_is_recognised_in_neither_and_that_is_told() {
    let judged = |untold: usize| {
        let thing = |index: usize| {
            grommet_but(|part| {
                part.fit.centre = at(0.06, 3.4 + 0.25 * index as f64, 0).place;
                part.first_lead = if index < untold { 0.1 } else { 0.5 };
                part.rival = Some((1, FIT));
            })
        };
        let found: Vec<Found> = (0..10).map(thing).collect();
        let judgement = judged(&IN_ANY_LIGHT, &found);
        let sure = judgement.candidates.iter().filter(|candidate| candidate.pose.is_some()).count();
        (sure, judgement.health.recognised, judgement.health.causes().contains(&HealthCause::LooksAlike))
    };
    assert_eq!(judged(3), (7, 7, false));
    assert_eq!(judged(4), (0, 0, true));
}

/// Of eleven grommets as taught, eight in one pose and three in the other, and one that fits worse than any may.
#[test]
fn what_three_of_four_recognised_parts_miss_is_told_by_pose_and_of_all() {
    let judged = |parts: &[(usize, f32)]| {
        let thing = |(index, (pose, share)): (usize, &(usize, f32))| {
            let centre = at(0.06, 3.3 + 0.2 * index as f64, 0).place;
            let cost = share * IN_LIGHT_TAUGHT.sought[*pose].miss_max();
            Found::new(*pose, Fit { centre, cost, ..FIT })
        };
        let found: Vec<Found> = parts.iter().enumerate().map(thing).collect();
        judged(&IN_LIGHT_TAUGHT, &found)
    };
    let close = |told: Option<f64>, wanted: f64| told.is_some_and(|told| (told - wanted).abs() < 1e-6);
    let lying: Vec<(usize, f32)> = [0.8, 0.1, 0.5, 0.3, 0.2, 0.7, 0.6, 0.4].map(|share| (0, share)).to_vec();
    let judgement = judged(&[lying, vec![(1, 0.15), (1, 0.25), (1, 0.05), (1, 1.1)]].concat());
    assert_eq!(judgement.health.recognised, 11);
    assert!(close(judgement.miss_ratios[0], 0.3), "{:?}", judgement.miss_ratios);
    assert_eq!(judgement.miss_ratios[1..], [None], "three are too few");
    assert!(close(judgement.miss_ratio, 0.15), "{:?}", judgement.miss_ratio);
    assert!(close(Some(judgement.health.miss_ratio), 0.3), "{:?}", judgement.health);
    assert!(close(judged(&[(0, 0.4), (1, 0.2)]).miss_ratio, 0.2), "two of any pose tell something");
    let alone = judged(&[(0, 0.4)]);
    assert_eq!((alone.miss_ratio, alone.health.miss_ratio.to_bits()), (None, 0), "one does not");
}
