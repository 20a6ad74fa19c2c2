//! Finds discs in single frames.

use image::GrayImage;
use nalgebra::Isometry2;

use super::ImageFault;
use super::circles::{self, Disc, Votes};
use super::segment::{Background, Segmentation};
use super::view::{RayTable, View};
use crate::camera::{CameraModel, MountedTray};

/// Where between foot (0) and upper face (1) the measured rim of a part lies: the lower edge shows on the side towards the
/// camera, the upper edge on the far side.
const RIM_HEIGHT_RATIO: f64 = 0.5;
/// Smallest thing that counts as an obstacle, px.
const BLOB_PX_MIN: usize = 9;

/// Finds parts in single frames.
#[derive(Clone, Debug)]
pub(super) struct Detector {
    pub(super) camera: CameraModel,
    pub(super) tray: MountedTray,
    rays: RayTable,
    pub(super) segmentation: Segmentation,
    votes: Votes,
}

impl Detector {
    pub(super) fn new(camera: &CameraModel, tray: &MountedTray) -> Self {
        Self {
            camera: camera.clone(),
            tray: *tray,
            rays: RayTable::new(camera),
            segmentation: Segmentation::default(),
            votes: Votes::default(),
        }
    }

    /// Finds discs of about this size and measures their rims.
    pub(super) fn discs(
        &mut self,
        image: &GrayImage,
        platen_from_tray: &Isometry2<f64>,
        size: PartSize,
        contrast_min_levels: f64,
    ) -> Result<(Vec<Disc>, Background), ImageFault> {
        let expected = (self.camera.width_px(), self.camera.height_px());
        if image.dimensions() != expected {
            return Err(ImageFault::WrongSize { found: image.dimensions(), expected });
        }
        let view = View { camera: &self.camera, tray: &self.tray, platen_from_tray: *platen_from_tray };
        let background = self.segmentation.look(&view, &self.rays, image, contrast_min_levels, BLOB_PX_MIN)?;
        let height_m = size.rim_height_m(&self.tray);
        let radius_m = size.diameter_m / 2.0;
        let radius_px = crate::camera::single(radius_m / self.camera.m_per_px(height_m));
        let discs = self
            .votes
            .centres(&self.segmentation, radius_px)
            .into_iter()
            .filter_map(|pixel| {
                let centre = view.tray_point(pixel.map(f64::from), height_m)?;
                circles::measure(&self.segmentation, &view, height_m, centre, radius_m)
            })
            .collect();
        Ok((discs, background))
    }
}

/// Size of the part looked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct PartSize {
    pub(super) diameter_m: f64,
    pub(super) height_m: f64,
}

impl PartSize {
    /// The plane above the platen in which rims are measured, m.
    pub(super) fn rim_height_m(self, tray: &MountedTray) -> f64 {
        tray.plateau_height_m() + RIM_HEIGHT_RATIO * self.height_m
    }

    /// The plane above the platen of upper faces, m.
    pub(super) fn face_height_m(self, tray: &MountedTray) -> f64 {
        tray.plateau_height_m() + self.height_m
    }
}
