//! Parts strewn over the plateau without overlap, up to a crowd.

use std::f64::consts::TAU;

use feeder_model::camera::MountedTray;
use feeder_model::geometry::StablePose;
use feeder_vision::LaidPart;
use nalgebra::{Isometry2, Point2, Vector2};
use rand::{Rng, RngExt};

/// Sweeps of small moves that stir a crowd between two frames, and how often parts are looked for room between sweeps.
const SWEEPS: usize = 6;
const TRIES: usize = 60;
/// Sweeps after which a crowd is as dense as it will get.
const SWEEPS_MAX: usize = 400;
/// A small move: share of a part's radius, and rad.
const MOVE_RATIO: f64 = 0.3;
const MOVE_RAD: f64 = 0.4;

/// Parts on the plateau.
pub(crate) struct Crowd<'a> {
    tray: &'a MountedTray,
    poses: &'a [StablePose],
    /// Share of the plateau that parts are to cover.
    area_fraction: f64,
    parts: Vec<LaidPart>,
    outlines: Vec<Vec<Point2<f64>>>,
    covered_m2: f64,
}

impl<'a> Crowd<'a> {
    pub(crate) fn new(tray: &'a MountedTray, poses: &'a [StablePose], area_fraction: f64) -> Self {
        Self { tray, poses, area_fraction, parts: Vec::new(), outlines: Vec::new(), covered_m2: 0.0 }
    }

    /// The parts.
    pub(crate) fn parts(&self) -> &[LaidPart] {
        &self.parts
    }

    /// Share of the plateau that they cover.
    pub(crate) fn covered_fraction(&self) -> f64 {
        self.covered_m2 / self.plateau_m2()
    }

    fn plateau_m2(&self) -> f64 {
        let geometry = &self.tray.geometry;
        0.5 * (TAU - geometry.ramp_angle_rad) * (geometry.outer_radius_m.powi(2) - geometry.inner_radius_m.powi(2))
    }

    /// Begins anew.
    pub(crate) fn strew(&mut self, random: &mut impl Rng) {
        self.parts.clear();
        self.outlines.clear();
        self.covered_m2 = 0.0;
        for _ in 0..SWEEPS_MAX {
            if self.fill(random) {
                return;
            }
            self.sweep(random);
        }
    }

    /// Moves every part a little several times.
    pub(crate) fn stir(&mut self, random: &mut impl Rng) {
        for _ in 0..SWEEPS {
            self.sweep(random);
        }
        self.fill(random);
    }

    /// Adds parts wherever there is room; tells whether there are enough.
    fn fill(&mut self, random: &mut impl Rng) -> bool {
        let wanted_m2 = self.area_fraction * self.plateau_m2();
        let geometry = &self.tray.geometry;
        for _ in 0..TRIES {
            let pose = random.random_range(0..self.poses.len());
            let area_m2 = self.poses[pose].outline.area_m2();
            if self.covered_m2 + 0.5 * area_m2 > wanted_m2 {
                return true;
            }
            let square = random.random_range(geometry.inner_radius_m.powi(2)..geometry.outer_radius_m.powi(2));
            let angle_rad = random.random_range(geometry.ramp_angle_rad..TAU);
            let place = Point2::new(angle_rad.cos(), angle_rad.sin()) * square.sqrt();
            let part = LaidPart { pose, place, yaw_rad: random.random_range(0.0..TAU) };
            let outline = self.outline(&part);
            if self.is_free(&outline, None, &part) {
                self.covered_m2 += area_m2;
                self.parts.push(part);
                self.outlines.push(outline);
            }
        }
        false
    }

    fn sweep(&mut self, random: &mut impl Rng) {
        for index in 0..self.parts.len() {
            let mut part = self.parts[index];
            let reach_m = MOVE_RATIO * self.poses[part.pose].outline.radius_m;
            part.place += Vector2::new(random.random_range(-reach_m..reach_m), random.random_range(-reach_m..reach_m));
            part.yaw_rad += random.random_range(-MOVE_RAD..MOVE_RAD);
            let outline = self.outline(&part);
            if self.is_free(&outline, Some(index), &part) {
                self.parts[index] = part;
                self.outlines[index] = outline;
            }
        }
    }

    /// The outline of a part where it lies.
    pub(crate) fn outline(&self, part: &LaidPart) -> Vec<Point2<f64>> {
        self.poses[part.pose].outline.at(&Isometry2::new(part.place.coords, part.yaw_rad))
    }

    fn is_free(&self, outline: &[Point2<f64>], own: Option<usize>, part: &LaidPart) -> bool {
        let geometry = &self.tray.geometry;
        let on_plateau = edges(outline).all(|(from, to)| {
            let middle = nalgebra::center(&from, &to);
            [from, middle].iter().all(|point| {
                let radius_m = point.coords.norm();
                radius_m > geometry.inner_radius_m
                    && radius_m < geometry.outer_radius_m
                    && self.tray.inside_sector_m(*point) > 0.0
            })
        });
        on_plateau
            && self.parts.iter().zip(&self.outlines).enumerate().all(|(index, (other, other_outline))| {
                own == Some(index) || self.circles_gap_m(part, other) > 0.0 || gap_m(outline, other_outline) > 0.0
            })
    }

    /// Gap between the circles round two parts, m: the parts are no nearer.
    fn circles_gap_m(&self, a: &LaidPart, b: &LaidPart) -> f64 {
        let reach_m = |part: &LaidPart| self.poses[part.pose].outline.radius_m;
        (a.place - b.place).norm() - reach_m(a) - reach_m(b)
    }

    /// Free gap from a part to its nearest neighbour, m.
    pub(crate) fn part_gap_m(&self, index: usize) -> f64 {
        let part = &self.parts[index];
        let others = self.parts.iter().zip(&self.outlines).enumerate().filter(|(other, _)| *other != index);
        others.fold(f64::INFINITY, |nearest_m, (_, (other, outline))| {
            // The circles round them tell of most that they are no nearer.
            if self.circles_gap_m(part, other) >= nearest_m {
                nearest_m
            } else {
                nearest_m.min(gap_m(&self.outlines[index], outline))
            }
        })
    }

    /// Distance of a part's outline from the edges where ramp and drop-off begin, m.
    pub(crate) fn edge_gap_m(&self, index: usize) -> f64 {
        let corners = self.outlines[index].iter();
        corners.map(|corner| self.tray.inside_sector_m(*corner)).fold(f64::INFINITY, f64::min)
    }

    /// Free gap from a part to the nearer wall, m.
    pub(crate) fn wall_gap_m(&self, index: usize) -> f64 {
        let geometry = &self.tray.geometry;
        let gap_m = |point: Point2<f64>| {
            (geometry.outer_radius_m - point.coords.norm()).min(point.coords.norm() - geometry.inner_radius_m)
        };
        edges(&self.outlines[index])
            .map(|(from, to)| gap_m(from).min(gap_m(nalgebra::center(&from, &to))))
            .fold(f64::INFINITY, f64::min)
    }
}

fn edges(outline: &[Point2<f64>]) -> impl Iterator<Item = (Point2<f64>, Point2<f64>)> {
    outline.iter().copied().zip(outline.iter().copied().cycle().skip(1))
}

/// Distance between convex outlines that do not overlap, m; 0 or less if they do: the widest gap between lines along an edge
/// of one of them is that between the outlines or, corner to corner, less, so that corners are looked at too.
fn gap_m(a: &[Point2<f64>], b: &[Point2<f64>]) -> f64 {
    let widest = |a: &[Point2<f64>], b: &[Point2<f64>]| {
        edges(a)
            .map(|(from, to)| {
                let along: Vector2<f64> = to - from;
                let outwards = Vector2::new(along.y, -along.x).normalize();
                b.iter().map(|corner| outwards.dot(&(corner - from))).fold(f64::INFINITY, f64::min)
            })
            .fold(f64::NEG_INFINITY, f64::max)
    };
    let between_lines_m = widest(a, b).max(widest(b, a));
    if between_lines_m <= 0.0 {
        return between_lines_m;
    }
    let nearest = |a: &[Point2<f64>], b: &[Point2<f64>]| {
        let to_edge = |corner: &Point2<f64>, (from, to): (Point2<f64>, Point2<f64>)| {
            let along: Vector2<f64> = to - from;
            let share = (along.dot(&(corner - from)) / along.norm_squared()).clamp(0.0, 1.0);
            (corner - from - along * share).norm()
        };
        a.iter().flat_map(|corner| edges(b).map(move |edge| to_edge(corner, edge))).fold(f64::INFINITY, f64::min)
    };
    nearest(a, b).min(nearest(b, a))
}
