//! From parts seen to templates.

use nalgebra::{DMatrix, DVector, Point2};

use super::super::hull::distance_m;
use super::super::template::{Factors, Plane, PoseTemplate, SLANT_PLANES, texel_place_m, yaw_steps};
use super::{Lesson, SHOWN_MIN, Seen, TeachError, Texel};
use feeder_model::camera::single;

/// What the pictures do not tell is taken to be alike at neighbouring yaws, and not to change with the slant: weights of
/// those beliefs, in parts shown; and of the belief that the walls' shade lies on the plateau but on no part, in
/// squares of the shade.
const YAW_RIDGE: f64 = 0.3;
const SLANT_RIDGE: f64 = 1.0;
const WALL_SHADE_RIDGE: f64 = 0.05;

impl Lesson<'_> {
    /// The template of a pose by least squares, texel by texel.
    pub(super) fn template(&self, pose: usize, views: &[Seen]) -> Result<PoseTemplate, TeachError> {
        if views.len() < SHOWN_MIN {
            return Err(TeachError::TooFew { pose, shown: views.len() });
        }
        let spec = &self.spec.poses[pose];
        let side = self.side(spec);
        let steps = yaw_steps(spec.yaw_symmetry);
        let wall_shade = steps + 1 + SLANT_PLANES;
        let unknowns = wall_shade + 1;
        let mut beliefs = DMatrix::<f64>::zeros(unknowns, unknowns);
        for yaw in 0..steps {
            for (row, column, sign) in [(0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0)] {
                beliefs[(yaw + row, yaw + column)] += sign * YAW_RIDGE;
            }
        }
        for plane in steps + 1..wall_shade {
            beliefs[(plane, plane)] += SLANT_RIDGE;
        }
        beliefs[(wall_shade, wall_shade)] += WALL_SHADE_RIDGE;
        // What never was seen is taken to be bare.
        beliefs[(0, 0)] += 1e-3;
        let factors: Vec<Factors> = views.iter().map(|seen| seen.aspect.factors(spec.yaw_symmetry, steps)).collect();
        let mut planes: Vec<Vec<f32>> = vec![Vec::with_capacity(side * side); unknowns];
        let mut deviations = Vec::with_capacity(side * side);
        let mean_noise = views.iter().map(|seen| seen.sigma * seen.sigma).sum::<f32>() / views.len() as f32;
        for texel in 0..side * side {
            let mut normal = beliefs.clone();
            let mut target = DVector::<f64>::zeros(unknowns);
            let beside = distance_m(&spec.outline_m, &Point2::from(texel_place_m(texel, side, self.texel_m()))) > 0.0;
            target[wall_shade] = WALL_SHADE_RIDGE * f64::from(u8::from(beside));
            let rows: Vec<(Vec<(usize, f64)>, f64)> = views
                .iter()
                .zip(&factors)
                .filter_map(|(seen, factors)| {
                    let Texel { level, wall_shade: shade } = seen.texels[texel]?;
                    let at_yaws = factors.at_yaws.into_iter().enumerate().take(steps + 1);
                    let mut row: Vec<(usize, f64)> = at_yaws.map(|(after, w)| (factors.first + after, w)).collect();
                    row.extend(factors.slant.into_iter().enumerate().map(|(plane, w)| (steps + 1 + plane, w)));
                    row.push((wall_shade, shade));
                    Some((row, level))
                })
                .collect();
            for (row, level) in &rows {
                for (i, w) in row {
                    target[*i] += w * level;
                    row.iter().for_each(|(j, v)| normal[(*i, *j)] += w * v);
                }
            }
            let solution = normal.cholesky().ok_or(TeachError::TooFew { pose, shown: views.len() })?.solve(&target);
            for (plane, value) in planes.iter_mut().zip(solution.iter()) {
                plane.push(single(*value));
            }
            let miss = |(row, level): &(Vec<(usize, f64)>, f64)| {
                (level - row.iter().map(|(i, w)| w * solution[*i]).sum::<f64>()).powi(2)
            };
            let square: f64 = rows.iter().map(miss).sum();
            let freedom = rows.len().saturating_sub(unknowns).max(1) as f64;
            deviations.push((single(square / freedom) - mean_noise).max(0.0).sqrt());
        }
        let mut planes = planes.into_iter().map(|values| Plane::new(side, values));
        let at_yaws = planes.by_ref().take(steps + 1).collect();
        let mut next = || planes.next().unwrap_or_else(|| Plane::new(side, vec![0.0; side * side]));
        Ok(PoseTemplate {
            height_m: spec.height_m,
            yaw_symmetry: spec.yaw_symmetry,
            ring_miss_max: 0.0,
            miss_max: 1.0,
            shade_reach_m: 0.0,
            texel_m: self.texel_m(),
            at_yaws,
            slant_x: next(),
            slant_y: next(),
            slant_xx: next(),
            slant_xy: next(),
            slant_yy: next(),
            wall_shade: next(),
            deviation: Plane::new(side, deviations),
            outline_m: spec.outline_m.clone(),
        })
    }
}
