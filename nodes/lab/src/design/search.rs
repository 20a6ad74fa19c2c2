//! Maximisation without derivatives: Nelder-Mead from many starts, restarted where it stops.

use argmin::core::{CostFunction, Error, Executor, State};
use argmin::solver::neldermead::NelderMead;

/// How hard to search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Random starts, besides those that are known to be good.
    pub starts: u32,
    /// Steps of the search from each start.
    pub steps: u64,
    /// Seed of the random starts.
    pub seed: u64,
}

/// A point and what the objective is worth there.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Found {
    pub(super) point: Vec<f64>,
    pub(super) value: f64,
}

struct Negated<'a, F>(&'a F);

impl<F: Fn(&[f64]) -> f64> CostFunction for Negated<'_, F> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, point: &Vec<f64>) -> Result<f64, Error> {
        let value = (self.0)(point);
        // A point without value is the worst of all; NaN would poison the simplex.
        Ok(if value.is_nan() { f64::MAX } else { -value })
    }
}

/// Climbs from `start`, whose coordinates are varied by about `steps_by` at first.
pub(super) fn climb<F: Fn(&[f64]) -> f64>(objective: &F, start: Vec<f64>, step_by: &[f64], steps: u64) -> Found {
    let value = objective(&start);
    let mut best = Found { value: if value.is_nan() { f64::NEG_INFINITY } else { value }, point: start };
    let mut left = steps;
    // Nelder-Mead collapses on the kinks of a max-min; a fresh simplex there often finds the way on.
    let mut scale = 1.0;
    while left > 0 {
        let share = left.min(steps.div_ceil(4));
        left -= share;
        let found = run_once(objective, &best.point, step_by, scale, share);
        match found {
            Some(found) if found.value > best.value => {
                let gained = found.value - best.value;
                best = found;
                if gained < 1e-7 * best.value.abs() {
                    scale *= -0.3;
                }
            }
            _ => scale *= -0.3,
        }
    }
    best
}

fn run_once<F: Fn(&[f64]) -> f64>(
    objective: &F,
    start: &[f64],
    step_by: &[f64],
    scale: f64,
    steps: u64,
) -> Option<Found> {
    let corner = |i: usize| {
        let mut point = start.to_vec();
        point[i] += step_by[i] * scale;
        point
    };
    let simplex = std::iter::once(start.to_vec()).chain((0..start.len()).map(corner)).collect();
    let solver = NelderMead::new(simplex);
    let outcome =
        Executor::new(Negated(objective), solver).configure(|state| state.max_iters(steps)).timer(false).run().ok()?;
    let state = outcome.state();
    let point = state.get_best_param()?.clone();
    Some(Found { value: objective(&point), point })
}
