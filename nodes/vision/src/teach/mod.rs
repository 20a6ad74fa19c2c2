//! Learns from pictures what a part looks like: `regression` makes the templates, `exam` tells how well they do.

mod clicks;
mod exam;
mod labels;
mod regression;

use image::GrayImage;
use nalgebra::{Isometry2, Matrix3, Point2, Rotation2, Vector2};
use serde::{Deserialize, Serialize};

use super::modes::Light;
use super::segment::{Plateau, PlateauSums, RADIAL_BINS, RELATIVE_UNITS, Segmentation, TaughtLight, hub_level};
use super::template::{
    Aspect, LIGHTS_ALL_ROUND, LitPicture, PartModel, Plane, SIDE_MAX, SIDES, period_rad, texel_place_m, yaw_steps,
};
use super::view::{RayTable, View};
use super::{ImageFault, require_above};
pub use clicks::{
    Click, ClickDoubt, ClickLabel, ClickLesson, ClickedPicture, FittedClick, fit_clicks, teach_from_clicks,
};
use exam::Exam;
use feeder_model::camera::{CameraModel, MountedTray, single};
use feeder_model::range::OutOfRange;

/// Room left round a part in its template, px.
const MARGIN_PX: f64 = 4.0;
/// Smallest thing that counts as more than noise, px.
const BLOB_PX_MIN: usize = 9;
/// How often the plateau is looked at between parts, and how far from what stands out, px.
const PLATEAU_ROUNDS: usize = 2;
const PLATEAU_MARGIN_PX: usize = 4;
/// Parts of a pose that must be shown at least where no drawing tells the rest.
const SHOWN_MIN: usize = 12;
/// How often labels are fitted and the templates learned anew, where labels are found to be off.
const LABEL_ROUNDS: usize = 3;
/// Parts that the walls shade by more than this, of the plateau's brightness, tell nothing of light from one side.
const WALL_SHADE_MAX: f64 = 0.3;

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
    Value(#[from] OutOfRange),
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
    /// Clicks that all show something else than the drawing.
    #[error(
        "none of the {clicks} clicks on parts shows the part as it is drawn: it is another part, the camera hangs elsewhere than \
         stated, or the clicks miss"
    )]
    NothingAsDrawn {
        /// How many there are.
        clicks: usize,
    },
    /// A model that was not drawn for this camera.
    #[error(
        "the drawn model's texels are {found_m} m, {side} along a side; this camera needs {expected_m} m and {expected_side}"
    )]
    OtherCamera {
        /// Size of the model's texels, m.
        found_m: f64,
        /// Texels along a side.
        side: usize,
        /// What they must be, m.
        expected_m: f64,
        /// As for the size.
        expected_side: usize,
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

/// Pictures of parts and of the bare plateau in lights other than the one taught.
pub struct OtherLights<'a> {
    /// In each of the lights from all sides.
    pub all_round: [Vec<TeachFrame<'a>>; LIGHTS_ALL_ROUND],
    /// In low light from one side: where that comes from, counter-clockwise from the platen's x, rad.
    pub from_side: Vec<(f64, Vec<TeachFrame<'a>>)>,
}

/// Learns a part from pictures of it lying free on the plateau, and of the bare plateau, and from the same in other lights.
///
/// # Errors
///
/// [`TeachError`] if a number is out of range, a picture unusable, a pose not shown often enough, or poses cannot be told
/// apart.
pub fn teach(
    frames: &[TeachFrame],
    other_lights: &OtherLights,
    camera: &CameraModel,
    tray: &MountedTray,
    spec: &TeachSpec,
) -> Result<PartModel, TeachError> {
    tray.validate()?;
    require_above(camera, tray)?;
    OutOfRange::unless(!spec.poses.is_empty(), "teach.poses", 0.0, "at least one")?;
    for pose in &spec.poses {
        OutOfRange::unless((0.0..=0.1).contains(&pose.height_m), "teach.poses.height_m", pose.height_m, "0 to 0.1 m")?;
        let side = 2.0 * (pose.radius_m() / camera.m_per_px(tray.plateau_height_m()) + MARGIN_PX) + 1.0;
        let radius_ok = pose.radius_m() > 0.0 && side <= SIDE_MAX as f64;
        OutOfRange::unless(radius_ok, "teach.poses.outline_m", pose.radius_m(), "a reach above 0, and at most 75 px")?;
    }
    let from_side = other_lights.from_side.iter().flat_map(|(_, frames)| frames);
    let otherwise_lit = other_lights.all_round.iter().flatten().chain(from_side);
    for part in frames.iter().chain(otherwise_lit).flat_map(|frame| frame.parts) {
        OutOfRange::unless(
            part.pose < spec.poses.len(),
            "teach.parts.pose",
            part.pose as f64,
            "an index of teach.poses",
        )?;
    }
    let lit = lit(other_lights, camera, tray, spec)?;
    let mut model = learn(frames, camera, tray, spec, &Known::Lit(&lit))?;
    let mut laid: Vec<Vec<LaidPart>> = frames.iter().map(|frame| frame.parts.to_vec()).collect();
    for _ in 0..LABEL_ROUNDS {
        let Some(fitted) = labels::fitted(frames, &laid, &model, camera, tray, spec)? else { break };
        laid = fitted;
        let frames: Vec<TeachFrame> =
            frames.iter().zip(&laid).map(|(frame, parts)| TeachFrame { parts, ..*frame }).collect();
        model = learn(&frames, camera, tray, spec, &Known::Lit(&lit))?;
    }
    let frames: Vec<TeachFrame> =
        frames.iter().zip(&laid).map(|(frame, parts)| TeachFrame { parts, ..*frame }).collect();
    Exam { frames: &frames, camera, tray, spec }.complete(&mut model)?;
    Ok(model)
}

/// What is known of a part before its templates are learned.
enum Known<'a> {
    /// What each pose looks like in other lights.
    Lit(&'a [Lit]),
    /// All that a drawing shows: only what differs from it is learned.
    Drawn(&'a PartModel),
}

/// What a pose looks like in other lights.
struct Lit {
    all_round: Vec<LitPicture>,
    from_side: [Plane; SIDES],
}

/// What each pose looks like in other lights.
fn lit(
    lights: &OtherLights,
    camera: &CameraModel,
    tray: &MountedTray,
    spec: &TeachSpec,
) -> Result<Vec<Lit>, TeachError> {
    let mut lesson = Lesson::new(camera, tray, spec);
    let mut all_round: Vec<Vec<LitPicture>> = vec![Vec::new(); spec.poses.len()];
    for frames in &lights.all_round {
        let (_, plateau) = lesson.plateau(frames)?;
        for (pose, views) in lesson.views(frames, &plateau, None)?.iter().enumerate() {
            all_round[pose].push(lesson.all_round(pose, views)?);
        }
    }
    let mut from_side: Vec<Vec<Seen>> = spec.poses.iter().map(|_| Vec::new()).collect();
    for (azimuth_rad, frames) in &lights.from_side {
        let (_, plateau) = lesson.plateau(frames)?;
        for (all, views) in from_side.iter_mut().zip(lesson.views(frames, &plateau, Some(*azimuth_rad))?) {
            all.extend(views.into_iter().filter(Seen::is_lit));
        }
    }
    let poses = all_round.into_iter().zip(&from_side).enumerate();
    poses
        .map(|(pose, (all_round, views))| Ok(Lit { all_round, from_side: lesson.lit_from_side(pose, views)? }))
        .collect()
}

/// The templates, without what an exam tells about them.
fn learn(
    frames: &[TeachFrame],
    camera: &CameraModel,
    tray: &MountedTray,
    spec: &TeachSpec,
    known: &Known,
) -> Result<PartModel, TeachError> {
    let mut lesson = Lesson::new(camera, tray, spec);
    let (taught, plateau) = lesson.plateau(frames)?;
    let mut model = PartModel {
        plateau_light: taught.light,
        hub_level: taught.hub_level,
        taught_at_m: taught.at_m.into(),
        plateau_shade: shade_plane(&plateau),
        poses: Vec::new(),
    };
    let drawn = if let Known::Drawn(drawn) = known { &drawn.poses[..] } else { &[] };
    for (drawn, spec) in drawn.iter().zip(&spec.poses) {
        let (found_m, side) = (drawn.texel_m, drawn.side());
        let (expected_m, expected_side) = (lesson.texel_m(), lesson.side(spec));
        if (found_m / expected_m - 1.0).abs() > 1e-6 || side != expected_side {
            return Err(TeachError::OtherCamera { found_m, side, expected_m, expected_side });
        }
    }
    let views = lesson.views(frames, &plateau, None)?;
    for (pose, views) in views.iter().enumerate() {
        let steps = yaw_steps(spec.poses[pose].yaw_symmetry);
        let mut template = lesson.template(pose, views, steps, drawn.get(pose))?;
        if let Known::Lit(lit) = known {
            template.lights.clone_from(&lit[pose].all_round);
            template.from_side.clone_from(&lit[pose].from_side);
        }
        model.poses.push(template);
    }
    model.validate()?;
    Ok(model)
}

/// A part seen once.
struct Seen {
    aspect: Aspect,
    /// Where low light comes from in the part's directions, rad, if from one side.
    lamp_rad: Option<f64>,
    /// Texels of its template; `None` where they lie off the plateau.
    texels: Vec<Option<Texel>>,
    sigma: f32,
}

impl Seen {
    /// Whether it lies where the walls leave most of the light.
    fn is_lit(&self) -> bool {
        let shades = self.texels.iter().flatten().map(|texel| texel.wall_shade);
        shades.sum::<f64>() > -WALL_SHADE_MAX * self.texels.len() as f64
    }
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

impl<'a> Lesson<'a> {
    fn new(camera: &'a CameraModel, tray: &'a MountedTray, spec: &'a TeachSpec) -> Self {
        Self { camera, tray, rays: RayTable::new(camera), segmentation: Segmentation::default(), spec }
    }

    fn look(&mut self, frame: &TeachFrame, index: usize, plateau: &Plateau) -> Result<(), TeachError> {
        let fault = |source| TeachError::Frame { index, source };
        let expected = (self.camera.width_px(), self.camera.height_px());
        if frame.image.dimensions() != expected {
            return Err(fault(ImageFault::WrongSize { found: frame.image.dimensions(), expected }));
        }
        let view = View { camera: self.camera, tray: self.tray, platen_from_tray: frame.platen_from_tray };
        let contrast = self.spec.contrast_min_levels;
        self.segmentation
            .look(&view, &self.rays, frame.image, plateau, Light::Any, contrast, BLOB_PX_MIN)
            .map_err(fault)
    }

    /// What the bare plateau looks like: as pictures without parts show it, or where there are none, as those with parts show
    /// it between them.
    fn plateau(&mut self, frames: &[TeachFrame]) -> Result<(TaughtLight, Plateau), TeachError> {
        let bare = frames.iter().any(|frame| frame.parts.is_empty());
        let mut learned =
            self.plateau_between(frames, |frame| frame.parts.is_empty() == bare, &Plateau::unknown(), bare)?;
        // What stands out from the plateau is known only once the plateau is.
        for _ in 0..if bare { 0 } else { PLATEAU_ROUNDS } {
            learned = self.plateau_between(frames, |_| true, &learned.1, bare)?;
        }
        Ok(learned)
    }

    /// What the plateau looks like in some pictures, in all of each that is bare, or outside of what lies on it.
    fn plateau_between(
        &mut self,
        frames: &[TeachFrame],
        counts: impl Fn(&TeachFrame) -> bool,
        known: &Plateau,
        bare: bool,
    ) -> Result<(TaughtLight, Plateau), TeachError> {
        let known = Plateau { taught: None, ..known.clone() };
        let mut sums = vec![PlateauSums::default(); RADIAL_BINS + 1];
        let (mut light, mut hub, mut at_m, mut count) = ([0.0; 6], 0.0, Vector2::zeros(), 0.0_f32);
        for (index, frame) in frames.iter().enumerate().filter(|(_, frame)| counts(frame)) {
            self.look(frame, index, &known)?;
            let view = View { camera: self.camera, tray: self.tray, platen_from_tray: frame.platen_from_tray };
            self.segmentation.learn_plateau(&view, if bare { None } else { Some(PLATEAU_MARGIN_PX) }, &mut sums);
            hub += hub_level(&view, frame.image).ok_or(TeachError::HubOutOfView { index })?;
            light = std::array::from_fn(|index| light[index] + self.segmentation.light[index]);
            at_m += view.beside_camera_m(Point2::origin());
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
        let taught =
            TaughtLight { light: light.map(|sum| sum / count), hub_level: hub / count, at_m: at_m / f64::from(count) };
        Ok((taught, Plateau { taught: Some(taught), shade: sums.iter().map(shade).collect() }))
    }

    /// Every part laid, as it was seen, by pose, in light from one side if that comes from anywhere.
    fn views(
        &mut self,
        frames: &[TeachFrame],
        plateau: &Plateau,
        azimuth_rad: Option<f64>,
    ) -> Result<Vec<Vec<Seen>>, TeachError> {
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
                    let lamp_rad = azimuth_rad.map(|azimuth_rad| azimuth_rad - folded_rad);
                    views[part.pose].push(Seen { aspect, lamp_rad, texels, sigma: self.segmentation.sigma });
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

    /// What is seen in a part's directions.
    fn sample(&self, view: &View, spec: &PoseSpec, place: Point2<f64>, yaw_rad: f64) -> Option<Vec<Option<Texel>>> {
        let frame = &self.segmentation;
        let height_m = self.tray.plateau_height_m() + 0.5 * spec.height_m;
        let corner = Vector2::new(frame.window.left as f64, frame.window.top as f64);
        let pixel = view.pixel(place, height_m)? - corner;
        let px_from_part = view.px_from_tray(place, height_m)? * Rotation2::new(yaw_rad).matrix();
        let side = self.side(spec);
        let sample = |index: usize| {
            let place = (pixel + px_from_part * texel_place_m(index, side, self.texel_m())).map(single);
            let (level, index) = frame.relative_at(place.x, place.y)?;
            let texel =
                Texel { level: f64::from(level / RELATIVE_UNITS), wall_shade: f64::from(frame.wall_shade(index)) };
            (frame.bins[index] != 0).then_some(texel)
        };
        Some((0..side * side).map(sample).collect())
    }
}

fn shade_plane(plateau: &Plateau) -> Plane {
    let row = |index: usize, base: f32| plateau.shade[1..].iter().map(move |shade| shade[index] - base);
    Plane::new(RADIAL_BINS, row(0, 1.0).chain(row(1, 0.0)).chain(row(2, 0.0)).collect())
}
