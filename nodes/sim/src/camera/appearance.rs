//! How bright the surfaces under the camera are.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::range::OutOfRange;

/// How bright the fixed surfaces are: the share of light that comes back from each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrayAppearance {
    /// The running surface.
    pub surface_reflectance: f64,
    /// The walls' faces.
    pub wall_reflectance: f64,
    /// The outer wall's rim and the hub's top.
    pub rim_reflectance: f64,
    /// The platen between its teeth.
    pub platen_reflectance: f64,
    /// The platen's teeth.
    pub tooth_reflectance: f64,
    /// Distance between teeth, m.
    pub tooth_pitch_m: f64,
    /// Amplitude of the cloudiness of all tray surfaces, relative.
    pub mottling_ratio: f64,
}

impl Default for TrayAppearance {
    fn default() -> Self {
        Self {
            surface_reflectance: 0.70,
            wall_reflectance: 0.62,
            rim_reflectance: 0.80,
            platen_reflectance: 0.21,
            tooth_reflectance: 0.30,
            tooth_pitch_m: 0.001_016,
            mottling_ratio: 0.012,
        }
    }
}

impl TrayAppearance {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming the field out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        for (field, value) in [
            ("tray.surface_reflectance", self.surface_reflectance),
            ("tray.wall_reflectance", self.wall_reflectance),
            ("tray.rim_reflectance", self.rim_reflectance),
            ("tray.platen_reflectance", self.platen_reflectance),
            ("tray.tooth_reflectance", self.tooth_reflectance),
            ("tray.mottling_ratio", self.mottling_ratio),
        ] {
            OutOfRange::unless((0.0..=1.0).contains(&value), field, value, "0 to 1")?;
        }
        let pitch_ok = (1e-4..=0.1).contains(&self.tooth_pitch_m);
        OutOfRange::unless(pitch_ok, "tray.tooth_pitch_m", self.tooth_pitch_m, "1e-4 to 0.1 m")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_appearance_is_refused_by_name() {
        let dark = TrayAppearance { surface_reflectance: -0.1, ..TrayAppearance::default() };
        assert_eq!(dark.validate().unwrap_err().parameter, "tray.surface_reflectance");
    }
}
