//! Parts per minute in one lane along the outer wall, and how far apart they arrive on the plateau.

use serde::{Deserialize, Serialize};

use super::singulation::{Crest, RampPassage};
use feeder_model::mechanics::MechanicsError;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::mechanics::map::TrayMap;
use feeder_model::tray::Surface;
use feeder_model::waveform::Waveform;

/// Places of entry at which the smallest spacing is looked for.
const PLACES: u32 = 600;

/// How parts come onto the ramp.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Loading {
    /// One at a time, as far apart as the plateau needs, but at least one part length.
    Metered,
    /// Queued up, one part length apart: the ramp and the plateau alone must separate them.
    Queued,
}

/// What tray and waveform do to a stream of parts of one kind and friction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Flow {
    /// Mean arc speed on the ramp, m/s.
    pub ramp_m_s: f64,
    /// Mean speed on the plateau, m/s.
    pub plateau_m_s: f64,
    /// Spacing on the ramp along the arc, in part lengths.
    pub ramp_spacing_parts: f64,
    /// Smallest spacing on the plateau over all places of a hop at which the first part may pass the crest, one hop past
    /// it, in part lengths.
    pub plateau_spacing_parts: f64,
    /// Parts that pass a place in a minute.
    pub parts_per_min: f64,
}

/// The flow of parts `length_m` long whose centres travel half of that inside the outer wall; `spacing_parts` is what
/// metered loading aims for on the plateau. `None` if parts do not climb the ramp and go on.
///
/// # Errors
///
/// If the lane is off the tray or a part leaves the surface.
pub fn lane_flow(
    track: &AnnularTrack,
    waveform: &Waveform,
    length_m: f64,
    loading: Loading,
    spacing_parts: f64,
) -> Result<Option<Flow>, MechanicsError> {
    Ok(Lane::new(track, waveform, length_m)?.with_crest(|crest| {
        let passage = crest.passage(PLACES);
        let ramp_m = loading.ramp_spacing_m(&passage, length_m, spacing_parts);
        Flow {
            ramp_m_s: crest.ramp_m_s(),
            plateau_m_s: crest.plateau_m_s(),
            ramp_spacing_parts: ramp_m / length_m,
            plateau_spacing_parts: passage.spacing_m(ramp_m) / length_m,
            parts_per_min: 60.0 * crest.ramp_m_s() / ramp_m,
        }
    }))
}

impl Loading {
    /// Spacing on the ramp, arc length in m.
    pub(super) fn ramp_spacing_m(self, passage: &RampPassage, length_m: f64, spacing_parts: f64) -> f64 {
        match self {
            Self::Metered => passage.ramp_spacing_m(length_m, spacing_parts * length_m),
            Self::Queued => length_m,
        }
    }
}

/// The lane along the outer wall as parts of one length and friction feel it.
#[derive(Clone, Debug)]
pub(super) struct Lane {
    pub(super) ramp: feeder_model::mechanics::slope::Drive,
    pub(super) plateau: feeder_model::mechanics::slope::Drive,
    slope_rad: f64,
}

impl Lane {
    pub(super) fn new(track: &AnnularTrack, waveform: &Waveform, length_m: f64) -> Result<Self, MechanicsError> {
        let map = TrayMap::new(track, waveform)?;
        let radius_m = track.tray().outer_radius_m - length_m / 2.0;
        Ok(Self {
            ramp: map.drive(radius_m, Surface::Ramp)?,
            plateau: map.drive(radius_m, Surface::Plateau)?,
            slope_rad: track.tray().ramp_slope_rad(radius_m),
        })
    }

    /// Looks at the crest, if parts get over it.
    pub(super) fn with_crest<R>(&self, look: impl FnOnce(&Crest<'_>) -> R) -> Option<R> {
        Crest::new(&self.ramp, &self.plateau, self.slope_rad).map(|crest| look(&crest))
    }
}
