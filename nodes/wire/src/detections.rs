//! What the selector sees, as detections that viewers show.

use minifactory_msgs::geometry_msgs::msg::Vector3;
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::vision_msgs::msg::{
    BoundingBox3D, Detection3D, Detection3DArray, ObjectHypothesis, ObjectHypothesisWithPose,
};

use crate::part_candidates::SeenPart;
use crate::pose;

/// A part that is seen, and how large its bounding box is along the part's own axes, m.
pub type SizedPart<'a> = (&'a SeenPart, [f64; 3]);

/// The parts as detections. A hypothesis names class and resting pose, as in `grommet/hole_up`; a part whose pose is not
/// known has none.
#[must_use]
pub fn to_message<'a>(
    header: &Header,
    part_class: &str,
    parts: impl IntoIterator<Item = SizedPart<'a>>,
) -> Detection3DArray {
    let detection = |(part, [x, y, z]): SizedPart<'_>| {
        let pose = pose::to_message(&part.pose_in_tray());
        let hypothesis = part.pose_class.as_ref().map(|pose_class| {
            let class_id = format!("{part_class}/{pose_class}");
            let mut result = ObjectHypothesisWithPose {
                hypothesis: ObjectHypothesis { class_id, score: part.confidence },
                ..ObjectHypothesisWithPose::default()
            };
            result.pose.pose = pose;
            result
        });
        Detection3D {
            header: header.clone(),
            results: hypothesis.into_iter().collect(),
            bbox: BoundingBox3D { center: pose, size: Vector3 { x, y, z } },
            id: part.id.to_string(),
        }
    };
    Detection3DArray { header: header.clone(), detections: parts.into_iter().map(detection).collect() }
}

#[cfg(test)]
mod tests {
    use feeder_model::part::Refusals;
    use nalgebra::Vector2;

    use super::*;

    #[test]
    fn everything_is_in_its_place_and_a_part_of_unknown_pose_has_no_hypothesis() {
        let known = SeenPart {
            id: 7,
            position_in_tray_m: Vector2::new(0.03, -0.06),
            yaw_in_tray_rad: 0.5,
            pose_class: Some("hole_up".to_owned()),
            confidence: 0.9,
            radius_m: 0.0036,
            part_gap_m: 0.01,
            wall_gap_m: 0.012,
            refusals: Refusals::default(),
        };
        let unknown = SeenPart { id: 8, pose_class: None, ..known.clone() };
        let header = Header { frame_id: "feeder/tray".to_owned(), ..Header::default() };
        let sizes = [[0.007, 0.006, 0.005], [0.004, 0.003, 0.002]];
        let message = to_message(&header, "grommet", [&known, &unknown].into_iter().zip(sizes));
        let pose = pose::to_message(&known.pose_in_tray());
        let mut result = ObjectHypothesisWithPose {
            hypothesis: ObjectHypothesis { class_id: "grommet/hole_up".to_owned(), score: 0.9 },
            ..ObjectHypothesisWithPose::default()
        };
        result.pose.pose = pose;
        let detection = |id: &str, results, [x, y, z]: [f64; 3]| Detection3D {
            header: header.clone(),
            results,
            bbox: BoundingBox3D { center: pose, size: Vector3 { x, y, z } },
            id: id.to_owned(),
        };
        let detections = vec![detection("7", vec![result], sizes[0]), detection("8", Vec::new(), sizes[1])];
        assert_eq!((pose.position.x, pose.position.y), (0.03, -0.06));
        assert_eq!(message, Detection3DArray { header, detections });
    }
}
