//! Solids of revolution and extruded polygons, as data.

use std::f64::consts::TAU;

use earcut::Earcut;
use nalgebra::{Point2, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::shape_error::ShapeError;
use crate::range::{OutOfRange, check_range};

/// Sides of the polygon that stands for a circle. Its area is 0.2 % short.
pub(super) const CIRCLE_SIDES: u32 = 64;

/// Most sides of a regular polygon.
const SIDES_MAX: u32 = 360;

/// A simple solid, standing on the part's x–y plane or wherever its numbers put it. Lengths in m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Solid {
    /// A profile turned about the z axis.
    Revolved {
        /// The closed profile as (radius, z), either way round; it may touch the axis.
        profile_m: Vec<[f64; 2]>,
        /// Share of light that comes back, if it is not the part's.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        reflectance: Option<f64>,
    },
    /// A polygon, perhaps with holes, drawn out along z.
    Extruded {
        /// The outer edge.
        outline: Loop,
        /// Holes in it that neither touch it nor each other.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        holes: Vec<Loop>,
        /// Where it begins and ends.
        z_m: [f64; 2],
        /// Share of light that comes back, if it is not the part's.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        reflectance: Option<f64>,
    },
}

/// A closed line in the x–y plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Loop {
    /// A circle, in truth a polygon of 64 sides.
    Circle {
        /// Radius, m.
        radius_m: f64,
        /// Centre, m.
        #[serde(default)]
        centre_m: [f64; 2],
    },
    /// A regular polygon with a side across the x axis.
    Regular {
        /// How many sides.
        sides: u32,
        /// Distance of a side from the centre, m: half the width across flats where the number of sides is even.
        inradius_m: f64,
        /// Centre, m.
        #[serde(default)]
        centre_m: [f64; 2],
    },
    /// Any polygon that does not cross itself, either way round, m.
    Polygon(Vec<[f64; 2]>),
}

/// Triangles being gathered.
#[derive(Debug, Default)]
pub(super) struct Soup {
    pub(super) vertices: Vec<Point3<f64>>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Soup {
    fn vertex(&mut self, x: f64, y: f64, z: f64) -> u32 {
        self.vertices.push(Point3::new(x, y, z));
        u32::try_from(self.vertices.len() - 1).unwrap_or(u32::MAX)
    }

    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

impl Solid {
    /// Share of light that comes back, if it is the solid's own.
    pub(super) fn reflectance(&self) -> Option<f64> {
        match self {
            Self::Revolved { reflectance, .. } | Self::Extruded { reflectance, .. } => *reflectance,
        }
    }

    /// Adds the closed surface of this solid.
    pub(super) fn add_to(&self, soup: &mut Soup) -> Result<(), ShapeError> {
        match self {
            Self::Revolved { profile_m, .. } => revolve(&counter_clockwise("profile_m", profile_m)?, soup),
            Self::Extruded { outline, holes, z_m, .. } => extrude(outline, holes, *z_m, soup),
        }
    }
}

impl Loop {
    /// Corners, counter-clockwise.
    fn corners(&self) -> Result<Vec<Point2<f64>>, ShapeError> {
        let regular = |sides: u32, circumradius: f64, centre: [f64; 2]| {
            let corner = |index: u32| {
                let (sin, cos) = (TAU * (f64::from(index) + 0.5) / f64::from(sides)).sin_cos();
                [centre[0] + circumradius * cos, centre[1] + circumradius * sin]
            };
            (0..sides).map(corner).collect::<Vec<_>>()
        };
        match self {
            Self::Circle { radius_m, centre_m } => {
                OutOfRange::unless_positive("radius_m", *radius_m)?;
                counter_clockwise("circle", &regular(CIRCLE_SIDES, *radius_m, *centre_m))
            }
            Self::Regular { sides, inradius_m, centre_m } => {
                OutOfRange::unless_positive("inradius_m", *inradius_m)?;
                check_range("sides", (*sides).into(), 3.0, SIDES_MAX.into())?;
                let circumradius_m = inradius_m / (TAU / f64::from(2 * sides)).cos();
                counter_clockwise("regular", &regular(*sides, circumradius_m, *centre_m))
            }
            Self::Polygon(corners) => counter_clockwise("polygon", corners),
        }
    }
}

/// The corners of a closed line, counter-clockwise and without those that lie between their neighbours.
fn counter_clockwise(key: &'static str, line: &[[f64; 2]]) -> Result<Vec<Point2<f64>>, ShapeError> {
    for value in line.iter().flatten() {
        OutOfRange::unless(value.is_finite(), key, *value, "finite numbers")?;
    }
    let mut corners: Vec<Point2<f64>> = line.iter().copied().map(Point2::from).collect();
    corners.dedup();
    let mut index = 0;
    while corners.len() > 2 && index < corners.len() {
        let count = corners.len();
        let (before, here, after) =
            (corners[(index + count - 1) % count], corners[index], corners[(index + 1) % count]);
        let (to, on) = (here - before, after - here);
        if to.perp(&on).abs() <= 1e-9 * to.norm() * on.norm() {
            corners.remove(index);
            index = index.saturating_sub(1);
        } else {
            index += 1;
        }
    }
    let doubled_area: f64 = super::outline::edges(&corners).map(|(a, b)| a.coords.perp(&b.coords)).sum();
    let encloses = corners.len() >= 3 && doubled_area != 0.0;
    let area_m2 = 0.5 * doubled_area.abs();
    OutOfRange::unless(encloses, key, area_m2, "a line of three or more corners around an area")?;
    if doubled_area < 0.0 {
        corners.reverse();
    }
    Ok(corners)
}

/// Turns a counter-clockwise profile (r, z) about z.
fn revolve(profile: &[Point2<f64>], soup: &mut Soup) -> Result<(), ShapeError> {
    for corner in profile {
        OutOfRange::unless(corner.x >= 0.0, "profile_m", corner.x, "radii of 0 or more")?;
    }
    // A ring of vertices for each corner, or one vertex where it lies on the axis.
    let rings: Vec<Vec<u32>> = profile
        .iter()
        .map(|corner| {
            let sides = if corner.x == 0.0 { 1 } else { CIRCLE_SIDES };
            let around = (0..sides).map(|side| {
                let (sin, cos) = (TAU * f64::from(side) / f64::from(CIRCLE_SIDES)).sin_cos();
                soup.vertex(corner.x * cos, corner.x * sin, corner.y)
            });
            around.collect()
        })
        .collect();
    for (below, above) in rings.iter().zip(rings.iter().cycle().skip(1)) {
        for side in 0..CIRCLE_SIDES as usize {
            let next = (side + 1) % CIRCLE_SIDES as usize;
            match (below.len(), above.len()) {
                (1, 1) => {}
                (1, _) => soup.triangles.push([below[0], above[next], above[side]]),
                (_, 1) => soup.triangles.push([below[side], below[next], above[0]]),
                _ => soup.quad([below[side], below[next], above[next], above[side]]),
            }
        }
    }
    Ok(())
}

fn extrude(outline: &Loop, holes: &[Loop], z_m: [f64; 2], soup: &mut Soup) -> Result<(), ShapeError> {
    let [bottom, top] = z_m;
    let rises = top > bottom && (top - bottom).is_finite();
    OutOfRange::unless(rises, "z_m", top, format_args!("above its begin of {bottom} m"))?;
    let mut loops = vec![outline.corners()?];
    for hole in holes {
        let mut corners = hole.corners()?;
        corners.reverse();
        loops.push(corners);
    }
    let corners: Vec<Point2<f64>> = loops.iter().flatten().copied().collect();
    let hole_starts: Vec<usize> = loops
        .iter()
        .scan(0, |start, line| {
            *start += line.len();
            Some(*start)
        })
        .take(holes.len())
        .collect();
    let mut cap: Vec<usize> = Vec::new();
    Earcut::new().earcut(corners.iter().map(|corner| [corner.x, corner.y]), &hole_starts, &mut cap);

    let low: Vec<u32> = corners.iter().map(|corner| soup.vertex(corner.x, corner.y, bottom)).collect();
    let high: Vec<u32> = corners.iter().map(|corner| soup.vertex(corner.x, corner.y, top)).collect();
    for triangle in cap.chunks_exact(3) {
        let (a, mut b, mut c) = (triangle[0], triangle[1], triangle[2]);
        if (corners[b] - corners[a]).perp(&(corners[c] - corners[a])) < 0.0 {
            std::mem::swap(&mut b, &mut c);
        }
        soup.triangles.push([high[a], high[b], high[c]]);
        soup.triangles.push([low[a], low[c], low[b]]);
    }
    let mut start = 0;
    for line in &loops {
        for index in 0..line.len() {
            let (here, next) = (start + index, start + (index + 1) % line.len());
            soup.quad([low[here], low[next], high[next], high[here]]);
        }
        start += line.len();
    }
    Ok(())
}
