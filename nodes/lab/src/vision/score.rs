//! What a selector makes of rendered frames, against the truth.

use std::time::Duration;

use feeder_model::geometry::StablePose;
use feeder_sim::camera::{PartView, Renderer, Scene, SensorModel, TrayShot, codec};
use feeder_vision::{Candidate, ImageFault, PartModel, Selector, SelectorConfig, misalignment};
use image::GrayImage;
use nalgebra::Isometry2;
use rand::Rng;

use super::crowd::Crowd;
use feeder::lesson::view;

/// Frames for which a crowd is stirred before it is strewn anew.
const STIRRED_FRAMES: u32 = 20;
/// A quarter of a millimetre decides nothing: a gap is wide enough, and a part on the plateau, by this much or it is not
/// scored, m.
const TOLERANCE_M: f64 = 0.000_25;
/// A candidate nearer than this to a part, relative to the part's radius, means that part.
const SAME_RATIO: f64 = 0.5;

/// Circumstances of some frames.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Circumstances {
    pub(crate) area_fraction: f64,
    pub(crate) noise_sigma_levels: f64,
    pub(crate) frames: u32,
}

/// What frames came to.
#[derive(Clone, Debug, Default)]
pub(crate) struct Score {
    pub(crate) frames: u32,
    /// Share of the plateau covered, summed over frames.
    pub(crate) covered: f64,
    pub(crate) parts: u32,
    /// Parts seen where they are, in the pose they are in, and in another.
    pub(crate) found: u32,
    pub(crate) posed: u32,
    pub(crate) misposed: u32,
    /// Candidates where no part is.
    pub(crate) phantoms: u32,
    /// Candidates selected, and those of them that are no part in the wanted pose, or have no room for the gripper.
    pub(crate) selected: u32,
    pub(crate) wrong: u32,
    /// Parts in the wanted pose with room round them, and those of them that were selected.
    pub(crate) isolated: u32,
    pub(crate) isolated_selected: u32,
    /// Errors of what was selected rightly.
    pub(crate) position_errors_m: Vec<f64>,
    pub(crate) yaw_errors_rad: Vec<f64>,
    /// Frames in which nothing was taken because of the calibration, and those in which it was warned of.
    pub(crate) refused: u32,
    pub(crate) warned: u32,
    pub(crate) render: Duration,
    pub(crate) select: Duration,
}

impl Score {
    pub(crate) fn add(&mut self, other: &Self) {
        self.frames += other.frames;
        self.covered += other.covered;
        self.parts += other.parts;
        self.found += other.found;
        self.posed += other.posed;
        self.misposed += other.misposed;
        self.phantoms += other.phantoms;
        self.selected += other.selected;
        self.wrong += other.wrong;
        self.isolated += other.isolated;
        self.isolated_selected += other.isolated_selected;
        self.position_errors_m.extend(&other.position_errors_m);
        self.yaw_errors_rad.extend(&other.yaw_errors_rad);
        self.refused += other.refused;
        self.warned += other.warned;
        self.render += other.render;
        self.select += other.select;
    }

    /// The value that 95 % of `errors` do not exceed; 0 without errors.
    pub(crate) fn p95(errors: &[f64]) -> f64 {
        let mut errors = errors.to_vec();
        errors.sort_by(f64::total_cmp);
        errors.get((errors.len() * 95 / 100).min(errors.len().saturating_sub(1))).copied().unwrap_or(0.0)
    }

    pub(crate) fn recall(&self) -> f64 {
        f64::from(self.isolated_selected) / f64::from(self.isolated.max(1))
    }
}

/// Time this thread has computed: what a frame costs, however busy the machine is.
pub(crate) fn cpu_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    let nanoseconds = u32::try_from(time.tv_nsec).unwrap_or(0);
    Duration::new(u64::try_from(time.tv_sec).unwrap_or(0), nanoseconds)
}

/// A part whose selector is put to the test.
pub(crate) struct Trial<'a> {
    /// What the selector believes of camera and tray.
    pub(crate) scene: &'a Scene,
    /// What is rendered.
    pub(crate) world: &'a Scene,
    /// Blur of the lens beyond the renderer's own, px, as a standard deviation.
    pub(crate) blur_px: f32,
    pub(crate) poses: &'a [StablePose],
    pub(crate) platen_from_tray: Isometry2<f64>,
    pub(crate) config: &'a SelectorConfig,
    pub(crate) model: &'a PartModel,
}

/// What a frame shows of the calibration.
enum Misplaced {
    Not,
    /// Far enough for a warning.
    Warned,
    /// So far that nothing may be selected.
    Refused,
}

impl Trial<'_> {
    /// Frames under some circumstances. `show` gets each frame with what the selector made of it.
    pub(crate) fn run(
        &self,
        circumstances: Circumstances,
        random: &mut impl Rng,
        mut show: impl FnMut(&GrayImage, &Selector, &[Candidate]) -> anyhow::Result<()>,
    ) -> anyhow::Result<Score> {
        let Circumstances { area_fraction, noise_sigma_levels, frames } = circumstances;
        let sensor = SensorModel { noise_sigma_levels, ..self.world.sensor };
        let mut renderer = Renderer::new(&Scene { sensor, ..self.world.clone() })?;
        let mut selector = Selector::new(self.config.clone(), &self.scene.camera, &self.scene.tray, self.model)?;
        let mut crowd = Crowd::new(&self.scene.tray, self.poses, area_fraction);
        let mut image = GrayImage::default();
        let mut score = Score::default();
        for frame in 0..frames {
            if frame % STIRRED_FRAMES == 0 {
                crowd.strew(random);
            } else {
                crowd.stir(random);
            }
            let views: Vec<PartView> = crowd.parts().iter().map(|part| view(part, self.world)).collect();
            let begin = cpu_time();
            renderer.render(&TrayShot::still(self.platen_from_tray), &views, random, &mut image)?;
            if self.blur_px > 0.0 {
                image = image::imageops::blur(&image, self.blur_px);
            }
            score.render += cpu_time() - begin;
            let bytes = codec::encode(&image, codec::DEFAULT_QUALITY, codec::DEFAULT_BYTES_MAX)?;
            let seen = feeder_vision::decode(&bytes)?;
            let begin = cpu_time();
            let detected = selector.detect(&seen, &self.platen_from_tray);
            score.select += cpu_time() - begin;
            // As in a run, a crowd that hides the plateau shows nothing.
            let mut candidates = match detected {
                Err(ImageFault::NoBackground) => Vec::new(),
                detected => detected?,
            };
            // As in a run, nothing is taken by a calibration that the frame refutes.
            match self.misplaced(&seen) {
                Misplaced::Refused => {
                    candidates.clear();
                    score.refused += 1;
                }
                Misplaced::Warned => score.warned += 1,
                Misplaced::Not => {}
            }
            score.frames += 1;
            score.covered += crowd.covered_fraction();
            self.judge(&crowd, &selector, &candidates, &mut score);
            show(&seen, &selector, &candidates)?;
        }
        Ok(score)
    }

    /// How far rim, hub and drop-off lie beside where they should.
    fn misplaced(&self, image: &GrayImage) -> Misplaced {
        let Scene { camera, tray, .. } = self.scene;
        let limits = &self.config.calibration;
        match misalignment(image, camera, tray, &self.platen_from_tray) {
            Err(_) => Misplaced::Refused,
            Ok(Some(found)) if limits.require(&found).is_err() => Misplaced::Refused,
            Ok(Some(found)) if limits.warn_of(&found) => Misplaced::Warned,
            Ok(_) => Misplaced::Not,
        }
    }

    fn judge(&self, crowd: &Crowd<'_>, selector: &Selector, candidates: &[Candidate], score: &mut Score) {
        let parts = crowd.parts();
        let mut shown: Vec<Option<usize>> = vec![None; parts.len()];
        for (index, candidate) in candidates.iter().enumerate() {
            let distance_m = |part: usize| (parts[part].place - candidate.centre()).norm();
            let reach_m = |part: usize| SAME_RATIO * self.poses[parts[part].pose].outline.radius_m;
            let near = (0..parts.len()).filter(|part| shown[*part].is_none() && distance_m(*part) < reach_m(*part));
            let part = near.min_by(|a, b| distance_m(*a).total_cmp(&distance_m(*b)));
            let selected = is_selected(selector, candidate);
            score.selected += u32::from(selected);
            let Some(part) = part else {
                score.phantoms += 1;
                score.wrong += u32::from(selected);
                continue;
            };
            shown[part] = Some(index);
            let truth = &parts[part];
            score.found += 1;
            score.posed += u32::from(candidate.pose == Some(truth.pose));
            score.misposed += u32::from(candidate.pose.is_some_and(|pose| pose != truth.pose));
            let cramped = crowd.part_gap_m(part) < self.config.part_clearance_m - TOLERANCE_M;
            if selected && (candidate.pose != Some(truth.pose) || cramped) {
                score.wrong += 1;
            } else if selected {
                score.position_errors_m.push(distance_m(part));
                let symmetry = self.poses[truth.pose].yaw_symmetry;
                if let Some(yaw_rad) = candidate.yaw_rad.filter(|_| symmetry > 0) {
                    let period = std::f64::consts::TAU / f64::from(symmetry);
                    let turns = (yaw_rad - truth.yaw_rad) / period;
                    score.yaw_errors_rad.push((turns - turns.round()).abs() * period);
                }
            }
        }
        score.parts += u32::try_from(parts.len()).unwrap_or(u32::MAX);
        for (index, part) in parts.iter().enumerate() {
            let isolated = self.config.wanted_poses.contains(&part.pose)
                && crowd.part_gap_m(index) >= self.config.part_clearance_m + TOLERANCE_M
                && crowd.wall_gap_m(index) >= self.config.wall_clearance_m + TOLERANCE_M
                && crowd.edge_gap_m(index) >= TOLERANCE_M;
            if isolated {
                score.isolated += 1;
                let taken = shown[index].is_some_and(|shown| {
                    is_selected(selector, &candidates[shown]) && candidates[shown].pose == Some(part.pose)
                });
                score.isolated_selected += u32::from(taken);
            }
        }
    }
}

/// Whether a candidate would be handed over where no goal asks for another pose.
fn is_selected(selector: &Selector, candidate: &Candidate) -> bool {
    candidate.pose.is_some_and(|pose| selector.is_wanted(pose)) && selector.admits(candidate)
}
