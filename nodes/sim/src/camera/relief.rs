//! A part in one resting pose as a map of heights, lit from every side beforehand.
//!
//! The map is what a camera straight above sees; a camera beside sees the same surfaces and the upright faces between
//! them, which the heights imply. What lies under an overhang is not seen. For each direction the lamp may have relative to
//! the part, the brightness of every point is kept, with the shadows that the part throws on itself and on the floor.

use std::f32::consts::TAU;

use nalgebra::{Point3, UnitQuaternion, Vector2};

use super::light::Shading;
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
    /// The upright face that ends at a texel.
    walls: Vec<Option<Wall>>,
    /// How steeply lamps for which brightness is kept fall, as the length of the shadow of a post of unit height.
    steepnesses: Vec<f32>,
    /// Share of the light that the floor throws back.
    thrown_back: f32,
    /// Brightness by steepness and direction of the lamp, then by texel; of the floor, what the part leaves of it.
    brightness: Vec<u8>,
}

/// An upright face.
#[derive(Clone, Copy, Debug)]
struct Wall {
    normal: Vector2<f32>,
    reflectance: f32,
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
        let mut relief = Self {
            side,
            texel_m: single(texel_m),
            top_m: single(top_m),
            radius_m: single(radius_m),
            reach_m: single(reach_m),
            heights_m: raster.heights_m.iter().copied().map(single).collect(),
            walls: Vec::new(),
            steepnesses: steepnesses.to_vec(),
            thrown_back,
            brightness: Vec::new(),
        };
        relief.light(&raster, diffuse);
        relief
    }

    fn light(&mut self, raster: &Raster, diffuse: f32) {
        let wall =
            |index: usize| self.downhill(index).map(|normal| Wall { normal, reflectance: raster.reflectances[index] });
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
            let lamp_tan = 1.0 / steepness.max(1e-3);
            let toward = direction(azimuth) * *steepness;
            for index in 0..self.heights_m.len() {
                let lit = (0.5 + (lamp_tan - horizon[index]) / (PENUMBRA * lamp_tan)).clamp(0.0, 1.0);
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
        let here = self.heights_m[index];
        let (mut downhill, mut lowest) = (Vector2::zeros(), here);
        for (dx, dy) in [(0, 0), (1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (1, 2), (2, 2)] {
            let there = self.heights_m[(row + dy - 1) * self.side + column + dx - 1];
            let away = Vector2::new(dx as f32 - 1.0, dy as f32 - 1.0);
            downhill += away / away.norm() * (here - there);
            lowest = lowest.min(there);
        }
        let length = downhill.norm();
        // Steeper than 63°.
        let upright = here - lowest > 2.0 * self.texel_m && length > 0.0;
        upright.then(|| downhill / length)
    }

    /// Tangent of the angle up to which the part stands in the way, seen from each texel towards an azimuth.
    fn horizon(&self, azimuth: usize) -> Vec<f32> {
        let step = direction(azimuth);
        let mut horizon = vec![0.0_f32; self.heights_m.len()];
        for (row, line) in horizon.chunks_mut(self.side).enumerate() {
            for (column, highest) in line.iter_mut().enumerate() {
                let Some(first) = self.steps_to_part(row, column, step) else { continue };
                let here = self.heights_m[row * self.side + column];
                let rise_m_max = self.top_m - here;
                let mut steps = first.max(1.0);
                // Further on nothing can stand higher against the sky, or high enough to matter.
                while rise_m_max > highest.max(HORIZON_TAN_MIN) * (steps * self.texel_m) {
                    let (x, y) = (column as f32 + 0.5 + steps * step.x, row as f32 + 0.5 + steps * step.y);
                    let Some(there) = self.texel(x, y) else {
                        break;
                    };
                    *highest = highest.max((self.heights_m[there] - here) / (steps * self.texel_m));
                    steps += 1.0;
                }
            }
        }
        horizon
    }

    /// After how many whole steps in a direction the part may begin, seen from a texel; `None` if it lies beside or behind.
    fn steps_to_part(&self, row: usize, column: usize, step: Vector2<f32>) -> Option<f32> {
        let radius = self.radius_m / self.texel_m + 2.0;
        let from_middle = Vector2::new(column as f32 + 0.5, row as f32 + 0.5) - Vector2::repeat(self.middle());
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
        Lamp { relief: self, brightness: &self.brightness[lamp * texels..(lamp + 1) * texels] }
    }
}

/// A relief under a lamp.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp<'a> {
    relief: &'a Relief,
    brightness: &'a [u8],
}

impl Lamp<'_> {
    /// What the part leaves of the light on the floor at a place in texels; `None` under the part.
    pub(super) fn floor(&self, place: Vector2<f32>) -> Option<f32> {
        let Some(index) = self.relief.texel(place.x, place.y) else {
            return Some(1.0);
        };
        let bare = self.relief.heights_m[index] <= 0.0;
        bare.then(|| f32::from(self.brightness[index]) * (1.0 / BRIGHTNESS_UNITS))
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
            if height_m < point.height_m || height_m <= 0.0 {
                continue;
            }
            if height_m - point.height_m > point.drop_m
                && let Some(wall) = relief.walls[index]
            {
                return Sight::Surface(wall.reflectance * (shading.on_wall(wall.normal) + 0.5 * relief.thrown_back));
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

/// The points of a line of sight that is displaced by `shift` texels from the floor to the height `top_m`.
pub(super) fn path(shift: Vector2<f32>, top_m: f32) -> Vec<PathPoint> {
    const STEPS_MAX: f32 = 48.0;
    let steps = shift.norm().ceil().clamp(1.0, STEPS_MAX);
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

fn direction(azimuth: usize) -> Vector2<f32> {
    let (sin, cos) = (TAU * azimuth as f32 / AZIMUTHS as f32).sin_cos();
    Vector2::new(cos, sin)
}

/// A depth buffer seen from above.
struct Raster {
    side: usize,
    texel_m: f64,
    heights_m: Vec<f64>,
    slopes: Vec<Vector2<f32>>,
    reflectances: Vec<f32>,
}

impl Raster {
    fn new(side: usize, texel_m: f64) -> Self {
        let texels = side * side;
        Self {
            side,
            texel_m,
            heights_m: vec![0.0; texels],
            slopes: vec![Vector2::zeros(); texels],
            // The floor sends back what it does without the part.
            reflectances: vec![1.0; texels],
        }
    }

    /// Draws a triangle if it faces up.
    fn draw(&mut self, corners: [Point3<f64>; 3], reflectance: f32) {
        let [a, b, c] = corners;
        let normal = (b - a).cross(&(c - a));
        if normal.z <= 1e-9 * normal.norm() {
            return;
        }
        let slope = Vector2::new(-normal.x, -normal.y) / normal.z;
        // The part's origin lies where texels meet, and with it edges at whole numbers of texels. In the middle of texels a
        // rounding would decide whether those belong to the part.
        let middle = (self.side / 2) as f64 - 0.5;
        let place = |x_m: f64| x_m / self.texel_m + middle;
        let range = |values: [f64; 3]| {
            let low = values.into_iter().fold(f64::INFINITY, f64::min);
            let high = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
            let range = (place(low).ceil() as usize)..((place(high).floor() + 1.0).max(0.0) as usize).min(self.side);
            range
        };
        let (columns, rows) = (range(corners.map(|p| p.x)), range(corners.map(|p| p.y)));
        for row in rows {
            let y = (row as f64 - middle) * self.texel_m;
            for column in columns.clone() {
                let x = (column as f64 - middle) * self.texel_m;
                let beside = |from: &Point3<f64>, to: &Point3<f64>| {
                    (to.x - from.x) * (y - from.y) - (to.y - from.y) * (x - from.x)
                };
                // A hair outside counts, so that no gap opens between triangles.
                let least = -1e-9 * normal.z;
                if beside(&a, &b) < least || beside(&b, &c) < least || beside(&c, &a) < least {
                    continue;
                }
                let height_m = a.z + slope.x * (x - a.x) + slope.y * (y - a.y);
                let index = row * self.side + column;
                if height_m > self.heights_m[index] {
                    self.heights_m[index] = height_m;
                    self.slopes[index] = slope.map(single);
                    self.reflectances[index] = reflectance;
                }
            }
        }
    }
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

    #[test]
    fn a_part_is_as_large_as_it_is_where_its_edges_fall_on_texels_and_beside() {
        // In 0.1 mm go both sides a whole number of times; a camera that hangs a little higher or lower sees other texels.
        for texel_m in [0.000_1, 0.000_099_9, 0.000_100_1, 0.000_099_5, 0.000_100_5] {
            let excess = area_m2(texel_m) / 24e-6 - 1.0;
            assert!(excess.abs() < 0.015, "{texel_m}: {excess}");
        }
    }
}
