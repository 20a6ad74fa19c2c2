//! Fits a camera to the edges of the tray that pictures show.

use image::GrayImage;
use nalgebra::{Isometry2, Matrix2, OMatrix, OVector, Rotation2, U5, Vector2};

use super::RimNotSeen;
use super::edges::{self, EdgePoint};
use crate::ImageFault;
use crate::view::View;
use feeder_model::camera::{CameraModel, CameraSpec, MountedTray};
use feeder_model::range::OutOfRange;

/// How far from where they should be edges are looked for, px: while a camera is watched, and while it is calibrated.
const WATCH_REACHES_PX: [f64; 3] = [6.0, 5.0, 4.0];
const CALIBRATION_REACHES_PX: [f64; 5] = [24.0, 12.0, 6.0, 4.0, 4.0];
/// A fit that moves no edge by more than this is not looked at again, px.
const SETTLED_PX: f64 = 0.25;
/// Share of the places on the rim in view at which an edge must fit, and how many must be in view to tell anything.
const RIM_RATIO_MIN: f64 = 0.5;
const RIM_IN_VIEW_MIN: usize = 40;
/// Rounds of weighting at each reach. Points beyond [`TUKEY`] times their usual miss, which is at least this, px, count
/// nothing.
const ROUNDS: usize = 6;
const TUKEY: f64 = 4.0;
const USUAL_MISS_PX_MIN: f64 = 0.15;
/// An edge that misses the fit by more than this is another, px.
const FITS_PX: f64 = 1.0;
/// How far a camera is moved, in x and y (m), height (of it), yaw (rad) and k1, before the first look: what pictures do not
/// tell stays as it was. In pixels squared these count as one point that misses by as much.
const PRIOR: [f64; 5] = [0.02, 0.02, 0.1, 0.2, 1.0];

/// A picture of the tray at a known place.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// The picture.
    pub image: &'a GrayImage,
    /// Where the tray stood.
    pub platen_from_tray: Isometry2<f64>,
}

/// A camera as pictures show that it is.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// The camera.
    pub camera: CameraModel,
    /// Root mean square by which edges miss it, px.
    pub miss_px: f64,
    /// How many places on edges were fitted.
    pub edges: usize,
}

/// Why no camera is fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// No picture.
    #[error("no picture to calibrate from")]
    NoPicture,
    /// A picture that cannot be used.
    #[error("picture {index}: {source}")]
    Picture {
        /// Which.
        index: usize,
        /// What is wrong with it.
        source: ImageFault,
    },
    /// The rim is not found.
    #[error("picture {index}: {source}")]
    NoRim {
        /// Which.
        index: usize,
        /// What is seen of it.
        source: RimNotSeen,
    },
    /// What fits is no camera.
    #[error(transparent)]
    Value(#[from] OutOfRange),
}

/// Fits the camera's pose, and its lens coefficient k1 if `with_k1`, to pictures of the tray. The focal length stays as it is:
/// seen from above, it and the height are one.
///
/// # Errors
///
/// [`CalibrationError`] if a picture is not the camera's, or does not show the rim within some 20 px of where it should be.
pub fn calibrate(
    shots: &[Shot],
    camera: &CameraModel,
    tray: &MountedTray,
    with_k1: bool,
) -> Result<Calibrated, CalibrationError> {
    tray.validate()?;
    let expected = (camera.width_px(), camera.height_px());
    for (index, shot) in shots.iter().enumerate() {
        let found = shot.image.dimensions();
        if found != expected {
            return Err(CalibrationError::Picture { index, source: ImageFault::WrongSize { found, expected } });
        }
    }
    let mut fit = Fit { camera: camera.clone(), with_k1, points: Vec::new() };
    for reach_px in CALIBRATION_REACHES_PX {
        fit.points.clear();
        for shot in shots {
            fit.look(shot, tray, reach_px);
        }
        fit.settle()?;
    }
    for (index, shot) in shots.iter().enumerate() {
        let enough = fit.rim(shot, tray).map_err(|source| CalibrationError::NoRim { index, source })?;
        if !enough {
            return Err(CalibrationError::Picture { index, source: ImageFault::PlateauOutOfView });
        }
    }
    let fitting: Vec<f64> = fit.misses().filter(|miss| miss.abs() <= FITS_PX).collect();
    if fitting.is_empty() {
        return Err(CalibrationError::NoPicture);
    }
    let square = fitting.iter().map(|miss| miss * miss).sum::<f64>() / fitting.len() as f64;
    Ok(Calibrated { camera: fit.camera, miss_px: square.sqrt(), edges: fitting.len() })
}

/// The camera hung so that it sees what a picture shows, and the share of the rim that lies in that; nothing if it is too
/// little.
pub(super) fn pose_seen(
    shot: &Shot,
    camera: &CameraModel,
    tray: &MountedTray,
) -> Result<Option<(CameraModel, f64)>, RimNotSeen> {
    let mut in_view = 0;
    let mut fit = Fit { camera: camera.clone(), with_k1: false, points: Vec::new() };
    for reach_px in WATCH_REACHES_PX {
        fit.points.clear();
        in_view = fit.look(shot, tray, reach_px);
        if in_view < RIM_IN_VIEW_MIN {
            return Ok(None);
        }
        // A fit that is no camera is as good as none: the rim is then not where it should be.
        if fit.settle().is_ok_and(|moved_px| moved_px <= SETTLED_PX) {
            break;
        }
    }
    let enough = fit.rim(shot, tray)?;
    Ok(enough.then_some((fit.camera, in_view as f64 / f64::from(edges::RIM_SPOKES))))
}

/// A camera, and where edges are seen.
struct Fit {
    camera: CameraModel,
    with_k1: bool,
    points: Vec<EdgePoint>,
}

type Step = OVector<f64, U5>;

impl Fit {
    /// Adds the edges that a picture shows; returns how many places on the rim it could show.
    fn look(&mut self, shot: &Shot, tray: &MountedTray, reach_px: f64) -> usize {
        let view = View { camera: &self.camera, tray, platen_from_tray: shot.platen_from_tray };
        let edges = edges::find(&view, shot.image, reach_px);
        self.points.extend(edges.seen);
        edges.rim_in_view
    }

    /// Whether enough of the rim is in view, and then seen where the camera should see it.
    fn rim(&self, shot: &Shot, tray: &MountedTray) -> Result<bool, RimNotSeen> {
        let view = View { camera: &self.camera, tray, platen_from_tray: shot.platen_from_tray };
        let edges = edges::find(&view, shot.image, 4.0 * FITS_PX);
        let fits = |edge: &&EdgePoint| edge.miss_px.abs() <= FITS_PX;
        let seen = edges.seen[..edges.rim_seen].iter().filter(fits).count();
        if edges.rim_in_view < RIM_IN_VIEW_MIN {
            return Ok(false);
        }
        let enough = seen as f64 >= RIM_RATIO_MIN * edges.rim_in_view as f64;
        if enough { Ok(true) } else { Err(RimNotSeen { seen, in_view: edges.rim_in_view }) }
    }

    /// By how much each edge is seen beside where the camera should see it, px.
    fn misses(&self) -> impl Iterator<Item = f64> {
        self.points.iter().filter_map(|point| self.miss(point))
    }

    fn miss(&self, point: &EdgePoint) -> Option<f64> {
        let seen = point.expected + point.across * point.miss_px;
        Some((seen - self.camera.project(point.place)?).dot(&point.across))
    }

    /// Moves the camera to where the edges fit best; returns by how much the edge moved furthest, px.
    fn settle(&mut self) -> Result<f64, OutOfRange> {
        let start = self.camera.clone();
        for _ in 0..ROUNDS {
            let rows: Vec<(Step, f64)> =
                self.points.iter().filter_map(|point| Some((self.slopes(point)?, self.miss(point)?))).collect();
            let mut sizes: Vec<f64> = rows.iter().map(|(_, miss)| miss.abs()).collect();
            sizes.sort_by(f64::total_cmp);
            let usual_px = 1.5 * sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
            let limit_px = TUKEY * usual_px.max(USUAL_MISS_PX_MIN);
            let mut normal = OMatrix::<f64, U5, U5>::from_diagonal(&Step::from(PRIOR).map(|size| size.powi(-2)));
            let mut target = Step::zeros();
            for (slopes, miss) in rows {
                let share = miss / limit_px;
                let weight = (1.0 - share * share).max(0.0).powi(2);
                normal += slopes * slopes.transpose() * weight;
                target += slopes * (weight * miss);
            }
            let Some(factors) = normal.cholesky() else { break };
            self.camera = moved(&self.camera, &factors.solve(&target))?;
        }
        let way = |point: &EdgePoint| Some((start.project(point.place)? - self.camera.project(point.place)?).norm());
        Ok(self.points.iter().filter_map(way).fold(0.0, f64::max))
    }

    /// How the place of an edge across itself changes with x and y (m), height (of it), yaw (rad) and k1 of the camera, px.
    fn slopes(&self, point: &EdgePoint) -> Option<Step> {
        let pose = self.camera.pose();
        let jacobian: Matrix2<f64> = self.camera.projection_jacobian(point.place)?;
        let across = jacobian.transpose() * point.across;
        let offset = point.place.xy().coords - Vector2::new(pose.x_m, pose.y_m);
        let depth_m = pose.height_m - point.place.z;
        // To turn the camera one way is to turn what it sees the other way.
        let turned = Rotation2::new(-std::f64::consts::FRAC_PI_2) * offset;
        let ideal = self.camera.image_from_platen() * offset / depth_m;
        let lens = self.camera.focal_length_px() * ideal.norm_squared() * point.across.dot(&ideal);
        let height = -across.dot(&offset) * pose.height_m / depth_m;
        Some(Step::new(-across.x, -across.y, height, across.dot(&turned), if self.with_k1 { lens } else { 0.0 }))
    }
}

/// The camera, moved.
fn moved(camera: &CameraModel, step: &Step) -> Result<CameraModel, OutOfRange> {
    let mut spec = CameraSpec::from(camera.clone());
    spec.pose.x_m += step[0];
    spec.pose.y_m += step[1];
    spec.pose.height_m *= 1.0 + step[2];
    spec.pose.yaw_rad += step[3];
    spec.distortion.k1 += step[4];
    CameraModel::new(spec)
}
