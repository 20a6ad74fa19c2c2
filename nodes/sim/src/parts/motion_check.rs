//! Which tray motion the bulk accepts.

use feeder_model::motion::{MotionBlock, MotionSample};
use feeder_model::range::{OutOfRange, check_range};

/// Longest time between samples, s: more would let parts pass walls and each other.
pub const LONGEST_SAMPLE_PERIOD_S: f64 = 0.01;

/// Largest acceleration of the tray along x and y, m/s²: a hundred g, far beyond any courier.
pub const LARGEST_ACCELERATION_M_S2: f64 = 1000.0;

/// Largest yaw acceleration of the tray, rad/s².
pub const LARGEST_YAW_ACCELERATION_RAD_S2: f64 = 10_000.0;

/// Largest yaw rate of the tray, rad/s.
pub const LARGEST_YAW_RATE_RAD_S: f64 = 100.0;

pub(super) fn check(block: &MotionBlock) -> Result<(), OutOfRange> {
    let period_s = block.sample_period_s;
    OutOfRange::unless(
        period_s > 0.0 && period_s <= LONGEST_SAMPLE_PERIOD_S,
        "tray motion sample_period_s",
        period_s,
        format_args!("above 0, up to {LONGEST_SAMPLE_PERIOD_S} s"),
    )?;
    for (index, sample) in block.samples.iter().enumerate() {
        check_sample(index, sample)?;
    }
    Ok(())
}

fn check_sample(index: usize, sample: &MotionSample) -> Result<(), OutOfRange> {
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
        check_range(component, value, -limit, limit)
            .map_err(|error| error.named(format!("tray motion samples[{index}].{component}")))?;
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
            "tray motion samples[2].acceleration.x = 2000 is outside its range: -1000 to 1000"
        );
        block.samples[1].velocity.z = f64::NAN;
        assert_eq!(check(&block).unwrap_err().parameter, "tray motion samples[1].velocity.yaw");
        block.sample_period_s = 0.0;
        assert_eq!(
            check(&block).unwrap_err().to_string(),
            "tray motion sample_period_s = 0 is outside its range: above 0, up to 0.01 s"
        );
    }
}
