//! The surfaces of a part as seen from straight above.

use nalgebra::{Point3, Vector2};

use feeder_model::camera::single;

/// A depth buffer seen from above.
pub(super) struct Raster {
    side: usize,
    texel_m: f64,
    pub heights_m: Vec<f64>,
    /// Of the lowest surface that faces down; infinite where none does.
    lowest_m: Vec<f64>,
    pub slopes: Vec<Vector2<f32>>,
    pub reflectances: Vec<f32>,
}

impl Raster {
    pub(super) fn new(side: usize, texel_m: f64) -> Self {
        let texels = side * side;
        Self {
            side,
            texel_m,
            heights_m: vec![0.0; texels],
            lowest_m: vec![f64::INFINITY; texels],
            slopes: vec![Vector2::zeros(); texels],
            // The floor sends back what it does without the part.
            reflectances: vec![1.0; texels],
        }
    }

    /// Height from which up the part is there: 0 where that is no more than `least_m`, and where the part is not.
    pub(super) fn undersides_m(&self, least_m: f64) -> impl Iterator<Item = f64> {
        let columns = self.heights_m.iter().zip(&self.lowest_m);
        columns.map(move |(top_m, lowest_m)| if (least_m..*top_m).contains(lowest_m) { *lowest_m } else { 0.0 })
    }

    /// Draws a triangle, unless it stands upright.
    pub(super) fn draw(&mut self, corners: [Point3<f64>; 3], reflectance: f32) {
        let [a, b, c] = corners;
        let normal = (b - a).cross(&(c - a));
        if normal.z.abs() <= 1e-9 * normal.norm() {
            return;
        }
        let faces = normal.z.signum();
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
                let least = -1e-9 * normal.z.abs();
                if [beside(&a, &b), beside(&b, &c), beside(&c, &a)].iter().any(|beside| faces * beside < least) {
                    continue;
                }
                let height_m = a.z + slope.x * (x - a.x) + slope.y * (y - a.y);
                let index = row * self.side + column;
                if faces < 0.0 {
                    self.lowest_m[index] = self.lowest_m[index].min(height_m);
                } else if height_m > self.heights_m[index] {
                    self.heights_m[index] = height_m;
                    self.slopes[index] = slope.map(single);
                    self.reflectances[index] = reflectance;
                }
            }
        }
    }
}
