//! Which tray motion the bulk accepts.

use thiserror::Error;

use feeder_model::motion::{MotionBlock, MotionSample};

/// Longest time between samples, s: more would let parts pass walls and each other.
pub const LONGEST_SAMPLE_PERIOD_S: f64 = 0.01;

/// Largest acceleration of the tray along x and y, m/s²: a hundred g, far beyond any courier.
pub const LARGEST_ACCELERATION_M_S2: f64 = 1000.0;

/// Largest yaw acceleration of the tray, rad/s².
pub const LARGEST_YAW_ACCELERATION_RAD_S2: f64 = 10_000.0;

/// Largest yaw rate of the tray, rad/s.
pub const LARGEST_YAW_RATE_RAD_S: f64 = 100.0;

/// Why a block of tray motion was refused. Nothing has moved then.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MotionError {
    /// The sample period is no usable time.
    #[error("tray motion: sample_period_s = {value} is outside the allowed range (0, {LONGEST_SAMPLE_PERIOD_S}] s")]
    SamplePeriod {
        /// The value found.
        value: f64,
    },
    /// A component of a sample is not finite or beyond what a tray can do.
    #[error("tray motion: samples[{index}].{component} = {value} is outside the allowed range [-{limit}, {limit}]")]
    Sample {
        /// Index of the sample in its block.
        index: usize,
        /// Which component.
        component: &'static str,
        /// The value found.
        value: f64,
        /// Largest magnitude allowed.
        limit: f64,
    },
}

pub(super) fn check(block: &MotionBlock) -> Result<(), MotionError> {
    let period_s = block.sample_period_s;
    if !(period_s > 0.0 && period_s <= LONGEST_SAMPLE_PERIOD_S) {
        return Err(MotionError::SamplePeriod { value: period_s });
    }
    for (index, sample) in block.samples.iter().enumerate() {
        check_sample(index, sample)?;
    }
    Ok(())
}

fn check_sample(index: usize, sample: &MotionSample) -> Result<(), MotionError> {
    let components = [
        ("position.x", sample.position.x, f64::MAX),
        ("position.y", sample.position.y, f64::MAX),
        ("position.yaw", sample.position.z, f64::MAX),
        ("velocity.x", sample.velocity.x, f64::MAX),
        ("velocity.y", sample.velocity.y, f64::MAX),
        ("velocity.yaw", sample.velocity.z, LARGEST_YAW_RATE_RAD_S),
        ("acceleration.x", sample.acceleration.x, LARGEST_ACCELERATION_M_S2),
        ("acceleration.y", sample.acceleration.y, LARGEST_ACCELERATION_M_S2),
        ("acceleration.yaw", sample.acceleration.z, LARGEST_YAW_ACCELERATION_RAD_S2),
    ];
    for (component, value, limit) in components {
        if !value.is_finite() || value.abs() > limit {
            return Err(MotionError::Sample { index, component, value, limit });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_sample_component_value_and_range() {
        let mut block = MotionBlock { sample_period_s: 5e-4, samples: vec![MotionSample::default(); 3] };
        check(&block).unwrap();
        block.samples[2].acceleration.x = 2000.0;
        assert_eq!(
            check(&block).unwrap_err().to_string(),
            "tray motion: samples[2].acceleration.x = 2000 is outside the allowed range [-1000, 1000]"
        );
        block.samples[1].velocity.z = f64::NAN;
        let error = check(&block).unwrap_err();
        assert!(matches!(error, MotionError::Sample { index: 1, component: "velocity.yaw", .. }));
        block.sample_period_s = 0.0;
        assert_eq!(
            check(&block).unwrap_err().to_string(),
            "tray motion: sample_period_s = 0 is outside the allowed range (0, 0.01] s"
        );
    }
}
