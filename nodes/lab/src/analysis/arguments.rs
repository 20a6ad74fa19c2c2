//! Flags that several subcommands share.

use std::convert::Infallible;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use clap::Args;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::Friction;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::{Axis, OptimalDesign, Waveform};

/// Friction and gravity.
#[derive(Clone, Debug, Args)]
pub(crate) struct FrictionArgs {
    /// Coefficient of kinetic friction.
    #[arg(long, default_value_t = 0.2, allow_negative_numbers = true)]
    pub(crate) mu: f64,
    /// Coefficient of static friction [default: that of kinetic friction].
    #[arg(long, allow_negative_numbers = true)]
    mu_static: Option<f64>,
    /// Gravity, m/s².
    #[arg(long, default_value_t = STANDARD_GRAVITY_M_S2, allow_negative_numbers = true)]
    pub(crate) gravity: f64,
}

impl FrictionArgs {
    pub(crate) fn friction(&self) -> Result<Friction> {
        Ok(Friction::new(self.mu_static.unwrap_or(self.mu), self.mu)?)
    }
}

/// The geometry of a tray; by default the paper's.
#[derive(Clone, Debug, Args)]
pub(crate) struct TrayArgs {
    /// Radius of the inner wall, m.
    #[arg(long, default_value_t = TrayGeometry::PAPER.inner_radius_m, allow_negative_numbers = true)]
    inner_radius: f64,
    /// Radius of the outer wall, m.
    #[arg(long, default_value_t = TrayGeometry::PAPER.outer_radius_m, allow_negative_numbers = true)]
    outer_radius: f64,
    /// Height of the plateau above the foot of the ramp, m.
    #[arg(long, default_value_t = TrayGeometry::PAPER.rise_m, allow_negative_numbers = true)]
    rise: f64,
    /// Angle spanned by the ramp, degrees.
    #[arg(long, default_value_t = TrayGeometry::PAPER.ramp_angle_rad.to_degrees(), allow_negative_numbers = true)]
    ramp_deg: f64,
}

impl TrayArgs {
    pub(crate) fn geometry(&self) -> TrayGeometry {
        TrayGeometry {
            inner_radius_m: self.inner_radius,
            outer_radius_m: self.outer_radius,
            rise_m: self.rise,
            ramp_angle_rad: self.ramp_deg.to_radians(),
        }
    }
}

/// What `--waveform` names.
#[derive(Clone, Debug)]
enum Shape {
    StickSlip,
    CoulombPump,
    Optimal,
    File(PathBuf),
}

impl FromStr for Shape {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "stick-slip" => Self::StickSlip,
            "coulomb-pump" => Self::CoulombPump,
            "optimal" => Self::Optimal,
            path => Self::File(path.into()),
        })
    }
}

/// A waveform; which flags are needed depends on its shape.
#[derive(Clone, Debug, Args)]
pub(crate) struct WaveformArgs {
    /// stick-slip (needs --period, --a-min, --a-max), coulomb-pump (--period, --a-max, --z), optimal (--period,
    /// --a-max), or a YAML file with `axis` and `segments` of `duration_s` and `acceleration`.
    #[arg(long, value_name = "stick-slip|coulomb-pump|optimal|FILE")]
    waveform: Shape,
    /// Period, s.
    #[arg(long, allow_negative_numbers = true)]
    period: Option<f64>,
    /// Smaller acceleration of stick-slip: m/s², for a tray rad/s².
    #[arg(long, allow_negative_numbers = true)]
    a_min: Option<f64>,
    /// Larger acceleration of stick-slip, or the acceleration of the others: m/s², for a tray rad/s².
    #[arg(long, allow_negative_numbers = true)]
    a_max: Option<f64>,
    /// Share of the Coulomb pump's period without acceleration, 0 to 1.
    #[arg(long, allow_negative_numbers = true)]
    z: Option<f64>,
}

/// A waveform as asked for, with what its closed form needs.
#[derive(Clone, Debug)]
pub(crate) enum Asked {
    StickSlip { period_s: f64, a_min: f64, a_max: f64 },
    CoulombPump { period_s: f64, a: f64, z: f64 },
    Optimal { period_s: f64, a: f64 },
    Described(Waveform),
}

impl WaveformArgs {
    pub(crate) fn asked(&self) -> Result<Asked> {
        let need = |value: Option<f64>, flag: &str| value.with_context(|| format!("this waveform needs {flag}"));
        let period = || need(self.period, "--period (s, greater than 0)");
        let a_max = || need(self.a_max, "--a-max (greater than 0)");
        Ok(match &self.waveform {
            Shape::StickSlip => Asked::StickSlip {
                period_s: period()?,
                a_min: need(self.a_min, "--a-min (greater than 0, less than --a-max)")?,
                a_max: a_max()?,
            },
            Shape::CoulombPump => {
                Asked::CoulombPump { period_s: period()?, a: a_max()?, z: need(self.z, "--z (0 < z < 1)")? }
            }
            Shape::Optimal => Asked::Optimal { period_s: period()?, a: a_max()? },
            Shape::File(path) => {
                let text = std::fs::read_to_string(path).with_context(|| {
                    format!(
                        "--waveform {}: neither stick-slip, coulomb-pump, optimal nor a readable file",
                        path.display()
                    )
                })?;
                let waveform = serde_saphyr::from_str(&text).with_context(|| format!("in {}", path.display()))?;
                Asked::Described(waveform)
            }
        })
    }
}

impl Asked {
    /// The waveform on `axis`; an optimal one is designed for `track` and made for a lever of `lever` (1, or a radius in m).
    pub(crate) fn build(self, axis: Axis, track: &OptimalTrack, lever: f64) -> Result<Waveform> {
        Ok(match self {
            Self::StickSlip { period_s, a_min, a_max } => Waveform::stick_slip(axis, period_s, a_min, a_max)?,
            Self::CoulombPump { period_s, a, z } => Waveform::coulomb_pump(axis, period_s, a, z)?,
            Self::Optimal { period_s, a } => {
                Waveform::optimal(axis, period_s, &track.design(a * lever))?.scaled(1.0 / lever)?
            }
            Self::Described(waveform) => {
                let fits = (waveform.axis() == Axis::Yaw) == (axis == Axis::Yaw);
                ensure!(fits, "the waveform in the file drives axis {:?}; allowed here: {}", waveform.axis(), {
                    if axis == Axis::Yaw { "yaw" } else { "x or y" }
                });
                waveform
            }
        })
    }
}

/// What an optimal waveform is designed for, but its limit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OptimalTrack {
    pub(crate) friction: f64,
    pub(crate) slope_rad: f64,
    pub(crate) gravity_m_s2: f64,
}

impl OptimalTrack {
    pub(crate) fn design(&self, limit_m_s2: f64) -> OptimalDesign {
        let Self { friction, slope_rad, gravity_m_s2 } = *self;
        OptimalDesign { friction, slope_rad, gravity_m_s2, limit_m_s2 }
    }
}
