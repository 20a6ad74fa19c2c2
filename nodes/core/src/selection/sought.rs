//! A taught pose made ready to be looked for at the scale of a camera.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Point2, Rotation2, Vector2};

use super::hull::convex_hull;
use super::template::{Aspect, PoseTemplate};
use crate::camera::{CameraModel, MountedTray, single};

/// Width of the strip round the part that is compared too, px: the edge, and what it stands out from.
const RIM_PX: f64 = 1.3;
/// What no template reproduces, relative to the plateau's brightness.
pub(super) const MODEL_SIGMA: f32 = 0.025;
/// Most points compared in the coarse search and in the fine one.
const COARSE_POINTS_MAX: usize = 120;
const FINE_POINTS_MAX: usize = 500;
/// Largest step of the rim between two turns of the coarse search, px.
const TURN_STEP_PX: f64 = 1.4;
/// How far the centre may be from where the rings are summed, px, as a standard deviation.
const RING_MISS_PX: f32 = 0.7;

/// A ring about the part's centre, one pixel wide.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ring {
    /// Mean brightness above the plateau's.
    pub mean: f32,
    /// Variance of that.
    pub variance: f32,
    /// What the ring counts.
    pub weight: f32,
}

/// A point of the coarse search.
#[derive(Clone, Copy, Debug)]
pub(super) struct CoarsePoint {
    /// Place beside the centre, px.
    pub column: isize,
    pub row: isize,
    pub value: f32,
    pub variance: f32,
}

/// The part turned by some yaw.
#[derive(Clone, Debug)]
pub(super) struct Turn {
    /// Yaw against the platen, rad.
    pub yaw_rad: f64,
    pub points: Vec<CoarsePoint>,
}

/// A pose as it is looked for.
#[derive(Clone, Debug)]
pub(super) struct Sought {
    pub template: PoseTemplate,
    /// The plane above the platen in which its places are measured, m.
    pub plane_m: f64,
    pub rings: Vec<Ring>,
    /// Nothing of the part need be seen nearer to its centre than this, px.
    pub hollow_px: usize,
    pub turns: Vec<Turn>,
    /// Texels compared in the fine search.
    pub texels: Vec<usize>,
    /// Convex outline in the part's directions, m, counter-clockwise.
    pub outline: Vec<Point2<f64>>,
    /// Greatest distance of the outline from the centre, m.
    pub radius_m: f64,
    /// Area that the part covers, m².
    pub area_m2: f64,
    /// Size of a pixel in the plane, m.
    pub m_per_px: f64,
}

impl Sought {
    pub(super) fn new(template: &PoseTemplate, camera: &CameraModel, tray: &MountedTray) -> Self {
        let plane_m = tray.plateau_height_m() + 0.5 * template.height_m;
        let m_per_px = camera.m_per_px(plane_m);
        let outline = convex_hull(half_crossings(template));
        let radius_m = outline.iter().map(|corner| corner.coords.norm()).fold(0.0, f64::max);
        let inside = template.inside.values();
        let count = inside.iter().filter(|inside| **inside >= 0.5).count();
        let mut sought = Self {
            template: template.clone(),
            plane_m,
            rings: Vec::new(),
            hollow_px: 0,
            turns: Vec::new(),
            texels: rim_and_inside(template, RIM_PX * m_per_px),
            outline,
            radius_m,
            area_m2: count as f64 * template.texel_m * template.texel_m,
            m_per_px,
        };
        thin(&mut sought.texels, FINE_POINTS_MAX);
        sought.rings = sought.rings();
        sought.hollow_px = sought.hollow();
        let image_from_platen = camera.image_from_platen();
        sought.turns = sought.yaws().into_iter().map(|yaw_rad| sought.turn(yaw_rad, &image_from_platen)).collect();
        sought
    }

    /// Yaws tried in the coarse search, rad.
    fn yaws(&self) -> Vec<f64> {
        if self.template.yaw_symmetry == 0 {
            return vec![0.0];
        }
        let span_rad = TAU / f64::from(self.template.yaw_symmetry);
        let step_rad = TURN_STEP_PX * self.m_per_px / self.radius_m.max(self.m_per_px);
        let count = (span_rad / step_rad).ceil().max(2.0);
        let mut yaws = Vec::new();
        while (yaws.len() as f64) < count {
            yaws.push(span_rad * yaws.len() as f64 / count);
        }
        yaws
    }

    fn turn(&self, yaw_rad: f64, image_from_platen: &Matrix2<f64>) -> Turn {
        let picture = self.template.picture(&Aspect { yaw_rad, slant: Vector2::zeros() });
        let deviation = self.template.deviation.values();
        let into_part = Rotation2::new(-yaw_rad) * image_from_platen.transpose() * self.m_per_px;
        let wanted = {
            let mut wanted = vec![false; picture.len()];
            for texel in rim_and_inside(&self.template, 0.5 * RIM_PX * self.m_per_px) {
                wanted[texel] = true;
            }
            wanted
        };
        let reach = ((self.radius_m / self.m_per_px) + 2.0).ceil();
        let mut points = Vec::new();
        let mut row = -reach;
        while row <= reach {
            let mut column = -reach;
            while column <= reach {
                let place = into_part * Vector2::new(column, row);
                if let Some(index) = self.texel(place).filter(|index| wanted[*index]) {
                    #[expect(clippy::cast_possible_truncation, reason = "a few dozen pixels")]
                    let (column, row) = (column as isize, row as isize);
                    let variance = deviation[index].powi(2) + self.displacement_variance(&picture, index);
                    points.push(CoarsePoint { column, row, value: picture[index], variance });
                }
                column += 1.0;
            }
            row += 1.0;
        }
        thin(&mut points, COARSE_POINTS_MAX);
        Turn { yaw_rad, points }
    }

    /// What half a pixel beside changes, squared: the coarse search is no more exact than that.
    fn displacement_variance(&self, picture: &[f32], index: usize) -> f32 {
        let texels_per_px = single(self.m_per_px / self.template.texel_m);
        let (along_x, along_y) = gradient(picture, self.template.side(), index);
        0.25 * texels_per_px.powi(2) * (along_x.powi(2) + along_y.powi(2))
    }

    /// The texel nearest to a place in the part's directions.
    pub(super) fn texel(&self, place_m: Vector2<f64>) -> Option<usize> {
        let side = self.template.side();
        let place = (place_m / self.template.texel_m).add_scalar((side / 2) as f64 + 0.5);
        let inside = place.x >= 0.0 && place.y >= 0.0 && place.x < side as f64 && place.y < side as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be within the picture")]
        inside.then(|| place.y as usize * side + place.x as usize)
    }

    fn rings(&self) -> Vec<Ring> {
        const SPOKES: usize = 48;
        let mean = self.template.mean.values();
        let deviation = self.template.deviation.values();
        let inside = self.template.inside.values();
        let mut rings = Vec::new();
        while rings.len() as f64 <= self.radius_m / self.m_per_px {
            let radius_m = rings.len() as f64 * self.m_per_px;
            let (mut sum, mut square, mut within, mut count) = (0.0, 0.0, 0.0, 0.0_f32);
            for spoke in 0..SPOKES {
                let (sin, cos) = (TAU * spoke as f64 / SPOKES as f64).sin_cos();
                let Some(index) = self.texel(Vector2::new(cos, sin) * radius_m) else {
                    continue;
                };
                sum += mean[index];
                square += deviation[index] * deviation[index];
                within += inside[index].clamp(0.0, 1.0);
                count += 1.0;
            }
            let count = count.max(1.0);
            // What of the ring lies beside the part shows the plateau, a shadow or a neighbour.
            let beside = 1.0 - within / count;
            let variance = square / count * 0.25 + (0.3 * beside).powi(2);
            rings.push(Ring { mean: sum / count, variance, weight: (rings.len() as f32 + 0.25).sqrt() });
        }
        // A ring summed beside the centre sees something of its neighbours.
        let means: Vec<f32> = rings.iter().map(|ring| ring.mean).collect();
        for (index, ring) in rings.iter_mut().enumerate() {
            let (inner, outer) = (index.saturating_sub(1), (index + 1).min(means.len() - 1));
            ring.variance += (0.5 * RING_MISS_PX * (means[outer] - means[inner])).powi(2) + 2.0 * MODEL_SIGMA.powi(2);
        }
        let total: f32 = rings.iter().map(|ring| ring.weight).sum();
        for ring in &mut rings {
            ring.weight /= total;
        }
        rings
    }

    /// How far from the centre the nearest thing is that stands out from the plateau, px.
    fn hollow(&self) -> usize {
        let seen = |index: &usize| {
            self.template.inside.values()[*index] >= 0.5 && self.template.mean.values()[*index].abs() > 0.15
        };
        let distance_m = |index: usize| self.template.place_m(index).norm();
        let nearest_m = (0..self.template.mean.values().len()).filter(seen).map(distance_m).fold(self.radius_m, f64::min);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few pixels")]
        let pixels = (nearest_m / self.m_per_px + 1.0).ceil() as usize;
        pixels
    }
}

/// Central differences of a picture, per texel.
pub(super) fn gradient(picture: &[f32], side: usize, index: usize) -> (f32, f32) {
    let (column, row) = (index % side, index / side);
    let (left, right) = (column.saturating_sub(1), (column + 1).min(side - 1));
    let (below, above) = (row.saturating_sub(1), (row + 1).min(side - 1));
    let at = |column: usize, row: usize| picture[row * side + column];
    (0.5 * (at(right, row) - at(left, row)), 0.5 * (at(column, above) - at(column, below)))
}

/// Texels that show the part, or lie within `rim_m` of one that does.
fn rim_and_inside(template: &PoseTemplate, rim_m: f64) -> Vec<usize> {
    let side = template.side();
    let inside = template.inside.values();
    let reach = rim_m / template.texel_m;
    #[expect(clippy::cast_possible_truncation, reason = "a few texels")]
    let steps = reach.floor() as isize;
    let near = |index: usize, dx: isize, dy: isize| {
        let column = (index % side).checked_add_signed(dx).filter(|column| *column < side);
        let row = (index / side).checked_add_signed(dy).filter(|row| *row < side);
        column.zip(row).is_some_and(|(column, row)| inside[row * side + column] >= 0.5)
    };
    let offsets: Vec<(isize, isize)> = (-steps..=steps)
        .flat_map(|dy| (-steps..=steps).map(move |dx| (dx, dy)))
        .filter(|(dx, dy)| (dx.pow(2) + dy.pow(2)) as f64 <= reach * reach)
        .collect();
    (0..inside.len()).filter(|index| offsets.iter().any(|(dx, dy)| near(*index, *dx, *dy))).collect()
}

/// Places in the part's directions where the share of pictures that show the part crosses one half, m.
fn half_crossings(template: &PoseTemplate) -> Vec<Point2<f64>> {
    let side = template.side();
    let inside = template.inside.values();
    let mut crossings = Vec::new();
    for index in 0..inside.len() {
        let (column, row) = (index % side, index / side);
        let here = inside[index];
        for (next, within) in [(index + 1, column + 1 < side), (index + side, row + 1 < side)] {
            if !within || (here >= 0.5) == (inside[next] >= 0.5) {
                continue;
            }
            let share = f64::from((0.5 - here) / (inside[next] - here));
            let (from, to) = (template.place_m(index), template.place_m(next));
            crossings.push(Point2::from(from + (to - from) * share));
        }
    }
    crossings
}

/// Leaves out evenly what is more than `most`.
fn thin<T: Copy>(points: &mut Vec<T>, most: usize) {
    if points.len() > most {
        let count = points.len();
        *points = (0..most).map(|index| points[index * count / most]).collect();
    }
}
