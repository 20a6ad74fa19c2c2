//! Tray and parts as viewers draw them. Nothing is made while nobody looks, but for the tray, which is made once.

use feeder_model::camera::MountedTray;
use feeder_model::part::PartType;
use feeder_runtime::node::{Declare, Publisher, StepIo, stamp_of_ns};
use feeder_scenario::plan::PartSimulatorConfig;
use feeder_sim::parts::{Part, PartBulk};
use feeder_wire::markers::{self, LyingPart, Rgb};
use feeder_wire::{frames, topics};
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::visualization_msgs::msg::MarkerArray;
use nalgebra::Point3;

/// Between two messages of the parts, ms.
const PERIOD_MS: u64 = 100;

/// Handles of the markers' ports.
pub(crate) struct Ports {
    tray: Publisher<MarkerArray>,
    parts: Publisher<MarkerArray>,
}

impl Ports {
    pub(crate) fn declare(io: &mut Declare) -> Self {
        Self { tray: io.publisher(&topics::TRAY_MARKERS), parts: io.publisher(&topics::PART_MARKERS) }
    }
}

/// What is drawn.
pub(crate) struct Drawing {
    tray: MountedTray,
    frame: String,
    period_ticks: u64,
    /// The part in each of its poses.
    poses: Vec<DrawnPose>,
}

struct DrawnPose {
    triangles_m: Vec<[Point3<f64>; 3]>,
    com_height_m: f64,
    colour: Rgb,
}

impl Drawing {
    pub(crate) fn new(config: &PartSimulatorConfig, part: &PartType) -> Self {
        let colours = markers::pose_colours(part.poses.len(), &part.wanted_poses);
        let drawn = part.poses.iter().zip(colours).enumerate().map(|(index, (pose, colour))| DrawnPose {
            triangles_m: part.drawn(index),
            com_height_m: pose.com_height_m,
            colour,
        });
        Self {
            tray: config.tray,
            frame: frames::tray(&config.feeder),
            period_ticks: PERIOD_MS.div_ceil(config.tick_ms.max(1)),
            poses: drawn.collect(),
        }
    }

    /// Publishes what is due; `stamp_ns` is the time for which the parts are known.
    pub(crate) fn draw(&self, io: &mut StepIo, ports: &Ports, stamp_ns: u64, bulk: &PartBulk) {
        let header = Header { stamp: stamp_of_ns(stamp_ns), frame_id: self.frame.clone() };
        if io.is_activated() {
            io.publish(&ports.tray, &markers::tray(&header, &self.tray));
        }
        if io.tick().is_multiple_of(self.period_ticks) && io.wanted(&ports.parts) {
            io.publish(&ports.parts, &markers::parts(&header, bulk.parts().iter().map(|part| self.lying(part))));
        }
    }

    fn lying(&self, part: &Part) -> LyingPart<'_> {
        let DrawnPose { triangles_m, com_height_m, colour } = &self.poses[part.pose];
        let (radius_m, angle_rad) = (part.radius_m(), part.angle_rad());
        let geometry = &self.tray.geometry;
        LyingPart {
            id: part.id,
            tray_from_lying: geometry.tray_from_lying(part.place, radius_m, angle_rad, part.yaw_rad, *com_height_m),
            triangles_m,
            colour: *colour,
        }
    }
}
