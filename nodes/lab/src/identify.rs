//! Friction from a recording of how a part slips, as the paper measured it: while a part slides on a level tray, friction
//! alone accelerates it, by ∓ μ g, whatever the tray does.

use feeder_model::range::OutOfRange;

/// Velocities of tray and part in the world at one instant, along the direction of feed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VelocitySample {
    /// Time, s.
    pub time_s: f64,
    /// Velocity of the tray, m/s.
    pub tray_m_s: f64,
    /// Velocity of the part, m/s.
    pub part_m_s: f64,
}

/// Friction found in a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IdentifiedFriction {
    /// Coefficient of kinetic friction.
    pub kinetic: f64,
    /// Its standard error, from the noise of the recording.
    pub standard_error: f64,
    /// Stretches of slip it was found in.
    pub slips: usize,
    /// Samples in them.
    pub samples: usize,
    /// Noise of the part's velocity, m/s rms.
    pub noise_m_s: f64,
}

/// Why no friction can be found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    /// A value of the recording or gravity has no meaning.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// Times do not increase.
    #[error("sample {index} at {time_s} s does not come after the one before it")]
    Unsorted {
        /// The offending sample.
        index: usize,
        /// Its time, s.
        time_s: f64,
    },
    /// Too little slip.
    #[error(
        "found {samples} samples of clear slip (faster than {threshold_m_s:.2e} m/s), allowed are {SAMPLES_MIN} or more: \
         the part sticks, or the recording is too short, too coarse or too noisy"
    )]
    NoSlip {
        /// Samples found.
        samples: usize,
        /// Speed relative to the tray that counts as slip, m/s.
        threshold_m_s: f64,
    },
}

/// Fewest samples of slip that a friction is believed from.
const SAMPLES_MIN: usize = 30;
/// Fewest samples of one slip: a line through fewer says little.
const SLIP_SAMPLES_MIN: usize = 5;
/// Samples dropped at either end of a slip, where the part sticks for a fraction of the sample period.
const TRIM: usize = 1;
/// Speed relative to the tray, in multiples of its noise, that counts as slip.
const CLEAR: f64 = 6.0;

/// Kinetic friction of a part on a level tray.
///
/// Every stretch of clear slip gives the slope of a straight line through the part's velocity; all slopes are fitted at
/// once, each with the sign of its slip.
///
/// # Errors
/// A value that is not finite, times that do not increase, or too little slip.
pub fn kinetic_friction(samples: &[VelocitySample], gravity_m_s2: f64) -> Result<IdentifiedFriction, IdentifyError> {
    OutOfRange::unless_positive("gravity_m_s2", gravity_m_s2)?;
    for (index, sample) in samples.iter().enumerate() {
        for (name, value) in [("time_s", sample.time_s), ("tray_m_s", sample.tray_m_s), ("part_m_s", sample.part_m_s)] {
            OutOfRange::unless(true, name, value, format_args!("finite (sample {index})"))?;
        }
        if index > 0 && sample.time_s <= samples[index - 1].time_s {
            return Err(IdentifyError::Unsorted { index, time_s: sample.time_s });
        }
    }
    let noise_m_s = noise(samples, |sample| sample.part_m_s);
    let fastest_m_s = samples.iter().map(|sample| sample.tray_m_s.abs()).fold(0.0, f64::max);
    let slip_noise_m_s = noise_m_s.hypot(noise(samples, |sample| sample.tray_m_s));
    let threshold_m_s = (CLEAR * slip_noise_m_s).max(1e-3 * fastest_m_s);

    // Sums over all slips: of t², and of t times velocity with the sign of the slip, about the means of each slip.
    let (mut time_square, mut product, mut slips, mut used) = (0.0, 0.0, 0, 0);
    for slip in clear_slips(samples, threshold_m_s) {
        let sign = (slip[0].part_m_s - slip[0].tray_m_s).signum();
        let count = slip.len() as f64;
        let mean_s = slip.iter().map(|sample| sample.time_s).sum::<f64>() / count;
        let mean_m_s = slip.iter().map(|sample| sample.part_m_s).sum::<f64>() / count;
        for sample in slip {
            let time_s = sample.time_s - mean_s;
            time_square += time_s * time_s;
            product += sign * time_s * (sample.part_m_s - mean_m_s);
        }
        slips += 1;
        used += slip.len();
    }
    if used < SAMPLES_MIN {
        return Err(IdentifyError::NoSlip { samples: used, threshold_m_s });
    }
    Ok(IdentifiedFriction {
        kinetic: -product / time_square / gravity_m_s2,
        standard_error: noise_m_s / time_square.sqrt() / gravity_m_s2,
        slips,
        samples: used,
        noise_m_s,
    })
}

/// Stretches in which the part clearly slips one way, their ends trimmed.
fn clear_slips(samples: &[VelocitySample], threshold_m_s: f64) -> impl Iterator<Item = &[VelocitySample]> {
    let way = move |sample: &VelocitySample| {
        let slip_m_s = sample.part_m_s - sample.tray_m_s;
        if slip_m_s.abs() > threshold_m_s { slip_m_s.signum() } else { 0.0 }
    };
    samples
        .chunk_by(move |a, b| way(a).total_cmp(&way(b)).is_eq())
        .filter(move |stretch| way(&stretch[0]) != 0.0 && stretch.len() >= SLIP_SAMPLES_MIN + 2 * TRIM)
        .map(|stretch| &stretch[TRIM..stretch.len() - TRIM])
}

/// Noise of a velocity, rms: half of the second differences are mere noise, since velocities are straight lines for long.
fn noise(samples: &[VelocitySample], velocity_m_s: impl Fn(&VelocitySample) -> f64) -> f64 {
    let mut bends: Vec<f64> = samples
        .windows(3)
        .map(|three| (velocity_m_s(&three[0]) - 2.0 * velocity_m_s(&three[1]) + velocity_m_s(&three[2])).abs())
        .collect();
    bends.sort_by(f64::total_cmp);
    // The median of |x| is 0.6745 standard deviations, and a second difference has √6 times the noise.
    bends.get(bends.len() / 2).map_or(0.0, |median| median / 0.6745 / 6.0_f64.sqrt())
}
