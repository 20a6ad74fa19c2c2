//! The best tray together with its waveform: parts per minute that arrive one by one.

use std::f64::consts::TAU;

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::flow::{Flow, Lane, Loading, lane_flow};
use super::search::{Effort, Found, climb};
use super::shape::{ShapeSpace, check_limits, closed_form, tamed};
use super::singulation::Crest;
use crate::mechanics::annular::AnnularTrack;
use crate::mechanics::map::TrayMap;
use crate::mechanics::{Friction, MechanicsError, check_slope};
use crate::range::OutOfRange;
use crate::tray::TrayGeometry;
use crate::waveform::{Axis, AxisLimits, OptimalDesign, Waveform};

/// Places of entry looked at during the search.
const SEARCH_PLACES: u32 = 24;
/// Places of entry looked at to polish the winners.
const POLISH_PLACES: u32 = 200;
/// Candidates that are polished.
const WINNERS: usize = 3;
/// Times the winners are polished at most.
const POLISH_ROUNDS: usize = 6;
/// Candidates of the coarse search, which knows mean speeds alone, that are taken on to the fine one.
const FINALISTS: usize = 8;
/// Spacing asked for in the fine search over that wanted, at first: room for places of entry between those looked at.
const SPACING_MARGIN: f64 = 1.001;

/// A kind of part to be fed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartKind {
    /// Length along the track, and width across it, m.
    pub length_m: f64,
    /// Coefficients of friction to be fed with.
    pub frictions: Vec<f64>,
}

/// The period of the waveform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Period {
    /// Given, s.
    Fixed(f64),
    /// Free up to this, s, and as far as speed and stroke allow.
    UpTo(f64),
}

/// What a tray is wanted for.
#[derive(Clone, Debug, PartialEq)]
pub struct TrayGoal {
    /// The parts; the slowest flow among kinds and frictions counts.
    pub kinds: Vec<PartKind>,
    /// Spacing wanted on the plateau, in part lengths: parts closer than that do not count.
    pub spacing_parts: f64,
    /// How parts come onto the ramp.
    pub loading: Loading,
    /// Radius of the outer wall, along which the parts travel, m.
    pub outer_radius_m: f64,
    /// Smallest radius of the inner wall, m.
    pub inner_radius_m: f64,
    /// Smallest rise, m: the height of the drop that turns parts over.
    pub rise_min_m: f64,
    /// Largest angle of the ramp, rad.
    pub ramp_angle_max_rad: f64,
    /// Period of the waveform.
    pub period: Period,
    /// What the yaw axis can do.
    pub limits: AxisLimits,
    /// Gravity, m/s².
    pub gravity_m_s2: f64,
}

/// A tray, its waveform, and what they do for each kind of part and friction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DesignedTray {
    /// The tray. Its inner wall stands at the critical radius where there is room for it, so that no part is stranded.
    pub tray: TrayGeometry,
    /// The waveform, on Yaw.
    pub waveform: Waveform,
    /// Flow by kind of part, then by friction.
    pub flows: Vec<Vec<Flow>>,
    /// Parts per minute that arrive with the spacing wanted, for the kind and friction with the fewest.
    pub parts_per_min: f64,
    /// Outermost radius from which some part does not climb, m; `None` where all climb everywhere.
    pub critical_radius_m: Option<f64>,
    /// Share of the area outside the goal's inner radius that lies inside the critical radius: the share of parts poured
    /// evenly over it that would be stranded there if the inner wall stood at the goal's inner radius.
    pub stranded_share: f64,
}

impl DesignedTray {
    /// The smallest spacing on the plateau of any kind and friction, in part lengths.
    #[must_use]
    pub fn spacing_parts(&self) -> Option<f64> {
        self.flows.iter().flatten().map(|flow| flow.plateau_spacing_parts).reduce(f64::min)
    }
}

impl TrayGoal {
    /// The best tray with a waveform of `segments` segments that a search finds, `None` if it finds none that feeds.
    ///
    /// `progress` is told the share of the search that is done, 0 to 1.
    ///
    /// # Errors
    ///
    /// If a parameter of the goal is out of range.
    pub fn best(
        &self,
        segments: usize,
        effort: Effort,
        mut progress: impl FnMut(f64),
    ) -> Result<Option<DesignedTray>, MechanicsError> {
        self.check()?;
        let space = ShapeSpace { axis: Axis::Yaw, segments, limit: self.limits.max_acceleration };
        let step_by = [space.step_by(), vec![0.2; Candidate::EXTRAS]].concat();
        let climb_all = |starts: Vec<Vec<f64>>, detail: Detail, steps: u64, progress: &mut dyn FnMut(f64)| {
            let objective = |point: &[f64]| self.score(&space, point, detail).unwrap_or(f64::NAN);
            let total = starts.len();
            let mut found: Vec<Found> = Vec::with_capacity(total);
            for start in starts {
                found.push(climb(&objective, start, &step_by, steps));
                progress(share(found.len(), total));
            }
            found.sort_by(|one, other| other.value.total_cmp(&one.value));
            found
        };
        let coarse =
            climb_all(self.starts(&space, effort), Detail::MeanSpeeds, effort.steps, &mut |done| progress(done / 2.0));
        let finalists = coarse.into_iter().take(FINALISTS).map(|found| found.point).collect();
        let mut asked_parts = self.spacing_parts * SPACING_MARGIN;
        let detail = Detail::Crest { places: SEARCH_PLACES, asked_parts };
        let mut winners = climb_all(finalists, detail, effort.steps, &mut |done| {
            progress(0.5 + 0.4 * done);
        });
        let mut best: Option<DesignedTray> = None;
        for round in 1..=POLISH_ROUNDS {
            winners.truncate(WINNERS);
            let points = winners.into_iter().map(|found| found.point).collect();
            let detail = Detail::Crest { places: POLISH_PLACES, asked_parts };
            winners = climb_all(points, detail, effort.steps / 4, &mut |_| ());
            progress(0.9 + 0.1 * share(round, POLISH_ROUNDS));
            for found in &winners {
                let Some(candidate) = self.candidate(&space, &found.point) else {
                    continue;
                };
                let Some(rated) = self.rated(candidate)? else {
                    continue;
                };
                if best.as_ref().is_none_or(|best| rated.parts_per_min > best.parts_per_min) {
                    best = Some(rated);
                }
            }
            // Where even the best arrive too close together, ask for that much more.
            let Some(spacing) =
                best.as_ref().filter(|best| best.parts_per_min == 0.0).and_then(DesignedTray::spacing_parts)
            else {
                break;
            };
            asked_parts *= (self.spacing_parts * SPACING_MARGIN / spacing).max(SPACING_MARGIN);
        }
        Ok(best)
    }

    /// What a given tray and waveform do for the goal; `None` if some part does not get over the crest.
    ///
    /// # Errors
    ///
    /// If the tray has no lane for a part, or a part leaves its surface.
    pub fn rate(&self, tray: TrayGeometry, waveform: Waveform) -> Result<Option<DesignedTray>, MechanicsError> {
        self.check()?;
        self.rated(Candidate { tray, waveform })
    }

    fn rated(&self, candidate: Candidate) -> Result<Option<DesignedTray>, MechanicsError> {
        let Candidate { tray, waveform } = candidate;
        let mut flows = Vec::with_capacity(self.kinds.len());
        let (mut parts_per_min, mut critical_radius_m) = (f64::INFINITY, None::<f64>);
        for kind in &self.kinds {
            let mut of_kind = Vec::with_capacity(kind.frictions.len());
            for &friction in &kind.frictions {
                let track = AnnularTrack::new(tray, Friction::uniform(friction)?, self.gravity_m_s2)?;
                let flow = lane_flow(&track, &waveform, kind.length_m, self.loading, self.spacing_parts)?;
                let Some(flow) = flow else { return Ok(None) };
                let arrives_apart = flow.plateau_spacing_parts >= self.spacing_parts * (1.0 - 1e-9);
                parts_per_min = parts_per_min.min(if arrives_apart { flow.parts_per_min } else { 0.0 });
                let critical = TrayMap::new(&track, &waveform)?.critical_radius_m()?;
                critical_radius_m = critical.into_iter().chain(critical_radius_m).reduce(f64::max);
                of_kind.push(flow);
            }
            flows.push(of_kind);
        }
        let (inner, outer) = (self.inner_radius_m, self.outer_radius_m);
        let stranded_share = critical_radius_m
            .map_or(0.0, |critical| (critical * critical - inner * inner).max(0.0) / (outer * outer - inner * inner));
        let widest_m = self.kinds.iter().map(|kind| kind.length_m).fold(0.0, f64::max);
        let inner_radius_m = critical_radius_m.unwrap_or(inner).max(inner).min(outer - widest_m);
        let tray = TrayGeometry { inner_radius_m, ..tray };
        Ok(Some(DesignedTray { tray, waveform, flows, parts_per_min, critical_radius_m, stranded_share }))
    }

    /// Checks every parameter of the goal.
    ///
    /// # Errors
    ///
    /// The first parameter out of its range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        check_limits(&self.limits)?;
        check_slope(0.0, self.gravity_m_s2)?;
        OutOfRange::unless_positive("spacing_parts", self.spacing_parts)?;
        OutOfRange::unless_positive("rise_min_m", self.rise_min_m)?;
        OutOfRange::unless(
            self.ramp_angle_max_rad > 0.0 && self.ramp_angle_max_rad < TAU,
            "ramp_angle_max_rad",
            self.ramp_angle_max_rad,
            "0 < ramp_angle_max_rad < 2π",
        )?;
        OutOfRange::unless_positive("inner_radius_m", self.inner_radius_m)?;
        match self.period {
            Period::Fixed(period_s) | Period::UpTo(period_s) => OutOfRange::unless_positive("period_s", period_s)?,
        };
        OutOfRange::unless(!self.kinds.is_empty(), "kinds", share(self.kinds.len(), 1), "at least one")?;
        for kind in &self.kinds {
            OutOfRange::unless(
                kind.length_m > 0.0 && kind.length_m < self.outer_radius_m - self.inner_radius_m,
                "length_m",
                kind.length_m,
                format_args!("0 < length_m < {} (between the walls)", self.outer_radius_m - self.inner_radius_m),
            )?;
            OutOfRange::unless(
                !kind.frictions.is_empty(),
                "frictions",
                share(kind.frictions.len(), 1),
                "at least one",
            )?;
            for &friction in &kind.frictions {
                Friction::uniform(friction)?;
            }
        }
        Ok(())
    }

    /// Closed forms for every kind and friction on ramp and plateau, then random ones.
    fn starts(&self, space: &ShapeSpace, effort: Effort) -> Vec<Vec<f64>> {
        let gentlest = self.tray(&[0.0; Candidate::EXTRAS]);
        let extras = vec![0.0; Candidate::EXTRAS];
        let cases = self.kinds.iter().flat_map(|kind| kind.frictions.iter().map(move |&friction| (kind, friction)));
        let known = cases.flat_map(|(kind, friction)| {
            let radius_m = self.outer_radius_m - kind.length_m / 2.0;
            [0.0, gentlest.ramp_slope_rad(radius_m)].into_iter().filter_map(move |slope_rad| {
                let limit_m_s2 = self.limits.max_acceleration * radius_m;
                let design = OptimalDesign { friction, slope_rad, gravity_m_s2: self.gravity_m_s2, limit_m_s2 };
                closed_form(Axis::Yaw, radius_m, 1.0, &design)
            })
        });
        let mut random = Pcg64Mcg::seed_from_u64(effort.seed);
        let random = (0..effort.starts).map(|_| space.random_point(&mut random));
        let points = known.map(|waveform| space.point(&waveform)).chain(random);
        points.map(|point| [point, extras.clone()].concat()).collect()
    }

    /// The tray of a point's extra coordinates: as gentle as allowed at 0, steeper away from it.
    fn tray(&self, extras: &[f64]) -> TrayGeometry {
        TrayGeometry {
            outer_radius_m: self.outer_radius_m,
            inner_radius_m: self.inner_radius_m,
            rise_m: self.rise_min_m * extras[0].abs().exp(),
            ramp_angle_rad: self.ramp_angle_max_rad * (-extras[1].abs()).exp(),
        }
    }

    fn candidate(&self, space: &ShapeSpace, point: &[f64]) -> Option<Candidate> {
        let (shape, extras) = point.split_at(point.len() - Candidate::EXTRAS);
        let waveform = match self.period {
            Period::Fixed(period_s) => tamed(space.waveform(shape, period_s)?, &self.limits)?,
            Period::UpTo(period_max_s) => {
                // Speed grows with the period and stroke with its square.
                let unit = space.waveform(shape, 1.0)?;
                let by_speed = self.limits.max_speed / unit.peak_speed();
                let by_stroke = (self.limits.max_stroke / unit.stroke()).sqrt();
                let longest_s = by_speed.min(by_stroke).min(period_max_s);
                space.waveform(shape, longest_s * (-extras[2].abs()).exp())?
            }
        };
        Some(Candidate { tray: self.tray(extras), waveform })
    }

    /// Parts per minute for the worst kind and friction; less than 0 where parts do not climb or are too close.
    fn score(&self, space: &ShapeSpace, point: &[f64], detail: Detail) -> Option<f64> {
        let Candidate { tray, waveform } = self.candidate(space, point)?;
        let mut worst = f64::INFINITY;
        for kind in &self.kinds {
            for &friction in &kind.frictions {
                let track = AnnularTrack::new(tray, Friction::uniform(friction).ok()?, self.gravity_m_s2).ok()?;
                let lane = Lane::new(&track, &waveform, kind.length_m).ok()?;
                let score = match lane.with_crest(|crest| self.crest_score(crest, kind.length_m, detail)) {
                    Some(score) => score,
                    // How far from climbing, so that the search can find its way.
                    None => lane.ramp.steady()?.feed_m_s.min(lane.plateau.steady()?.feed_m_s) / kind.length_m - 1.0,
                };
                worst = worst.min(score);
            }
        }
        Some(worst)
    }

    fn crest_score(&self, crest: &Crest<'_>, length_m: f64, detail: Detail) -> f64 {
        let per_min = |ramp_m: f64| 60.0 * crest.ramp_m_s() / ramp_m;
        match detail {
            Detail::MeanSpeeds => {
                let spread = crest.plateau_m_s() / crest.ramp_m_s() / self.spacing_parts;
                match self.loading {
                    Loading::Metered => per_min(length_m) * spread.min(1.0),
                    Loading::Queued => per_min(length_m) * too_close(spread),
                }
            }
            Detail::Crest { places, asked_parts } => {
                let passage = crest.passage(places);
                let ramp_m = self.loading.ramp_spacing_m(&passage, length_m, asked_parts);
                per_min(ramp_m) * too_close(passage.spacing_m(ramp_m) / (asked_parts * length_m))
            }
        }
    }
}

/// What parts count in the search that are closer than wanted: so much less that closing up never pays (an exact penalty),
/// but not nothing, so that the search finds its way out.
fn too_close(spacing_over_wanted: f64) -> f64 {
    (60.0 * (spacing_over_wanted - 1.0).min(0.0)).exp()
}

/// How closely the search looks at a candidate.
#[derive(Clone, Copy, Debug)]
enum Detail {
    /// At mean speeds on ramp and plateau.
    MeanSpeeds,
    /// At the passage over the crest too.
    Crest {
        /// Places of entry.
        places: u32,
        /// Spacing asked for, in part lengths.
        asked_parts: f64,
    },
}

/// A tray with a waveform, as the search proposes it.
#[derive(Clone, Debug)]
struct Candidate {
    tray: TrayGeometry,
    waveform: Waveform,
}

impl Candidate {
    /// Coordinates besides those of the waveform's shape: rise, angle of the ramp, period.
    const EXTRAS: usize = 3;
}

fn share(part: usize, whole: usize) -> f64 {
    let number = |n: usize| f64::from(u32::try_from(n).unwrap_or(u32::MAX));
    number(part) / number(whole)
}
