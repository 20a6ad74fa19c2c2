//! What is seen, in messages: for viewers as detections, for planners with what was measured and what speaks against each part.

use feeder_vision::{Selector, TrackedCandidate};
use feeder_wire::part_candidates::{self, ImageWorth, SeenPart};
use feeder_wire::{detections, markers};
use minifactory_msgs::msg::PartCandidates;
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::vision_msgs::msg::Detection3DArray;
use minifactory_msgs::visualization_msgs::msg::MarkerArray;

/// Names of classes and frames.
pub(crate) struct Names {
    pub(crate) part: String,
    pub(crate) poses: Vec<String>,
    pub(crate) tray_frame: String,
    /// The plateau above the tray's origin, m.
    pub(crate) plateau_m: f64,
    pub(crate) node: String,
}

impl Names {
    /// What was seen.
    pub(crate) fn seen(&self, tracked: &[TrackedCandidate], selector: &Selector) -> Vec<SeenPart> {
        tracked.iter().map(|part| self.seen_part(part, selector)).collect()
    }

    /// What was seen, as it is drawn.
    pub(crate) fn markers(&self, image: &Header, seen: &[SeenPart]) -> MarkerArray {
        markers::candidates(&self.header(image), self.plateau_m, seen)
    }

    /// What was seen, for viewers and for planners.
    pub(crate) fn messages(
        &self,
        image: &Header,
        tracked: &[TrackedCandidate],
        parts: &[SeenPart],
        selector: &Selector,
        worth: &ImageWorth,
    ) -> (Detection3DArray, PartCandidates) {
        let header = self.header(image);
        let sizes_m = tracked.iter().map(|part| selector.size_m(&part.candidate));
        let on_plateau = parts.iter().zip(sizes_m).filter(|(part, _)| !part.refusals.off_plateau);
        let shown = detections::to_message(&header, &self.part, on_plateau);
        (shown, PartCandidates { header, ..part_candidates::to_message(&self.part, parts, worth) })
    }

    fn header(&self, image: &Header) -> Header {
        Header { stamp: image.stamp, frame_id: self.tray_frame.clone() }
    }

    fn seen_part(&self, part: &TrackedCandidate, selector: &Selector) -> SeenPart {
        SeenPart {
            id: part.id,
            position_in_tray_m: part.candidate.centre().coords,
            yaw_in_tray_rad: part.candidate.yaw_rad.unwrap_or(0.0),
            pose_class: part.pose.and_then(|pose| self.poses.get(pose)).cloned(),
            confidence: part.confidence,
            radius_m: selector.radius_m(&part.candidate),
            part_gap_m: part.candidate.part_gap_m,
            wall_gap_m: part.candidate.wall_gap_m,
            refusals: selector.refusals(part),
        }
    }
}
