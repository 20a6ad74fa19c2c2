//! A part as it lies: its outline for contact, and how it turns.

use nalgebra::Point2;

use feeder_model::geometry::{PartMesh, StablePose};

/// How much of an outline may be cut off its corners to have fewer of them, as a share of its radius.
const CORNER_CUT: f64 = 0.005;

/// A part in one of its poses, seen from above at yaw 0 about its centre of mass.
#[derive(Clone, Debug)]
pub(super) struct Body {
    /// Distance of the farthest point from the centre, m; of all points of the edge where the body is round.
    pub(super) radius_m: f64,
    /// Radius of gyration about the vertical, m.
    pub(super) gyration_m: f64,
    /// Corners of the convex outline, counter-clockwise, m; none where the body is round.
    pub(super) corners: Vec<[f64; 2]>,
    /// Outward normals of the edges from each corner to the next, and their distances from the centre, m.
    pub(super) edges: Vec<([f64; 2], f64)>,
}

impl Body {
    pub(super) fn new(mesh: &PartMesh, pose: &StablePose) -> Self {
        let turn = pose.orientation.to_rotation_matrix();
        let inertia = turn.matrix() * mesh.inertia_per_density_m5() * turn.matrix().transpose();
        let gyration_m = (inertia[(2, 2)] / mesh.volume_m3()).sqrt();
        let outline = &pose.outline;
        let corners = if outline.round { Vec::new() } else { simplified(&outline.corners_m, outline.radius_m) };
        let corners: Vec<[f64; 2]> = corners.iter().map(|corner| [corner.x, corner.y]).collect();
        let edges = corners.iter().zip(corners.iter().cycle().skip(1)).map(|(from, to)| {
            let along = [to[0] - from[0], to[1] - from[1]];
            let length = along[0].hypot(along[1]);
            let normal = [along[1] / length, -along[0] / length];
            (normal, dot(normal, *from))
        });
        let edges = edges.collect();
        Self { radius_m: outline.radius_m, gyration_m, corners, edges }
    }

    pub(super) fn is_round(&self) -> bool {
        self.corners.is_empty()
    }
}

/// Leaves out corners that hardly stick out, the least first.
fn simplified(corners: &[Point2<f64>], radius_m: f64) -> Vec<Point2<f64>> {
    let mut kept = corners.to_vec();
    while kept.len() > 3 {
        let count = kept.len();
        let height = |index: usize| {
            let (before, here, after) = (kept[(index + count - 1) % count], kept[index], kept[(index + 1) % count]);
            let base = after - before;
            ((here - before).perp(&base) / base.norm()).abs()
        };
        let Some(least) = (0..count).min_by(|&a, &b| height(a).total_cmp(&height(b))) else { break };
        if height(least) > CORNER_CUT * radius_m {
            break;
        }
        kept.remove(least);
    }
    kept
}

pub(super) fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(super) fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}
