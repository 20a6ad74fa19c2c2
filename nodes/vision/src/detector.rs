//! Finds the parts that a single frame shows.

use std::f64::consts::TAU;

use image::GrayImage;
use nalgebra::{Isometry2, Point2, Rotation2, Vector2};

use super::ImageFault;
use super::align::{Belief, Fineness, Fit, NO_PART, Owners, coarse, glance, refine, residuals, turned_share};
use super::modes::{self, Amounts, LIGHT_MODES};
use super::search::{Search, Seed};
use super::segment::{Plateau, Segmentation, Uncovered};
use super::sought::{FREE_SIGMA, SHADE_SIGMA, Sought, Turn, slant_index};
use super::surround::{Samples, Surround};
use super::template::PartModel;
use super::view::{RayTable, View};
use feeder_model::camera::{CameraModel, MountedTray};

/// Smallest thing that counts as an obstacle, px.
const BLOB_PX_MIN: usize = 9;
/// Mean square miss at a glance up to which a place is looked at closely.
const GLANCE_COST_MAX: f32 = 5.0;
/// Mean square miss up to which a guess is worth fitting.
const COARSE_COST_MAX: f32 = 5.0;
/// The same for the first points looked at.
const FIRST_COST_MAX: f32 = 9.0;
/// What a pixel beside may make of the miss.
const BESIDE_COST: f32 = 2.0;
/// Mean square miss up to which a rough fit is worth a fine one.
const ROUGH_COST_MAX: f32 = 5.0;
/// A second yaw is tried where it misses by at most this much more than the best.
const SECOND_YAW_COST: f32 = 2.0;
/// Yaws tried at most at a seed.
const YAWS_MAX: usize = 5;
/// Share of a part's area that others may cover before it is taken for one of them.
const OVERLAP_MAX: f64 = 0.2;
/// Share of a part's area that another explanation of the same thing covers.
const SAME_THING_MIN: f64 = 0.5;
/// Places nearer than this, relative to the part's radius, are one.
const SAME_PLACE_RATIO: f64 = 0.4;
/// Yaws further apart than so many steps of the coarse search lead to different fits.
const OTHER_YAW_TURNS: f64 = 1.2;
/// How far a part shades what lies beside it, in its height.
const SHADE_HEIGHTS: f64 = 0.8;
/// A pose whose evidence is this much weaker per texel in the coarse search is not fitted.
const COARSE_LEAD: f32 = 1.2;

/// Mean square miss up to which a part counts among those that tell what the light of a frame is, and how much evidence it must
/// have at least, of that of the middle one; how many there must be for that, and to add to the template what all show.
const ALIKE_COST_MAX: f32 = 3.0;
const ALIKE_EVIDENCE_RATIO: f32 = 0.5;
const ALIKE_MIN: usize = 4;
const ADAPTED_MIN: usize = 6;
/// A part with less evidence than this, of that of the middle one, is none of them.
const WEAK_RATIO: f32 = 0.3;
/// A rival explanation that is led by less than this, per texel, is as good.
const LEAD_MIN: f32 = 0.05;
/// What parts under one light differ by among each other at least, in spreads of the modes; and a part alone from the one taught.
const PART_SPREADS: Amounts = [0.3, 0.2, 0.12, 0.4, 1.0, 1.0, 0.5];
const LONE_SPREADS: Amounts = [0.3, 0.3, 0.3, 0.3, 1.0, 1.0, 0.3];

/// Something that looks like the part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub pose: usize,
    pub fit: Fit,
    /// By how much, per texel, the evidence is stronger than that for another pose in the same place.
    pub lead: f32,
    /// By how many times what parts of a frame differ by it looks unlike the others in light.
    pub unlike: f32,
    /// Whether enough others of the pose lie in the frame to tell that.
    pub in_company: bool,
    /// Whether much less speaks for it than for the others.
    pub weak: bool,
    /// As [`turned_share`] tells.
    pub turned: Option<f32>,
    /// The strongest explanation by another pose.
    pub rival: Option<(usize, Fit)>,
    /// Mean square miss before what the frame shows of others was known.
    pub first_cost: f32,
    /// The lead relative to that of the middle one of the others; `None` if too few have a rival too.
    pub lead_ratio: Option<f32>,
    /// Evidence for each texel.
    pub evidence_per_texel: f32,
}

impl Found {
    /// A fit of which nothing else is known yet.
    fn new(pose: usize, fit: Fit) -> Self {
        Self {
            pose,
            fit,
            lead: f32::INFINITY,
            unlike: 0.0,
            in_company: false,
            weak: false,
            turned: None,
            rival: None,
            first_cost: fit.cost,
            lead_ratio: None,
            evidence_per_texel: 0.0,
        }
    }
}

/// Finds parts in single frames.
#[derive(Clone, Debug)]
pub(super) struct Detector {
    pub(super) camera: CameraModel,
    pub(super) tray: MountedTray,
    rays: RayTable,
    plateau: Plateau,
    pub(super) segmentation: Segmentation,
    pub(super) sought: Vec<Sought>,
    /// Height of the part in the pose in which it is highest, m.
    height_m_max: f64,
    search: Search,
    /// For each pixel of the window the part it shows, counted from 1.
    owners: Vec<u16>,
    /// What the parts of each pose have round them in the latest frame.
    pub(super) surrounds: Vec<Surround>,
}

impl Detector {
    pub(super) fn new(camera: &CameraModel, tray: &MountedTray, model: &PartModel) -> Self {
        let sought: Vec<Sought> = model.poses.iter().map(|pose| Sought::new(pose, camera, tray)).collect();
        Self {
            camera: camera.clone(),
            tray: *tray,
            rays: RayTable::new(camera),
            plateau: model.plateau(),
            segmentation: Segmentation::default(),
            height_m_max: sought.iter().map(|sought| sought.template.height_m).fold(0.0, f64::max),
            search: Search::new(&sought),
            surrounds: sought.iter().map(|sought| sought.template.surround()).collect(),
            sought,
            owners: Vec::new(),
        }
    }

    pub(super) fn view(&self, platen_from_tray: &Isometry2<f64>) -> View<'_> {
        View { camera: &self.camera, tray: &self.tray, platen_from_tray: *platen_from_tray }
    }

    /// By how much the rings of brightness about a place miss those of a pose in the frame looked at last.
    pub(super) fn ring_miss(&self, view: &View, pose: usize, place: Point2<f64>) -> Option<f32> {
        let window = self.segmentation.window;
        let pixel =
            view.pixel(place, self.sought.get(pose)?.plane_m)? - Vector2::new(window.left as f64, window.top as f64);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
        let (column, row) = (pixel.x.round() as usize, pixel.y.round() as usize);
        Some(self.search.miss_near(pose, column, row))
    }

    /// Takes a frame apart, for what is asked of it next.
    pub(super) fn look(
        &mut self,
        image: &GrayImage,
        platen_from_tray: &Isometry2<f64>,
        contrast_min_levels: f64,
    ) -> Result<(), ImageFault> {
        let expected = (self.camera.width_px(), self.camera.height_px());
        if image.dimensions() != expected {
            return Err(ImageFault::WrongSize { found: image.dimensions(), expected });
        }
        let view = View { camera: &self.camera, tray: &self.tray, platen_from_tray: *platen_from_tray };
        self.segmentation.look(&view, &self.rays, image, &self.plateau, contrast_min_levels, BLOB_PX_MIN)?;
        let noise = self.segmentation.sigma * self.segmentation.sigma;
        self.sought.iter_mut().for_each(|sought| sought.expect_noise(noise));
        self.owners.clear();
        self.owners.extend(self.segmentation.bins.iter().map(|bin| if *bin == 0 { NO_PART } else { 0 }));
        Ok(())
    }

    /// The best fit of a pose whose centre lies within `reach_m` of what a pixel sees, in the frame looked at last.
    pub(super) fn near(&self, view: &View, pose: usize, pixel: Point2<f64>, reach_m: f64) -> Option<Fit> {
        const TRIED: usize = 6;
        let sought = self.sought.get(pose)?;
        let window = self.segmentation.window;
        let reach_px = reach_m / sought.m_per_px;
        let middle = pixel - Vector2::new(window.left as f64, window.top as f64);
        let mut seeds: Vec<(f32, Seed)> = Vec::new();
        for row in clip(middle.y - reach_px, middle.y + reach_px, window.height) {
            for column in clip(middle.x - reach_px, middle.x + reach_px, window.width) {
                let aside = Vector2::new(column as f64, row as f64) - middle.coords;
                if aside.norm() > reach_px || self.segmentation.bins[row * window.width + column] == 0 {
                    continue;
                }
                let light = self.search.light_at(&self.segmentation, sought, column, row);
                let seed = Seed { pose, column, row, light };
                let turns = turns_at(view, &self.segmentation, sought, seed);
                let least =
                    |least: f32, turn: &Turn| least.min(glance(&self.segmentation, turn, (column, row), &light, least));
                seeds.push((turns.iter().fold(f32::MAX, least), seed));
            }
        }
        seeds.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut guesses = Vec::new();
        for (_, seed) in seeds.into_iter().take(TRIED) {
            self.guess(view, seed, &mut guesses);
        }
        let fits = guesses.into_iter().filter_map(|guess| self.fitted(view, guess)).map(|found| found.fit);
        fits.max_by(|a, b| a.evidence.total_cmp(&b.evidence))
    }

    /// Finds parts that miss their template by at most `cost_max`, the likeliest first.
    pub(super) fn find(
        &mut self,
        image: &GrayImage,
        platen_from_tray: &Isometry2<f64>,
        contrast_min_levels: f64,
        cost_max: f32,
    ) -> Result<Vec<Found>, ImageFault> {
        self.look(image, platen_from_tray, contrast_min_levels)?;
        let (camera, tray) = (self.camera.clone(), self.tray);
        let view = View { camera: &camera, tray: &tray, platen_from_tray: *platen_from_tray };
        let mut guesses = Vec::new();
        let glance = |seed: Seed| {
            let turns = turns_at(&view, &self.segmentation, &self.sought[seed.pose], seed);
            let place = (seed.column, seed.row);
            let least =
                |least: f32, turn: &Turn| least.min(glance(&self.segmentation, turn, place, &seed.light, least));
            let miss = turns.iter().fold(GLANCE_COST_MAX, least);
            if miss < GLANCE_COST_MAX { miss } else { f32::INFINITY }
        };
        for seed in self.search.seeds(&self.segmentation, &self.sought, glance) {
            self.guess(&view, seed, &mut guesses);
        }
        let guesses = self.distinct(guesses);
        let mut fits: Vec<Found> = guesses.into_iter().filter_map(|guess| self.fitted(&view, guess)).collect();
        fits.sort_by(|a, b| b.fit.evidence.total_cmp(&a.fit.evidence));
        let mut owners = std::mem::take(&mut self.owners);
        let mut found = self.explain(&view, fits, &mut owners);
        self.owners = owners;
        self.fit_again(&view, &mut found);
        // Among others a part fits only once those are known: what does not fit then is none.
        let fits = |found: &Found| found.fit.cost <= cost_max;
        for owner in self.owners.iter_mut().filter(|owner| **owner != NO_PART) {
            if usize::from(*owner).checked_sub(1).is_some_and(|part| !fits(&found[part])) {
                *owner = 0;
            }
        }
        let samples = self.samples(&view, &found, |_, found| fits(found));
        self.surrounds = samples
            .into_iter()
            .zip(&self.sought)
            .map(|(samples, sought)| samples.of_frame(&sought.template.surround()))
            .collect();
        found.retain(fits);
        Ok(found)
    }

    /// What parts have round them, by pose, as far as they count; `found` as they own the frame's pixels.
    fn samples(&self, view: &View, found: &[Found], counts: impl Fn(usize, &Found) -> bool) -> Vec<Samples> {
        let mut samples = vec![Samples::default(); self.sought.len()];
        for (index, part) in found.iter().enumerate().filter(|(index, part)| counts(*index, part)) {
            let taken = |pixel: usize| self.owners[pixel] != 0 && usize::from(self.owners[pixel]) != index + 1;
            samples[part.pose].add(&self.segmentation, view, &self.sought[part.pose], &part.fit, taken);
        }
        samples
    }

    /// What a part has round it in the frame looked at last, whatever else lies there.
    pub(super) fn sample(&self, view: &View, part: &Found, samples: &mut Samples) {
        let sought = &self.sought[part.pose];
        let mut own = Vec::new();
        covered(&self.segmentation, view, sought, &part.fit, |pixel| own.push(self.owners[pixel]));
        own.sort_unstable();
        let own = own.chunk_by(|a, b| a == b).max_by_key(|run| run.len()).map_or(0, |run| run[0]);
        samples.add(&self.segmentation, view, sought, &part.fit, |pixel| {
            self.owners[pixel] != 0 && self.owners[pixel] != own
        });
    }

    /// The fit that a guess leads to.
    fn fitted(&self, view: &View, guess: Found) -> Option<Found> {
        let nobody = Owners { of: &self.owners, own: 0, beside_sigma: SHADE_SIGMA };
        let refined = |start: Fit, fineness: Fineness| {
            refine(&self.segmentation, view, &self.sought[guess.pose], start, &nobody, &Belief::open(), fineness)
        };
        let rough = refined(guess.fit, Fineness::Rough).filter(|fit| fit.cost <= ROUGH_COST_MAX)?;
        let fit = refined(rough, Fineness::Full)?;
        Some(Found { fit, ..guess })
    }

    /// The fit of a pose that a guess of place and yaw leads to, in the frame looked at last.
    pub(super) fn fit_from(&self, view: &View, pose: usize, guess: Fit) -> Option<Fit> {
        self.fitted(view, Found::new(pose, guess)).map(|found| found.fit)
    }

    /// First guesses of the yaw at a seed: as the rings tell the light there or, where that leads to none, as taught.
    fn guess(&self, view: &View, seed: Seed, guesses: &mut Vec<Found>) {
        let before = guesses.len();
        self.guess_in_light(view, seed, guesses);
        if guesses.len() == before {
            self.guess_in_light(view, Seed { light: [0.0; LIGHT_MODES], ..seed }, guesses);
        }
    }

    fn guess_in_light(&self, view: &View, seed: Seed, guesses: &mut Vec<Found>) {
        let sought = &self.sought[seed.pose];
        let window = self.segmentation.window;
        let turns = turns_at(view, &self.segmentation, sought, seed);
        let mut least = f32::INFINITY;
        let mut looks: Vec<(f32, f32)> = turns
            .iter()
            .map(|turn| {
                let cost_max = FIRST_COST_MAX.min(least + BESIDE_COST);
                let look = coarse(&self.segmentation, turn, (seed.column, seed.row), &seed.light, cost_max);
                least = least.min(look.0);
                look
            })
            .collect();
        // The seed may be a pixel beside the centre: the place where the best turn misses least is taken.
        let worth_a_look = least + BESIDE_COST;
        let mut best_place = (seed.column, seed.row);
        for (look, turn) in looks.iter_mut().zip(turns).filter(|(look, _)| look.0 <= worth_a_look) {
            for place in beside(seed) {
                let other = coarse(&self.segmentation, turn, place, &seed.light, look.0);
                if other.0 < look.0 {
                    *look = other;
                    if other.0 <= least {
                        (least, best_place) = (other.0, place);
                    }
                }
            }
        }
        let pixel = Point2::new((window.left + best_place.0) as f64, (window.top + best_place.1) as f64);
        let Some(centre) = view.tray_point(pixel, sought.plane_m) else {
            return;
        };
        guesses.extend(valleys(&looks).into_iter().map(|index| {
            let (cost, evidence) = looks[index];
            let amounts = modes::all(&seed.light);
            let yaw_rad = turns[index].yaw_rad - view.platen_from_tray.rotation.angle();
            Found::new(seed.pose, Fit { centre, yaw_rad, cost, evidence, amounts })
        }));
    }

    /// Leaves out guesses that another one near does better: with the same pose and yaw it leads to the same fit, and with
    /// another pose it is only an explanation to be led.
    fn distinct(&self, mut guesses: Vec<Found>) -> Vec<Found> {
        guesses.sort_by(|a, b| b.fit.evidence.total_cmp(&a.fit.evidence));
        let mut kept: Vec<Found> = Vec::with_capacity(guesses.len());
        for guess in guesses {
            let sought = &self.sought[guess.pose];
            let near_m = (SAME_PLACE_RATIO * sought.radius_m).max(1.5 * sought.m_per_px);
            let mut worth_fitting = true;
            for other in kept.iter_mut().filter(|other| (other.fit.centre - guess.fit.centre).norm() <= near_m) {
                let lead = self.lead(other, &guess);
                if other.pose == guess.pose {
                    worth_fitting &= lead <= COARSE_LEAD && self.yaws_differ(other, &guess);
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

    /// By how much, per texel, the evidence for a part is stronger than that for another explanation.
    fn lead(&self, part: &Found, other: &Found) -> f32 {
        let sought = &self.sought[part.pose];
        (part.fit.evidence - other.fit.evidence) / (sought.texels.len() as f32 * sought.texel_weight)
    }

    /// Takes the fits in order of their evidence for the parts they show, and what they cover as shown.
    fn explain(&self, view: &View, fits: Vec<Found>, owners: &mut [u16]) -> Vec<Found> {
        let mut found: Vec<Found> = Vec::new();
        let mut pixels = Vec::new();
        for fit in fits {
            pixels.clear();
            covered(&self.segmentation, view, &self.sought[fit.pose], &fit.fit, |index| pixels.push(index));
            let count = pixels.len() as f64;
            let mut taken: Vec<u16> =
                pixels.iter().map(|index| owners[*index]).filter(|owner| *owner != 0 && *owner != NO_PART).collect();
            if taken.len() as f64 > OVERLAP_MAX * count {
                taken.sort_unstable();
                for run in taken.chunk_by(|a, b| a == b) {
                    let owner = &mut found[usize::from(run[0]) - 1];
                    if run.len() as f64 >= SAME_THING_MIN * count && owner.pose != fit.pose {
                        let lead = self.lead(owner, &fit);
                        if lead < owner.lead {
                            (owner.lead, owner.rival) = (lead, Some((fit.pose, fit.fit)));
                        }
                    }
                }
                continue;
            }
            let Some(own) = u16::try_from(found.len() + 1).ok().filter(|own| *own != NO_PART) else {
                break;
            };
            for index in &pixels {
                if owners[*index] == 0 {
                    owners[*index] = own;
                }
            }
            found.push(fit);
        }
        found
    }

    /// Whether two fits of a pose tell different yaws.
    fn yaws_differ(&self, a: &Found, b: &Found) -> bool {
        let sought = &self.sought[a.pose];
        let symmetry = sought.template.yaw_symmetry;
        let apart_rad = yaw_difference_rad(a.fit.yaw_rad, b.fit.yaw_rad, symmetry).abs();
        symmetry != 0 && apart_rad > OTHER_YAW_TURNS * std::f64::consts::TAU / f64::from(symmetry) / sought.yaw_count()
    }

    /// What the parts of each pose have in common in this frame: light, lens, and what the template does not tell.
    fn beliefs(&self, view: &View, found: &[Found]) -> Vec<Belief> {
        let belief = |pose: usize| {
            let sought = &self.sought[pose];
            let of_pose = |part: &Found| part.pose == pose && part.fit.cost <= ALIKE_COST_MAX;
            let mut evidences: Vec<f32> =
                found.iter().filter(|part| of_pose(part)).map(|part| part.fit.evidence).collect();
            let usual = median(&mut evidences);
            let alike: Vec<(usize, &Found)> = found
                .iter()
                .enumerate()
                .filter(|(_, part)| of_pose(part) && part.fit.evidence >= ALIKE_EVIDENCE_RATIO * usual)
                .collect();
            if alike.len() < ALIKE_MIN {
                return Belief { spread: LONE_SPREADS, ..Belief::open() };
            }
            let middle: Amounts = std::array::from_fn(|mode| {
                let mut amounts: Vec<f32> = alike.iter().map(|(_, part)| part.fit.amounts[mode]).collect();
                median(&mut amounts)
            });
            let mut added = Vec::new();
            if alike.len() >= ADAPTED_MIN {
                let seen: Vec<Vec<Option<f32>>> = alike
                    .iter()
                    .filter_map(|(index, part)| {
                        let own = u16::try_from(index + 1).unwrap_or(u16::MAX);
                        let owners = Owners { of: &self.owners, own, beside_sigma: SHADE_SIGMA };
                        residuals(&self.segmentation, view, sought, &part.fit, &owners)
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
            let spread = std::array::from_fn(|mode| {
                let mut aside: Vec<f32> =
                    alike.iter().map(|(_, part)| (part.fit.amounts[mode] - middle[mode]).abs()).collect();
                median(&mut aside).max(PART_SPREADS[mode])
            });
            Belief { middle, spread, added, evidence: usual }
        };
        (0..self.sought.len()).map(belief).collect()
    }

    /// Fits parts again from where they were found, by what they have in common: without what belongs to neighbours, and what
    /// lies alone by what is seen beside it too.
    fn fit_again(&self, view: &View, found: &mut [Found]) {
        let beliefs = self.beliefs(view, found);
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
            let own = u16::try_from(index + 1).unwrap_or(u16::MAX);
            let beside_sigma = if alone { FREE_SIGMA } else { SHADE_SIGMA };
            let owners = Owners { of: &self.owners, own, beside_sigma };
            let belief = &beliefs[part.pose];
            if let Some(fit) = refine(&self.segmentation, view, sought, part.fit, &owners, belief, Fineness::Full) {
                part.first_cost = part.fit.cost;
                part.fit = fit;
                let texels = sought.texels.len() as f32 * sought.texel_weight;
                if let Some((pose, rival)) = part.rival {
                    let (sought, belief) = (&self.sought[pose], &beliefs[pose]);
                    let rival = refine(&self.segmentation, view, sought, rival, &owners, belief, Fineness::Full);
                    part.lead = rival.map_or(f32::INFINITY, |rival| (fit.evidence - rival.evidence) / texels);
                }
                part.evidence_per_texel = fit.evidence / texels;
                part.turned = turned_share(&self.segmentation, view, sought, &fit, &owners, belief);
                part.weak = fit.evidence < WEAK_RATIO * belief.evidence;
                part.in_company = belief.evidence > 0.0;
                let unlike = |mode: usize| ((fit.amounts[mode] - belief.middle[mode]) / belief.spread[mode]).abs();
                part.unlike = (0..LIGHT_MODES).chain([modes::SCALE]).map(unlike).fold(0.0, f32::max);
            }
        }
        for pose in 0..self.sought.len() {
            let counts =
                |part: &Found| part.pose == pose && part.in_company && part.fit.cost <= 1.0 && part.lead.is_finite();
            let mut leads: Vec<f32> = found.iter().filter(|part| counts(part)).map(|part| part.lead).collect();
            if leads.len() < ALIKE_MIN {
                continue;
            }
            let usual = median(&mut leads).max(LEAD_MIN);
            for part in found.iter_mut().filter(|part| part.pose == pose) {
                part.lead_ratio = Some(part.lead / usual);
            }
        }
    }

    /// Where the tray frame shows something that no part found covers, further than `strip_px` from the plateau's edges, and
    /// how bright that is.
    pub(super) fn uncovered(&self, view: &View, strip_px: f64) -> Vec<Uncovered> {
        self.segmentation.foreground_points(view, self.tray.plateau_height_m(), strip_px, &self.owners)
    }

    /// Pixels of the plateau, and those of them on which parts found lie.
    pub(super) fn covered_px(&self) -> (usize, usize) {
        let on_plateau = self.owners.iter().filter(|owner| **owner != NO_PART).count();
        let of_parts = self.owners.iter().filter(|owner| **owner != NO_PART && **owner != 0).count();
        (on_plateau, of_parts)
    }

    /// How the light in the frame looked at last compares with the one taught: on the plateau, and on the hub's top.
    pub(super) fn light_ratios(&self) -> Option<(f64, Option<f64>)> {
        let taught = self.plateau.taught?;
        let frame = &self.segmentation;
        let ratio = |level: f32, taught: f32| f64::from(level / taught.max(1.0));
        Some((ratio(frame.light[0], taught.light[0]), frame.hub_level.map(|level| ratio(level, taught.hub_level))))
    }

    /// The outline of a part found, tray frame, counter-clockwise.
    pub(super) fn outline(&self, pose: usize, centre: Point2<f64>, yaw_rad: f64) -> Vec<Point2<f64>> {
        let turn = Rotation2::new(yaw_rad);
        let outline = self.sought.get(pose).map_or(&[][..], |sought| &sought.outline_m);
        outline.iter().map(|corner| centre + turn * corner.coords).collect()
    }
}

/// The turns as the camera sees them at a seed; none where it sees no place.
fn turns_at<'a>(view: &View, frame: &Segmentation, sought: &'a Sought, seed: Seed) -> &'a [Turn] {
    let seeded = Point2::new((frame.window.left + seed.column) as f64, (frame.window.top + seed.row) as f64);
    let slant = view.tray_point(seeded, sought.plane_m).map(|place| view.slant(place, sought.plane_m));
    slant.and_then(|slant| sought.turns.get(slant_index(slant))).map_or(&[], Vec::as_slice)
}

/// Of what all turns look like (mean square miss and evidence), the few that miss less than those next to them, the best
/// first.
fn valleys(looks: &[(f32, f32)]) -> Vec<usize> {
    let cost_after = |index: usize, step: usize| looks[(index + step) % looks.len()].0;
    let least = looks.iter().map(|look| look.0).fold(f32::INFINITY, f32::min);
    let mut valleys: Vec<usize> = (0..looks.len())
        .filter(|index| {
            let cost = looks[*index].0;
            let lowest = cost <= cost_after(*index, 1) && cost <= cost_after(*index, looks.len() - 1);
            // What bare floor explains better is no part.
            lowest && cost <= COARSE_COST_MAX.min(least + SECOND_YAW_COST) && looks[*index].1 > 0.0
        })
        .collect();
    valleys.sort_by(|a, b| looks[*a].0.total_cmp(&looks[*b].0));
    valleys.truncate(YAWS_MAX);
    valleys
}

/// The pixels beside a seed that are tried.
fn beside(seed: Seed) -> impl Iterator<Item = (usize, usize)> {
    let near = [(1, 0), (-1, 0), (0, 1), (0, -1)];
    near.into_iter().filter_map(move |(x, y)| seed.column.checked_add_signed(x).zip(seed.row.checked_add_signed(y)))
}

/// Smallest difference of two yaws of a part of this symmetry, rad.
pub(super) fn yaw_difference_rad(a_rad: f64, b_rad: f64, symmetry: u32) -> f64 {
    let period = TAU / f64::from(symmetry.max(1));
    let difference = (a_rad - b_rad) / period;
    (difference - difference.round()) * period
}

/// The middle of some values; 0 without any.
fn median(values: &mut [f32]) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Calls `each` with the pixels of the window that a part covers.
fn covered(frame: &Segmentation, view: &View, sought: &Sought, fit: &Fit, mut each: impl FnMut(usize)) {
    let window = frame.window;
    let (Some(pixel), Some(px_from_tray)) =
        (view.pixel(fit.centre, sought.plane_m), view.px_from_tray(fit.centre, sought.plane_m))
    else {
        return;
    };
    let Some(tray_from_px) = px_from_tray.try_inverse() else {
        return;
    };
    let part_from_px = Rotation2::new(-fit.yaw_rad).matrix() * tray_from_px;
    let middle = pixel - Vector2::new(window.left as f64, window.top as f64);
    let reach_px = sought.radius_m / sought.m_per_px + 1.0;
    for row in clip(middle.y - reach_px, middle.y + reach_px, window.height) {
        for column in clip(middle.x - reach_px, middle.x + reach_px, window.width) {
            let place = part_from_px * (Vector2::new(column as f64, row as f64) - middle.coords);
            if sought.texel(place).is_some_and(|texel| sought.outside_m[texel] <= 0.0) {
                each(row * window.width + column);
            }
        }
    }
}

/// The whole numbers from `low` to `high` within 0..`size`.
fn clip(low: f64, high: f64, size: usize) -> std::ops::Range<usize> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
    let (low, high) = (low.ceil() as usize, (high.floor() + 1.0) as usize);
    low.min(size)..high.min(size).max(low.min(size))
}
