//! Where two parts touch, seen from above.

use super::Part;
use super::body::{Body, dot};

/// Where two bodies overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Touch {
    /// Unit vector along which the second has to move to part from the first.
    pub(super) normal: [f64; 2],
    /// How far it has to move, m.
    pub(super) depth_m: f64,
    /// One or two points between which the bodies press on each other.
    points: [[f64; 2]; 2],
    two: bool,
}

impl Touch {
    fn at(normal: [f64; 2], depth_m: f64, point: [f64; 2]) -> Self {
        Self { normal, depth_m, points: [point; 2], two: false }
    }

    /// The points of contact.
    pub(super) fn points(&self) -> &[[f64; 2]] {
        &self.points[..if self.two { 2 } else { 1 }]
    }

    fn reversed(self) -> Self {
        Self { normal: [-self.normal[0], -self.normal[1]], ..self }
    }
}

/// Room for the corners of two bodies, kept between calls.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    first: Outlined,
    second: Outlined,
}

/// An outline where its part is.
#[derive(Clone, Debug, Default)]
struct Outlined {
    corners: Vec<[f64; 2]>,
    /// Outward normal of the edge from each corner to the next, and its distance from the origin, m.
    edges: Vec<([f64; 2], f64)>,
}

impl Outlined {
    fn place(&mut self, body: &Body, part: &Part) {
        let (sin, cos) = part.yaw_rad.sin_cos();
        let turn = |v: [f64; 2]| [cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]];
        let centre = [part.x_m, part.y_m];
        self.corners.clear();
        self.corners.extend(body.corners.iter().map(|&corner| {
            let turned = turn(corner);
            [centre[0] + turned[0], centre[1] + turned[1]]
        }));
        self.edges.clear();
        self.edges.extend(body.edges.iter().map(|&(normal, distance_m)| {
            let turned = turn(normal);
            (turned, distance_m + dot(turned, centre))
        }));
    }

    /// The edge from which the other outline is farthest, and how far; negative where they overlap.
    fn farthest_edge(&self, other: &Self) -> (usize, f64) {
        let mut best = (0, f64::NEG_INFINITY);
        for (index, &(normal, distance_m)) in self.edges.iter().enumerate() {
            let nearest = other.corners.iter().map(|&corner| dot(normal, corner)).fold(f64::INFINITY, f64::min);
            let apart_m = nearest - distance_m;
            if apart_m > best.1 {
                best = (index, apart_m);
                if apart_m >= 0.0 {
                    break;
                }
            }
        }
        best
    }

    fn edge_ends(&self, index: usize) -> [[f64; 2]; 2] {
        [self.corners[index], self.corners[(index + 1) % self.corners.len()]]
    }
}

/// Where two parts overlap, if they do.
pub(super) fn touch(a: (&Body, &Part), b: (&Body, &Part), scratch: &mut Scratch) -> Option<Touch> {
    let (body_a, part_a) = a;
    let (body_b, part_b) = b;
    let apart = [part_b.x_m - part_a.x_m, part_b.y_m - part_a.y_m];
    let reach_m = body_a.radius_m + body_b.radius_m;
    let squared = dot(apart, apart);
    if squared >= reach_m * reach_m {
        return None;
    }
    match (body_a.is_round(), body_b.is_round()) {
        (true, true) => {
            let distance_m = squared.sqrt();
            let normal = if distance_m > 0.0 { apart.map(|component| component / distance_m) } else { [1.0, 0.0] };
            let arm_m = body_a.radius_m - 0.5 * (reach_m - distance_m);
            let point = [part_a.x_m + arm_m * normal[0], part_a.y_m + arm_m * normal[1]];
            Some(Touch::at(normal, reach_m - distance_m, point))
        }
        (false, true) => {
            scratch.first.place(body_a, part_a);
            touch_disc(&scratch.first, [part_b.x_m, part_b.y_m], body_b.radius_m)
        }
        (true, false) => {
            scratch.second.place(body_b, part_b);
            touch_disc(&scratch.second, [part_a.x_m, part_a.y_m], body_a.radius_m).map(Touch::reversed)
        }
        (false, false) => {
            scratch.first.place(body_a, part_a);
            scratch.second.place(body_b, part_b);
            touch_outlines(&scratch.first, &scratch.second)
        }
    }
}

/// Where a part with corners overlaps a disc that stands still, with the normal away from the part.
pub(super) fn touch_fixed_disc(
    part: (&Body, &Part),
    centre: [f64; 2],
    radius_m: f64,
    scratch: &mut Scratch,
) -> Option<Touch> {
    scratch.first.place(part.0, part.1);
    touch_disc(&scratch.first, centre, radius_m)
}

fn touch_disc(outline: &Outlined, centre: [f64; 2], radius_m: f64) -> Option<Touch> {
    let mut best = (0, f64::NEG_INFINITY);
    for (index, &(normal, distance_m)) in outline.edges.iter().enumerate() {
        let apart_m = dot(normal, centre) - distance_m;
        if apart_m >= radius_m {
            return None;
        }
        if apart_m > best.1 {
            best = (index, apart_m);
        }
    }
    let (index, apart_m) = best;
    let (normal, _) = *outline.edges.get(index)?;
    let [from, to] = outline.edge_ends(index);
    let along = [to[0] - from[0], to[1] - from[1]];
    let share = dot(along, [centre[0] - from[0], centre[1] - from[1]]) / dot(along, along);
    if apart_m <= 0.0 || (0.0..=1.0).contains(&share) {
        let foot = [centre[0] - apart_m * normal[0], centre[1] - apart_m * normal[1]];
        return Some(Touch::at(normal, radius_m - apart_m, foot));
    }
    let corner = if share < 0.0 { from } else { to };
    let away = [centre[0] - corner[0], centre[1] - corner[1]];
    let distance_m = dot(away, away).sqrt();
    (distance_m < radius_m)
        .then(|| Touch::at(away.map(|component| component / distance_m), radius_m - distance_m, corner))
}

/// Separating axes (Gottschalk 1996) among the normals of both outlines, and the clipped edge that lies in the other.
fn touch_outlines(a: &Outlined, b: &Outlined) -> Option<Touch> {
    let (edge_a, apart_a) = a.farthest_edge(b);
    if apart_a >= 0.0 {
        return None;
    }
    let (edge_b, apart_b) = b.farthest_edge(a);
    if apart_b >= 0.0 {
        return None;
    }
    // A slight preference keeps the choice from flickering between parallel edges.
    if apart_a + 1e-9 >= apart_b {
        Some(clipped(a, edge_a, apart_a, b))
    } else {
        Some(clipped(b, edge_b, apart_b, a).reversed())
    }
}

fn clipped(reference: &Outlined, index: usize, apart_m: f64, other: &Outlined) -> Touch {
    let (normal, distance_m) = reference.edges[index];
    let [from, to] = reference.edge_ends(index);
    let facing = |&(a, _): &(usize, &([f64; 2], f64)), &(b, _): &(usize, &([f64; 2], f64))| {
        dot(other.edges[a].0, normal).total_cmp(&dot(other.edges[b].0, normal))
    };
    let incident = other.edges.iter().enumerate().min_by(facing).map_or(0, |(index, _)| index);
    let along = [-normal[1], normal[0]];
    let (low, high) = (dot(along, from), dot(along, to));
    let ends = other.edge_ends(incident);
    let places = ends.map(|end| dot(along, end));
    let cut = |place: f64| {
        let span = places[1] - places[0];
        let share = if span.abs() > 0.0 { ((place - places[0]) / span).clamp(0.0, 1.0) } else { 0.0 };
        [0, 1].map(|axis| ends[0][axis] + share * (ends[1][axis] - ends[0][axis]))
    };
    let points = places.map(|place| cut(place.clamp(low.min(high), low.max(high))));
    let depths = points.map(|point| distance_m - dot(normal, point));
    let depth_m = -apart_m;
    match (depths[0] > 0.0, depths[1] > 0.0) {
        (true, true) => Touch { normal, depth_m, points, two: true },
        (false, true) => Touch::at(normal, depth_m, points[1]),
        _ => Touch::at(normal, depth_m, points[0]),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use proptest::prelude::*;

    use super::*;
    use crate::parts::Place;
    use crate::parts::tests::{block, disc, part_at};

    static BLOCK: LazyLock<Body> = LazyLock::new(|| body(&block(0.006, 0.004, 0.003)));
    static DISC: LazyLock<Body> = LazyLock::new(|| body(&disc(0.004, 0.2)));

    fn body(part: &feeder_model::part::PartType) -> Body {
        Body::new(&part.mesh, &part.poses[0])
    }

    fn at(x_m: f64, y_m: f64, yaw_rad: f64) -> Part {
        Part { yaw_rad, ..part_at(Place::Plateau, x_m, y_m) }
    }

    fn meet(a: &Body, part_a: &Part, b: &Body, part_b: &Part) -> Option<Touch> {
        touch((a, part_a), (b, part_b), &mut Scratch::default())
    }

    #[test]
    fn faces_meet_in_two_points_and_corners_in_one() {
        let block = &*BLOCK;
        let here = at(0.0, 0.0, 0.0);
        let face = meet(block, &here, block, &at(0.0059, 0.001, 0.0)).unwrap();
        assert!(dot(face.normal, [1.0, 0.0]) > 1.0 - 1e-12);
        assert!((face.depth_m - 1e-4).abs() < 1e-12);
        let mut heights: Vec<f64> = face.points().iter().map(|point| point[1]).collect();
        heights.sort_by(f64::total_cmp);
        assert!((heights[0] + 0.001).abs() < 1e-12 && (heights[1] - 0.002).abs() < 1e-12, "{heights:?}");
        // Turned by 45°, the corner reaches 5/√2 mm.
        let reach_m = 0.005 / 2.0_f64.sqrt();
        let corner = meet(block, &here, block, &at(0.003 + reach_m - 1e-4, 0.0, std::f64::consts::FRAC_PI_4));
        let corner = corner.unwrap();
        assert!((corner.depth_m - 1e-4).abs() < 1e-9 && corner.points().len() == 1);
        assert_eq!(meet(block, &here, block, &at(0.003 + reach_m + 1e-6, 0.0, std::f64::consts::FRAC_PI_4)), None);
    }

    #[test]
    fn a_disc_meets_faces_and_corners() {
        let (block, disc) = (&*BLOCK, &*DISC);
        let face = meet(block, &at(0.0, 0.0, 0.0), disc, &at(0.001, 0.0039, 0.3)).unwrap();
        assert!((face.depth_m - 1e-4).abs() < 1e-9 && dot(face.normal, [0.0, 1.0]) > 1.0 - 1e-12);
        let (x_m, y_m) = (0.003 + 0.0019 * 0.6, 0.002 + 0.0019 * 0.8);
        let corner = meet(disc, &at(x_m, y_m, 0.0), block, &at(0.0, 0.0, 0.0)).unwrap();
        assert!((corner.depth_m - 1e-4).abs() < 1e-9);
        assert!((corner.normal[0] + 0.6).abs() < 1e-9 && (corner.normal[1] + 0.8).abs() < 1e-9);
        assert_eq!(meet(block, &at(0.0, 0.0, 0.0), disc, &at(0.0045, 0.0035, 0.0)), None);
    }

    proptest! {
        /// Moving the second by the depth along the normal parts the two, and by less does not.
        #[test]
        fn the_depth_is_the_way_out(
            x in -0.006..0.006_f64,
            y in -0.006..0.006_f64,
            yaws in prop::array::uniform2(-3.0..3.0_f64),
            round in prop::array::uniform2(any::<bool>()),
        ) {
            let [a, b] = round.map(|round| if round { &*DISC } else { &*BLOCK });
            let (here, there) = (at(0.0, 0.0, yaws[0]), at(x, y, yaws[1]));
            if let Some(touch) = meet(a, &here, b, &there) {
                let moved = |share: f64| {
                    let way_m = share * touch.depth_m;
                    at(x + way_m * touch.normal[0], y + way_m * touch.normal[1], yaws[1])
                };
                prop_assert!((touch.normal[0].hypot(touch.normal[1]) - 1.0).abs() < 1e-9);
                let left = meet(a, &here, b, &moved(1.0 + 1e-6)).map_or(0.0, |touch| touch.depth_m);
                prop_assert!(left < 1e-9, "{left} m left");
                prop_assert!(touch.depth_m < 1e-7 || meet(a, &here, b, &moved(0.99)).is_some());
                let back = meet(b, &there, a, &here).unwrap();
                prop_assert!((back.depth_m - touch.depth_m).abs() < 1e-9);
            }
        }
    }
}
