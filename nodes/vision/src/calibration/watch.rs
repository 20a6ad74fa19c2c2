//! Follows from frame to frame how far the calibration is off.

use std::collections::VecDeque;

use image::GrayImage;
use nalgebra::Isometry2;

use super::{CalibrationLimits, Misalignment, RimNotSeen, misalignment};
use feeder_model::camera::{CameraModel, MountedTray};

/// Frames whose median decides whether a warning is given: one that is blurred or half hidden does not. It decides, too, that
/// nothing is selected in a frame that seems right among others that are too far off.
const FRAMES: usize = 9;
/// Share of the rim that a frame must show to count for a warning: with less, small errors of the lens look like a camera that
/// has moved. Where a camera never sees so much, nearly as much as it saw at best.
const RIM_RATIO_MIN: f64 = 0.5;
const NEARLY: f64 = 0.9;

/// Why nothing of a picture can be trusted to lie where it seems to.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationFault {
    /// The tray is seen beside where it should be.
    #[error("the camera is off its calibration, allowed: {:.2} mm; {misalignment}", 1e3 * allowed_m)]
    Off {
        /// By how much.
        misalignment: Misalignment,
        /// Error of place from which nothing is selected, m.
        allowed_m: f64,
    },
    /// The tray is not seen where it should be at all.
    #[error(transparent)]
    RimNotSeen(#[from] RimNotSeen),
}

impl CalibrationLimits {
    /// Refuses what is too far off.
    ///
    /// # Errors
    ///
    /// [`CalibrationFault::Off`].
    pub fn require(&self, misalignment: &Misalignment) -> Result<(), CalibrationFault> {
        let off = misalignment.error_m >= self.refusal_m;
        let fault = CalibrationFault::Off { misalignment: *misalignment, allowed_m: self.refusal_m };
        if off { Err(fault) } else { Ok(()) }
    }

    /// Whether it is so far off that somebody should be warned.
    #[must_use]
    pub fn warn_of(&self, misalignment: &Misalignment) -> bool {
        misalignment.error_m >= self.warning_m
    }
}

/// The calibration as the latest frames show it.
#[derive(Clone, Debug)]
pub struct CalibrationWatch {
    limits: CalibrationLimits,
    camera: CameraModel,
    tray: MountedTray,
    recent: VecDeque<Misalignment>,
    /// Greatest share of the rim that a frame has shown.
    rim_ratio_max: f64,
}

impl CalibrationWatch {
    /// Nothing seen so far.
    #[must_use]
    pub fn new(limits: CalibrationLimits, camera: CameraModel, tray: MountedTray) -> Self {
        Self { limits, camera, tray, recent: VecDeque::new(), rim_ratio_max: 0.0 }
    }

    /// Looks at a frame with the tray at `platen_from_tray`.
    ///
    /// # Errors
    ///
    /// [`CalibrationFault`] if this frame is too far off, or the latest ones are.
    pub fn look(&mut self, image: &GrayImage, platen_from_tray: &Isometry2<f64>) -> Result<(), CalibrationFault> {
        let Some(found) = misalignment(image, &self.camera, &self.tray, platen_from_tray)? else { return Ok(()) };
        self.rim_ratio_max = self.rim_ratio_max.max(found.rim_ratio);
        if found.rim_ratio >= RIM_RATIO_MIN.min(NEARLY * self.rim_ratio_max) {
            if self.recent.len() >= FRAMES {
                self.recent.pop_front();
            }
            self.recent.push_back(found);
        }
        self.limits.require(&found)?;
        // Where a crowd hides the drop-off, a frame alone does not tell a turn that others show.
        self.usual().map_or(Ok(()), |usual| self.limits.require(&usual))
    }

    /// How far off the latest frames are: of them, the one in the middle.
    #[must_use]
    pub fn usual(&self) -> Option<Misalignment> {
        let mut recent: Vec<&Misalignment> = self.recent.iter().collect();
        recent.sort_by(|a, b| a.error_m.total_cmp(&b.error_m));
        recent.get(recent.len() / 2).map(|middle| **middle)
    }

    /// How far off the latest frames are, if somebody should be warned of it.
    #[must_use]
    pub fn warning(&self) -> Option<Misalignment> {
        self.usual().filter(|usual| self.limits.warn_of(usual))
    }
}
