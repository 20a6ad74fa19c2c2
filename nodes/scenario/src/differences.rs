//! How the simulated world differs from what control was told of it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::camera::{CameraModel, CameraPose, CameraSpec, Distortion};
use feeder_model::mechanics::Friction;
use feeder_model::part::PartType;
use feeder_model::range::{OutOfRange, check_ranges};
use feeder_sim::camera::{LightModel, SensorModel};

/// How the simulated world differs from what control was told of it: from the camera's calibration, from the light in which
/// the part was taught, from the part's file. Small by default, but not nothing: no calibration is perfect, and no lamp stays
/// as it was.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Differences {
    /// The camera's optical centre from where it was calibrated to hang, x, m.
    #[schemars(range(min = -0.1, max = 0.1))]
    pub camera_x_m: f64,
    /// The same, y, m.
    #[schemars(range(min = -0.1, max = 0.1))]
    pub camera_y_m: f64,
    /// How much higher it hangs, m.
    #[schemars(range(min = -0.1, max = 0.1))]
    pub camera_height_m: f64,
    /// How far the camera is turned about the platen's z from how it was calibrated, rad.
    #[schemars(range(min = -3.2, max = 3.2))]
    pub camera_yaw_rad: f64,
    /// Radial distortion of the lens, coefficient of r², beyond the calibrated.
    #[schemars(range(min = -0.5, max = 0.5))]
    pub lens_k1: f64,
    /// Light of the lamp over that in which the part was taught.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub light_ratio: f64,
    /// How far the lamp has moved round the tray since, counter-clockwise, rad.
    #[schemars(range(min = -3.2, max = 3.2))]
    pub lamp_azimuth_rad: f64,
    /// Noise of the camera's sensor over that with which the part was taught.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub noise_ratio: f64,
    /// Friction between part and tray over that which the part's file states. What lies within the file's uncertainty is
    /// carried without sliding.
    #[schemars(range(min = 0.1, max = 10.0))]
    pub friction_ratio: f64,
}

impl Default for Differences {
    fn default() -> Self {
        Self {
            // `feeder calibrate` leaves up to 0.08 mm.
            camera_x_m: 0.04e-3,
            camera_y_m: -0.03e-3,
            camera_height_m: 0.3e-3,
            camera_yaw_rad: 0.4e-3,
            lens_k1: -0.002,
            light_ratio: 0.97,
            lamp_azimuth_rad: 0.03,
            noise_ratio: 1.1,
            friction_ratio: 0.97,
        }
    }
}

impl Differences {
    /// A world that is just as control was told.
    pub const NONE: Self = Self {
        camera_x_m: 0.0,
        camera_y_m: 0.0,
        camera_height_m: 0.0,
        camera_yaw_rad: 0.0,
        lens_k1: 0.0,
        light_ratio: 1.0,
        lamp_azimuth_rad: 0.0,
        noise_ratio: 1.0,
        friction_ratio: 1.0,
    };

    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        check_ranges("differences.", self)
    }

    /// The camera as it is, which was calibrated as `told`.
    ///
    /// # Errors
    /// A camera that cannot be.
    pub fn camera(&self, told: &CameraModel) -> Result<CameraModel, OutOfRange> {
        let told = CameraSpec::from(told.clone());
        let (lens, place) = (told.distortion, told.pose);
        CameraModel::new(CameraSpec {
            distortion: Distortion { k1: lens.k1 + self.lens_k1, ..lens },
            pose: CameraPose {
                x_m: place.x_m + self.camera_x_m,
                y_m: place.y_m + self.camera_y_m,
                height_m: place.height_m + self.camera_height_m,
                yaw_rad: place.yaw_rad + self.camera_yaw_rad,
            },
            ..told
        })
    }

    /// The light as it is, which was that of `told` when the part was taught.
    #[must_use]
    pub fn light(&self, told: LightModel) -> LightModel {
        LightModel {
            white_level: told.white_level * self.light_ratio,
            azimuth_rad: told.azimuth_rad + self.lamp_azimuth_rad,
            ..told
        }
    }

    /// The sensor as it is, which was like `told` when the part was taught.
    #[must_use]
    pub fn sensor(&self, told: SensorModel) -> SensorModel {
        SensorModel { noise_sigma_levels: told.noise_sigma_levels * self.noise_ratio, ..told }
    }

    /// The part as it is, of which its file says that it is like `told`.
    ///
    /// # Errors
    /// A friction that cannot be.
    pub fn part(&self, told: &PartType) -> Result<PartType, OutOfRange> {
        let (at_rest, sliding) = (told.friction.static_coefficient(), told.friction.kinetic_coefficient());
        let friction = Friction::new(at_rest * self.friction_ratio, sliding * self.friction_ratio)?;
        Ok(PartType { friction, ..told.clone() })
    }
}
