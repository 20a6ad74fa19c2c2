//! How fast parts travel at each radius of an annular tray under a yaw vibration, and where they slide back.

use super::MechanicsError;
use super::annular::{AnnularTrack, PartState};
use super::slope::{Drive, LinearTrack, Steady};
use crate::tray::Surface;
use crate::waveform::{Axis, Waveform};

/// Samples per period in which radial drift is integrated: 0.1 % of it at the paper's parameters.
const DRIFT_SAMPLES: u32 = 4000;
/// Periods after which the radial motion repeats at the latest.
const DRIFT_PERIODS_MAX: u32 = 200;
/// Radii at which the ramp is looked at for a change of sign, evenly spaced.
const SCAN_RADII: u32 = 240;

/// The steady travel of a part at one radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadiusFeed {
    /// Distance from the tray's axis, m.
    pub radius_m: f64,
    /// On the ramp; `None` where parts slide down without end.
    pub ramp: Option<SurfaceFeed>,
    /// On the plateau.
    pub plateau: Option<SurfaceFeed>,
}

/// Steady travel on one surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceFeed {
    /// Mean angular speed relative to the tray, rad/s.
    pub rate_rad_s: f64,
    /// Mean outward speed, m/s, which centrifugal force gives to a sliding part.
    pub radial_drift_m_s: f64,
    /// The motion along the track.
    pub steady: Steady,
}

/// A tray under a yaw vibration.
#[derive(Clone, Debug)]
pub struct TrayMap<'a> {
    track: &'a AnnularTrack,
    waveform: &'a Waveform,
}

impl<'a> TrayMap<'a> {
    /// The map of a tray under `waveform`.
    ///
    /// # Errors
    ///
    /// If the waveform does not drive the yaw axis.
    pub fn new(track: &'a AnnularTrack, waveform: &'a Waveform) -> Result<Self, MechanicsError> {
        match waveform.axis() {
            Axis::Yaw => Ok(Self { track, waveform }),
            axis => Err(MechanicsError::WrongAxis { axis }),
        }
    }

    /// The waveform as a part at `radius_m` on `surface` feels it: the local-slope model, exact but for the coupling of
    /// radial and circular motion (0.06 % at T = 1/30 s on the paper's tray, 0.5 % at 0.17 s).
    ///
    /// # Errors
    ///
    /// If the radius is off the tray, or the part leaves the surface.
    pub fn drive(&self, radius_m: f64, surface: Surface) -> Result<Drive, MechanicsError> {
        self.track.check_radius(radius_m)?;
        LinearTrack::new(self.track.friction(), self.slope_rad(radius_m, surface), self.track.gravity_m_s2())?
            .drive(self.waveform, radius_m)
    }

    /// How fast parts run round in steady motion, rad/s; `None` if they slide down for ever.
    ///
    /// # Errors
    ///
    /// If the radius is off the tray, or the part leaves the surface.
    pub fn rate_rad_s(&self, radius_m: f64, surface: Surface) -> Result<Option<f64>, MechanicsError> {
        let steady = self.drive(radius_m, surface)?.steady();
        Ok(steady.map(|steady| self.round_rad_s(radius_m, surface, &steady)))
    }

    fn round_rad_s(&self, radius_m: f64, surface: Surface, steady: &Steady) -> f64 {
        steady.feed_m_s * self.slope_rad(radius_m, surface).cos() / radius_m
    }

    /// Steady travel at a radius, and the drift across it, which takes far longer to find.
    ///
    /// # Errors
    ///
    /// If the radius is off the tray, or the part leaves the surface.
    pub fn at(&self, radius_m: f64) -> Result<RadiusFeed, MechanicsError> {
        let feed = |surface| -> Result<Option<SurfaceFeed>, MechanicsError> {
            Ok(self.drive(radius_m, surface)?.steady().map(|steady| SurfaceFeed {
                rate_rad_s: self.round_rad_s(radius_m, surface, &steady),
                radial_drift_m_s: self.radial_drift_m_s(radius_m, surface, &steady),
                steady,
            }))
        };
        Ok(RadiusFeed { radius_m, ramp: feed(Surface::Ramp)?, plateau: feed(Surface::Plateau)? })
    }

    /// The outermost radius at which the feed on the ramp changes between climbing and not climbing; `None` if there is
    /// none on the tray.
    ///
    /// # Errors
    ///
    /// If a part leaves the surface somewhere on the ramp.
    pub fn critical_radius_m(&self) -> Result<Option<f64>, MechanicsError> {
        // Feeds below this are rounding: a part that never slips has none at all.
        const STANDSTILL_M_S: f64 = 1e-12;
        let climbs = |radius_m: f64| -> Result<bool, MechanicsError> {
            Ok(self.drive(radius_m, Surface::Ramp)?.steady().is_some_and(|steady| steady.feed_m_s > STANDSTILL_M_S))
        };
        let (inner, outer) = (self.track.tray().inner_radius_m, self.track.tray().outer_radius_m);
        let climbs_outside = climbs(outer)?;
        let mut beyond = outer;
        for i in (0..SCAN_RADII).rev() {
            let radius_m = inner + (outer - inner) * f64::from(i) / f64::from(SCAN_RADII);
            if climbs(radius_m)? != climbs_outside {
                let (mut low, mut high) = (radius_m, beyond);
                while high - low > 1e-15 * outer {
                    let middle = f64::midpoint(low, high);
                    if middle <= low || middle >= high {
                        break;
                    }
                    if climbs(middle)? == climbs_outside {
                        high = middle;
                    } else {
                        low = middle;
                    }
                }
                return Ok(Some(f64::midpoint(low, high)));
            }
            beyond = radius_m;
        }
        Ok(None)
    }

    fn slope_rad(&self, radius_m: f64, surface: Surface) -> f64 {
        match surface {
            Surface::Ramp => self.track.tray().ramp_slope_rad(radius_m),
            Surface::Plateau => 0.0,
        }
    }

    /// Mean outward speed in the steady motion, at a radius held where it is.
    fn radial_drift_m_s(&self, radius_m: f64, surface: Surface, steady: &Steady) -> f64 {
        let tray = self.track.tray();
        let angle_rad = match surface {
            Surface::Ramp => tray.ramp_angle_rad / 2.0,
            Surface::Plateau => f64::midpoint(tray.ramp_angle_rad, std::f64::consts::TAU),
        };
        let track = self.track.without_walls();
        let mut part = PartState { along_m_s: steady.start_m_s, ..PartState::at_rest(radius_m, angle_rad) };
        let samples = self.waveform.samples(DRIFT_SAMPLES);
        let mut last_m = f64::NAN;
        for _ in 0..DRIFT_PERIODS_MAX {
            let mut drift_m = 0.0;
            for (motion, sample_s) in &samples {
                track.step(&mut part, motion, *sample_s);
                drift_m += part.radius_m - radius_m;
                (part.radius_m, part.angle_rad) = (radius_m, angle_rad);
            }
            if (drift_m - last_m).abs() <= 1e-9 * drift_m.abs() {
                last_m = drift_m;
                break;
            }
            last_m = drift_m;
        }
        last_m / self.waveform.period_s()
    }
}
