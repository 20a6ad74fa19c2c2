//! Fits the labels of teaching pictures to what the pictures show: hands and rulers err by some tenths of a millimetre.

use super::super::align::Fit;
use super::super::detector::{Detector, yaw_difference_rad};
use super::super::modes::{Light, MODES};
use super::super::template::PartModel;
use super::super::view::View;
use super::{LaidPart, TeachError, TeachFrame, TeachSpec};
use feeder_model::camera::{CameraModel, MountedTray};

/// Labels that are this good as a mean square, px at the part's rim, stay as they are: a fit is no better.
const LABEL_ERROR_PX: f64 = 0.3;

/// The labels as the templates learned from them tell; `None` if they were good.
pub(super) fn fitted(
    frames: &[TeachFrame],
    laid: &[Vec<LaidPart>],
    model: &PartModel,
    camera: &CameraModel,
    tray: &MountedTray,
    spec: &TeachSpec,
) -> Result<Option<Vec<Vec<LaidPart>>>, TeachError> {
    let mut detector = Detector::new(camera, tray, model, Light::Any);
    let (mut square_px2, mut count) = (0.0, 0.0_f64);
    let mut fitted = Vec::with_capacity(laid.len());
    for (index, (frame, parts)) in frames.iter().zip(laid).enumerate() {
        if parts.is_empty() {
            fitted.push(Vec::new());
            continue;
        }
        let fault = |source| TeachError::Frame { index, source };
        detector.look(frame.image, &frame.platen_from_tray, spec.contrast_min_levels).map_err(fault)?;
        let view = View { camera, tray, platen_from_tray: frame.platen_from_tray };
        let mut fit = |part: &LaidPart| {
            let guess =
                Fit { centre: part.place, yaw_rad: part.yaw_rad, cost: 0.0, evidence: 0.0, amounts: [0.0; MODES] };
            let Some(found) = detector.fit_from(&view, part.pose, guess) else { return *part };
            let sought = &detector.sought[part.pose];
            let symmetry = sought.template.yaw_symmetry;
            let turned_rad =
                if symmetry == 0 { 0.0 } else { yaw_difference_rad(found.yaw_rad, part.yaw_rad, symmetry) };
            let moved_m = (found.centre - part.place).norm_squared() + (turned_rad * sought.radius_m).powi(2);
            square_px2 += moved_m / sought.m_per_px.powi(2);
            count += 1.0;
            LaidPart { place: found.centre, yaw_rad: part.yaw_rad + turned_rad, ..*part }
        };
        fitted.push(parts.iter().map(&mut fit).collect());
    }
    let good = square_px2 <= count * LABEL_ERROR_PX * LABEL_ERROR_PX;
    Ok((!good).then_some(fitted))
}
