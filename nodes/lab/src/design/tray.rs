//! The best tray together with its waveform: parts per minute that arrive one by one.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::flow::{Flow, Loading, lane_flow};
use super::shape::check_limits;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::mechanics::map::TrayMap;
use feeder_model::mechanics::{Friction, MechanicsError, check_slope};
use feeder_model::range::OutOfRange;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::{AxisLimits, Waveform};

/// A kind of part to be fed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartKind {
    /// Length along the track, and width across it, m.
    pub length_m: f64,
    /// Coefficients of friction to be fed with.
    pub frictions: Vec<f64>,
}

/// The period of the waveform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Period {
    /// Given, s.
    Fixed(f64),
    /// Free up to this, s, and as far as speed and stroke allow.
    UpTo(f64),
}

/// What a tray is wanted for.
#[derive(Clone, Debug, PartialEq)]
pub struct TrayGoal {
    /// The parts; the slowest flow among kinds and frictions counts.
    pub kinds: Vec<PartKind>,
    /// Spacing wanted on the plateau, in part lengths: parts closer than that do not count.
    pub spacing_parts: f64,
    /// How parts come onto the ramp.
    pub loading: Loading,
    /// Radius of the outer wall, along which the parts travel, m.
    pub outer_radius_m: f64,
    /// Smallest radius of the inner wall, m.
    pub inner_radius_m: f64,
    /// Smallest rise, m: the height of the drop that turns parts over.
    pub rise_min_m: f64,
    /// Largest angle of the ramp, rad.
    pub ramp_angle_max_rad: f64,
    /// Period of the waveform.
    pub period: Period,
    /// What the yaw axis can do.
    pub limits: AxisLimits,
    /// Gravity, m/s².
    pub gravity_m_s2: f64,
}

/// A tray, its waveform, and what they do for each kind of part and friction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DesignedTray {
    /// The tray. Its inner wall stands at the critical radius where there is room for it, so that no part is stranded.
    pub tray: TrayGeometry,
    /// The waveform, on Yaw.
    pub waveform: Waveform,
    /// Flow by kind of part, then by friction.
    pub flows: Vec<Vec<Flow>>,
    /// Parts per minute that arrive with the spacing wanted, for the kind and friction with the fewest.
    pub parts_per_min: f64,
    /// Outermost radius from which some part does not climb, m; `None` where all climb everywhere.
    pub critical_radius_m: Option<f64>,
    /// Share of the area outside the goal's inner radius that lies inside the critical radius: the share of parts poured
    /// evenly over it that would be stranded there if the inner wall stood at the goal's inner radius.
    pub stranded_share: f64,
}

impl DesignedTray {
    /// The smallest spacing on the plateau of any kind and friction, in part lengths.
    #[must_use]
    pub fn spacing_parts(&self) -> Option<f64> {
        self.flows.iter().flatten().map(|flow| flow.plateau_spacing_parts).reduce(f64::min)
    }
}

impl TrayGoal {
    /// What a given tray and waveform do for the goal; `None` if some part does not get over the crest.
    ///
    /// # Errors
    ///
    /// If the tray has no lane for a part, or a part leaves its surface.
    pub fn rate(&self, tray: TrayGeometry, waveform: Waveform) -> Result<Option<DesignedTray>, MechanicsError> {
        self.check()?;
        self.rated(tray, waveform)
    }

    /// As [`Self::rate`], for a goal that was checked.
    pub(super) fn rated(&self, tray: TrayGeometry, waveform: Waveform) -> Result<Option<DesignedTray>, MechanicsError> {
        let mut flows = Vec::with_capacity(self.kinds.len());
        let (mut parts_per_min, mut critical_radius_m) = (f64::INFINITY, None::<f64>);
        for kind in &self.kinds {
            let mut of_kind = Vec::with_capacity(kind.frictions.len());
            for &friction in &kind.frictions {
                let track = AnnularTrack::new(tray, Friction::uniform(friction)?, self.gravity_m_s2)?;
                let flow = lane_flow(&track, &waveform, kind.length_m, self.loading, self.spacing_parts)?;
                let Some(flow) = flow else { return Ok(None) };
                let arrives_apart = flow.plateau_spacing_parts >= self.spacing_parts * (1.0 - 1e-9);
                parts_per_min = parts_per_min.min(if arrives_apart { flow.parts_per_min } else { 0.0 });
                let critical = TrayMap::new(&track, &waveform)?.critical_radius_m()?;
                critical_radius_m = critical.into_iter().chain(critical_radius_m).reduce(f64::max);
                of_kind.push(flow);
            }
            flows.push(of_kind);
        }
        let (inner, outer) = (self.inner_radius_m, self.outer_radius_m);
        let stranded_share = critical_radius_m
            .map_or(0.0, |critical| (critical * critical - inner * inner).max(0.0) / (outer * outer - inner * inner));
        let widest_m = self.kinds.iter().map(|kind| kind.length_m).fold(0.0, f64::max);
        let inner_radius_m = critical_radius_m.unwrap_or(inner).max(inner).min(outer - widest_m);
        let tray = TrayGeometry { inner_radius_m, ..tray };
        Ok(Some(DesignedTray { tray, waveform, flows, parts_per_min, critical_radius_m, stranded_share }))
    }

    /// Checks every parameter of the goal.
    ///
    /// # Errors
    ///
    /// The first parameter out of its range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        check_limits(&self.limits)?;
        check_slope(0.0, self.gravity_m_s2)?;
        OutOfRange::unless_positive("spacing_parts", self.spacing_parts)?;
        OutOfRange::unless_positive("rise_min_m", self.rise_min_m)?;
        OutOfRange::unless(
            self.ramp_angle_max_rad > 0.0 && self.ramp_angle_max_rad < TAU,
            "ramp_angle_max_rad",
            self.ramp_angle_max_rad,
            "0 < ramp_angle_max_rad < 2π",
        )?;
        OutOfRange::unless_positive("inner_radius_m", self.inner_radius_m)?;
        match self.period {
            Period::Fixed(period_s) | Period::UpTo(period_s) => OutOfRange::unless_positive("period_s", period_s)?,
        };
        OutOfRange::unless(!self.kinds.is_empty(), "kinds", share(self.kinds.len(), 1), "at least one")?;
        for kind in &self.kinds {
            OutOfRange::unless(
                kind.length_m > 0.0 && kind.length_m < self.outer_radius_m - self.inner_radius_m,
                "length_m",
                kind.length_m,
                format_args!("0 < length_m < {} (between the walls)", self.outer_radius_m - self.inner_radius_m),
            )?;
            OutOfRange::unless(
                !kind.frictions.is_empty(),
                "frictions",
                share(kind.frictions.len(), 1),
                "at least one",
            )?;
            for &friction in &kind.frictions {
                Friction::uniform(friction)?;
            }
        }
        Ok(())
    }
}

/// A number of things as a share of another.
pub(super) fn share(part: usize, whole: usize) -> f64 {
    let number = |n: usize| f64::from(u32::try_from(n).unwrap_or(u32::MAX));
    number(part) / number(whole)
}
