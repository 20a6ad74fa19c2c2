//! Parts are fitted again by what the parts of a frame have in common: their light, and what their templates do not tell.

use nalgebra::{Point2, Rotation2, Vector2};

use super::super::align::{AtYaw, Fineness, Fit, Laid, Owners, detail_seen, lead_due, refine, residuals};
use super::super::modes::{self, Amounts, Belief, Light, MODES, SideAmounts};
use super::super::sought::{FREE_SIGMA, SHADE_SIGMA};
use super::super::template::period_rad;
use super::super::view::View;
use super::{Detector, Found};

/// How far a part shades what lies beside it, in its height.
const SHADE_HEIGHTS: f64 = 0.8;
/// Mean square miss up to which a part counts among those that tell what the light of a frame is, and how much evidence it must
/// have at least, of that which a quarter of them has; how many there must be for that, and to add to the template what all show.
const ALIKE_COST_MAX: f32 = 3.0;
const ALIKE_EVIDENCE_RATIO: f32 = 0.5;
pub(in super::super) const ALIKE_MIN: usize = 4;
const ADAPTED_MIN: usize = 6;
/// A part is looked for so far beside where it was found, px, and is another if it stays farther than that from there.
const BESIDE_PX: f64 = 3.0;
const SAME_PLACE_PX: f64 = 1.0;
/// What parts under one light differ by among each other at least, in spreads of the modes; and a part alone from the one taught,
/// beside which the floor may be as bright as it likes: a white part lights it.
const PART_SPREADS: Amounts = [0.3, 0.2, 0.4, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 1.0, 0.5];
const LONE_SPREADS: Amounts = [0.3, 0.3, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.3];
/// Light comes from one side, more than when the part was taught, where what tells that is more than this in sum, in spreads of the modes
/// (root of the squares), and what so many parts share.
const FROM_A_SIDE_MIN: f32 = 0.5;
const FROM_A_SIDE_COUNT_MIN: usize = 2;
/// Where parts seem to differ by more than so many times that, things of another kind are among them.
const PART_SPREADS_RATIO_MAX: f32 = 2.0;
/// Standard deviation of what is normally distributed, in median absolute deviations.
const DEVIATIONS_PER_MEDIAN: f32 = 1.4826;
/// What leaves no more than this share unexplained, a correlation of 0.97, may differ from its like by as much as those do from each other, if
/// that is more: parts gleam or not by where they lie. Set by hand, on path-traced nuts of metal; of foreign things that differed from
/// their like by no more than that a grommet's blank left 0.08.
const UNEXPLAINED_RATIO_MAX: f32 = 0.06;

impl Detector {
    /// What the parts of each pose have in common in this frame: light, lens, and what the template does not tell.
    fn beliefs(&self, view: &View, found: &[Found]) -> Vec<Belief> {
        let open = self.open_belief(view);
        // The same light falls on all poses.
        let lights = shared_light(self.telling(found));
        let belief = |pose: usize| {
            let sought = &self.sought[pose];
            let alike = alike(found, pose);
            if alike.len() < ALIKE_MIN {
                let spread = std::array::from_fn(|mode| open.spread[mode].min(LONE_SPREADS[mode]));
                return Belief { spread, deviation: spread, ..open.clone() };
            }
            let middle: Amounts = std::array::from_fn(|mode| {
                if modes::OTHER_LIGHTS.contains(&mode) {
                    return lights[mode];
                }
                let mut amounts: Vec<f32> = alike.iter().map(|(_, part)| part.fit.amounts[mode]).collect();
                median(&mut amounts)
            });
            let usual = median(&mut alike.iter().map(|(_, part)| part.fit.evidence).collect::<Vec<f32>>());
            let mut added = Vec::new();
            if alike.len() >= ADAPTED_MIN {
                let seen: Vec<Vec<Option<f32>>> = alike
                    .iter()
                    .filter_map(|(index, part)| {
                        let owners = self.owners_for(*index, SHADE_SIGMA);
                        let picture = sought.fitted(&sought.aspect(view, &part.fit), &part.fit.amounts);
                        residuals(&self.segmentation, view, sought, (&part.fit, &picture), &owners)
                    })
                    .collect();
                added.resize(sought.outside_m.len(), 0.0);
                let mut levels = Vec::new();
                for (place, texel) in sought.texels.iter().enumerate() {
                    levels.clear();
                    levels.extend(seen.iter().filter_map(|seen| seen[place]));
                    if levels.len() >= ADAPTED_MIN {
                        added[*texel] = median(&mut levels);
                    }
                }
            }
            let aside: Amounts = std::array::from_fn(|mode| {
                if modes::OTHER_LIGHTS.contains(&mode) {
                    return PART_SPREADS[mode];
                }
                let aside = |(_, part): &(usize, &Found)| (part.fit.amounts[mode] - middle[mode]).abs();
                let mut aside: Vec<f32> = alike.iter().map(aside).collect();
                median(&mut aside).min(PART_SPREADS_RATIO_MAX * PART_SPREADS[mode])
            });
            let spread = std::array::from_fn(|mode| aside[mode].max(PART_SPREADS[mode]));
            let deviation = std::array::from_fn(|mode| (DEVIATIONS_PER_MEDIAN * aside[mode]).max(PART_SPREADS[mode]));
            Belief { middle, spread, deviation, added, evidence: usual }
        };
        (0..self.sought.len()).map(belief).collect()
    }

    /// From where the parts of a frame tell that light comes, if it comes from one side more than when they were taught.
    pub(super) fn light_from_a_side(&self, found: &[Found]) -> Option<SideAmounts> {
        let sides = modes::of_sides(&shared_light(self.telling(found)));
        let square: f32 = sides.iter().map(|amount| amount * amount).sum();
        let told = self.telling(found).count() >= FROM_A_SIDE_COUNT_MIN;
        let is_from_a_side = told && square >= FROM_A_SIDE_MIN * FROM_A_SIDE_MIN;
        (self.light == Light::Any && is_from_a_side).then_some(sides)
    }

    /// The fits that tell what the light of a frame is, of all poses.
    fn telling<'a>(&self, found: &'a [Found]) -> impl Iterator<Item = &'a Fit> {
        (0..self.sought.len()).flat_map(|pose| alike(found, pose)).map(|(_, part)| &part.fit)
    }

    /// Fits parts again from where they were found, by what they have in common: without what belongs to neighbours, and what
    /// lies alone by what is seen beside it too.
    pub(in super::super) fn fit_again(&self, view: &View, found: &mut [Found]) {
        let beliefs = match self.light {
            Light::Taught => vec![Belief::open(); self.sought.len()],
            Light::Any => self.beliefs(view, found),
        };
        let places: Vec<(Point2<f64>, f64)> =
            found.iter().map(|part| (part.fit.centre, self.sought[part.pose].radius_m)).collect();
        for (index, part) in found.iter_mut().enumerate() {
            let sought = &self.sought[part.pose];
            let (centre, radius_m) = places[index];
            let shaded_m = |height_m: f64| SHADE_HEIGHTS * height_m + 3.0 * sought.m_per_px;
            let close = |(other, (place, reach_m)): (usize, &(Point2<f64>, f64))| {
                other != index && (place - centre).norm() < radius_m + reach_m + shaded_m(self.height_m_max)
            };
            let alone = !places.iter().enumerate().any(close);
            let owners = self.owners_for(index, if alone { FREE_SIGMA } else { SHADE_SIGMA });
            let belief = &beliefs[part.pose];
            if let Some(fit) = refine(&self.segmentation, view, sought, part.fit, &owners, belief, Fineness::Full) {
                let (fit, turned) = self.righted(view, part, fit, &owners, belief);
                (part.first_cost, part.first_lead) = (part.fit.cost, part.lead);
                // In the light taught, what is seen beside tells where a part is, not what it is.
                let told = if alone && self.light == Light::Taught { part.fit } else { fit };
                part.fit = Fit { cost: told.cost, evidence: told.evidence, ..fit };
                part.evidence_per_texel = sought.per_texel(part.fit.evidence);
                let laid = Laid { sought, fit: &fit, belief };
                let at_yaw = AtYaw::new(&self.segmentation, view, laid, &owners);
                let led = |other: Fit| at_yaw.as_ref()?.lead_share(&other);
                part.turned = turned.into_iter().filter_map(led).reduce(f32::min);
                part.yaw_lead = self.likeliest_at_another_yaw(view, part, &fit, &owners, belief).and_then(led);
                part.detail_seen = detail_seen(&self.segmentation, view, sought, &fit, &owners);
                if self.light == Light::Taught {
                    continue;
                }
                if let Some((pose, rival)) = part.rival {
                    let (other, belief) = (&self.sought[pose], &beliefs[pose]);
                    let rival = refine(&self.segmentation, view, other, rival, &owners, belief, Fineness::Full);
                    if let Some(rival) = rival {
                        part.lead = sought.per_texel(fit.evidence - rival.evidence);
                        let rival = Laid { sought: other, fit: &rival, belief };
                        part.lead_due = lead_due(&self.segmentation, view, &laid, &rival, &owners);
                    }
                }
                part.beside_lead = self.lead_beside(view, part.pose, &fit, &owners, belief);
                part.evidence_ratio = (belief.evidence > 0.0).then(|| fit.evidence / belief.evidence);
                part.unlike = unlike(part, &fit, belief);
            } else if self.light == Light::Any {
                // What fits only in a light that is not the frame's is nothing.
                part.fit.evidence = f32::NEG_INFINITY;
            }
        }
        if self.light == Light::Any {
            compare_lights(found, self.sought.len());
        }
    }

    /// By how much, per texel, a fit leads those of the same pose that begin a little beside it and stay there: where a sloping side is as
    /// bright as the top, either may be what is seen.
    fn lead_beside(&self, view: &View, pose: usize, fit: &Fit, owners: &Owners, belief: &Belief) -> f32 {
        let sought = &self.sought[pose];
        let led = |(x, y): (f64, f64)| {
            let aside_m = Vector2::new(x, y) * BESIDE_PX * sought.m_per_px;
            let mut other = Fit { centre: fit.centre + Rotation2::new(fit.yaw_rad) * aside_m, ..*fit };
            for fineness in [Fineness::Rough, Fineness::Full] {
                other = refine(&self.segmentation, view, sought, other, owners, belief, fineness)?;
                if (other.centre - fit.centre).norm() <= SAME_PLACE_PX * sought.m_per_px {
                    return None;
                }
            }
            Some(sought.per_texel(fit.evidence - other.evidence))
        };
        let asides = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)];
        asides.into_iter().filter_map(led).fold(f32::INFINITY, f32::min)
    }

    /// A part fitted among others, or turned by half if it is seen better so: from afar the search may take one for the other. With
    /// what fits turned by half from there.
    fn righted(&self, view: &View, part: &mut Found, fit: Fit, owners: &Owners, belief: &Belief) -> (Fit, Vec<Fit>) {
        let turned = self.turned(view, part.pose, &fit, owners, belief);
        let better = turned.iter().filter(|other| other.evidence > fit.evidence);
        let Some(better) = better.copied().max_by(|a, b| a.evidence.total_cmp(&b.evidence)) else {
            return (fit, turned);
        };
        // As it would have been found.
        let (sought, owners_first) = (&self.sought[part.pose], Owners { beside_sigma: SHADE_SIGMA, ..*owners });
        let open = self.open_belief(view);
        let first = refine(&self.segmentation, view, sought, better, &owners_first, &open, Fineness::Full);
        let Some(first) = first else { return (fit, turned) };
        part.lead += sought.per_texel(first.evidence - part.fit.evidence);
        part.fit = first;
        (better, self.turned(view, part.pose, &better, owners, belief))
    }

    /// What fits in place of a part that was fitted so turned by half a period of its symmetry, in the same place and only a little
    /// beside.
    fn turned(&self, view: &View, pose: usize, fit: &Fit, owners: &Owners, belief: &Belief) -> Vec<Fit> {
        let sought = &self.sought[pose];
        if sought.template.yaw_symmetry == 0 {
            return Vec::new();
        }
        let turned = Fit { yaw_rad: fit.yaw_rad + 0.5 * period_rad(sought.template.yaw_symmetry), ..*fit };
        let stays = |other: &Fit| !self.yaws_differ(pose, turned.yaw_rad, other.yaw_rad);
        let laid = |fineness: Fineness| refine(&self.segmentation, view, sought, turned, owners, belief, fineness);
        [Fineness::Fixed, Fineness::Full].into_iter().filter_map(laid).filter(stays).collect()
    }

    /// What the likeliest explanation of a part that was fitted so by the same pose at another yaw comes to, if that is another in the
    /// end.
    fn likeliest_at_another_yaw(
        &self,
        view: &View,
        part: &Found,
        fit: &Fit,
        owners: &Owners,
        belief: &Belief,
    ) -> Option<Fit> {
        let sought = &self.sought[part.pose];
        let rival = refine(&self.segmentation, view, sought, part.yaw_rival?, owners, belief, Fineness::Full)?;
        self.yaws_differ(part.pose, fit.yaw_rad, rival.yaw_rad).then_some(rival)
    }
}

/// The amounts of other lights in which parts are seen: the same light falls on all.
fn shared_light<'a>(fits: impl Iterator<Item = &'a Fit>) -> Amounts {
    let fits: Vec<&Fit> = fits.filter(|fit| fit.cost <= ALIKE_COST_MAX).collect();
    let mut lights = [0.0; MODES];
    for mode in modes::OTHER_LIGHTS {
        lights[mode] = median(&mut fits.iter().map(|fit| fit.amounts[mode]).collect::<Vec<f32>>());
    }
    lights
}

/// By how many times what parts of its pose differ by one that is fitted so differs from the middle one, as a surface or in size.
fn unlike(part: &Found, fit: &Fit, belief: &Belief) -> f32 {
    let differ = if part.correlates(UNEXPLAINED_RATIO_MAX) { &belief.deviation } else { &belief.spread };
    let unlike = |mode: usize| ((fit.amounts[mode] - belief.middle[mode]) / differ[mode]).abs();
    (0..modes::OTHER_LIGHTS.start).chain([modes::SCALE]).map(unlike).fold(0.0, f32::max)
}

/// Tells how unlike the others of its pose each part is in the light that it seems to be seen in. (Poses differ in that: what their drawings
/// leave out is put down to light.)
fn compare_lights(found: &mut [Found], poses: usize) {
    for pose in 0..poses {
        let alike = alike(found, pose);
        if alike.len() < ALIKE_MIN {
            continue;
        }
        let lights = shared_light(alike.iter().map(|(_, part)| &part.fit));
        for part in found.iter_mut().filter(|part| part.pose == pose) {
            let unlike = |mode: usize| ((part.fit.amounts[mode] - lights[mode]) / PART_SPREADS[mode]).abs();
            part.unlike_in_light = modes::WHOLE_LIGHTS.map(unlike).fold(0.0, f32::max);
        }
    }
}

/// The parts in a pose that tell what the light of a frame is, with where they stand among all. Beside parts the floor may pass for dim
/// ones, and for more than there are parts: what stands out by far less than a quarter of them do tells nothing.
fn alike(found: &[Found], pose: usize) -> Vec<(usize, &Found)> {
    let of_pose = |part: &Found| part.pose == pose && part.fit.cost <= ALIKE_COST_MAX;
    let mut evidences: Vec<f32> = found.iter().filter(|part| of_pose(part)).map(|part| part.fit.evidence).collect();
    evidences.sort_by(f32::total_cmp);
    let strong = evidences.get(evidences.len() * 3 / 4).copied().unwrap_or(0.0);
    let stands_out = |part: &Found| part.fit.evidence >= ALIKE_EVIDENCE_RATIO * strong;
    found.iter().enumerate().filter(|(_, part)| of_pose(part) && stands_out(part)).collect()
}

/// What parts that lie in the same light tell of it about another one, if they are enough.
pub(in super::super) fn belief_of_light(fits: &[Fit], open: &Belief) -> Option<Belief> {
    let lights = shared_light(fits.iter());
    let mut belief = open.clone();
    for mode in modes::OTHER_LIGHTS {
        (belief.middle[mode], belief.spread[mode]) = (lights[mode], PART_SPREADS[mode]);
    }
    (fits.iter().filter(|fit| fit.cost <= ALIKE_COST_MAX).count() >= ALIKE_MIN).then_some(belief)
}

/// The middle of some values; 0 without any.
fn median(values: &mut [f32]) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry2;

    use super::*;
    use crate::template::SIDES;
    use crate::tests::recognition::IN_ANY_LIGHT;

    /// A part that fits with this evidence, and what light has made of it.
    fn found(evidence: f32, change: impl FnOnce(&mut Fit)) -> Found {
        let mut fit = Fit { centre: Point2::new(0.0, -0.06), yaw_rad: 0.0, cost: 0.1, evidence, amounts: [0.0; MODES] };
        change(&mut fit);
        Found::new(0, fit)
    }

    /// The floor beside parts may pass for dim ones, and more of those may be seen than parts.
    #[test]
    fn the_light_of_a_frame_is_told_by_what_stands_out_most_however_much_dimmer_things_there_are() {
        let view = IN_ANY_LIGHT.view(&Isometry2::identity());
        let mut things: Vec<Found> = (0..4).map(|_| found(900.0, |fit| fit.amounts[0] = 0.5)).collect();
        things.extend((0..5).map(|_| found(300.0, |fit| fit.amounts[0] = -1.5)));
        let belief = &IN_ANY_LIGHT.beliefs(&view, &things)[0];
        assert_eq!((belief.middle[0], belief.evidence), (0.5, 900.0));
        // Three are too few to tell.
        let belief = &IN_ANY_LIGHT.beliefs(&view, &things[..3])[0];
        assert_eq!((belief.middle[0], belief.evidence), (0.0, 0.0));
    }

    /// Parts that gleam differ from each other by where they lie.
    #[test]
    fn a_part_may_be_the_more_unlike_its_like_the_more_those_differ_but_not_without_end() {
        let view = IN_ANY_LIGHT.view(&Isometry2::identity());
        for (apart, spread, deviation) in [(0.0, 0.2, 0.2), (0.15, 0.2, 0.2224), (0.3, 0.3, 0.4448), (1.5, 0.4, 0.593)]
        {
            let things: Vec<Found> =
                [-1.0, -1.0, 0.0, 1.0, 1.0].map(|side| found(900.0, |fit| fit.amounts[1] = side * apart)).into();
            let belief = &IN_ANY_LIGHT.beliefs(&view, &things)[0];
            assert!((belief.spread[1] - spread).abs() < 1e-4, "{apart}: {:?}", belief.spread);
            assert!((belief.deviation[1] - deviation).abs() < 1e-4, "{apart}: {:?}", belief.deviation);
        }
    }

    #[test]
    fn what_its_template_explains_next_to_wholly_may_differ_from_its_like_as_those_do_from_each_other() {
        let belief = Belief { deviation: [0.5; MODES], spread: [0.25; MODES], ..Belief::open() };
        let unlike_one = |evidence_per_texel: f32| {
            let thing = Found { evidence_per_texel, ..found(900.0, |fit| fit.amounts[0] = 1.0) };
            unlike(&thing, &thing.fit, &belief)
        };
        // It misses by 0.1.
        assert!((unlike_one(0.8) - 2.0).abs() < 1e-6);
        assert!((unlike_one(0.75) - 4.0).abs() < 1e-6);
        assert!((unlike_one(-1.0) - 4.0).abs() < 1e-6, "it stands out less than bare floor would");
    }

    #[test]
    fn light_comes_from_a_side_where_what_two_parts_share_tells_so() {
        let first = modes::OTHER_LIGHTS.end - SIDES;
        let lit = |amount: f32, cost: f32| {
            found(900.0, |fit| {
                (fit.amounts[first], fit.amounts[first + 3]) = (amount, amount);
                fit.cost = cost;
            })
        };
        let told = IN_ANY_LIGHT.light_from_a_side(&[lit(0.5, 0.1), lit(0.5, 2.0), lit(0.0, 0.2)]);
        assert_eq!(told, Some([0.5, 0.0, 0.0, 0.5]));
        assert_eq!(IN_ANY_LIGHT.light_from_a_side(&[lit(0.3, 0.1), lit(0.3, 0.1)]), None, "no more than chance");
        assert_eq!(IN_ANY_LIGHT.light_from_a_side(&[lit(0.5, 0.1), lit(0.5, 4.0)]), None, "one that fits");
    }

    #[test]
    fn how_unlike_its_like_in_light_a_part_is_is_told_by_pose_where_enough_lie_to_tell() {
        let lit = |pose: usize, amount: f32| Found {
            pose,
            ..found(900.0, |fit| fit.amounts[modes::WHOLE_LIGHTS.start + 1] = amount)
        };
        // Poses differ by more than one of a pose may; those of low light from a side tell nothing.
        let mut things = [[lit(0, 0.5); 4], [lit(1, 1.5); 4]].concat();
        things.push(lit(0, 0.25));
        things[0].fit.amounts[modes::OTHER_LIGHTS.end - 1] = 2.0;
        compare_lights(&mut things, 2);
        let unlike: Vec<f32> = things.iter().map(|part| part.unlike_in_light).collect();
        assert_eq!(unlike[..8], [0.0; 8]);
        assert!((unlike[8] - 2.5).abs() < 1e-5, "{unlike:?}");
        let mut few = [lit(0, 0.5), lit(0, 0.5), lit(0, 2.0)];
        compare_lights(&mut few, 1);
        assert!(few.iter().all(|part| part.unlike_in_light < 1e-6));
    }
}
