//! Finds the parts that a single frame shows: `guess` tells what may lie where, `explain` what of that does, `company` what the
//! parts tell about each other.

mod company;
mod explain;
mod guess;

use std::f64::consts::TAU;

use image::GrayImage;
use nalgebra::{Isometry2, Point2, Rotation2, Vector2};

use super::ImageFault;
use super::align::{Fineness, Fit, NO_PART, Owners, glance, refine};
use super::health;
use super::modes::{Belief, Light, SideAmounts};
use super::search::{Search, Seed};
use super::segment::{Plateau, Segmentation, TaughtLight, Uncovered};
use super::sought::{SHADE_SIGMA, Sought, Turn};
use super::surround::{SHOWN_MIN, Sample, Samples, Surround, Told};
use super::template::{PartModel, SIDES};
use super::view::{RayTable, View};
pub(super) use company::{ALIKE_MIN, belief_of_light};
use explain::clip;
pub(super) use explain::covered;
use feeder_model::camera::{CameraModel, MountedTray};
use guess::{glance_at, turns_at};

/// Smallest thing that counts as an obstacle, px.
const BLOB_PX_MIN: usize = 9;
/// So near to where it stood when the part was taught, m, light falls on the tray as it did then.
const SAME_PLACE_M: f64 = 0.005;
/// Mean square miss up to which a rough fit is worth a fine one.
const ROUGH_COST_MAX: f32 = 5.0;

/// Something that looks like the part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub pose: usize,
    pub fit: Fit,
    /// By how much, per texel, the evidence is stronger than that for another pose in the same place.
    pub lead: f32,
    /// By how many times what parts of a frame differ by it looks unlike the others, as a surface or in size does.
    pub unlike: f32,
    /// The same of the light that it seems to be seen in.
    pub unlike_in_light: f32,
    /// Evidence relative to that of the middle one of the others, where enough of the pose lie in the frame to tell of each other.
    pub evidence_ratio: Option<f32>,
    /// As [`AtYaw::lead_share`](super::align::AtYaw::lead_share) tells of it turned by half a period of its symmetry.
    pub turned: Option<f32>,
    /// The strongest explanation by the same pose at another yaw, and by how much that is led, as it is for `turned`.
    pub yaw_rival: Option<Fit>,
    pub yaw_lead: Option<f32>,
    /// By how much, as for `lead`, the evidence is stronger than that for the same pose a little beside, where the light is not that taught.
    pub beside_lead: f32,
    /// The strongest explanation by another pose.
    pub rival: Option<(usize, Fit)>,
    /// Mean square miss before what the frame shows of others was known.
    pub first_cost: f32,
    /// The lead then.
    pub first_lead: f32,
    /// What the templates say that the lead over the rival must be; `None` without a rival that still fits once the light is known.
    pub lead_due: Option<f32>,
    /// How much of the template's fine detail is seen; `None` where it has too little to tell.
    pub detail_seen: Option<f32>,
    /// How high it seems by its shade, as [`Told::height_seen`] tells.
    pub height_seen: Option<f32>,
    /// Evidence for each texel.
    pub evidence_per_texel: f32,
    /// Pixels that it covers.
    pub px: usize,
}

impl Found {
    /// A fit of which nothing else is known yet.
    pub(super) fn new(pose: usize, fit: Fit) -> Self {
        Self {
            pose,
            fit,
            lead: f32::INFINITY,
            unlike: 0.0,
            unlike_in_light: 0.0,
            evidence_ratio: None,
            turned: None,
            yaw_lead: None,
            yaw_rival: None,
            beside_lead: f32::INFINITY,
            rival: None,
            first_cost: fit.cost,
            first_lead: f32::INFINITY,
            lead_due: None,
            detail_seen: None,
            height_seen: None,
            evidence_per_texel: 0.0,
            px: 0,
        }
    }

    /// Whether the template leaves no more than this share of its contrast with bare floor unexplained: a correlation is the root of the rest.
    pub(super) fn correlates(&self, unexplained_ratio_max: f32) -> bool {
        let (miss, evidence) = (self.fit.cost, self.evidence_per_texel);
        miss <= unexplained_ratio_max * (miss + 2.0 * evidence)
    }
}

/// Finds parts in single frames.
#[derive(Clone, Debug)]
pub(super) struct Detector {
    pub(super) camera: CameraModel,
    pub(super) tray: MountedTray,
    rays: RayTable,
    plateau: Plateau,
    pub(super) light: Light,
    pub(super) segmentation: Segmentation,
    pub(super) sought: Vec<Sought>,
    /// Height of the part in the pose in which it is highest, m.
    height_m_max: f64,
    search: Search,
    /// For each pixel of the window the part it shows, counted from 1.
    owners: Vec<u16>,
    /// Whether light comes from one side in the latest frame, more than when the part was taught.
    pub(super) is_lit_from_a_side: bool,
    /// What the parts of each pose have round them in the latest frame.
    pub(super) surrounds: Vec<Surround>,
    /// What fits best where something lies in the latest frame, but too badly to be taken for it: poses and fits.
    pub(super) unlikely: Vec<(usize, Fit)>,
}

impl Detector {
    pub(super) fn new(camera: &CameraModel, tray: &MountedTray, model: &PartModel, light: Light) -> Self {
        let sought: Vec<Sought> = model.poses.iter().map(|pose| Sought::new(pose, camera, tray, light)).collect();
        Self {
            camera: camera.clone(),
            tray: *tray,
            rays: RayTable::new(camera),
            plateau: model.plateau(),
            light,
            segmentation: Segmentation::default(),
            height_m_max: sought.iter().map(|sought| sought.template.height_m).fold(0.0, f64::max),
            search: Search::new(&sought),
            surrounds: sought.iter().map(|sought| sought.template.surround()).collect(),
            sought,
            owners: Vec::new(),
            unlikely: Vec::new(),
            is_lit_from_a_side: false,
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
        self.segmentation.look(
            &view,
            &self.rays,
            image,
            &self.plateau,
            self.light,
            contrast_min_levels,
            BLOB_PX_MIN,
        )?;
        self.is_lit_from_a_side = false;
        let noise = self.segmentation.sigma * self.segmentation.sigma;
        self.sought.iter_mut().for_each(|sought| sought.expect_noise(noise));
        self.owners.clear();
        self.owners.extend(self.segmentation.bins.iter().map(|bin| if *bin == 0 { NO_PART } else { 0 }));
        Ok(())
    }

    /// The best fit of a pose whose centre lies within `reach_m` of what a pixel sees, in the frame looked at last.
    pub(super) fn near(
        &self,
        view: &View,
        pose: usize,
        (pixel, reach_m): (Point2<f64>, f64),
        belief: &Belief,
    ) -> Option<Fit> {
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
                let least = |least: f32, turn: &Turn| {
                    least.min(glance(&self.segmentation, turn, (column, row), light.as_ref(), least))
                };
                seeds.push((turns.iter().fold(f32::MAX, least), seed));
            }
        }
        seeds.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut guesses = Vec::new();
        for (_, seed) in seeds.into_iter().take(TRIED) {
            self.guess(view, seed, &mut guesses);
        }
        let fits = guesses.into_iter().filter_map(|guess| self.fitted(view, guess, belief)).map(|found| found.fit);
        let within = |fit: &Fit| {
            view.pixel(fit.centre, sought.plane_m).is_some_and(|place| (place - pixel).norm() <= reach_px + 0.5)
        };
        fits.filter(within).max_by(|a, b| a.evidence.total_cmp(&b.evidence))
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
        let mut fits = self.fits(&view, &[0.0; SIDES]);
        let mut found = self.explained(&view, &mut fits);
        // Rings tell nothing of a side from which light comes: where parts found do, others are looked for in that light.
        if let Some(sides) = self.light_from_a_side(&found) {
            self.is_lit_from_a_side = true;
            self.owners.iter_mut().filter(|owner| **owner != NO_PART).for_each(|owner| *owner = 0);
            fits.extend(self.fits(&view, &sides));
            found = self.explained(&view, &mut fits);
        }
        self.fit_again(&view, &mut found);
        // Among others a part fits only once those are known: what does not fit then is none.
        let kept: Vec<bool> = found.iter().map(|part| part.fit.cost <= cost_max && self.is_thing(part)).collect();
        for owner in self.owners.iter_mut().filter(|owner| **owner != NO_PART) {
            if usize::from(*owner).checked_sub(1).is_some_and(|part| !kept[part]) {
                *owner = 0;
            }
        }
        let dropped = found.iter().zip(&kept).filter(|(_, kept)| !**kept);
        self.unlikely = dropped.map(|(part, _)| (part.pose, part.fit)).collect();
        let found = found.into_iter().enumerate().zip(kept).filter(|(_, kept)| *kept);
        let (mut found, shades): (Vec<Found>, Vec<Sample>) = found
            .map(|((index, part), _)| (part, self.shade(&view, &part, &self.owners_for(index, SHADE_SIGMA))))
            .unzip();
        let mut samples = vec![Samples::default(); self.sought.len()];
        found.iter().zip(&shades).for_each(|(part, shade)| samples[part.pose].add(shade));
        let told: Vec<Told> = samples.into_iter().map(|samples| samples.told(SHOWN_MIN)).collect();
        for (part, shade) in found.iter_mut().zip(&shades) {
            part.height_seen = told[part.pose].height_seen(shade);
        }
        if self.light == Light::Any {
            let as_taught = self.light_is_as_taught(&view);
            self.surrounds = told
                .iter()
                .zip(&self.sought)
                .map(|(told, sought)| told.of_frame(&sought.template.surround(), as_taught))
                .collect();
        }
        Ok(found)
    }

    /// What fits somewhere in the frame looked at last, each alone, where light comes from these sides.
    fn fits(&mut self, view: &View, sides: &SideAmounts) -> Vec<Found> {
        let mut guesses = Vec::new();
        let glance = |seed: Seed| glance_at(view, &self.segmentation, &self.sought[seed.pose], seed);
        for seed in self.search.seeds(&self.segmentation, &self.sought, sides, glance) {
            self.guess(view, seed, &mut guesses);
        }
        let open = self.open_belief(view);
        self.distinct(guesses).into_iter().filter_map(|guess| self.fitted(view, guess, &open)).collect()
    }

    /// The likeliest of these fits, which own what they cover.
    fn explained(&mut self, view: &View, fits: &mut [Found]) -> Vec<Found> {
        fits.sort_by(|a, b| b.fit.evidence.total_cmp(&a.fit.evidence));
        let mut owners = std::mem::take(&mut self.owners);
        let found = self.explain(view, fits, &mut owners);
        self.owners = owners;
        found
    }

    /// Whose the pixels are, asked by the part found that stands at this index.
    fn owners_for(&self, index: usize, beside_sigma: f32) -> Owners<'_> {
        Owners { of: &self.owners, own: u16::try_from(index + 1).unwrap_or(u16::MAX), beside_sigma }
    }

    /// What a part has round it that is no other's.
    fn shade(&self, view: &View, part: &Found, owners: &Owners) -> Sample {
        Sample::new(&self.segmentation, view, &self.sought[part.pose], &part.fit, |pixel| owners.taken(pixel))
    }

    /// What a part has round it in the frame looked at last, whatever else lies there.
    pub(super) fn sample(&self, view: &View, part: &Found) -> Sample {
        let mut own = Vec::new();
        covered(&self.segmentation, view, &self.sought[part.pose], &part.fit, |pixel| own.push(self.owners[pixel]));
        own.sort_unstable();
        let own = own.chunk_by(|a, b| a == b).max_by_key(|run| run.len()).map_or(0, |run| run[0]);
        self.shade(view, part, &Owners { of: &self.owners, own, beside_sigma: SHADE_SIGMA })
    }

    /// The fit that a guess leads to by what is believed of parts.
    fn fitted(&self, view: &View, guess: Found, belief: &Belief) -> Option<Found> {
        let nobody = Owners { of: &self.owners, own: 0, beside_sigma: SHADE_SIGMA };
        let refined = |start: Fit, fineness: Fineness| {
            refine(&self.segmentation, view, &self.sought[guess.pose], start, &nobody, belief, fineness)
        };
        let rough = refined(guess.fit, Fineness::Rough).filter(|fit| fit.cost <= ROUGH_COST_MAX)?;
        let fit = refined(rough, Fineness::Full)?;
        Some(Found { fit, ..guess })
    }

    /// What is believed of any part in the frame looked at last, before parts have been found.
    pub(super) fn open_belief(&self, view: &View) -> Belief {
        if self.light_is_as_taught(view) { Belief::of_light_as_taught() } else { Belief::open() }
    }

    /// The fit of a pose that a guess of place and yaw leads to, in the frame looked at last.
    pub(super) fn fit_from(&self, view: &View, pose: usize, guess: Fit) -> Option<Fit> {
        self.fitted(view, Found::new(pose, guess), &self.open_belief(view)).map(|found| found.fit)
    }

    /// Where the tray frame shows something that no part found covers, further than `strip_px` from the plateau's edges, and
    /// how bright that is.
    pub(super) fn uncovered(&self, view: &View, strip_px: f64) -> Vec<Uncovered> {
        self.segmentation.foreground_points(view, self.tray.plateau_height_m(), strip_px, &self.owners)
    }

    /// Pixels of the plateau.
    pub(super) fn plateau_px(&self) -> usize {
        self.owners.iter().filter(|owner| **owner != NO_PART).count()
    }

    /// Whether the light in the frame looked at last is known to fall as it did when the part was taught.
    fn light_is_as_taught(&self, view: &View) -> bool {
        let compared = self.light_ratios().zip(self.light_change(view));
        // A far lamp may stand elsewhere, and the bare plateau look as it did.
        let looks_so = compared.is_some_and(|((plateau, hub), change)| !health::light_differs(plateau, hub, change));
        looks_so && !self.is_lit_from_a_side
    }

    /// How the light in the frame looked at last compares with the one taught: on the plateau, and on the hub's top.
    pub(super) fn light_ratios(&self) -> Option<(f64, Option<f64>)> {
        let taught = self.plateau.taught?;
        let frame = &self.segmentation;
        let ratio = |level: f32, taught: f32| f64::from(level / taught.max(1.0));
        Some((ratio(frame.light[0], taught.light[0]), frame.hub_level.map(|level| ratio(level, taught.hub_level))))
    }

    /// By how much the light falls otherwise across the bare plateau of the frame looked at last than when the part was taught,
    /// relative to its brightness there: root of the mean square over the picture. How much light there is does not matter.
    /// `None` where the tray stands elsewhere than when the part was taught, and the light falls otherwise for that alone.
    pub(super) fn light_change(&self, view: &View) -> Option<f64> {
        let TaughtLight { light: taught, at_m, .. } = self.plateau.taught?;
        if (view.beside_camera_m(Point2::origin()) - at_m).norm() > SAME_PLACE_M {
            return None;
        }
        let light = self.segmentation.light;
        let share = |light: &[f32; 6], index: usize| f64::from(light[index] / light[0].max(1.0));
        let [u, v, uu, uv, vv] = [1, 2, 3, 4, 5].map(|index| share(&light, index) - share(&taught, index));
        // Means over the square from -1 to 1: 1/3 of u squared, 1/5 of its fourth power, 1/9 of the product of two squares.
        let square = (u * u + v * v) / 3.0 + (uu * uu + vv * vv) / 5.0 + (2.0 * uu * vv + uv * uv) / 9.0;
        Some((square - ((uu + vv) / 3.0).powi(2)).max(0.0).sqrt())
    }

    /// The outline of a part found, tray frame, counter-clockwise.
    pub(super) fn outline(&self, pose: usize, centre: Point2<f64>, yaw_rad: f64) -> Vec<Point2<f64>> {
        let turn = Rotation2::new(yaw_rad);
        let outline = self.sought.get(pose).map_or(&[][..], |sought| &sought.outline_m);
        outline.iter().map(|corner| centre + turn * corner.coords).collect()
    }
}

/// Smallest difference of two yaws of a part of this symmetry, rad.
pub(super) fn yaw_difference_rad(a_rad: f64, b_rad: f64, symmetry: u32) -> f64 {
    let period = TAU / f64::from(symmetry.max(1));
    let difference = (a_rad - b_rad) / period;
    (difference - difference.round()) * period
}
