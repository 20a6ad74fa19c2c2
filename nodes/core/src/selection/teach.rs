//! Learns from pictures what a part looks like.

use image::GrayImage;
use nalgebra::{DMatrix, DVector, Isometry2, Matrix3, Point2, Rotation2, Vector2};
use serde::{Deserialize, Serialize};

use super::candidate::EDGE_STRIP_PX;
use super::detector::{Detector, Found};
use super::hull::distance_m;
use super::search::MISS_MAX;
use super::segment::{Plateau, PlateauSums, RADIAL_BINS, RELATIVE_UNITS, Segmentation, TaughtLight, hub_level};
use super::template::{Aspect, Factors, PartModel, Plane, PoseTemplate, SIDE_MAX, SLANT_PLANES, period_rad, yaw_steps};
use super::view::{RayTable, View};
use super::{ImageFault, SelectorConfig, candidate, require_above};
use crate::camera::{CameraModel, InvalidValue, MountedTray, require, single};

/// Room left round a part in its template, px.
const MARGIN_PX: f64 = 4.0;
/// Smallest thing that counts as more than noise, px.
const BLOB_PX_MIN: usize = 9;
/// Parts of a pose that must be shown at least.
const SHOWN_MIN: usize = 12;
/// What the pictures do not tell is taken to be alike at neighbouring yaws, and not to change with the slant: weights of
/// those beliefs, in parts shown; and of the belief that the walls' shade lies on the plateau but on no part, in
/// squares of the shade.
const YAW_RIDGE: f64 = 0.3;
const SLANT_RIDGE: f64 = 1.0;
const WALL_SHADE_RIDGE: f64 = 0.05;
/// Share of the parts shown in a pose that must be recognised, once it is learned, and that may be taken for another.
const RECOGNISED_RATIO_MIN: f64 = 0.6;
const MISTAKEN_RATIO_MAX: f64 = 0.04;
/// What the rings of parts among others may miss by more than those of parts shown: relative, and beside.
const RING_ALLOWANCE_RATIO: f32 = 1.5;
const RING_ALLOWANCE: f32 = 1.0;
/// What parts among others may miss by more than those shown: relative, and beside.
const MISS_ALLOWANCE_RATIO: f32 = 1.5;
const MISS_ALLOWANCE: f32 = 1.2;
/// How far from where it was laid a part is recognised as the same, relative to its radius.
const SAME_PLACE_RATIO: f64 = 0.3;

/// A part as it was laid for a picture, in the tray frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaidPart {
    /// Resting pose.
    pub pose: usize,
    /// Place, m.
    pub place: Point2<f64>,
    /// Yaw, rad.
    pub yaw_rad: f64,
}

/// A picture to teach from.
#[derive(Clone, Copy, Debug)]
pub struct TeachFrame<'a> {
    /// The picture.
    pub image: &'a GrayImage,
    /// Pose of the tray when it was taken.
    pub platen_from_tray: Isometry2<f64>,
    /// The parts laid on the plateau; a picture of none teaches what the bare plateau looks like.
    pub parts: &'a [LaidPart],
}

/// What must be known of a pose before it is taught: the part's drawing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseSpec {
    /// Height of the part as it lies, m.
    pub height_m: f64,
    /// Convex outline seen from above, counter-clockwise about its place at yaw 0, m.
    pub outline_m: Vec<Point2<f64>>,
    /// The turn by one over this many leaves the part as it was; 0 if any turn does.
    pub yaw_symmetry: u32,
}

impl PoseSpec {
    /// Greatest distance of the outline from the place, m.
    fn radius_m(&self) -> f64 {
        self.outline_m.iter().map(|corner| corner.coords.norm()).fold(0.0, f64::max)
    }
}

/// What must be known before a part is taught.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TeachSpec {
    /// The resting poses.
    pub poses: Vec<PoseSpec>,
    /// Grey levels by which a part differs from the plateau at least.
    pub contrast_min_levels: f64,
}

/// Why teaching failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TeachError {
    /// A number out of range.
    #[error(transparent)]
    Value(#[from] InvalidValue),
    /// A picture that cannot be used.
    #[error("teaching frame {index}")]
    Frame {
        /// Which picture.
        index: usize,
        /// What is wrong with it.
        source: ImageFault,
    },
    /// No picture of the bare plateau.
    #[error("no teaching frame shows the plateau without parts")]
    NoBarePlateau,
    /// The hub, whose top serves as the reference of brightness, is not seen.
    #[error("teaching frame {index} does not show the tray's hub")]
    HubOutOfView {
        /// Which picture.
        index: usize,
    },
    /// A pose without enough pictures.
    #[error("the teaching frames show {shown} parts in pose {pose}; allowed: at least {SHOWN_MIN}")]
    TooFew {
        /// The pose.
        pose: usize,
        /// Parts shown.
        shown: usize,
    },
    /// A pose that looks like another, or different every time.
    #[error(
        "{recognised} of {shown} parts shown in pose {pose} are recognised, {mistaken} taken for another pose; \
         allowed: at least 60 % and at most 4 %"
    )]
    NotRecognised {
        /// The pose.
        pose: usize,
        /// Parts shown.
        shown: usize,
        /// Parts recognised.
        recognised: usize,
        /// Parts taken for another pose.
        mistaken: usize,
    },
}

/// Learns a part from pictures of it lying free on the plateau, and of the bare plateau.
///
/// # Errors
///
/// [`TeachError`] if a number is out of range, a picture unusable, a pose not shown often enough, or poses cannot be told
/// apart.
pub fn teach(
    frames: &[TeachFrame],
    camera: &CameraModel,
    tray: &MountedTray,
    spec: &TeachSpec,
) -> Result<PartModel, TeachError> {
    tray.validate()?;
    require_above(camera, tray)?;
    require(!spec.poses.is_empty(), "teach.poses", 0.0, "at least one")?;
    for pose in &spec.poses {
        require((0.0..=0.1).contains(&pose.height_m), "teach.poses.height_m", pose.height_m, "0 to 0.1 m")?;
        let side = 2.0 * (pose.radius_m() / camera.m_per_px(tray.plateau_height_m()) + MARGIN_PX) + 1.0;
        let radius_ok = pose.radius_m() > 0.0 && side <= SIDE_MAX as f64;
        require(radius_ok, "teach.poses.outline_m", pose.radius_m(), "a reach above 0, and at most 75 px")?;
    }
    for part in frames.iter().flat_map(|frame| frame.parts) {
        require(part.pose < spec.poses.len(), "teach.parts.pose", part.pose as f64, "an index of teach.poses")?;
    }
    let mut lesson = Lesson { camera, tray, rays: RayTable::new(camera), segmentation: Segmentation::default(), spec };
    let (taught, plateau) = lesson.plateau(frames)?;
    let mut model = PartModel {
        plateau_light: taught.light,
        hub_level: taught.hub_level,
        plateau_shade: shade_plane(&plateau),
        poses: Vec::new(),
    };
    let views = lesson.views(frames, &plateau)?;
    for (pose, views) in views.iter().enumerate() {
        model.poses.push(lesson.template(pose, views)?);
    }
    model.validate()?;
    measure_rings(frames, camera, tray, spec, &mut model)?;
    measure_parts(frames, camera, tray, spec, &mut model)?;
    examine(frames, camera, tray, spec, &model)?;
    Ok(model)
}

/// A part seen once.
struct Seen {
    aspect: Aspect,
    /// Texels of its template; `None` where they lie off the plateau.
    texels: Vec<Option<Texel>>,
    sigma: f32,
}

#[derive(Clone, Copy)]
struct Texel {
    /// Brightness above the plateau's, relative to it.
    level: f64,
    /// What the walls' shade adds to the plateau's there.
    wall_shade: f64,
}

struct Lesson<'a> {
    camera: &'a CameraModel,
    tray: &'a MountedTray,
    rays: RayTable,
    segmentation: Segmentation,
    spec: &'a TeachSpec,
}

impl Lesson<'_> {
    fn look(&mut self, frame: &TeachFrame, index: usize, plateau: &Plateau) -> Result<(), TeachError> {
        let fault = |source| TeachError::Frame { index, source };
        let expected = (self.camera.width_px(), self.camera.height_px());
        if frame.image.dimensions() != expected {
            return Err(fault(ImageFault::WrongSize { found: frame.image.dimensions(), expected }));
        }
        let view = View { camera: self.camera, tray: self.tray, platen_from_tray: frame.platen_from_tray };
        let contrast = self.spec.contrast_min_levels;
        self.segmentation.look(&view, &self.rays, frame.image, plateau, contrast, BLOB_PX_MIN).map_err(fault)
    }

    /// What the bare plateau looks like.
    fn plateau(&mut self, frames: &[TeachFrame]) -> Result<(TaughtLight, Plateau), TeachError> {
        let mut sums = vec![PlateauSums::default(); RADIAL_BINS + 1];
        let (mut light, mut hub, mut count) = ([0.0; 6], 0.0, 0.0_f32);
        for (index, frame) in frames.iter().enumerate().filter(|(_, frame)| frame.parts.is_empty()) {
            self.look(frame, index, &Plateau::unknown())?;
            let view = View { camera: self.camera, tray: self.tray, platen_from_tray: frame.platen_from_tray };
            self.segmentation.learn_plateau(&view, &mut sums);
            hub += hub_level(&view, frame.image).ok_or(TeachError::HubOutOfView { index })?;
            light = std::array::from_fn(|index| light[index] + self.segmentation.light[index]);
            count += 1.0;
        }
        if count == 0.0 {
            return Err(TeachError::NoBarePlateau);
        }
        let shade = |sums: &PlateauSums| {
            // Bins no pixel falls into, and directions never seen, stay as bright as the middle.
            let ridge = Matrix3::from_diagonal(&nalgebra::Vector3::new(1e-6, 3.0, 3.0));
            let target = sums.target - sums.normal.column(0);
            let solution = (sums.normal + ridge).cholesky().map(|factors| factors.solve(&target));
            let [constant, cos, sin] = solution.unwrap_or_default().map(single).into();
            [1.0 + constant, cos, sin]
        };
        let taught = TaughtLight { light: light.map(|sum| sum / count), hub_level: hub / count };
        Ok((taught, Plateau { taught: Some(taught), shade: sums.iter().map(shade).collect() }))
    }

    /// Every part laid, as it was seen, by pose.
    fn views(&mut self, frames: &[TeachFrame], plateau: &Plateau) -> Result<Vec<Vec<Seen>>, TeachError> {
        let mut views: Vec<Vec<Seen>> = self.spec.poses.iter().map(|_| Vec::new()).collect();
        for (index, frame) in frames.iter().enumerate().filter(|(_, frame)| !frame.parts.is_empty()) {
            self.look(frame, index, plateau)?;
            let view = View { camera: self.camera, tray: self.tray, platen_from_tray: frame.platen_from_tray };
            let tray_yaw_rad = frame.platen_from_tray.rotation.angle();
            for part in frame.parts {
                let spec = &self.spec.poses[part.pose];
                // Yaws that look the same count as one.
                let period_rad = period_rad(spec.yaw_symmetry);
                let on_platen_rad = part.yaw_rad + tray_yaw_rad;
                let folded_rad = if period_rad > 0.0 { on_platen_rad.rem_euclid(period_rad) } else { 0.0 };
                let yaw_rad = folded_rad - tray_yaw_rad;
                let height_m = self.tray.plateau_height_m() + 0.5 * spec.height_m;
                let aspect = Aspect { yaw_rad: folded_rad, slant: view.slant(part.place, height_m) };
                if let Some(texels) = self.sample(&view, spec, part.place, yaw_rad) {
                    views[part.pose].push(Seen { aspect, texels, sigma: self.segmentation.sigma });
                }
            }
        }
        Ok(views)
    }

    fn texel_m(&self) -> f64 {
        self.camera.m_per_px(self.tray.plateau_height_m())
    }

    /// Texels of a template along a side.
    fn side(&self, spec: &PoseSpec) -> usize {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked against SIDE_MAX")]
        let half = (spec.radius_m() / self.texel_m() + MARGIN_PX).ceil() as usize;
        (2 * half + 1).min(SIDE_MAX)
    }

    /// Place of a texel in a part's directions, m.
    fn place_m(&self, spec: &PoseSpec, texel: usize) -> Vector2<f64> {
        let side = self.side(spec);
        let middle = (side / 2) as f64;
        Vector2::new((texel % side) as f64 - middle, (texel / side) as f64 - middle) * self.texel_m()
    }

    /// What is seen in a part's directions.
    fn sample(&self, view: &View, spec: &PoseSpec, place: Point2<f64>, yaw_rad: f64) -> Option<Vec<Option<Texel>>> {
        let frame = &self.segmentation;
        let height_m = self.tray.plateau_height_m() + 0.5 * spec.height_m;
        let corner = Vector2::new(frame.window.left as f64, frame.window.top as f64);
        let pixel = view.pixel(place, height_m)? - corner;
        let px_from_part = view.px_from_tray(place, height_m)? * Rotation2::new(yaw_rad).matrix();
        let side = self.side(spec);
        let sample = |index: usize| {
            let place = (pixel + px_from_part * self.place_m(spec, index)).map(single);
            let (level, index) = frame.relative_at(place.x, place.y)?;
            let texel =
                Texel { level: f64::from(level / RELATIVE_UNITS), wall_shade: f64::from(frame.wall_shade(index)) };
            (frame.bins[index] != 0).then_some(texel)
        };
        Some((0..side * side).map(sample).collect())
    }

    fn template(&self, pose: usize, views: &[Seen]) -> Result<PoseTemplate, TeachError> {
        if views.len() < SHOWN_MIN {
            return Err(TeachError::TooFew { pose, shown: views.len() });
        }
        let spec = &self.spec.poses[pose];
        let side = self.side(spec);
        let steps = yaw_steps(spec.yaw_symmetry);
        let wall_shade = steps + 1 + SLANT_PLANES;
        let unknowns = wall_shade + 1;
        let mut beliefs = DMatrix::<f64>::zeros(unknowns, unknowns);
        for yaw in 0..steps {
            for (row, column, sign) in [(0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0)] {
                beliefs[(yaw + row, yaw + column)] += sign * YAW_RIDGE;
            }
        }
        for plane in steps + 1..wall_shade {
            beliefs[(plane, plane)] += SLANT_RIDGE;
        }
        beliefs[(wall_shade, wall_shade)] += WALL_SHADE_RIDGE;
        // What never was seen is taken to be bare.
        beliefs[(0, 0)] += 1e-3;
        let factors: Vec<Factors> = views.iter().map(|seen| seen.aspect.factors(spec.yaw_symmetry, steps)).collect();
        let mut planes: Vec<Vec<f32>> = vec![Vec::with_capacity(side * side); unknowns];
        let mut deviations = Vec::with_capacity(side * side);
        let mean_noise = views.iter().map(|seen| seen.sigma * seen.sigma).sum::<f32>() / views.len() as f32;
        for texel in 0..side * side {
            let mut normal = beliefs.clone();
            let mut target = DVector::<f64>::zeros(unknowns);
            let beside = distance_m(&spec.outline_m, &Point2::from(self.place_m(spec, texel))) > 0.0;
            target[wall_shade] = WALL_SHADE_RIDGE * f64::from(u8::from(beside));
            let rows: Vec<(Vec<(usize, f64)>, f64)> = views
                .iter()
                .zip(&factors)
                .filter_map(|(seen, factors)| {
                    let Texel { level, wall_shade: shade } = seen.texels[texel]?;
                    let at_yaws = factors.at_yaws.into_iter().enumerate().take(steps + 1);
                    let mut row: Vec<(usize, f64)> = at_yaws.map(|(after, w)| (factors.first + after, w)).collect();
                    row.extend(factors.slant.into_iter().enumerate().map(|(plane, w)| (steps + 1 + plane, w)));
                    row.push((wall_shade, shade));
                    Some((row, level))
                })
                .collect();
            for (row, level) in &rows {
                for (i, w) in row {
                    target[*i] += w * level;
                    row.iter().for_each(|(j, v)| normal[(*i, *j)] += w * v);
                }
            }
            let solution = normal.cholesky().ok_or(TeachError::TooFew { pose, shown: views.len() })?.solve(&target);
            for (plane, value) in planes.iter_mut().zip(solution.iter()) {
                plane.push(single(*value));
            }
            let miss = |(row, level): &(Vec<(usize, f64)>, f64)| {
                (level - row.iter().map(|(i, w)| w * solution[*i]).sum::<f64>()).powi(2)
            };
            let square: f64 = rows.iter().map(miss).sum();
            let freedom = rows.len().saturating_sub(unknowns).max(1) as f64;
            deviations.push((single(square / freedom) - mean_noise).max(0.0).sqrt());
        }
        let mut planes = planes.into_iter().map(|values| Plane::new(side, values));
        let at_yaws = planes.by_ref().take(steps + 1).collect();
        let mut next = || planes.next().unwrap_or_else(|| Plane::new(side, vec![0.0; side * side]));
        Ok(PoseTemplate {
            height_m: spec.height_m,
            yaw_symmetry: spec.yaw_symmetry,
            ring_miss_max: 0.0,
            miss_max: 1.0,
            shade_reach_m: 0.0,
            texel_m: self.texel_m(),
            at_yaws,
            slant_x: next(),
            slant_y: next(),
            slant_xx: next(),
            slant_xy: next(),
            slant_yy: next(),
            wall_shade: next(),
            deviation: Plane::new(side, deviations),
            outline_m: spec.outline_m.clone(),
        })
    }
}

fn shade_plane(plateau: &Plateau) -> Plane {
    let row = |index: usize, base: f32| plateau.shade[1..].iter().map(move |shade| shade[index] - base);
    Plane::new(RADIAL_BINS, row(0, 1.0).chain(row(1, 0.0)).chain(row(2, 0.0)).collect())
}

/// Learns how well the rings of brightness about a part fit: from the parts shown, with some allowance for neighbours.
fn measure_rings(
    frames: &[TeachFrame],
    camera: &CameraModel,
    tray: &MountedTray,
    spec: &TeachSpec,
    model: &mut PartModel,
) -> Result<(), TeachError> {
    let mut detector = Detector::new(camera, tray, model);
    let mut misses: Vec<Vec<f32>> = vec![Vec::new(); spec.poses.len()];
    for (index, frame) in frames.iter().enumerate().filter(|(_, frame)| !frame.parts.is_empty()) {
        detector
            .find(frame.image, &frame.platen_from_tray, spec.contrast_min_levels, 0.0)
            .map_err(|source| TeachError::Frame { index, source })?;
        let view = detector.view(&frame.platen_from_tray);
        for part in frame.parts {
            misses[part.pose].extend(detector.ring_miss(&view, part.pose, part.place));
        }
    }
    for (pose, misses) in model.poses.iter_mut().zip(&mut misses) {
        misses.sort_by(f32::total_cmp);
        let most = misses.get(misses.len() * 98 / 100).copied().unwrap_or(0.0);
        pose.ring_miss_max = (RING_ALLOWANCE_RATIO * most + RING_ALLOWANCE).min(MISS_MAX);
    }
    Ok(())
}

/// Learns from parts that lie alone how well they fit, and how far their shade reaches: what stands out from the plateau beside
/// them.
fn measure_parts(
    frames: &[TeachFrame],
    camera: &CameraModel,
    tray: &MountedTray,
    spec: &TeachSpec,
    model: &mut PartModel,
) -> Result<(), TeachError> {
    let mut detector = Detector::new(camera, tray, model);
    let cost_max = single(SelectorConfig::default().miss_max);
    let mut misses: Vec<Vec<f32>> = vec![Vec::new(); spec.poses.len()];
    let mut reaches_m = vec![0.0_f64; spec.poses.len()];
    for (index, frame) in frames.iter().enumerate().filter(|(_, frame)| !frame.parts.is_empty()) {
        let found = detector
            .find(frame.image, &frame.platen_from_tray, spec.contrast_min_levels, cost_max)
            .map_err(|source| TeachError::Frame { index, source })?;
        for part in frame.parts {
            let near_m = SAME_PLACE_RATIO * spec.poses[part.pose].radius_m();
            let is_it = |found: &&Found| found.pose == part.pose && (found.fit.centre - part.place).norm() <= near_m;
            let beyond_noise = |found: &Found| found.fit.cost - detector.sought[part.pose].noise_miss;
            misses[part.pose].extend(found.iter().find(is_it).map(beyond_noise));
        }
        let outlines: Vec<_> =
            frame.parts.iter().map(|part| detector.outline(part.pose, part.place, part.yaw_rad)).collect();
        for point in detector.unexplained(&detector.view(&frame.platen_from_tray), EDGE_STRIP_PX) {
            let distances_m = outlines.iter().map(|outline| distance_m(outline, &point)).enumerate();
            if let Some((part, distance_m)) = distances_m.min_by(|(_, a), (_, b)| a.total_cmp(b)) {
                let reach_m = &mut reaches_m[frame.parts[part].pose];
                *reach_m = reach_m.max(distance_m);
            }
        }
    }
    for ((pose, misses), reach_m) in model.poses.iter_mut().zip(&mut misses).zip(reaches_m) {
        misses.sort_by(f32::total_cmp);
        let most = misses.get(misses.len() * 98 / 100).copied().unwrap_or(0.0).max(0.0);
        pose.miss_max = MISS_ALLOWANCE_RATIO * most + MISS_ALLOWANCE;
        // Two pixels more: the outline is fitted to a pixel, and more noise frays the shade.
        pose.shade_reach_m = reach_m + 2.0 * pose.texel_m;
    }
    Ok(())
}

/// Whether what was learned recognises what it was learned from.
fn examine(
    frames: &[TeachFrame],
    camera: &CameraModel,
    tray: &MountedTray,
    spec: &TeachSpec,
    model: &PartModel,
) -> Result<(), TeachError> {
    let config = SelectorConfig { contrast_min_levels: spec.contrast_min_levels, ..SelectorConfig::default() };
    let mut detector = Detector::new(camera, tray, model);
    let mut tally = vec![(0_usize, 0_usize, 0_usize); spec.poses.len()];
    for (index, frame) in frames.iter().enumerate().filter(|(_, frame)| !frame.parts.is_empty()) {
        let found = detector
            .find(frame.image, &frame.platen_from_tray, config.contrast_min_levels, single(config.miss_max))
            .map_err(|source| TeachError::Frame { index, source })?;
        let candidates = candidate::judge(&detector, &detector.view(&frame.platen_from_tray), &config, &found);
        for part in frame.parts {
            let (shown, recognised, mistaken) = &mut tally[part.pose];
            *shown += 1;
            let reach_m = SAME_PLACE_RATIO * spec.poses[part.pose].radius_m();
            let seen = candidates.iter().find(|candidate| (candidate.centre() - part.place).norm() <= reach_m);
            match seen.and_then(|candidate| candidate.pose) {
                Some(pose) if pose == part.pose => *recognised += 1,
                Some(_) => *mistaken += 1,
                None => {}
            }
        }
    }
    for (pose, (shown, recognised, mistaken)) in tally.into_iter().enumerate() {
        let shown_f64 = shown as f64;
        let unknown = (recognised as f64) < RECOGNISED_RATIO_MIN * shown_f64;
        if unknown || mistaken as f64 > MISTAKEN_RATIO_MAX * shown_f64 {
            return Err(TeachError::NotRecognised { pose, shown, recognised, mistaken });
        }
    }
    Ok(())
}
