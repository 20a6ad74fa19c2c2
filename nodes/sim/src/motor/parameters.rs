//! What the simulated motor is like.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::faults::FaultHooks;
use feeder_model::range::OutOfRange;
use feeder_model::range::{check_range, check_ranges};

/// A courier driven by four forcers, tethered, measured by a sensor, with a tray on a mounting that may twist.
///
/// Forcers 1 and 2 push along x and sit at y = ∓ the arm, forcers 3 and 4 push along y and sit at x = ± the arm; forces
/// are positive along the axis. [`Self::IDEAL`] follows any command inside the envelope exactly; the assumed motor, `launch_configs/plants/assumed.yaml`, has the
/// imperfections by which plain feedback fails to feed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MotorParameters {
    /// Mass, kg.
    #[schemars(range(min = 1e-2, max = 100.0))]
    pub mass_kg: f64,
    /// Moment of inertia of courier and empty tray about their centre of mass, kg m².
    #[schemars(range(min = 1e-6, max = 10.0))]
    pub inertia_kg_m2: f64,
    /// Offset of the centre of mass from the courier's centre along x and y, m. Yaw is too small to turn it.
    #[schemars(inner(range(min = -0.05, max = 0.05)))]
    pub center_of_mass_offset_m: [f64; 2],
    /// Force at which each of the four forcers saturates, N.
    #[schemars(range(min = 1e-3, max = 1e3))]
    pub forcer_force_n_max: f64,
    /// Distance of each forcer's line of force from the courier's centre, m.
    #[schemars(range(min = 1e-3, max = 1.0))]
    pub forcer_arm_m: f64,
    /// Time from a command to its first effect, s.
    #[schemars(range(min = 0.0, max = 0.02))]
    pub delay_s: f64,
    /// Time constant of the force's first-order response, s; 0 for none.
    #[schemars(range(min = 0.0, max = 0.02))]
    pub lag_s: f64,
    /// Force ripple of each forcer relative to its force, once a tooth pitch.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub ripple: f64,
    /// Share of a forcer's force that is missing at its peak, as the iron saturates; it grows with the square of the force.
    #[schemars(range(min = 0.0, max = 0.9))]
    pub force_loss_at_peak: f64,
    /// Phase of each forcer's ripple where the courier's position is 0, rad.
    #[schemars(inner(range(min = -10.0, max = 10.0)))]
    pub ripple_phase_rad: [f64; 4],
    /// Tooth pitch of the platen, m.
    #[schemars(range(min = 1e-5, max = 0.1))]
    pub tooth_pitch_m: f64,
    /// Drag of translation, N s/m.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub drag_n_s_m: f64,
    /// Drag of rotation, N m s/rad.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub drag_n_m_s_rad: f64,
    /// Where the tether is fixed, x and y on the platen, m.
    #[schemars(inner(range(min = -10.0, max = 10.0)))]
    pub tether_anchor_m: [f64; 2],
    /// Pull of the tether towards its anchor wherever the courier is, N.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub tether_tension_n: f64,
    /// Increase of that pull with the distance from the anchor, N/m.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub tether_stiffness_n_m: f64,
    /// Friction within the cables along x and along y, N: the force that is left when the courier has turned back.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub cable_friction_n: f64,
    /// The same in yaw, N m.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub cable_friction_n_m: f64,
    /// Travel over which that force builds up, m.
    #[schemars(range(min = 1e-6, max = 0.1))]
    pub cable_travel_m: f64,
    /// The same in yaw, rad.
    #[schemars(range(min = 1e-6, max = 0.1))]
    pub cable_travel_rad: f64,
    /// Share of the moment of inertia that sits on the tray, behind a mounting that twists; 0 for a rigid one. A load is on
    /// the tray.
    #[schemars(range(min = 0.0, max = 0.9))]
    pub tray_inertia_share: f64,
    /// Frequency at which the empty tray swings against the free courier, Hz.
    #[schemars(range(min = 10.0, max = 5000.0))]
    pub tray_mode_hz: f64,
    /// Damping ratio of that mode.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub tray_mode_damping: f64,
    /// Mass of the parts that slide on the tray, kg; what sticks to it belongs to the load.
    pub sliding_mass_kg: f64,
    /// Distance of these parts from the tray's centre, m.
    #[schemars(range(min = 1e-3, max = 0.5))]
    pub sliding_radius_m: f64,
    /// Their friction on the tray.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub sliding_friction: f64,
    /// Length of the blocks in which their motion becomes known, s: their friction acts on the tray one block late.
    #[schemars(range(min = 1e-4, max = 0.1))]
    pub sliding_block_s: f64,
    /// Whether the sensor sees the tray's yaw; it sees the courier's otherwise.
    pub sensor_on_tray: bool,
    /// Resolution of the position sensor, m; 0 for none.
    #[schemars(range(min = 0.0, max = 1e-3))]
    pub sensor_resolution_m: f64,
    /// Noise of the position sensor, m rms.
    #[schemars(range(min = 0.0, max = 1e-3))]
    pub sensor_noise_m_rms: f64,
    /// Age of a position when it is read, s.
    #[schemars(range(min = 0.0, max = 0.02))]
    pub sensor_delay_s: f64,
    /// Calibration error of the sensor's scale, relative.
    #[schemars(range(min = -0.1, max = 0.1))]
    pub sensor_scale_error: f64,
    /// Calibration error within a tooth pitch: amplitude of a sine, m.
    #[schemars(range(min = 0.0, max = 1e-4))]
    pub sensor_periodic_error_m: f64,
    /// What goes wrong, and when.
    pub faults: FaultHooks,
}

impl MotorParameters {
    /// A rigid body under exact, immediate force with an exact sensor.
    pub const IDEAL: Self = Self {
        mass_kg: 1.2,
        inertia_kg_m2: 0.005,
        center_of_mass_offset_m: [0.0, 0.0],
        forcer_force_n_max: 15.0,
        forcer_arm_m: 0.045,
        delay_s: 0.0,
        lag_s: 0.0,
        ripple: 0.0,
        force_loss_at_peak: 0.0,
        ripple_phase_rad: [0.0; 4],
        tooth_pitch_m: 1.016e-3,
        drag_n_s_m: 0.0,
        drag_n_m_s_rad: 0.0,
        tether_anchor_m: [0.0, 0.0],
        tether_tension_n: 0.0,
        tether_stiffness_n_m: 0.0,
        cable_friction_n: 0.0,
        cable_friction_n_m: 0.0,
        cable_travel_m: 1e-3,
        cable_travel_rad: 1e-2,
        tray_inertia_share: 0.0,
        tray_mode_hz: 1000.0,
        tray_mode_damping: 0.02,
        sliding_mass_kg: 0.0,
        sliding_radius_m: 0.085,
        sliding_friction: 0.2,
        sliding_block_s: 0.01,
        sensor_on_tray: false,
        sensor_resolution_m: 0.0,
        sensor_noise_m_rms: 0.0,
        sensor_delay_s: 0.0,
        sensor_scale_error: 0.0,
        sensor_periodic_error_m: 0.0,
        faults: FaultHooks::NONE,
    };

    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("motor.", self)?;
        // Late by a block, the reaction of much more would shake the courier.
        check_range("motor.sliding_mass_kg", self.sliding_mass_kg, 0.0, 0.2 * self.mass_kg)?;
        self.faults.validate()
    }
}

impl Default for MotorParameters {
    fn default() -> Self {
        Self::IDEAL
    }
}
