//! A taught pose made ready to be looked for at the scale of a camera.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Point2, Rotation2, SMatrix, SVector, Vector2};

use super::align::Fit;
use super::modes::{self, Amounts, Effects, EffectsOn, LIGHT_MODES, Light, LightAmounts};
use super::template::{Aspect, PoseTemplate, period_rad};
use super::view::View;
use feeder_model::camera::{CameraModel, MountedTray, single};
use feeder_model::geometry::apart::signed_distance_m;

/// Width of the strip round the part that is compared too, px: the edge, and what it stands out from.
const RIM_PX: f64 = 1.8;
/// How far inside and outside the outline the lens lets see of both, px.
const EDGE_PX: f64 = 1.0;
/// Scatter of what lies beside a part among others and alone, relative to the plateau's brightness.
pub(super) const SHADE_SIGMA: f32 = 0.12;
pub(super) const FREE_SIGMA: f32 = 0.02;
/// What bare floor may look like: hardly brighter than it is, but darker by far in the shade of parts.
pub(super) const BARE_BRIGHT_SIGMA: f32 = 0.12;
pub(super) const BARE_DARK_SIGMA: f32 = 0.3;
/// The same where nothing shades it: stains and mottling.
pub(super) const BARE_PLAIN_SIGMA: f32 = 0.03;
/// Most points compared in the coarse search and in the fine one.
const COARSE_POINTS_MAX: usize = 100;
const FINE_POINTS_MAX: usize = 500;
/// Every so many points of the coarse search come first, so that the first ones are spread over the part.
const SPREAD: usize = 5;
/// Share of the evidence that a part alone must have, without which nothing is a thing at all.
const STANDS_OUT_RATIO: f32 = 0.5;
/// Most corners of an outline: of a circle 1 % is cut off.
const OUTLINE_CORNERS_MAX: usize = 24;
/// Step between slants of the line of sight in the coarse search.
const SLANT_STEP: f64 = 0.1;
/// Largest step of the rim between two turns of the coarse search, px.
const TURN_STEP_PX: f64 = 1.4;
/// How far the centre may be from where the rings are summed, px, as a standard deviation.
const RING_MISS_PX: f32 = 0.7;

/// A ring about the part's centre, one pixel wide.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ring {
    /// Mean brightness above the plateau's, and the share of the walls' shade that lies on it.
    pub mean: f32,
    pub wall_shade: f32,
    /// Variance of that.
    pub variance: f32,
    /// Variance along the ring: what is seen of a part of it tells the mean no better.
    pub variance_along: f32,
    /// What the ring counts.
    pub weight: f32,
    /// What the modes of light add to it.
    pub effect: LightAmounts,
    /// What each unit by which it is brighter tells of those modes' amounts, under the noise of the latest frame.
    pub amounts: LightAmounts,
}

/// A point of the coarse search.
#[derive(Clone, Copy, Debug)]
pub(super) struct CoarsePoint {
    /// Place beside the centre, px.
    pub column: i16,
    pub row: i16,
    pub value: f32,
    /// What the modes of light add to that.
    pub effect: LightAmounts,
    /// Share of the walls' shade that lies on it.
    pub wall_shade: f32,
    pub variance: f32,
    /// One over the standard deviation under the noise of the latest frame, and the logarithm of that.
    pub inverse_sigma: f32,
    pub log_inverse_sigma: f32,
}

/// The part turned by some yaw.
#[derive(Clone, Debug)]
pub(super) struct Turn {
    /// Yaw against the platen, rad.
    pub yaw_rad: f64,
    pub points: Vec<CoarsePoint>,
    /// How many pixels each point stands for.
    pub point_weight: f32,
}

/// A pose as it is looked for.
#[derive(Clone, Debug)]
pub(super) struct Sought {
    pub template: PoseTemplate,
    /// The light in which it is looked for.
    pub light: Light,
    /// The plane above the platen in which its places are measured, m.
    pub plane_m: f64,
    pub rings: Vec<Ring>,
    /// Nothing of the part need be seen nearer to its centre than this, px.
    pub hollow_px: usize,
    /// Turned parts for each slant of the line of sight, as [`slant_index`] counts them.
    pub turns: Vec<Vec<Turn>>,
    /// Texels compared in the fine search, and how many each stands for.
    pub texels: Vec<usize>,
    pub texel_weight: f32,
    /// What the noise of the latest frame alone makes a part miss, mean square in standard deviations: below 1.
    pub noise_miss: f32,
    /// For each texel how far outside the outline it lies, m; below 0 inside.
    pub outside_m: Vec<f32>,
    /// For each texel the share of it that shows the part and not what lies beside, 0 to 1, as sharp as the lens is.
    pub inside: Vec<f32>,
    /// Variance by which each texel misses because edges are where they are, and as sharp as they are, only about.
    pub edge_variance: Vec<f32>,
    /// What light and lens may add to each texel.
    effects: Effects,
    /// The outline, round ones with fewer corners than the drawing has, m.
    pub outline_m: Vec<Point2<f64>>,
    /// Greatest distance of the outline from the centre, m.
    pub radius_m: f64,
    /// Size of a pixel in the plane, m.
    pub m_per_px: f64,
}

impl Sought {
    pub(super) fn new(template: &PoseTemplate, camera: &CameraModel, tray: &MountedTray, light: Light) -> Self {
        let plane_m = tray.plateau_height_m() + 0.5 * template.height_m;
        let m_per_px = camera.m_per_px(plane_m);
        let radius_m = template.outline_m.iter().map(|corner| corner.coords.norm()).fold(0.0, f64::max);
        let mut sought = Self {
            template: template.clone(),
            light,
            plane_m,
            rings: Vec::new(),
            hollow_px: 0,
            turns: Vec::new(),
            texels: Vec::new(),
            texel_weight: 1.0,
            noise_miss: 0.0,
            outside_m: outside_m(template),
            inside: Vec::new(),
            effects: Effects::none(0),
            edge_variance: Vec::new(),
            outline_m: template.outline_m.clone(),
            radius_m,
            m_per_px,
        };
        let edge_m = single(2.0 * EDGE_PX * m_per_px);
        sought.inside = sought.outside_m.iter().map(|outside_m| (0.5 - outside_m / edge_m).clamp(0.0, 1.0)).collect();
        let texels_per_px = single(m_per_px / template.texel_m);
        let mean = template.mean();
        let edge = |index: usize| {
            let (x, y) = gradient(&mean, template.side(), index);
            (light.edge_miss_px() * texels_per_px).powi(2) * (x * x + y * y)
        };
        sought.edge_variance = (0..mean.len()).map(edge).collect();
        sought.effects = match light {
            Light::Taught => Effects::none(mean.len()),
            Light::Any => Effects::new(template, &mean, &sought.inside, texels_per_px),
        };
        sought.texels = sought.within(RIM_PX * m_per_px);
        let all = sought.texels.len() as f32;
        thin(&mut sought.texels, FINE_POINTS_MAX);
        sought.texel_weight = all / sought.texels.len().max(1) as f32;
        thin(&mut sought.outline_m, OUTLINE_CORNERS_MAX);
        sought.rings = sought.rings();
        sought.hollow_px = sought.hollow();
        let image_from_platen = camera.image_from_platen();
        let yaws = sought.yaws();
        let turned = |slant| yaws.iter().map(|yaw_rad| sought.turn(*yaw_rad, slant, &image_from_platen)).collect();
        sought.turns = slants().map(turned).collect();
        sought
    }

    /// How many yaws the coarse search tries.
    pub(super) fn yaw_count(&self) -> f64 {
        self.turns.first().map_or(1.0, |turns| turns.len() as f64)
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

    fn turn(&self, yaw_rad: f64, slant: Vector2<f64>, image_from_platen: &Matrix2<f64>) -> Turn {
        let aspect = Aspect { yaw_rad, slant };
        let picture = self.template.picture(&aspect);
        let effects = self.effects(&picture, &aspect);
        let into_part = Rotation2::new(-yaw_rad) * image_from_platen.transpose() * self.m_per_px;
        let rim_m = single(0.5 * RIM_PX * self.m_per_px);
        let reach = ((self.radius_m / self.m_per_px) + 2.0).ceil();
        let mut points = Vec::new();
        let mut row = -reach;
        while row <= reach {
            let mut column = -reach;
            while column <= reach {
                let place = into_part * Vector2::new(column, row);
                if let Some(index) = self.texel(place).filter(|index| self.outside_m[*index] <= rim_m) {
                    #[expect(clippy::cast_possible_truncation, reason = "a few dozen pixels")]
                    let (column, row) = (column as i16, row as i16);
                    let variance = self.variance(index, SHADE_SIGMA) + self.displacement_variance(&picture, index);
                    let (value, wall_shade) = (picture[index], self.template.wall_shade.values()[index]);
                    let (inverse_sigma, log_inverse_sigma) = (0.0, 0.0);
                    points.push(CoarsePoint {
                        column,
                        row,
                        value,
                        effect: modes::of_light(&effects.at(index)),
                        wall_shade,
                        variance,
                        inverse_sigma,
                        log_inverse_sigma,
                    });
                }
                column += 1.0;
            }
            row += 1.0;
        }
        let all = points.len() as f32;
        thin(&mut points, COARSE_POINTS_MAX);
        let points: Vec<CoarsePoint> =
            (0..SPREAD).flat_map(|first| points.iter().copied().skip(first).step_by(SPREAD)).collect();
        let point_weight = all / points.len().max(1) as f32;
        Turn { yaw_rad, points, point_weight }
    }

    /// What light and lens may add to each texel of a picture of the part under some aspect.
    pub(super) fn effects(&self, picture: &[f32], aspect: &Aspect) -> EffectsOn<'_> {
        match self.light {
            Light::Taught => self.effects.as_taught(),
            Light::Any => self.effects.on(&self.template, picture, aspect),
        }
    }

    /// How the part is seen where it lies as fitted, its yaw within a period of its symmetry.
    pub(super) fn aspect(&self, view: &View, fit: &Fit) -> Aspect {
        let period_rad = period_rad(self.template.yaw_symmetry);
        let on_platen_rad = fit.yaw_rad + view.platen_from_tray.rotation.angle();
        let yaw_rad = if period_rad > 0.0 { on_platen_rad.rem_euclid(period_rad) } else { 0.0 };
        Aspect { yaw_rad, slant: view.slant(fit.centre, self.plane_m) }
    }

    /// The picture of the part as fitted, with what light and lens have made of it.
    pub(super) fn fitted(&self, aspect: &Aspect, amounts: &Amounts) -> Vec<f32> {
        let picture = self.template.picture(aspect);
        self.lit(&picture, &self.effects(&picture, aspect), amounts)
    }

    /// A picture of the part with what light and lens have made of it.
    pub(super) fn lit(&self, picture: &[f32], effects: &EffectsOn, amounts: &Amounts) -> Vec<f32> {
        let lit = |(texel, level): (usize, &f32)| match self.light {
            Light::Taught => *level,
            Light::Any => level + effects.added(texel, amounts),
        };
        picture.iter().enumerate().map(lit).collect()
    }

    /// How the picture `lit` of the part, as it is under this aspect, changes with the yaw, 1/rad.
    pub(super) fn lit_change(&self, aspect: &Aspect, lit: &[f32], amounts: &Amounts) -> Vec<f32> {
        const STEP_RAD: f64 = 0.02;
        if self.light == Light::Taught {
            return self.template.picture_change(aspect);
        }
        let step_rad =
            if aspect.yaw_rad + STEP_RAD < period_rad(self.template.yaw_symmetry) { STEP_RAD } else { -STEP_RAD };
        let turned = self.fitted(&Aspect { yaw_rad: aspect.yaw_rad + step_rad, ..*aspect }, amounts);
        turned.iter().zip(lit).map(|(turned, lit)| (turned - lit) / single(step_rad)).collect()
    }

    /// Mean square miss in the latest frame up to which the template holds.
    pub(super) fn miss_max(&self) -> f32 {
        self.template.miss_max + self.noise_miss
    }

    /// What is summed over texels, per texel.
    pub(super) fn per_texel(&self, summed: f32) -> f32 {
        summed / (self.texels.len() as f32 * self.texel_weight)
    }

    /// Whether so much evidence, summed over texels, is more than bare floor gives: as much as a part has even where the light lets it
    /// stand out by far less than it did when taught.
    pub(super) fn stands_out(&self, evidence: f32) -> bool {
        self.per_texel(evidence) >= STANDS_OUT_RATIO * self.template.evidence_min
    }

    /// Prepares for a frame whose bare plateau has this variance.
    pub(super) fn expect_noise(&mut self, variance: f32) {
        let share = |index: &usize| variance / (self.variance(*index, SHADE_SIGMA) + variance);
        self.noise_miss = self.texels.iter().map(share).sum::<f32>() / self.texels.len().max(1) as f32;
        for point in self.turns.iter_mut().flatten().flat_map(|turn| &mut turn.points) {
            point.inverse_sigma = 1.0 / (point.variance + variance).sqrt();
            point.log_inverse_sigma = point.inverse_sigma.ln();
        }
        // Least squares with the modes' spreads for a belief: the amounts are these sums over what the rings miss.
        let mut normal = SMatrix::<f32, LIGHT_MODES, LIGHT_MODES>::identity();
        for ring in &self.rings {
            let effect = SVector::from(ring.effect);
            normal += effect * effect.transpose() / (ring.variance + variance);
        }
        if let Some(factors) = normal.cholesky() {
            for ring in &mut self.rings {
                ring.amounts = factors.solve(&SVector::from(ring.effect)).into();
                ring.amounts.iter_mut().for_each(|amount| *amount /= ring.variance + variance);
            }
        }
    }

    /// Texels that show the part, or lie within `rim_m` of it.
    fn within(&self, rim_m: f64) -> Vec<usize> {
        (0..self.outside_m.len()).filter(|index| self.outside_m[*index] <= single(rim_m)).collect()
    }

    /// Variance of a texel about the template, with `beside_sigma` for what lies beside the part: it may be in the shade of
    /// neighbours.
    pub(super) fn variance(&self, index: usize, beside_sigma: f32) -> f32 {
        let beside = (1.0 - self.inside[index]) * beside_sigma;
        self.template.deviation.values()[index].powi(2)
            + self.light.model_sigma().powi(2)
            + beside * beside
            + self.edge_variance[index]
    }

    /// What a third of a pixel beside changes, squared: the coarse search is no more exact than that.
    fn displacement_variance(&self, picture: &[f32], index: usize) -> f32 {
        let texels_per_px = single(self.m_per_px / self.template.texel_m);
        let (along_x, along_y) = gradient(picture, self.template.side(), index);
        0.11 * texels_per_px.powi(2) * (along_x.powi(2) + along_y.powi(2))
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
        let mean = self.template.mean();
        let deviation = self.template.deviation.values();
        let wall_shade = self.template.wall_shade.values();
        let mut rings = Vec::new();
        while rings.len() as f64 <= self.radius_m / self.m_per_px {
            let radius_m = rings.len() as f64 * self.m_per_px;
            let (mut sum, mut level_square, mut shade) = (0.0, 0.0, 0.0);
            let (mut square, mut within, mut count) = (0.0, 0.0, 0.0_f32);
            let mut effect = [0.0; LIGHT_MODES];
            for spoke in 0..SPOKES {
                let (sin, cos) = (TAU * spoke as f64 / SPOKES as f64).sin_cos();
                let Some(index) = self.texel(Vector2::new(cos, sin) * radius_m) else {
                    continue;
                };
                sum += mean[index];
                level_square += mean[index] * mean[index];
                shade += wall_shade[index];
                square += deviation[index] * deviation[index];
                within += f32::from(u8::from(self.outside_m[index] <= 0.0));
                effect.iter_mut().zip(self.effects.of_light(index)).for_each(|(sum, effect)| *sum += effect);
                count += 1.0;
            }
            let count = count.max(1.0);
            // What of the ring lies beside the part shows the plateau, a shadow or a neighbour.
            let beside = 1.0 - within / count;
            let variance = square / count * 0.25 + (0.3 * beside).powi(2);
            let weight = (rings.len() as f32 + 0.25).sqrt();
            let mean = sum / count;
            let variance_along = (level_square / count - mean * mean).max(0.0);
            let effect = effect.map(|sum| sum / count);
            let amounts = [0.0; LIGHT_MODES];
            rings.push(Ring { mean, wall_shade: shade / count, variance, variance_along, weight, effect, amounts });
        }
        // A ring summed beside the centre sees something of its neighbours.
        let means: Vec<f32> = rings.iter().map(|ring| ring.mean).collect();
        for (index, ring) in rings.iter_mut().enumerate() {
            let (inner, outer) = (index.saturating_sub(1), (index + 1).min(means.len() - 1));
            ring.variance +=
                (0.5 * RING_MISS_PX * (means[outer] - means[inner])).powi(2) + 2.0 * self.light.model_sigma().powi(2);
        }
        let total: f32 = rings.iter().map(|ring| ring.weight).sum();
        for ring in &mut rings {
            ring.weight /= total;
        }
        rings
    }

    /// How far from the centre the nearest thing is that stands out from the plateau, px.
    fn hollow(&self) -> usize {
        let mean = self.template.mean();
        let seen = |index: &usize| self.outside_m[*index] <= 0.0 && mean[*index].abs() > 0.15;
        let distance_m = |index: usize| self.template.place_m(index).norm();
        let nearest_m = (0..mean.len()).filter(seen).map(distance_m).fold(self.radius_m, f64::min);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few pixels")]
        let pixels = (nearest_m / self.m_per_px + 1.0).ceil() as usize;
        pixels
    }
}

/// Slants of the line of sight that the coarse search tells apart, platen frame.
fn slants() -> impl Iterator<Item = Vector2<f64>> {
    let steps = [-SLANT_STEP, 0.0, SLANT_STEP];
    steps.into_iter().flat_map(move |y| steps.into_iter().map(move |x| Vector2::new(x, y)))
}

/// Which of the slants of the coarse search is nearest.
pub(super) fn slant_index(slant: Vector2<f64>) -> usize {
    let step = |value: f64| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0, 1 or 2")]
        let step = ((value / SLANT_STEP).round().clamp(-1.0, 1.0) + 1.0) as usize;
        step
    };
    3 * step(slant.y) + step(slant.x)
}

/// Central differences of a picture, per texel.
pub(super) fn gradient(picture: &[f32], side: usize, index: usize) -> (f32, f32) {
    let (column, row) = (index % side, index / side);
    let (left, right) = (column.saturating_sub(1), (column + 1).min(side - 1));
    let (below, above) = (row.saturating_sub(1), (row + 1).min(side - 1));
    let at = |column: usize, row: usize| picture[row * side + column];
    (0.5 * (at(right, row) - at(left, row)), 0.5 * (at(column, above) - at(column, below)))
}

/// How far outside the outline each texel lies, m.
fn outside_m(template: &PoseTemplate) -> Vec<f32> {
    let outside = |index: usize| single(signed_distance_m(&template.outline_m, &Point2::from(template.place_m(index))));
    (0..template.deviation.values().len()).map(outside).collect()
}

/// Leaves out evenly what is more than `most`.
fn thin<T: Copy>(points: &mut Vec<T>, most: usize) {
    if points.len() > most {
        let count = points.len();
        *points = (0..most).map(|index| points[index * count / most]).collect();
    }
}
