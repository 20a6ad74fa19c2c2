//! The search for the best tray: coarse at mean speeds, then with the crest, then polished until parts arrive apart.

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::flow::{Lane, Loading};
use super::search::{Effort, Found, climb};
use super::shape::{ShapeSpace, closed_form, tamed};
use super::singulation::Crest;
use super::tray::{DesignedTray, Period, TrayGoal, share};
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::mechanics::{Friction, MechanicsError};
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::{Axis, OptimalDesign, Waveform};

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
        let step_by = [space.step_by(), vec![0.2; TrayCandidate::EXTRAS]].concat();
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
                let Some(rated) = self.rated(candidate.tray, candidate.waveform)? else {
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

    /// Closed forms for every kind and friction on ramp and plateau, then random ones.
    fn starts(&self, space: &ShapeSpace, effort: Effort) -> Vec<Vec<f64>> {
        let gentlest = self.tray(&[0.0; TrayCandidate::EXTRAS]);
        let extras = vec![0.0; TrayCandidate::EXTRAS];
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

    fn candidate(&self, space: &ShapeSpace, point: &[f64]) -> Option<TrayCandidate> {
        let (shape, extras) = point.split_at(point.len() - TrayCandidate::EXTRAS);
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
        Some(TrayCandidate { tray: self.tray(extras), waveform })
    }

    /// Parts per minute for the worst kind and friction; less than 0 where parts do not climb or are too close.
    fn score(&self, space: &ShapeSpace, point: &[f64], detail: Detail) -> Option<f64> {
        let TrayCandidate { tray, waveform } = self.candidate(space, point)?;
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
struct TrayCandidate {
    tray: TrayGeometry,
    waveform: Waveform,
}

impl TrayCandidate {
    /// Coordinates besides those of the waveform's shape: rise, angle of the ramp, period.
    const EXTRAS: usize = 3;
}
