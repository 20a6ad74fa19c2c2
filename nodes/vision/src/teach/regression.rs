//! From parts seen to templates.

use nalgebra::{DMatrix, DVector, Point2};

use super::super::surround::{DIRECTIONS, DISTANCES};
use super::super::template::{
    Factors, LIGHTS_MAX, LitPicture, Plane, PoseTemplate, SIDES, SLANT_PLANES, direction_factors, texel_place_m,
};
use super::{Lesson, SHOWN_MIN, Seen, TeachError, Texel};
use feeder_model::camera::single;
use feeder_model::geometry::apart::distance_m;

/// What the pictures do not tell is taken to be alike at neighbouring yaws, and not to change with the slant: weights of
/// those beliefs, in parts shown; and of the belief that the walls' shade lies on the plateau but on no part, in
/// squares of the shade.
const YAW_RIDGE: f64 = 0.3;
const SLANT_RIDGE: f64 = 1.0;
const WALL_SHADE_RIDGE: f64 = 0.05;
/// The same of light from one side, which is taken to add nothing, in parts shown.
const SIDE_RIDGE: f64 = 1.0;
/// By how much more a drawing is believed about what depends on yaw and slant than that they change nothing, and how many
/// parts it counts for where the scatter about the pictures is asked for.
const DRAWN_RATIO: f64 = 4.0;
const DRAWN_VIEWS: f64 = 4.0;
/// Parts shown that a drawing counts for where it tells how bright a part is: hardly any, for it does not know the light.
const DRAWN_SHOWN: f64 = 0.2;

impl Lesson<'_> {
    /// The pictures that make up a pose's by least squares, texel by texel, with so many steps of yaw: at those, by slant, by the walls'
    /// shade and by where low light comes from; and the scatter about them.
    fn planes(
        &self,
        pose: usize,
        views: &[Seen],
        steps: usize,
        drawn: Option<&PoseTemplate>,
    ) -> Result<(Vec<Plane>, Plane), TeachError> {
        let too_few = TeachError::TooFew { pose, shown: views.len() };
        if drawn.is_none() && views.len() < SHOWN_MIN {
            return Err(too_few);
        }
        let spec = &self.spec.poses[pose];
        let side = self.side(spec);
        let drawn_planes: Vec<&Plane> = drawn.map_or_else(Vec::new, PoseTemplate::planes);
        let wall_shade = steps + 1 + SLANT_PLANES;
        let from_side = wall_shade + 1;
        let unknowns = from_side + if views.iter().any(|seen| seen.lamp_rad.is_some()) { SIDES } else { 0 };
        let mut beliefs = DMatrix::<f64>::zeros(unknowns, unknowns);
        // Beside a drawing the unknowns are what differs from it.
        let ratio = if drawn.is_some() { DRAWN_RATIO } else { 1.0 };
        for yaw in 0..steps {
            for (row, column, sign) in [(0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0)] {
                beliefs[(yaw + row, yaw + column)] += sign * ratio * YAW_RIDGE;
            }
        }
        for plane in steps + 1..wall_shade {
            beliefs[(plane, plane)] += ratio * SLANT_RIDGE;
        }
        beliefs[(wall_shade, wall_shade)] += ratio * WALL_SHADE_RIDGE;
        for plane in from_side..unknowns {
            beliefs[(plane, plane)] += SIDE_RIDGE;
        }
        // What never was seen is taken to be bare, or as drawn.
        beliefs[(0, 0)] += if drawn.is_some() { DRAWN_SHOWN } else { 1e-3 };
        let factors: Vec<Factors> = views.iter().map(|seen| seen.aspect.factors(spec.yaw_symmetry, steps)).collect();
        let mut planes: Vec<Vec<f32>> = vec![Vec::with_capacity(side * side); unknowns];
        let mut deviations = Vec::with_capacity(side * side);
        let mean_noise = views.iter().map(|seen| seen.sigma * seen.sigma).sum::<f32>() / views.len() as f32;
        for texel in 0..side * side {
            let mut normal = beliefs.clone();
            let mut target = DVector::<f64>::zeros(unknowns);
            let expected: Vec<f64> = match drawn_planes.is_empty() {
                true => vec![0.0; unknowns],
                false => drawn_planes.iter().map(|plane| f64::from(plane.values()[texel])).collect(),
            };
            let beside = distance_m(&spec.outline_m, &Point2::from(texel_place_m(texel, side, self.texel_m()))) > 0.0;
            if drawn.is_none() {
                target[wall_shade] = WALL_SHADE_RIDGE * f64::from(u8::from(beside));
            }
            let rows: Vec<(Vec<(usize, f64)>, f64)> = views
                .iter()
                .zip(&factors)
                .filter_map(|(seen, factors)| {
                    let Texel { level, wall_shade: shade } = seen.texels[texel]?;
                    let at_yaws = factors.at_yaws.into_iter().enumerate().take(steps + 1);
                    let mut row: Vec<(usize, f64)> = at_yaws.map(|(after, w)| (factors.first + after, w)).collect();
                    row.extend(factors.slant.into_iter().enumerate().map(|(plane, w)| (steps + 1 + plane, w)));
                    row.push((wall_shade, shade));
                    if let Some(lamp_rad) = seen.lamp_rad {
                        row.extend((from_side..).zip(direction_factors(lamp_rad)));
                    }
                    let expected: f64 = row.iter().map(|(i, w)| w * expected[*i]).sum();
                    Some((row, level - expected))
                })
                .collect();
            for (row, level) in &rows {
                for (i, w) in row {
                    target[*i] += w * level;
                    row.iter().for_each(|(j, v)| normal[(*i, *j)] += w * v);
                }
            }
            let solution = normal.cholesky().ok_or_else(|| too_few.clone())?.solve(&target);
            for ((plane, value), expected) in planes.iter_mut().zip(solution.iter()).zip(&expected) {
                plane.push(single(value + expected));
            }
            let miss = |(row, level): &(Vec<(usize, f64)>, f64)| {
                (level - row.iter().map(|(i, w)| w * solution[*i]).sum::<f64>()).powi(2)
            };
            let square: f64 = rows.iter().map(miss).sum();
            let variance = match drawn {
                None => square / rows.len().saturating_sub(unknowns).max(1) as f64,
                Some(drawn) => {
                    let drawn = f64::from(drawn.deviation.values()[texel].powi(2) + mean_noise);
                    (square + DRAWN_VIEWS * drawn) / (rows.len().saturating_sub(1) as f64 + DRAWN_VIEWS)
                }
            };
            deviations.push((single(variance) - mean_noise).max(0.0).sqrt());
        }
        let planes = planes.into_iter().map(|values| Plane::new(side, values)).collect();
        Ok((planes, Plane::new(side, deviations)))
    }

    /// The template of a pose with so many steps of yaw.
    pub(super) fn template(
        &self,
        pose: usize,
        views: &[Seen],
        steps: usize,
        drawn: Option<&PoseTemplate>,
    ) -> Result<PoseTemplate, TeachError> {
        if let Some(drawn) = drawn.filter(|_| views.is_empty()) {
            return Ok(drawn.clone());
        }
        let spec = &self.spec.poses[pose];
        let side = self.side(spec);
        let (planes, deviation) = self.planes(pose, views, steps, drawn)?;
        let nothing = || Plane::new(side, vec![0.0; side * side]);
        let mut planes = planes.into_iter();
        let at_yaws = planes.by_ref().take(steps + 1).collect();
        let mut next = || planes.next().unwrap_or_else(nothing);
        Ok(PoseTemplate {
            height_m: spec.height_m,
            yaw_symmetry: spec.yaw_symmetry,
            ring_miss_max: 0.0,
            miss_max: 1.0,
            evidence_min: drawn.map_or(0.0, |drawn| drawn.evidence_min),
            lights: drawn.map_or_else(Vec::new, lights),
            from_side: drawn.map_or_else(|| std::array::from_fn(|_| nothing()), |drawn| drawn.from_side.clone()),
            surround: Plane::new(DIRECTIONS, vec![0.0; DIRECTIONS * DISTANCES]),
            surround_scatter: Plane::new(DIRECTIONS, vec![0.0; DIRECTIONS * DISTANCES]),
            texel_m: self.texel_m(),
            at_yaws,
            slant_x: next(),
            slant_y: next(),
            slant_xx: next(),
            slant_xy: next(),
            slant_yy: next(),
            wall_shade: next(),
            deviation,
            outline_m: spec.outline_m.clone(),
        })
    }

    /// What a pose looks like in light that falls alike from all sides.
    pub(super) fn all_round(&self, pose: usize, views: &[Seen]) -> Result<LitPicture, TeachError> {
        let template = self.template(pose, views, 0, None)?;
        Ok(lit(&template))
    }

    /// What it adds to a pose's picture that low light comes from one side: nothing is known where the walls leave too few parts in it.
    pub(super) fn lit_from_side(&self, pose: usize, views: &[Seen]) -> Result<[Plane; SIDES], TeachError> {
        if views.len() < SHOWN_MIN {
            let side = self.side(&self.spec.poses[pose]);
            return Ok([0.0; SIDES].map(|nothing| Plane::new(side, vec![nothing; side * side])));
        }
        let (mut planes, _) = self.planes(pose, views, 0, None)?;
        let side = planes.split_off(planes.len() - SIDES);
        side.try_into().map_err(|_| TeachError::TooFew { pose, shown: views.len() })
    }
}

/// What a template shows, as one light of several.
fn lit(template: &PoseTemplate) -> LitPicture {
    LitPicture { at_yaws: template.at_yaws.clone(), slant: template.slant_planes().map(Plane::clone) }
}

/// The lights in which a drawing shows a part: those from all sides, and its own.
fn lights(drawn: &PoseTemplate) -> Vec<LitPicture> {
    let mut lights = drawn.lights.clone();
    if lights.len() < LIGHTS_MAX {
        lights.push(lit(drawn));
    }
    lights
}
