//! A part in one resting pose as a map of heights, lit from every side beforehand.
//!
//! The map is what a camera straight above sees; a camera beside sees the same surfaces and the upright faces between
//! them, which the heights imply, and under overhangs: each point of the map is solid from its top down to the lowest of the part
//! there. For each direction the lamp may have relative to the part, the brightness of every point is kept, with the shadows that
//! the part throws on itself and on the floor. The floor under an overhang is taken to be as bright as the nearest beside it: no more than
//! a strip along the edge is ever seen.

use std::collections::VecDeque;
use std::f32::consts::TAU;

use nalgebra::{Point3, UnitQuaternion, Vector2};

use super::light::Shading;
use super::raster::Raster;
use super::solid::PartSolid;
use feeder_model::camera::single;

/// Directions of the lamp that brightness is kept for.
const AZIMUTHS: usize = 64;
/// Table units per unit of brightness: 1.5 times that of level white fits into a byte.
const BRIGHTNESS_UNITS: f32 = 170.0;
/// Share of the lamp's steepness over which a shadow fades in: the lamp is no point.
const PENUMBRA: f32 = 0.35;
/// What stands lower against the sky than this hides no light worth counting.
const HORIZON_TAN_MIN: f32 = 0.35;
/// Heights of the part over which it dims the floor around.
const DIMMING_HEIGHTS: f64 = 1.2;
/// Largest side of a map.
const SIDE_MAX: f64 = 640.0;

/// A resting pose, seen from above.
#[derive(Clone, Debug)]
pub(super) struct Relief {
    /// Texels along either side; the part's origin lies in the middle.
    side: usize,
    pub(super) texel_m: f32,
    /// Height of the highest point, m.
    pub(super) top_m: f32,
    /// Radius of the part about its origin, and with the shadows, m.
    pub(super) radius_m: f32,
    pub(super) reach_m: f32,
    /// Height of the surface, m; 0 is the floor.
    heights_m: Vec<f32>,
    /// Height from which up the part is there, m: more than 0 under an overhang.
    undersides_m: Vec<f32>,
    /// Whether that is so anywhere.
    overhangs: bool,
    /// The texel whose floor is seen at a texel: itself, or under an overhang the nearest bare one.
    floors: Vec<usize>,
    /// The upright face that ends at a texel.
    walls: Vec<Option<Box<Wall>>>,
    /// How steeply lamps for which brightness is kept fall, as the length of the shadow of a post of unit height.
    steepnesses: Vec<f32>,
    /// Share of the light that the floor throws back.
    thrown_back: f32,
    /// Brightness by steepness and direction of the lamp, then by texel; of the floor, what the part leaves of it.
    brightness: Vec<u8>,
}

/// An upright face.
#[derive(Clone, Debug)]
struct Wall {
    normal: Vector2<f32>,
    reflectance: f32,
    /// Share of the light from the sky and the floor before it that the part leaves it.
    open: f32,
    /// For each azimuth the tangent of the angle up to which the part stands in the way, seen from half way up.
    horizon: [f32; AZIMUTHS],
}

impl Wall {
    /// How bright it is under a lamp.
    fn brightness(&self, shading: &Shading, (azimuth, lamp_tan): (usize, f32), thrown_back: f32) -> f32 {
        let from_lamp = arriving(lamp_tan, self.horizon[azimuth]) * shading.lamp_on_wall(self.normal);
        self.reflectance * (from_lamp + self.open * 0.5 * (shading.diffuse() + thrown_back))
    }
}

/// What a line of sight meets.
#[derive(Clone, Copy, Debug)]
pub(super) enum Sight {
    /// Nothing of the part.
    Floor,
    /// A surface with this brightness relative to level white.
    Surface(f32),
}

impl Relief {
    /// `diffuse` is the share of the light that is diffuse; the rest falls as steeply as any of `steepnesses` says. The floor throws
    /// the share `thrown_back` of it onto upright faces and slopes.
    pub(super) fn new(
        solid: &PartSolid,
        pose: &UnitQuaternion<f64>,
        texel_m: f64,
        diffuse: f32,
        steepnesses: &[f32],
        thrown_back: f32,
    ) -> Self {
        let vertices: Vec<Point3<f64>> = solid.mesh.vertices().iter().map(|vertex| pose * vertex).collect();
        let lowest_m = vertices.iter().map(|vertex| vertex.z).fold(f64::INFINITY, f64::min);
        let top_m = vertices.iter().map(|vertex| vertex.z).fold(f64::NEG_INFINITY, f64::max) - lowest_m;
        let radius_m = vertices.iter().map(|vertex| vertex.coords.xy().norm()).fold(0.0, f64::max);
        let steepness = f64::from(steepnesses.iter().copied().fold(0.0, f32::max));
        let reach_m = radius_m + top_m * (steepness * (1.0 + f64::from(PENUMBRA))).max(DIMMING_HEIGHTS) + texel_m;
        let texel_m = texel_m.max(2.0 * reach_m / SIDE_MAX);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most SIDE_MAX and positive")]
        let side = ((2.0 * reach_m / texel_m).ceil() as usize).next_multiple_of(2);
        let mut raster = Raster::new(side, texel_m);
        for (triangle, reflectance) in solid.mesh.triangles().iter().zip(solid.mesh.reflectance()) {
            let corners = triangle.map(|corner| {
                let vertex = vertices[corner as usize];
                Point3::new(vertex.x, vertex.y, vertex.z - lowest_m)
            });
            raster.draw(corners, single(*reflectance));
        }
        let undersides_m: Vec<f32> = raster.undersides_m(2.0 * texel_m).map(single).collect();
        let mut relief = Self {
            side,
            texel_m: single(texel_m),
            top_m: single(top_m),
            radius_m: single(radius_m),
            reach_m: single(reach_m),
            heights_m: raster.heights_m.iter().copied().map(single).collect(),
            overhangs: undersides_m.iter().any(|underside_m| *underside_m > 0.0),
            undersides_m,
            floors: Vec::new(),
            walls: Vec::new(),
            steepnesses: steepnesses.to_vec(),
            thrown_back,
            brightness: Vec::new(),
        };
        relief.floors = relief.floors();
        relief.light(&raster, diffuse);
        relief
    }

    /// See the field of this name.
    fn floors(&self) -> Vec<usize> {
        let mut floors: Vec<usize> = (0..self.heights_m.len()).collect();
        let mut reached: Vec<bool> = self.heights_m.iter().map(|height_m| *height_m <= 0.0).collect();
        let mut border: VecDeque<usize> = (0..reached.len()).filter(|index| reached[*index]).collect();
        while let Some(index) = border.pop_front() {
            for beside in self.beside(index) {
                if !reached[beside] && self.undersides_m[beside] > 0.0 {
                    (reached[beside], floors[beside]) = (true, floors[index]);
                    border.push_back(beside);
                }
            }
        }
        floors
    }

    /// The texels that touch a texel's sides.
    fn beside(&self, index: usize) -> impl Iterator<Item = usize> {
        let (side, column, row) = (self.side, index % self.side, index / self.side);
        let left = (column > 0).then(|| index - 1);
        let right = (column + 1 < side).then(|| index + 1);
        let below = (row > 0).then(|| index - side);
        let above = (row + 1 < side).then(|| index + side);
        [left, right, below, above].into_iter().flatten()
    }

    fn light(&mut self, raster: &Raster, diffuse: f32) {
        let wall = |index: usize| self.wall(index, self.downhill(index)?, raster.reflectances[index]).map(Box::new);
        self.walls = (0..self.heights_m.len()).map(wall).collect();
        let horizons: Vec<Vec<f32>> = (0..AZIMUTHS).map(|azimuth| self.horizon(azimuth)).collect();
        let openness: Vec<f32> = (0..self.heights_m.len())
            .map(|index| {
                let open = horizons.iter().map(|horizon| 1.0 / (1.0 + horizon[index] * horizon[index]));
                let hidden = 1.0 - open.sum::<f32>() / AZIMUTHS as f32;
                1.0 - hidden * self.fading(index)
            })
            .collect();
        let lamps =
            self.steepnesses.iter().flat_map(|steepness| horizons.iter().enumerate().map(move |to| (steepness, to)));
        let mut brightness = Vec::with_capacity(self.steepnesses.len() * AZIMUTHS * self.heights_m.len());
        for (steepness, (azimuth, horizon)) in lamps {
            let lamp_tan = lamp_tan(*steepness);
            let toward = direction(azimuth) * *steepness;
            for index in 0..self.heights_m.len() {
                let lit = arriving(lamp_tan, horizon[index]);
                let slope = raster.slopes[index];
                let level = 1.0 / (1.0 + slope.norm_squared()).sqrt();
                let facing = (1.0 - slope.dot(&toward)).max(0.0) * level;
                let from_floor = self.thrown_back * 0.5 * (1.0 - level);
                let light = diffuse * openness[index] + (1.0 - diffuse) * lit * facing + from_floor;
                brightness
                    .push(feeder_model::camera::grey_level(raster.reflectances[index] * light * BRIGHTNESS_UNITS));
            }
        }
        self.brightness = brightness;
    }

    /// 1 near the part, falling to 0 at the border of the map, so that no step shows there.
    fn fading(&self, index: usize) -> f32 {
        let place = |index: usize| (index as f32 + 0.5 - self.middle()) * self.texel_m;
        let radius_m = place(index % self.side).hypot(place(index / self.side));
        ((self.reach_m - radius_m) / (0.7 * (self.reach_m - self.radius_m))).clamp(0.0, 1.0)
    }

    /// The direction downhill where an upright face ends at a texel.
    fn downhill(&self, index: usize) -> Option<Vector2<f32>> {
        let (column, row) = (index % self.side, index / self.side);
        if column == 0 || row == 0 || column + 1 == self.side || row + 1 == self.side {
            return None;
        }
        let (top_m, underside_m) = (self.heights_m[index], self.undersides_m[index]);
        let (mut downhill, mut most_m) = (Vector2::zeros(), 0.0_f32);
        for (dx, dy) in [(0, 0), (1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (1, 2), (2, 2)] {
            let there = (row + dy - 1) * self.side + column + dx - 1;
            let away = Vector2::new(dx as f32 - 1.0, dy as f32 - 1.0);
            // How much of it there is nothing beside, above and, under an overhang, below.
            let (above_m, below_m) = (top_m - self.heights_m[there], self.undersides_m[there] - underside_m);
            downhill += away / away.norm() * (above_m + below_m.max(0.0));
            most_m = most_m.max(above_m).max(below_m);
        }
        let length = downhill.norm();
        // Steeper than 63°.
        let upright = most_m > 2.0 * self.texel_m && length > 0.0;
        upright.then(|| downhill / length)
    }

    /// The upright face that ends at a texel and faces this way.
    fn wall(&self, index: usize, normal: Vector2<f32>, reflectance: f32) -> Option<Wall> {
        // What lies before it, clear of it where it runs aslant of the map.
        const BEFORE_TEXELS: f32 = 1.5;
        let before = self.place(index) + normal * BEFORE_TEXELS;
        let foot_m = self.texel(before.x, before.y).map(|before| self.heights_m[before])?;
        let top_m = self.heights_m[index];
        // Under an overhang what lies before it is above it.
        let foot_m = if foot_m < top_m { foot_m.max(self.undersides_m[index]) } else { 0.0 };
        let middle_m = 0.5 * (top_m + foot_m);
        let horizon = std::array::from_fn(|azimuth| self.against_sky(before, middle_m, direction(azimuth)));
        // A face sees what is before it by the cosine, and by the cosine squared of the height.
        let seen = |(azimuth, horizon_tan): (usize, &f32)| {
            let height = horizon_tan.atan();
            let facing = direction(azimuth).dot(&normal).max(0.0);
            (facing, facing * (1.0 - 2.0 * std::f32::consts::FRAC_1_PI * (height + height.sin() * height.cos())))
        };
        let seen = horizon.iter().enumerate().map(seen);
        let (all, open) = seen.fold((0.0, 0.0), |(all, open), (facing, seen)| (all + facing, open + seen));
        Some(Wall { normal, reflectance, open: open / all, horizon })
    }

    /// Tangent of the angle up to which the part stands in the way, seen from each texel towards an azimuth.
    fn horizon(&self, azimuth: usize) -> Vec<f32> {
        let towards = direction(azimuth);
        let seen = |index: usize| self.against_sky(self.place(index), self.heights_m[index], towards);
        (0..self.heights_m.len()).map(seen).collect()
    }

    /// The same seen from a place in texels and a height.
    fn against_sky(&self, from: Vector2<f32>, height_m: f32, step: Vector2<f32>) -> f32 {
        let mut highest = 0.0_f32;
        let Some(first) = self.steps_to_part(from, step) else { return highest };
        let rise_m_max = self.top_m - height_m;
        let mut steps = first.max(1.0);
        // Further on nothing can stand higher against the sky, or high enough to matter.
        while rise_m_max > highest.max(HORIZON_TAN_MIN) * (steps * self.texel_m) {
            let place = from + steps * step;
            let Some(there) = self.texel(place.x, place.y) else {
                break;
            };
            highest = highest.max((self.heights_m[there] - height_m) / (steps * self.texel_m));
            steps += 1.0;
        }
        highest
    }

    /// After how many whole steps in a direction the part may begin, seen from a place in texels; `None` if it lies beside or behind.
    fn steps_to_part(&self, from: Vector2<f32>, step: Vector2<f32>) -> Option<f32> {
        let radius = self.radius_m / self.texel_m + 2.0;
        let from_middle = from - Vector2::repeat(self.middle());
        let outside = from_middle.norm_squared() - radius * radius;
        if outside <= 0.0 {
            return Some(0.0);
        }
        let nearer = -from_middle.dot(&step);
        let half_chord = nearer * nearer - outside;
        (nearer > 0.0 && half_chord >= 0.0).then(|| (nearer - half_chord.sqrt()).floor())
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked, and a float cast saturates")]
    fn texel(&self, x: f32, y: f32) -> Option<usize> {
        let inside = x >= 0.0 && y >= 0.0 && x < self.side as f32 && y < self.side as f32;
        inside.then(|| y as usize * self.side + x as usize)
    }

    /// Texel coordinates of a texel's middle.
    fn place(&self, index: usize) -> Vector2<f32> {
        Vector2::new((index % self.side) as f32, (index / self.side) as f32).add_scalar(0.5)
    }

    /// Texel coordinates of the part's origin.
    pub(super) fn middle(&self) -> f32 {
        (self.side / 2) as f32
    }

    /// The entry of the brightness table that is nearest to a lamp at `azimuth_rad` in the part's frame whose light falls so steeply.
    pub(super) fn lamp(&self, azimuth_rad: f64, steepness: f32) -> Lamp<'_> {
        let off = |index: &usize| (self.steepnesses[*index] - steepness).abs();
        let steep = (0..self.steepnesses.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0);
        let turns = (azimuth_rad / std::f64::consts::TAU).rem_euclid(1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to AZIMUTHS")]
        let azimuth = (turns * AZIMUTHS as f64).round() as usize % AZIMUTHS;
        let lamp = steep * AZIMUTHS + azimuth;
        let texels = self.heights_m.len();
        let brightness = &self.brightness[lamp * texels..(lamp + 1) * texels];
        Lamp {
            relief: self,
            azimuth,
            lamp_tan: lamp_tan(self.steepnesses.get(steep).copied().unwrap_or(0.0)),
            brightness,
        }
    }
}

/// A relief under a lamp.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp<'a> {
    relief: &'a Relief,
    azimuth: usize,
    lamp_tan: f32,
    brightness: &'a [u8],
}

impl Lamp<'_> {
    /// What the part leaves of the light on the floor at a place in texels; `None` where the part stands.
    pub(super) fn floor(&self, place: Vector2<f32>) -> Option<f32> {
        let Some(index) = self.relief.texel(place.x, place.y) else {
            return Some(1.0);
        };
        let bare = self.relief.heights_m[index] <= 0.0 || self.relief.undersides_m[index] > 0.0;
        bare.then(|| f32::from(self.brightness[self.relief.floors[index]]) * (1.0 / BRIGHTNESS_UNITS))
    }

    /// Follows a line of sight that reaches the floor at `place` (texels), coming from the points `path` above it, highest
    /// first. Upright faces are lit by `shading`, which is in the part's frame.
    pub(super) fn look(&self, place: Vector2<f32>, path: &[PathPoint], shading: &Shading) -> Sight {
        let relief = self.relief;
        for point in path {
            let (x, y) = (place.x + point.offset.x, place.y + point.offset.y);
            let Some(index) = relief.texel(x, y) else {
                continue;
            };
            let height_m = relief.heights_m[index];
            let is_under = relief.undersides_m[index] > point.height_m + point.drop_m;
            if height_m < point.height_m || height_m <= 0.0 || is_under {
                continue;
            }
            if height_m - point.height_m > point.drop_m
                && let Some(wall) = &relief.walls[index]
            {
                return Sight::Surface(wall.brightness(shading, (self.azimuth, self.lamp_tan), relief.thrown_back));
            }
            return Sight::Surface(f32::from(self.brightness[index]) * (1.0 / BRIGHTNESS_UNITS));
        }
        Sight::Floor
    }
}

/// A point of a line of sight.
#[derive(Clone, Copy, Debug)]
pub(super) struct PathPoint {
    /// Beside the line's foot, texels.
    offset: Vector2<f32>,
    height_m: f32,
    /// Descent since the point before, m.
    drop_m: f32,
}

/// The points of a line of sight through a relief that is displaced by `shift` texels from the floor to the relief's top.
pub(super) fn path(shift: Vector2<f32>, relief: &Relief) -> Vec<PathPoint> {
    const STEPS_MAX: f32 = 48.0;
    // What overhangs seems to reach down by a step.
    let steps_min = if relief.overhangs { 16.0 } else { 1.0 };
    let steps = shift.norm().ceil().clamp(steps_min, STEPS_MAX);
    let top_m = relief.top_m;
    let drop_m = top_m / steps;
    let mut points = Vec::new();
    let mut step = 0.0;
    while step < steps {
        // The first look is a hair below the top, so that what lies there is met.
        let share = (1.0 - step / steps - 1e-3).max(0.0);
        points.push(PathPoint { offset: shift * share, height_m: top_m * share, drop_m: 1.01 * drop_m + 1e-6 });
        step += 1.0;
    }
    points.push(PathPoint { offset: Vector2::zeros(), height_m: 0.0, drop_m: 1.01 * drop_m + 1e-6 });
    points
}

/// Tangent of the height of a lamp whose light falls so steeply.
fn lamp_tan(steepness: f32) -> f32 {
    1.0 / steepness.max(1e-3)
}

/// Share of a lamp's light that arrives where something stands in the way up to a height, both as tangents.
fn arriving(lamp_tan: f32, horizon_tan: f32) -> f32 {
    (0.5 + (lamp_tan - horizon_tan) / (PENUMBRA * lamp_tan)).clamp(0.0, 1.0)
}

fn direction(azimuth: usize) -> Vector2<f32> {
    let (sin, cos) = (TAU * azimuth as f32 / AZIMUTHS as f32).sin_cos();
    Vector2::new(cos, sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Area of the texels that show a block of 6 x 4 mm, lying flat, m².
    fn area_m2(texel_m: f64) -> f64 {
        let solid = PartSolid::of_catalogue("block");
        let relief = Relief::new(&solid, &solid.poses[0], texel_m, 1.0, &[0.0], 0.0);
        relief.heights_m.iter().filter(|height_m| **height_m > 0.0).count() as f64 * texel_m.powi(2)
    }

    const TEXEL_M: f64 = 0.000_08;

    /// A grommet with its flange of 5 mm up, on a boss of 3 mm: 2 mm high, the flange from 1.2 mm.
    fn grommet() -> Relief {
        let solid = PartSolid::of_catalogue("grommet");
        Relief::new(&solid, &solid.poses[0], TEXEL_M, 0.5, &[0.5], 0.0)
    }

    /// What is seen along the x axis from a slant to the left through a place on the floor, m from the part's middle, with the lamp to the left.
    fn seen_from_the_left(relief: &Relief, x_m: f32, slant: f32) -> Sight {
        let towards_eye = -relief.top_m * slant / relief.texel_m;
        let place = Vector2::new(relief.middle() + x_m / relief.texel_m, relief.middle() + 0.5);
        let shading = Shading::of_lamp(0.5, Vector2::new(-0.5, 0.0));
        let lamp = relief.lamp(std::f64::consts::PI, 0.5);
        lamp.look(place, &path(Vector2::new(towards_eye, 0.0), relief), &shading)
    }

    #[test]
    fn the_floor_under_an_overhang_is_seen_from_aside_and_what_overhangs_is_not_drawn_down_to_it() {
        let relief = grommet();
        let is_floor = |x_m: f32| matches!(seen_from_the_left(&relief, x_m, 0.2), Sight::Floor);
        // Its lower edge, 1.2 mm up at 2.5 mm to the left, hides the floor from 0.24 mm to the right of it on; drawn down to the floor it
        // would from there on.
        assert!(is_floor(-0.0026) && is_floor(-0.0024) && !is_floor(-0.0021));
        // To the right its upper edge, 2 mm up, hides 0.4 mm of the floor beyond.
        assert!(!is_floor(0.0028) && is_floor(0.0030));
        // Nor is it so dark there that it could not be told from the flange's side: as dark as beside.
        let lamp = relief.lamp(std::f64::consts::PI, 0.5);
        let floor = |x_m: f32| lamp.floor(Vector2::new(relief.middle() + x_m / relief.texel_m, relief.middle() + 0.5));
        assert!(floor(-0.0024).is_some() && floor(-0.0024) == floor(-0.00256) && floor(-0.001).is_none());
    }

    #[test]
    fn the_wall_of_a_bore_is_in_the_dark_and_a_wall_outside_is_not() {
        let relief = grommet();
        let wall = |x_m: f32| {
            relief.walls[relief.texel(relief.middle() + x_m / relief.texel_m, relief.middle() + 0.5).unwrap()].clone()
        };
        let (bore, outside) = (wall(0.000_72).unwrap(), wall(-0.002_48).unwrap());
        // Both face the lamp to the left.
        assert!(bore.normal.x < -0.9 && outside.normal.x < -0.9, "{bore:?} {outside:?}");
        assert!(outside.open > 0.99 && (0.1..0.6).contains(&bore.open), "{} {}", outside.open, bore.open);
        let shading = Shading::of_lamp(0.5, Vector2::new(-0.5, 0.0));
        let lit = |wall: &Wall| wall.brightness(&shading, (AZIMUTHS / 2, 2.0), 0.0) / wall.reflectance;
        assert!(
            (lit(&outside) - 0.5).abs() < 0.01 && lit(&bore) < 0.7 * lit(&outside),
            "{} {}",
            lit(&outside),
            lit(&bore)
        );
    }

    #[test]
    fn a_part_is_as_large_as_it_is_where_its_edges_fall_on_texels_and_beside() {
        // In 0.1 mm go both sides a whole number of times; a camera that hangs a little higher or lower sees other texels.
        for texel_m in [0.000_1, 0.000_099_9, 0.000_100_1, 0.000_099_5, 0.000_100_5] {
            let excess = area_m2(texel_m) / 24e-6 - 1.0;
            assert!(excess.abs() < 0.015, "{texel_m}: {excess}");
        }
    }
}
