//! What a part looks like from above in one resting pose, as a function of where and how it lies.
//!
//! Brightness is counted relative to the bare plateau in full light. In the part's own directions it is a picture that changes with the
//! part's yaw against the lamp, which stands still, plus what the slant of the line of sight adds:
//!
//! I(u) = Σ hₖ(ψ) Mₖ(u) + X(u) a + Y(u) b + XX(u) a² + XY(u) ab + YY(u) b² + W(u) s,
//!
//! with ψ the part's yaw on the platen within one period of its symmetry, hₖ the weights of linear interpolation between
//! pictures Mₖ evenly spaced over the period, (a, b) the slant in the part's directions, and s what the walls' shade
//! adds to the plateau's brightness there: a part stands out of it. The pictures and the scatter about them are learned from
//! images.

use std::f64::consts::TAU;

use nalgebra::{Point2, Rotation2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::segment::{Plateau, RADIAL_BINS, TaughtLight};
use super::surround::{DIRECTIONS, DISTANCES, Surround};
use feeder_model::camera::single;
use feeder_model::range::OutOfRange;

/// Pictures that tell what the slant adds.
pub(super) const SLANT_PLANES: usize = 5;
/// Largest step of yaw between pictures, rad: shadows turn by as much against the part.
const YAW_STEP_RAD: f64 = 0.21;
/// Most pictures of a pose at yaws over a period.
const YAW_PLANES_MAX: usize = 64;
/// Slant of the line of sight for which the pictures X and Y are stated.
const SLANT_UNIT: f64 = 0.1;
/// Greatest distance of the tray from below the camera, m.
const PLACE_MAX_M: f64 = 10.0;
/// Steps of brightness in a stored picture, per unit.
const STORED_STEPS: f32 = 100.0;
/// Largest side of a picture, texels.
pub(super) const SIDE_MAX: usize = 161;
/// A ring that misses by more standard deviations counts no more than this many.
const RING_MISS_SIGMAS_MAX: f32 = 3.0;
/// The largest mean square miss of rings that there can be.
pub(super) const RING_MISS_MAX: f32 = RING_MISS_SIGMAS_MAX * RING_MISS_SIGMAS_MAX;

/// A picture of small numbers, row by row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "Vec<String>", into = "Vec<String>")]
pub struct Plane {
    width: usize,
    values: Vec<f32>,
}

impl Plane {
    pub(super) fn new(width: usize, values: Vec<f32>) -> Self {
        Self { width, values }
    }

    /// The values, row by row.
    pub(super) fn values(&self) -> &[f32] {
        &self.values
    }

    fn is_square(&self, side: usize) -> bool {
        self.width == side && self.values.len() == side * side
    }
}

impl From<Plane> for Vec<String> {
    /// A row is a line of two hexadecimal digits per entry: hundredths above −128.
    fn from(plane: Plane) -> Self {
        let digits = |value: &f32| {
            let level = feeder_model::camera::grey_level(value * STORED_STEPS + 128.0);
            format!("{level:02x}")
        };
        plane.values.chunks(plane.width.max(1)).map(|row| row.iter().map(digits).collect()).collect()
    }
}

impl TryFrom<Vec<String>> for Plane {
    type Error = String;

    fn try_from(rows: Vec<String>) -> Result<Self, String> {
        let digits = rows.first().map_or(0, String::len);
        let mut values = Vec::with_capacity(rows.len() * digits / 2);
        for row in &rows {
            let bytes = row.as_bytes();
            if bytes.len() != digits || !digits.is_multiple_of(2) || digits == 0 {
                return Err(format!("a row has {} digits; allowed: two an entry, as many in every row", bytes.len()));
            }
            for pair in bytes.chunks(2) {
                let level = std::str::from_utf8(pair).ok().and_then(|pair| u8::from_str_radix(pair, 16).ok());
                let level = level.ok_or_else(|| format!("{row:?} holds something else than hexadecimal digits"))?;
                values.push((f32::from(level) - 128.0) / STORED_STEPS);
            }
        }
        Ok(Self { width: digits / 2, values })
    }
}

/// Lights from all sides in which a part's pictures are taught: from a ring round the lens, from a dome, and low.
pub const LIGHTS_ALL_ROUND: usize = 3;

/// Most lights other than the one taught in which a part is known.
pub(super) const LIGHTS_MAX: usize = LIGHTS_ALL_ROUND + 1;

/// Pictures that tell what it adds that light comes from one side: for the cosine and the sine of its direction, and for those of
/// twice that, without which shadows would be too wide.
pub(super) const SIDES: usize = 4;

/// What a part looks like in another light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LitPicture {
    /// Seen from straight above: at yaws over a period, as the template is, or one where no yaw matters.
    pub at_yaws: Vec<Plane>,
    /// What the slant (a, b) of the line of sight adds, in units of 0.1: times a, b, a², ab and b².
    pub slant: [Plane; SLANT_PLANES],
}

impl LitPicture {
    /// Mean over all yaws, seen from straight above.
    pub(super) fn mean(&self) -> Vec<f32> {
        mean(&self.at_yaws)
    }

    fn picture(&self, aspect: &Aspect, symmetry: u32) -> Vec<f32> {
        let factors = aspect.factors(symmetry, self.at_yaws.len().saturating_sub(1));
        let at_yaws = self.at_yaws[factors.first..].iter().zip(factors.at_yaws);
        weighted(at_yaws.chain(self.slant.iter().zip(factors.slant)))
    }
}

/// A taught resting pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseTemplate {
    /// Height of the part as it lies, m.
    pub height_m: f64,
    /// The turn by one over this many leaves the part as it was; 0 if any turn does.
    pub yaw_symmetry: u32,
    /// Mean square miss of the rings of brightness, in their standard deviations, up to which a place is looked at closely.
    pub ring_miss_max: f32,
    /// Mean square miss of the picture, in standard deviations, up to which a part counts as recognised in this pose: beyond
    /// what noise alone makes it.
    pub miss_max: f32,
    /// Size of a texel, m.
    pub texel_m: f64,
    /// Brightness above the plateau's at yaws evenly spaced over a period of the symmetry, its two ends included; a single
    /// picture if any turn leaves the part as it was.
    pub at_yaws: Vec<Plane>,
    /// What is added per slant of 0.1 along the part's x, and along its y.
    pub slant_x: Plane,
    /// As for x.
    pub slant_y: Plane,
    /// What is added per square or product of those.
    pub slant_xx: Plane,
    /// Per product.
    pub slant_xy: Plane,
    /// Per square along y.
    pub slant_yy: Plane,
    /// Share of the walls' shade on the plateau that lies on what is seen: 0 for none of it, 1 for the plateau itself.
    pub wall_shade: Plane,
    /// Evidence, for each texel, below which something that fits is no part: a stain, faint as it is, is fitted by much.
    pub evidence_min: f32,
    /// Standard deviation about all that.
    pub deviation: Plane,
    /// The part as drawn in other lights: in those that fall alike from all sides, from round the lens, from a dome and low, and,
    /// where it was taught from pictures, in the light in which it was drawn.
    pub lights: Vec<LitPicture>,
    /// What it adds to the part's picture in low light from all sides that it comes from one of them: times the cosine of its direction,
    /// counter-clockwise from the part's x, times the sine, and times those of twice that direction.
    pub from_side: [Plane; SIDES],
    /// Brightness of what parts have round them, relative to the plateau's: for each pixel of distance from the outline a row
    /// of directions on the platen.
    pub surround: Plane,
    /// Scatter of that from part to part.
    pub surround_scatter: Plane,
    /// Convex outline in the part's directions, counter-clockwise, m: what a gripper must reach round.
    #[schemars(with = "Vec<[f64; 2]>")]
    pub outline_m: Vec<Point2<f64>>,
}

/// How a part lies towards lamp and camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aspect {
    /// Yaw against the platen, rad.
    pub yaw_rad: f64,
    /// Slant of the line of sight: way outwards per descent, platen frame.
    pub slant: Vector2<f64>,
}

/// What a picture depends on: factors of the pictures that make it up, and how those change with the yaw, 1/rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Factors {
    /// The picture before the yaw; the one after it follows.
    pub first: usize,
    /// Weights of those two.
    pub at_yaws: [f64; 2],
    pub slant: [f64; SLANT_PLANES],
    pub at_yaws_change: [f64; 2],
    pub slant_change: [f64; SLANT_PLANES],
}

/// Factors of the pictures that tell what it adds that light comes from a direction, rad.
pub(super) fn direction_factors(direction_rad: f64) -> [f64; SIDES] {
    let ((sin, cos), (sin_twice, cos_twice)) = (direction_rad.sin_cos(), (2.0 * direction_rad).sin_cos());
    [cos, sin, cos_twice, sin_twice]
}

/// How many steps of yaw a period is divided into.
pub(super) fn yaw_steps(symmetry: u32) -> usize {
    let period_rad = period_rad(symmetry);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 30")]
    let steps = (period_rad / YAW_STEP_RAD).ceil() as usize;
    steps
}

/// Place of a texel of a picture with this side in the part's directions, m.
pub(super) fn texel_place_m(index: usize, side: usize, texel_m: f64) -> Vector2<f64> {
    let middle = (side / 2) as f64;
    Vector2::new((index % side) as f64 - middle, (index / side) as f64 - middle) * texel_m
}

/// The turn that leaves a part as it was, rad; 0 if any does.
pub(super) fn period_rad(symmetry: u32) -> f64 {
    if symmetry == 0 { 0.0 } else { TAU / f64::from(symmetry) }
}

impl Aspect {
    /// The factors of a pose of this symmetry and this many steps of yaw.
    pub(super) fn factors(&self, symmetry: u32, steps: usize) -> Factors {
        let slant = Rotation2::new(-self.yaw_rad) * self.slant / SLANT_UNIT;
        let (a, b) = (slant.x, slant.y);
        let mut factors = Factors {
            first: 0,
            at_yaws: [1.0, 0.0],
            slant: [a, b, a * a, a * b, b * b],
            at_yaws_change: [0.0, 0.0],
            slant_change: [b, -a, 2.0 * a * b, b * b - a * a, -2.0 * a * b],
        };
        if steps > 0 {
            let per_rad = steps as f64 / period_rad(symmetry);
            let place = (self.yaw_rad * per_rad).clamp(0.0, steps as f64);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
            let first = (place as usize).min(steps - 1);
            let after = place - first as f64;
            factors.first = first;
            factors.at_yaws = [1.0 - after, after];
            factors.at_yaws_change = [-per_rad, per_rad];
        }
        factors
    }
}

/// The sum of pictures times factors.
fn weighted<'a>(planes: impl Iterator<Item = (&'a Plane, f64)>) -> Vec<f32> {
    let mut sums = Vec::new();
    for (plane, factor) in planes {
        let factor = single(factor);
        sums.resize(plane.values.len(), 0.0);
        for (sum, value) in sums.iter_mut().zip(&plane.values) {
            *sum += factor * value;
        }
    }
    sums
}

/// The mean of pictures.
fn mean(planes: &[Plane]) -> Vec<f32> {
    let share = 1.0 / planes.len().max(1) as f64;
    weighted(planes.iter().map(|plane| (plane, share)))
}

impl PoseTemplate {
    /// Texels along a side.
    pub(super) fn side(&self) -> usize {
        self.deviation.width
    }

    /// How many steps of yaw a period is divided into.
    fn steps(&self) -> usize {
        self.at_yaws.len().saturating_sub(1)
    }

    /// What parts have round them.
    pub(super) fn surround(&self) -> Surround {
        Surround::new(&self.surround.values, &self.surround_scatter.values)
    }

    /// The same, as it was learned.
    pub(super) fn set_surround(&mut self, surround: &Surround) {
        let (levels, scatter) = surround.planes();
        self.surround = Plane::new(DIRECTIONS, levels);
        self.surround_scatter = Plane::new(DIRECTIONS, scatter);
    }

    /// Mean over all yaws, seen from straight above.
    pub(super) fn mean(&self) -> Vec<f32> {
        mean(&self.at_yaws)
    }

    /// Place of a texel in the part's directions, m.
    pub(super) fn place_m(&self, index: usize) -> Vector2<f64> {
        texel_place_m(index, self.side(), self.texel_m)
    }

    pub(super) fn slant_planes(&self) -> [&Plane; SLANT_PLANES] {
        [&self.slant_x, &self.slant_y, &self.slant_xx, &self.slant_xy, &self.slant_yy]
    }

    /// The pictures in the order in which a lesson learns them: at yaws, by slant, by the walls' shade.
    pub(super) fn planes(&self) -> Vec<&Plane> {
        self.at_yaws.iter().chain(self.slant_planes()).chain([&self.wall_shade]).collect()
    }

    /// The picture expected under an aspect, whose yaw lies within a period: brightness above the plateau's.
    pub(super) fn picture(&self, aspect: &Aspect) -> Vec<f32> {
        let factors = aspect.factors(self.yaw_symmetry, self.steps());
        self.sum(factors.first, factors.at_yaws, factors.slant)
    }

    /// How that picture changes with the yaw, 1/rad.
    pub(super) fn picture_change(&self, aspect: &Aspect) -> Vec<f32> {
        let factors = aspect.factors(self.yaw_symmetry, self.steps());
        self.sum(factors.first, factors.at_yaws_change, factors.slant_change)
    }

    fn sum(&self, first: usize, at_yaws: [f64; 2], slant: [f64; SLANT_PLANES]) -> Vec<f32> {
        weighted(self.at_yaws[first..].iter().zip(at_yaws).chain(self.slant_planes().into_iter().zip(slant)))
    }

    /// The picture expected under an aspect in each of the other lights.
    pub(super) fn in_other_lights(&self, aspect: &Aspect) -> impl Iterator<Item = Vec<f32>> {
        self.lights.iter().map(move |lit| lit.picture(aspect, self.yaw_symmetry))
    }

    /// What it adds under an aspect that low light comes from one side, as in `from_side`, but for directions from the platen's x.
    pub(super) fn lit_from_sides(&self, aspect: &Aspect) -> [Vec<f32>; SIDES] {
        let [cos, sin, cos_twice, sin_twice] = direction_factors(aspect.yaw_rad);
        let [x, y, xx, xy] = &self.from_side;
        let pairs = [
            [(x, cos), (y, -sin)],
            [(x, sin), (y, cos)],
            [(xx, cos_twice), (xy, -sin_twice)],
            [(xx, sin_twice), (xy, cos_twice)],
        ];
        pairs.map(|pair| weighted(pair.into_iter()))
    }

    /// Checks every number.
    pub(super) fn validate(&self) -> Result<(), OutOfRange> {
        OutOfRange::unless(
            (0.0..=0.1).contains(&self.height_m),
            "part_model.poses.height_m",
            self.height_m,
            "0 to 0.1 m",
        )?;
        let symmetry_ok = self.yaw_symmetry <= 360;
        OutOfRange::unless(symmetry_ok, "part_model.poses.yaw_symmetry", self.yaw_symmetry.into(), "0 to 360")?;
        let miss_ok = (0.0..=RING_MISS_MAX).contains(&self.ring_miss_max);
        OutOfRange::unless(miss_ok, "part_model.poses.ring_miss_max", self.ring_miss_max.into(), "0 to 9")?;
        let miss_ok = (0.01..=16.0).contains(&self.miss_max);
        OutOfRange::unless(miss_ok, "part_model.poses.miss_max", self.miss_max.into(), "0.01 to 16")?;
        let evidence_ok = (-16.0..=16.0).contains(&self.evidence_min);
        OutOfRange::unless(evidence_ok, "part_model.poses.evidence_min", self.evidence_min.into(), "-16 to 16")?;
        for plane in [&self.surround, &self.surround_scatter] {
            let size_ok = plane.width == DIRECTIONS && plane.values.len() == DIRECTIONS * DISTANCES;
            let allowed = "16 rows of 24 entries";
            OutOfRange::unless(size_ok, "part_model.poses.surround", plane.width as f64, allowed)?;
        }
        let texel_ok = (1e-6..=0.01).contains(&self.texel_m);
        OutOfRange::unless(texel_ok, "part_model.poses.texel_m", self.texel_m, "1e-6 to 0.01 m")?;
        let side = self.side();
        let side_ok = !side.is_multiple_of(2) && side <= SIDE_MAX && self.deviation.is_square(side);
        OutOfRange::unless(
            side_ok,
            "part_model.poses.deviation",
            side as f64,
            "a square of an odd number of texels up to 161",
        )?;
        let yaws = self.at_yaws.len();
        let yaws_ok = if self.yaw_symmetry == 0 { yaws == 1 } else { (2..=YAW_PLANES_MAX).contains(&yaws) };
        OutOfRange::unless(
            yaws_ok,
            "part_model.poses.at_yaws",
            yaws as f64,
            "1 picture without a yaw, 2 to 64 with one",
        )?;
        let lights = self.lights.len();
        OutOfRange::unless(
            (LIGHTS_ALL_ROUND..=LIGHTS_MAX).contains(&lights),
            "part_model.poses.lights",
            lights as f64,
            "3 or 4 lights",
        )?;
        for lit in &self.lights {
            let yaws_ok = lit.at_yaws.len() == 1 || lit.at_yaws.len() == yaws;
            let (yaws, allowed) = (lit.at_yaws.len() as f64, "one picture, or as many as the template's");
            OutOfRange::unless(yaws_ok, "part_model.poses.lights.at_yaws", yaws, allowed)?;
        }
        let lit = self.lights.iter().flat_map(|lit| lit.slant.iter().chain(&lit.at_yaws));
        let whole = [&self.wall_shade].into_iter().chain(&self.at_yaws).chain(&self.from_side);
        for plane in self.slant_planes().into_iter().chain(whole).chain(lit) {
            OutOfRange::unless(plane.is_square(side), "part_model.poses", plane.width as f64, "pictures of one size")?;
        }
        let reach_m = self.outline_m.iter().map(|corner| corner.coords.norm()).fold(0.0, f64::max);
        let outline_ok = self.outline_m.len() >= 3 && reach_m > 0.0 && reach_m < 0.5 * side as f64 * self.texel_m;
        OutOfRange::unless(
            outline_ok,
            "part_model.poses.outline_m",
            reach_m,
            "three corners or more, within the pictures",
        )
    }
}

/// A taught part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PartModel {
    /// Light on the bare plateau when the part was taught: coefficients of 1, u, v, u², uv, v² of its grey level, with u
    /// and v from −1 to 1 across the picture.
    pub plateau_light: [f32; 6],
    /// Grey level of the hub's top when the part was taught: by it a frame tells how the light has changed.
    pub hub_level: f32,
    /// Where the tray stood when the part was taught, platen frame but from below the camera, m: elsewhere the light falls
    /// otherwise.
    pub taught_at_m: [f64; 2],
    /// Brightness of the bare plateau above the middle's and relative to it, in bins from the inner wall to the outer: a row
    /// of constants, one per cosine and one per sine of the direction from the tray's centre on the platen.
    pub plateau_shade: Plane,
    /// The part in each resting pose.
    pub poses: Vec<PoseTemplate>,
}

impl PartModel {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming the field out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        let [level, ..] = self.plateau_light;
        let light_ok = (1.0..=255.0).contains(&level) && self.plateau_light.iter().all(|c| c.abs() <= 255.0);
        OutOfRange::unless(
            light_ok,
            "part_model.plateau_light",
            level.into(),
            "a level of 1 to 255, and changes no larger",
        )?;
        let hub_ok = (1.0..=255.0).contains(&self.hub_level);
        OutOfRange::unless(hub_ok, "part_model.hub_level", self.hub_level.into(), "1 to 255")?;
        let [x_m, y_m] = self.taught_at_m;
        let place_ok = x_m.hypot(y_m) <= PLACE_MAX_M;
        OutOfRange::unless(place_ok, "part_model.taught_at_m", x_m.hypot(y_m), "a place within 10 m of the camera")?;
        let shade = &self.plateau_shade;
        let shade_ok = shade.width == RADIAL_BINS && shade.values.len() == 3 * RADIAL_BINS;
        OutOfRange::unless(shade_ok, "part_model.plateau_shade", shade.width as f64, "three rows of 200 entries")?;
        for [constant, cos, sin] in self.shades() {
            let least = f64::from(constant - cos.hypot(sin));
            OutOfRange::unless(
                least >= 0.1,
                "part_model.plateau_shade",
                least,
                "a brightness above 0.1 in any direction",
            )?;
        }
        OutOfRange::unless(!self.poses.is_empty(), "part_model.poses", 0.0, "at least one")?;
        self.poses.iter().try_for_each(PoseTemplate::validate)
    }

    /// For each radial bin the brightness relative to the middle's: constant, per cosine and per sine.
    fn shades(&self) -> impl Iterator<Item = [f32; 3]> {
        let row = |index: usize| self.plateau_shade.values[index * RADIAL_BINS..(index + 1) * RADIAL_BINS].iter();
        row(0).zip(row(1)).zip(row(2)).map(|((constant, cos), sin)| [1.0 + constant, *cos, *sin])
    }

    pub(super) fn plateau(&self) -> Plateau {
        let shade = std::iter::once([1.0, 0.0, 0.0]).chain(self.shades()).collect();
        let at_m = Vector2::from(self.taught_at_m);
        Plateau { taught: Some(TaughtLight { light: self.plateau_light, hub_level: self.hub_level, at_m }), shade }
    }
}
