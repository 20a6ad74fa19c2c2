//! What is measured of a part from frame to frame, smoothed.

use nalgebra::{Matrix2, Vector2};

/// Kalman filter for values of nearly constant rate that share their uncertainty.
#[derive(Clone, Debug)]
pub(super) struct Filter<const N: usize> {
    pub value: [f64; N],
    pub rate: [f64; N],
    /// Covariance of value and rate.
    covariance: Matrix2<f64>,
}

impl<const N: usize> Filter<N> {
    pub(super) fn start(value: [f64; N], value_sigma: f64, rate_sigma: f64) -> Self {
        let covariance = Matrix2::new(value_sigma.powi(2), 0.0, 0.0, rate_sigma.powi(2));
        Self { value, rate: [0.0; N], covariance }
    }

    pub(super) fn predict(&mut self, dt: f64, acceleration_sigma: f64) {
        for (value, rate) in self.value.iter_mut().zip(&self.rate) {
            *value += rate * dt;
        }
        let advance = Matrix2::new(1.0, dt, 0.0, 1.0);
        // White acceleration held over each interval.
        let kick = Vector2::new(0.5 * dt * dt, dt) * acceleration_sigma;
        self.covariance = advance * self.covariance * advance.transpose() + kick * kick.transpose();
    }

    /// Takes in by how much a measurement differs from the value expected.
    pub(super) fn correct(&mut self, innovation: [f64; N], value_sigma: f64) {
        let variance = self.covariance[(0, 0)] + value_sigma.powi(2);
        let gain = self.covariance.column(0) / variance;
        for (index, innovation) in innovation.into_iter().enumerate() {
            self.value[index] += innovation * gain[0];
            self.rate[index] += innovation * gain[1];
        }
        self.covariance -= gain * self.covariance.row(0).clone_owned();
    }
}
