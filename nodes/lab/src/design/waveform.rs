//! The best waveform for a track, for one friction or for the worst of several.

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::search::{Effort, climb};
use super::shape::{ShapeSpace, check_limits, closed_form, tamed};
use feeder_model::mechanics::slope::LinearTrack;
use feeder_model::mechanics::{Friction, check_slope};
use feeder_model::range::OutOfRange;
use feeder_model::waveform::{Axis, AxisLimits, OptimalDesign, Waveform};

/// Treads in which a limited slew is written.
const SLEW_STEPS: u32 = 4;

/// What a waveform is wanted for.
#[derive(Clone, Debug, PartialEq)]
pub struct WaveformGoal {
    /// The axis driven.
    pub axis: Axis,
    /// 1 on X and Y; on Yaw the radius at which the part sits, m.
    pub lever: f64,
    /// Slope of the track, rad.
    pub slope_rad: f64,
    /// Gravity, m/s².
    pub gravity_m_s2: f64,
    /// Coefficients of friction; the slowest feed among them counts.
    pub frictions: Vec<f64>,
    /// Period, s.
    pub period_s: f64,
    /// What the axis can do.
    pub limits: AxisLimits,
    /// Time the amplifier takes to change the acceleration, s; 0 if none.
    pub slew_s: f64,
}

/// A waveform and what it is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignedWaveform {
    /// The waveform to command, before the amplifier limits its slew.
    pub waveform: Waveform,
    /// Mean feed along the slope for each friction of the goal, m/s.
    pub feeds_m_s: Vec<f64>,
    /// The slowest of them.
    pub worst_feed_m_s: f64,
    /// Upper bound of `worst_feed_m_s`: the smallest optimal feed over the frictions with |a| limited alone. `None`
    /// where the closed form does not hold for one of them.
    pub bound_m_s: Option<f64>,
    /// Whether it is the closed form, proven best, rather than the outcome of a search.
    pub proven: bool,
}

impl WaveformGoal {
    /// The best waveform: the closed form where it is proven (one friction and no other limit that it meets), else the
    /// best of `segments` segments that a search finds. `None` if none is found that feeds forward.
    ///
    /// # Errors
    ///
    /// If a parameter of the goal is out of range.
    pub fn best(&self, segments: usize, effort: Effort) -> Result<Option<DesignedWaveform>, OutOfRange> {
        self.check(segments)?;
        let closed_forms: Vec<Waveform> = self
            .frictions
            .iter()
            .filter_map(|&mu| closed_form(self.axis, self.lever, self.period_s, &self.design(mu)))
            .collect();
        if let ([_], [optimal]) = (&self.frictions[..], &closed_forms[..])
            && self.slew_s == 0.0
            && optimal.check(&self.limits).is_ok()
        {
            return Ok(self.rated(optimal.clone(), true));
        }
        Ok(self.searched(segments, &closed_forms, effort))
    }

    /// The best waveform that a search finds from random starts alone, without knowing the closed form. `None` if none
    /// is found that feeds forward.
    ///
    /// # Errors
    ///
    /// If a parameter of the goal is out of range.
    pub fn search(&self, segments: usize, effort: Effort) -> Result<Option<DesignedWaveform>, OutOfRange> {
        self.check(segments)?;
        Ok(self.searched(segments, &[], effort))
    }

    /// Mean feed of `waveform` for each friction of the goal after the amplifier's slew, m/s; `None` where the part
    /// leaves the tray or slides down without end.
    pub fn feeds_m_s(&self, waveform: &Waveform) -> impl Iterator<Item = Option<f64>> {
        let slewed = if self.slew_s > 0.0 { waveform.slew_limited(self.slew_s, SLEW_STEPS).ok() } else { None };
        self.frictions.iter().map(move |&mu| {
            let track = LinearTrack::new(Friction::uniform(mu).ok()?, self.slope_rad, self.gravity_m_s2).ok()?;
            let drive = track.drive(slewed.as_ref().unwrap_or(waveform), self.lever).ok()?;
            Some(drive.steady()?.feed_m_s)
        })
    }

    fn check(&self, segments: usize) -> Result<(), OutOfRange> {
        OutOfRange::unless_positive("lever", self.lever)?;
        OutOfRange::unless_positive("period_s", self.period_s)?;
        check_limits(&self.limits)?;
        OutOfRange::unless(
            (0.0..self.period_s).contains(&self.slew_s),
            "slew_s",
            self.slew_s,
            format_args!("0 ≤ slew_s < {}", self.period_s),
        )?;
        let count = |n: usize| f64::from(u32::try_from(n).unwrap_or(u32::MAX));
        OutOfRange::unless((2..=64).contains(&segments), "segments", count(segments), "2 to 64")?;
        OutOfRange::unless(!self.frictions.is_empty(), "frictions", count(self.frictions.len()), "at least one")?;
        check_slope(self.slope_rad, self.gravity_m_s2)?;
        for &mu in &self.frictions {
            let angle_rad = Friction::uniform(mu)?.kinetic_coefficient().atan();
            let allowed = format_args!("within ±{angle_rad} (the friction angle for {mu})");
            OutOfRange::unless(self.slope_rad.abs() < angle_rad, "slope_rad", self.slope_rad, allowed)?;
        }
        let limit_m_s2 = self.limits.max_acceleration * self.lever;
        let lift_off = self.gravity_m_s2 / self.slope_rad.abs().tan();
        let allowed = format_args!("at most {lift_off} m/s² at the part (g / tan |φ|, contact)");
        OutOfRange::unless(limit_m_s2 <= lift_off, "max_acceleration", limit_m_s2, allowed)?;
        Ok(())
    }

    fn design(&self, friction: f64) -> OptimalDesign {
        OptimalDesign {
            friction,
            slope_rad: self.slope_rad,
            gravity_m_s2: self.gravity_m_s2,
            limit_m_s2: self.limits.max_acceleration * self.lever,
        }
    }

    fn searched(&self, segments: usize, known: &[Waveform], effort: Effort) -> Option<DesignedWaveform> {
        let space = ShapeSpace { axis: self.axis, segments, limit: self.limits.max_acceleration };
        let objective = |point: &[f64]| {
            let worst =
                space.waveform(point, self.period_s).and_then(|waveform| tamed(waveform, &self.limits)).and_then(
                    |waveform| self.feeds_m_s(&waveform).try_fold(f64::INFINITY, |worst, feed| Some(worst.min(feed?))),
                );
            worst.unwrap_or(f64::NAN)
        };
        let mut random = Pcg64Mcg::seed_from_u64(effort.seed);
        let starts = known
            .iter()
            .map(|waveform| space.point(waveform))
            .chain((0..effort.starts).map(|_| space.random_point(&mut random)));
        let best = starts
            .map(|start| climb(&objective, start, &space.step_by(), effort.steps))
            .filter(|found| found.value > 0.0)
            .max_by(|one, other| one.value.total_cmp(&other.value))?;
        self.rated(tamed(space.waveform(&best.point, self.period_s)?, &self.limits)?, false)
    }

    fn rated(&self, waveform: Waveform, proven: bool) -> Option<DesignedWaveform> {
        let feeds_m_s = self.feeds_m_s(&waveform).collect::<Option<Vec<_>>>()?;
        let worst_feed_m_s = feeds_m_s.iter().copied().reduce(f64::min)?;
        let bounds = self.frictions.iter().map(|&mu| self.design(mu).best_feed_m_s(self.period_s).ok());
        let bound_m_s = bounds.collect::<Option<Vec<_>>>().and_then(|bounds| bounds.into_iter().reduce(f64::min));
        Some(DesignedWaveform { waveform, feeds_m_s, worst_feed_m_s, bound_m_s, proven })
    }
}
