//! The camera above the feeding place.

use feeder_model::camera::CameraModel;
use feeder_model::part::PartType;
use feeder_model::seed::generator;
use feeder_runtime::lockstep::MESSAGE_BYTES_MAX;
use feeder_runtime::node::{Declare, NodeError, Publisher, StepIo, stamp_of_ns};
use feeder_scenario::plan::PartSimulatorConfig;
use feeder_sim::camera::{PartView, Renderer, TrayShot, codec};
use feeder_sim::parts::{Part, PartBulk, Place};
use feeder_wire::pictures::{self, Encoding};
use feeder_wire::{frames, robot_description, topics};
use image::GrayImage;
use minifactory_msgs::sensor_msgs::msg::{CameraInfo, CompressedImage, Image};
use minifactory_msgs::std_msgs::msg::{Header, String as Text};
use minifactory_msgs::tf2_msgs::msg::TFMessage;
use rand_pcg::Pcg64Mcg;

/// Room for the rest of a compressed image's message, bytes.
const OVERHEAD_BYTES: usize = 256;

/// Handles of the camera's ports.
pub(crate) struct Ports {
    raw: Publisher<Image>,
    compressed: Publisher<CompressedImage>,
    info: Publisher<CameraInfo>,
    tf_static: Publisher<TFMessage>,
    description: Publisher<Text>,
}

impl Ports {
    pub(crate) fn declare(io: &mut Declare) -> Self {
        Self {
            raw: io.publisher(&topics::IMAGE_RAW),
            compressed: io.publisher(&topics::IMAGE_COMPRESSED),
            info: io.publisher(&topics::CAMERA_INFO),
            tf_static: io.publisher(&topics::TF_STATIC),
            description: io.publisher(&topics::CAMERA_DESCRIPTION),
        }
    }
}

/// When pictures are taken: at whole periods, also where time does not begin at 0.
struct Schedule {
    period_ns: u64,
    /// Stamp of the next picture, ns.
    next_ns: u64,
}

impl Schedule {
    fn new(period_ns: u64) -> Self {
        Self { period_ns, next_ns: period_ns }
    }

    /// Whether a picture is due at this stamp, which never goes back; if so, it is taken to be taken.
    fn is_due(&mut self, stamp_ns: u64) -> bool {
        let due = stamp_ns >= self.next_ns;
        if due {
            self.next_ns = (stamp_ns / self.period_ns + 1) * self.period_ns;
        }
        due
    }
}

/// The camera.
pub(crate) struct Camera {
    renderer: Renderer,
    /// As everybody is told.
    calibrated: CameraModel,
    tray: feeder_model::tray::TrayGeometry,
    schedule: Schedule,
    quality: u8,
    noise: Pcg64Mcg,
    image: GrayImage,
    feeder: String,
    frame: String,
    views: Vec<PartView>,
}

impl Camera {
    pub(crate) fn open(config: &PartSimulatorConfig, part: &PartType) -> Result<Self, NodeError> {
        Ok(Self {
            renderer: Renderer::new(&config.camera.scene(config.tray, part)).map_err(NodeError::new)?,
            calibrated: config.camera.calibrated.clone(),
            tray: config.tray.geometry,
            schedule: Schedule::new(config.camera.period_ms * 1_000_000),
            quality: config.camera.jpeg_quality,
            noise: generator(config.seed, "camera"),
            image: GrayImage::default(),
            feeder: config.feeder.clone(),
            frame: frames::camera(&config.feeder),
            views: Vec::new(),
        })
    }

    /// Takes a picture if one is due at `stamp_ns`, the time for which tray and parts are known.
    pub(crate) fn look(
        &mut self,
        io: &mut StepIo,
        ports: &Ports,
        stamp_ns: u64,
        shot: &TrayShot,
        bulk: &PartBulk,
    ) -> Result<(), NodeError> {
        if io.is_activated() {
            io.publish(&ports.tf_static, &self.mounting());
            let urdf = robot_description::camera(&self.feeder, &self.calibrated.platen_from_camera());
            io.publish(&ports.description, &urdf);
        }
        if !self.schedule.is_due(stamp_ns) {
            return Ok(());
        }
        self.views.clear();
        self.views.extend(bulk.parts().iter().filter_map(|part| view(part, &self.tray)));
        self.renderer.render(shot, &self.views, &mut self.noise, &mut self.image).map_err(NodeError::new)?;

        let header = || Header { stamp: stamp_of_ns(stamp_ns), frame_id: self.frame.clone() };
        let data =
            codec::encode(&self.image, self.quality, MESSAGE_BYTES_MAX - OVERHEAD_BYTES).map_err(NodeError::new)?;
        io.publish(&ports.compressed, &pictures::to_compressed(header(), data));
        io.publish(&ports.info, &pictures::to_camera_info(header(), &self.calibrated));
        if io.wanted(&ports.raw) {
            let (size_px, data) = (self.image.dimensions(), self.image.as_raw().clone());
            io.publish(&ports.raw, &pictures::to_image(header(), Encoding::Grey, size_px, data));
        }
        Ok(())
    }

    /// Where the camera hangs, as calibrated.
    fn mounting(&self) -> TFMessage {
        frames::to_message(stamp_of_ns(0), frames::PLATEN, &self.frame, &self.calibrated.platen_from_camera())
    }
}

/// A part as the camera sees it; one that is falling is hidden behind the end of the plateau.
fn view(part: &Part, tray: &feeder_model::tray::TrayGeometry) -> Option<PartView> {
    let z_m = match part.place {
        Place::Ramp | Place::Plateau => tray.height_m(part.angle_rad()),
        Place::Falling => return None,
    };
    Some(PartView {
        x_m: part.x_m,
        y_m: part.y_m,
        z_m,
        yaw_rad: part.yaw_rad,
        pose: part.pose,
        vx_m_s: part.velocity_x_m_s,
        vy_m_s: part.velocity_y_m_s,
    })
}

#[cfg(test)]
mod tests {
    use super::Schedule;

    /// Stamps of the pictures taken in a second of ticks of 10 ms.
    fn taken_ms(start_ms: u64, period_ms: u64) -> Vec<u64> {
        let mut schedule = Schedule::new(period_ms * 1_000_000);
        (0..100).map(|tick| start_ms + 10 * tick).filter(|ms| schedule.is_due(ms * 1_000_000)).collect()
    }

    #[test]
    fn pictures_are_a_period_apart_whenever_time_begins() {
        let simulated: Vec<u64> = (1..10).map(|picture| 100 * picture).collect();
        assert_eq!(taken_ms(0, 100), simulated);
        let now_ms = 1_800_000_000_000;
        assert_eq!(taken_ms(now_ms, 100), (0..10).map(|picture| now_ms + 100 * picture).collect::<Vec<_>>());
    }

    #[test]
    fn a_period_that_is_no_whole_number_of_ticks_is_kept_on_average() {
        assert_eq!(taken_ms(0, 25)[..4], [30, 50, 80, 100]);
    }
}
