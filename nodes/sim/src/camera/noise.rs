//! Sensor noise: Gaussian, drawn once into a table and dealt out row by row from random places.

use std::f64::consts::TAU;

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Length of the table before its repeated head; a row starts anywhere in it.
const TABLE_LENGTH: usize = 1 << 16;

/// Gaussian grey-level noise. A full frame costs a fraction of what drawing every pixel would.
#[derive(Clone, Debug)]
pub(crate) struct NoiseTable {
    levels: Vec<i8>,
}

impl NoiseTable {
    /// A table for rows up to `row_length` pixels with standard deviation `sigma` grey levels.
    pub(crate) fn new(sigma: f64, row_length: usize) -> Self {
        // The table is a fixed part of the sensor; which of it a frame sees comes from the generator passed to `add`.
        let mut generator = Pcg64Mcg::seed_from_u64(0x6e6f_6973_6521);
        let mut levels = Vec::with_capacity(TABLE_LENGTH + row_length);
        while levels.len() < TABLE_LENGTH {
            // Box–Muller; 1 − u keeps the logarithm finite.
            let radius = sigma * (-2.0 * (1.0 - generator.random::<f64>()).ln()).sqrt();
            let (sin, cos) = (TAU * generator.random::<f64>()).sin_cos();
            for value in [radius * cos, radius * sin] {
                #[expect(clippy::cast_possible_truncation, reason = "clamped to i8")]
                levels.push(value.round().clamp(-127.0, 127.0) as i8);
            }
        }
        levels.extend_from_within(..row_length);
        Self { levels }
    }

    /// Adds noise to rows of `row_length` pixels, saturating as a sensor does.
    pub(crate) fn add(&self, generator: &mut impl Rng, row_length: usize, pixels: &mut [u8]) {
        for row in pixels.chunks_mut(row_length) {
            let start = generator.next_u32() as usize % TABLE_LENGTH;
            for (pixel, noise) in row.iter_mut().zip(&self.levels[start..]) {
                *pixel = pixel.saturating_add_signed(*noise);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_moments_of_the_noise() {
        let table = NoiseTable::new(2.0, 640);
        let mut pixels = vec![128_u8; 640 * 480];
        table.add(&mut Pcg64Mcg::seed_from_u64(7), 640, &mut pixels);
        let count = f64::from(640_u32 * 480);
        let mean = pixels.iter().map(|p| f64::from(*p)).sum::<f64>() / count;
        let variance = pixels.iter().map(|p| (f64::from(*p) - mean).powi(2)).sum::<f64>() / count;
        // A table of 65,536 has a mean within 4·2/256; rounding to whole levels adds 1/12 to the variance of 4, whose
        // own scatter is 4·√(2/65536) = 0.022.
        assert!((mean - 128.0).abs() < 0.032, "mean {mean}");
        assert!((variance - 4.083).abs() < 0.09, "variance {variance}");
    }

    #[test]
    fn no_noise_changes_nothing_and_noise_saturates() {
        let mut pixels = vec![10_u8; 64];
        NoiseTable::new(0.0, 16).add(&mut Pcg64Mcg::seed_from_u64(1), 16, &mut pixels);
        assert!(pixels.iter().all(|p| *p == 10));
        let mut white = vec![255_u8; 6400];
        NoiseTable::new(40.0, 64).add(&mut Pcg64Mcg::seed_from_u64(1), 64, &mut white);
        assert!(white.contains(&255) && white.iter().any(|p| *p < 230));
    }
}
