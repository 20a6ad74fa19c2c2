//! First guesses of what lies at a place, and which of them are worth fitting.

use nalgebra::Point2;

use super::super::align::{CostMax, Fit, coarse, coarse_evidence, glance};
use super::super::modes::{self, Light, MODES};
use super::super::search::Seed;
use super::super::segment::Segmentation;
use super::super::sought::{Sought, Turn, slant_index};
use super::super::view::View;
use super::{Detector, Found, yaw_difference_rad};

/// Mean square miss at a glance up to which a place is looked at closely.
const GLANCE_COST_MAX: f32 = 5.0;
/// Mean square miss up to which a guess is worth fitting, and where light comes from one side more than when the part was taught, as
/// shadows then end beside where they are expected. Set by hand: with 5 there, a third of the path-traced grommets under a low lamp were
/// missed that were taught under a ring, with 8 a sixth. In all light 6.5 to 12 did for them what 8 does, and one nut more was wrong.
const COARSE_COST_MAX: f32 = 5.0;
const COARSE_COST_FROM_A_SIDE_MAX: f32 = 8.0;
/// The same for the first points looked at.
const FIRST_COST_MAX: f32 = 9.0;
/// What a pixel beside may make of the miss.
const BESIDE_COST: f32 = 2.0;
/// A second yaw is tried where it misses by at most this much more than the best.
const SECOND_YAW_COST: f32 = 2.0;
/// Yaws tried at most at a seed.
const YAWS_MAX: usize = 5;
/// Places nearer than this, relative to the part's radius, are one.
const SAME_PLACE_RATIO: f64 = 0.4;
/// Yaws further apart than so many steps of the coarse search lead to different fits.
const OTHER_YAW_TURNS: f64 = 1.2;
/// A pose whose evidence is this much weaker per texel in the coarse search is not fitted.
const COARSE_LEAD: f32 = 1.2;

impl Detector {
    /// First guesses of the yaw at a seed: as the rings tell the light there or, where that leads to none, as taught.
    pub(super) fn guess(&self, view: &View, seed: Seed, guesses: &mut Vec<Found>) {
        let before = guesses.len();
        self.guess_in_light(view, seed, guesses);
        if self.light == Light::Any && guesses.len() == before {
            self.guess_in_light(view, Seed { light: None, ..seed }, guesses);
        }
    }

    fn guess_in_light(&self, view: &View, seed: Seed, guesses: &mut Vec<Found>) {
        let sought = &self.sought[seed.pose];
        let window = self.segmentation.window;
        let turns = turns_at(view, &self.segmentation, sought, seed);
        let mut least = f32::INFINITY;
        let mut looks: Vec<Look> = turns
            .iter()
            .map(|turn| {
                let all = least + BESIDE_COST;
                let cost_max = CostMax { first: FIRST_COST_MAX.min(all), all };
                let place = (seed.column, seed.row);
                let cost = coarse(&self.segmentation, &turn.points, place, seed.light.as_ref(), cost_max);
                least = least.min(cost);
                Look { cost, place }
            })
            .collect();
        // The seed may be a pixel beside the centre: the place where the best turn misses least is taken.
        let worth_a_look = least + BESIDE_COST;
        let mut best_place = (seed.column, seed.row);
        for (look, turn) in looks.iter_mut().zip(turns).filter(|(look, _)| look.cost <= worth_a_look) {
            for place in beside(seed) {
                let cost_max = CostMax { first: look.cost, all: look.cost };
                let cost = coarse(&self.segmentation, &turn.points, place, seed.light.as_ref(), cost_max);
                if cost < look.cost {
                    *look = Look { cost, place };
                    if cost <= least {
                        (least, best_place) = (cost, place);
                    }
                }
            }
        }
        let pixel = Point2::new((window.left + best_place.0) as f64, (window.top + best_place.1) as f64);
        let Some(centre) = view.tray_point(pixel, sought.plane_m) else {
            return;
        };
        let evidence =
            |index: usize| coarse_evidence(&self.segmentation, &turns[index], looks[index].place, seed.light.as_ref());
        guesses.extend(valleys(&looks, self.coarse_cost_max(), evidence).into_iter().map(|(index, evidence)| {
            let cost = looks[index].cost;
            let amounts = seed.light.map_or([0.0; MODES], |light| modes::all(&light));
            let yaw_rad = turns[index].yaw_rad - view.platen_from_tray.rotation.angle();
            Found::new(seed.pose, Fit { centre, yaw_rad, cost, evidence, amounts })
        }));
    }

    /// Mean square miss up to which a guess is worth fitting in the frame looked at.
    fn coarse_cost_max(&self) -> f32 {
        if self.is_lit_from_a_side { COARSE_COST_FROM_A_SIDE_MAX } else { COARSE_COST_MAX }
    }

    /// Leaves out guesses that another one near does better: with the same pose and yaw it leads to the same fit, and with
    /// another pose it is only an explanation to be led.
    pub(super) fn distinct(&self, mut guesses: Vec<Found>) -> Vec<Found> {
        guesses.sort_by(|a, b| b.fit.evidence.total_cmp(&a.fit.evidence));
        let mut kept: Vec<Found> = Vec::with_capacity(guesses.len());
        for guess in guesses {
            let sought = &self.sought[guess.pose];
            let near_m = (SAME_PLACE_RATIO * sought.radius_m).max(1.5 * sought.m_per_px);
            let mut worth_fitting = true;
            for other in kept.iter_mut().filter(|other| (other.fit.centre - guess.fit.centre).norm() <= near_m) {
                let lead = self.lead(other, &guess);
                if other.pose == guess.pose {
                    worth_fitting &=
                        lead <= COARSE_LEAD && self.yaws_differ(guess.pose, other.fit.yaw_rad, guess.fit.yaw_rad);
                } else if lead > COARSE_LEAD {
                    other.lead = other.lead.min(lead);
                    worth_fitting = false;
                }
            }
            if worth_fitting {
                kept.push(guess);
            }
        }
        kept
    }

    /// Whether two yaws of a pose are more than a few degrees apart, so that they lead to different fits.
    pub(in super::super) fn yaws_differ(&self, pose: usize, a_rad: f64, b_rad: f64) -> bool {
        let sought = &self.sought[pose];
        let symmetry = sought.template.yaw_symmetry;
        let apart_rad = yaw_difference_rad(a_rad, b_rad, symmetry).abs();
        symmetry != 0 && apart_rad > OTHER_YAW_TURNS * std::f64::consts::TAU / f64::from(symmetry) / sought.yaw_count()
    }
}

/// What a glance at a seed misses at least; infinitely much where nothing there is worth a closer look.
pub(super) fn glance_at(view: &View, frame: &Segmentation, sought: &Sought, seed: Seed) -> f32 {
    let least =
        |least: f32, turn: &Turn| least.min(glance(frame, turn, (seed.column, seed.row), seed.light.as_ref(), least));
    let miss = turns_at(view, frame, sought, seed).iter().fold(GLANCE_COST_MAX, least);
    if miss < GLANCE_COST_MAX { miss } else { f32::INFINITY }
}

/// The turns as the camera sees them at a seed; none where it sees no place.
pub(super) fn turns_at<'a>(view: &View, frame: &Segmentation, sought: &'a Sought, seed: Seed) -> &'a [Turn] {
    let seeded = Point2::new((frame.window.left + seed.column) as f64, (frame.window.top + seed.row) as f64);
    let slant = view.tray_point(seeded, sought.plane_m).map(|place| view.slant(place, sought.plane_m));
    slant.and_then(|slant| sought.turns.get(slant_index(slant))).map_or(&[], Vec::as_slice)
}

/// What a turn looks like at the place near a seed where it misses least.
#[derive(Clone, Copy)]
struct Look {
    /// Mean square miss.
    cost: f32,
    /// Column and row of the window.
    place: (usize, usize),
}

/// Of what all turns look like, the few that miss less than those next to them and by at most `cost_max`, with their evidence, the
/// best first.
fn valleys(looks: &[Look], cost_max: f32, evidence: impl Fn(usize) -> f32) -> Vec<(usize, f32)> {
    let cost_after = |index: usize, step: usize| looks[(index + step) % looks.len()].cost;
    let least = looks.iter().map(|look| look.cost).fold(f32::INFINITY, f32::min);
    let is_lowest = |index: usize| {
        let cost = looks[index].cost;
        let lowest = cost <= cost_after(index, 1) && cost <= cost_after(index, looks.len() - 1);
        lowest && cost <= cost_max.min(least + SECOND_YAW_COST)
    };
    let valleys = (0..looks.len()).filter(|index| is_lowest(*index)).map(|index| (index, evidence(index)));
    // What bare floor explains better is no part.
    let mut valleys: Vec<(usize, f32)> = valleys.filter(|(_, evidence)| *evidence > 0.0).collect();
    valleys.sort_by(|(a, _), (b, _)| looks[*a].cost.total_cmp(&looks[*b].cost));
    valleys.truncate(YAWS_MAX);
    valleys
}

/// The pixels beside a seed that are tried.
fn beside(seed: Seed) -> impl Iterator<Item = (usize, usize)> {
    let near = [(1, 0), (-1, 0), (0, 1), (0, -1)];
    near.into_iter().filter_map(move |(x, y)| seed.column.checked_add_signed(x).zip(seed.row.checked_add_signed(y)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::recognition::IN_ANY_LIGHT;

    #[test]
    fn a_guess_may_miss_by_more_where_light_comes_from_one_side() {
        let looks = [9.0, 7.0, 9.0].map(|cost| Look { cost, place: (0, 0) });
        let mut detector = IN_ANY_LIGHT.clone();
        for (is_lit_from_a_side, worth_fitting) in [(false, vec![]), (true, vec![(1, 2.0)])] {
            detector.is_lit_from_a_side = is_lit_from_a_side;
            assert_eq!(valleys(&looks, detector.coarse_cost_max(), |_| 2.0), worth_fitting);
        }
        assert!(valleys(&looks, detector.coarse_cost_max(), |_| -1.0).is_empty(), "bare floor explains it better");
    }
}
