//! A part as few triangles, for who draws many of them.

use nalgebra::{Point2, Point3};

use super::PartType;
use crate::geometry::StablePose;

/// Most triangles of a body that is drawn as it is; another is drawn as the prism of its silhouette.
const TRIANGLES_MAX: usize = 48;
/// Most corners of such a silhouette.
const CORNERS_MAX: usize = 16;

impl PartType {
    /// The part in one of its poses, as it lies on a level floor at yaw 0, its centre of mass at the origin, m. A body of
    /// many triangles is simplified to the prism over its silhouette.
    ///
    /// # Panics
    /// A pose that the part does not have.
    #[must_use]
    pub fn drawn(&self, pose: usize) -> Vec<[Point3<f64>; 3]> {
        let pose = &self.poses[pose];
        if self.mesh.triangles().len() > TRIANGLES_MAX {
            return prism(pose);
        }
        let corner = |index: u32| pose.orientation * self.mesh.vertices()[index as usize];
        self.mesh.triangles().iter().map(|triangle| triangle.map(corner)).collect()
    }
}

fn prism(pose: &StablePose) -> Vec<[Point3<f64>; 3]> {
    let all = &pose.outline.corners_m;
    let kept: Vec<Point2<f64>> = all.iter().step_by(all.len().div_ceil(CORNERS_MAX).max(1)).copied().collect();
    let (floor_m, top_m) = (-pose.com_height_m, pose.height_m - pose.com_height_m);
    let at = |corner: Point2<f64>, z_m: f64| Point3::new(corner.x, corner.y, z_m);
    let next = kept.iter().cycle().skip(1);
    let sides = kept.iter().zip(next).flat_map(|(&from, &to)| {
        let (a, b, c, d) = (at(from, floor_m), at(to, floor_m), at(to, top_m), at(from, top_m));
        [[a, b, c], [a, c, d]]
    });
    let lid = kept.windows(2).skip(1).map(|pair| [kept[0], pair[0], pair[1]].map(|corner| at(corner, top_m)));
    sides.chain(lid).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Loop, ShapeSpec, Solid};
    use crate::part::PartSpec;

    fn part(outline: Loop) -> PartType {
        let solid = Solid::Extruded { outline, holes: Vec::new(), z_m: [0.0, 0.002], reflectance: None };
        let spec = PartSpec {
            name: "disc".to_owned(),
            density_kg_m3: 1000.0,
            friction_static: 0.4,
            friction_kinetic: 0.3,
            friction_uncertainty_ratio: 0.1,
            reflectance: 0.5,
            shape: ShapeSpec::Solids(vec![solid]),
            poses: Vec::new(),
            wanted_poses: vec!["pose_1".to_owned()],
            drops: None,
        };
        PartType::new(&spec).unwrap()
    }

    /// Volume of what the triangles and the floor below them enclose, m³.
    fn volume_m3(triangles: &[[Point3<f64>; 3]], floor_m: f64) -> f64 {
        let above = |[a, b, c]: &[Point3<f64>; 3]| {
            let area_m2 = 0.5 * (b.xy() - a.xy()).perp(&(c.xy() - a.xy()));
            area_m2 * ((a.z + b.z + c.z) / 3.0 - floor_m)
        };
        triangles.iter().map(above).sum()
    }

    #[test]
    fn a_simple_body_is_drawn_as_it_is_and_another_as_its_prism() {
        let block = part(Loop::Regular { sides: 4, inradius_m: 0.003, centre_m: [0.0, 0.0] });
        assert_eq!(block.drawn(0).len(), block.mesh.triangles().len());
        let disc = part(Loop::Circle { radius_m: 0.003, centre_m: [0.0, 0.0] });
        assert!(disc.mesh.triangles().len() > TRIANGLES_MAX);
        assert_eq!(disc.drawn(0).len(), 3 * CORNERS_MAX - 2);
        for (part, share) in [(block, 1.0), (disc, 0.974)] {
            for (index, pose) in part.poses.iter().enumerate() {
                let drawn = volume_m3(&part.drawn(index), -pose.com_height_m) / part.mesh.volume_m3();
                // Sixteen corners on a circle enclose 97.4 % of it; seen from its side it is more than it is.
                assert!((drawn / share - 1.0).abs() < 0.01 || pose.rolls, "{drawn} of pose {index}");
            }
        }
    }
}
