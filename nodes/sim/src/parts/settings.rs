//! What a bulk of parts needs to know besides the tray and the part.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::part::PartType;
use feeder_model::range::OutOfRange;
use feeder_model::tray::TrayGeometry;

/// Largest outer radius of a tray, m.
const LARGEST_TRAY_M: f64 = 10.0;

/// Parameters of the bulk. The defaults suit the tray of the paper; contact, settling and landing are assumed values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BulkSettings {
    /// Parts are loaded with their centres no nearer to the tray's axis than this, m. It must lie outside the critical
    /// radius of the waveform. Left out: anywhere between the walls.
    pub loading_inner_radius_m: Option<f64>,
    /// Whether parts are loaded onto the plateau as well as onto the ramp.
    pub load_plateau: bool,
    /// Radius inside which the waveform moves parts down the ramp, m: such a part is reported as stranded. Left out:
    /// there is none.
    pub critical_radius_m: Option<f64>,
    /// Time between two looks at who climbs, s: a part inside the critical radius that has not is stranded, and one outside
    /// it that was shaken and has not is blocked.
    pub stranding_time_s: f64,
    /// Coefficient of restitution between parts, 0 to 1.
    pub part_restitution: f64,
    /// Coefficient of friction between parts.
    pub part_friction: f64,
    /// Coefficient of restitution at the walls and at the face of the drop-off, 0 to 1.
    pub wall_restitution: f64,
    /// Coefficient of friction at the walls and at the face of the drop-off.
    pub wall_friction: f64,
    /// Time a part that has fallen takes to come to rest, s, in addition to the fall itself.
    pub settling_time_s: f64,
    /// Largest change of radius by the fall, m, either way.
    pub landing_scatter_m: f64,
    /// Longest distance along the ramp, beyond its foot, at which a falling part comes to rest, m.
    pub landing_length_m: f64,
}

impl Default for BulkSettings {
    fn default() -> Self {
        Self {
            loading_inner_radius_m: None,
            load_plateau: false,
            critical_radius_m: None,
            stranding_time_s: 1.0,
            part_restitution: 0.0,
            part_friction: 0.2,
            wall_restitution: 0.1,
            wall_friction: 0.2,
            settling_time_s: 0.05,
            landing_scatter_m: 0.001,
            landing_length_m: 0.005,
        }
    }
}

/// Checks that a tray is one and that parts fit onto its path.
///
/// # Errors
/// What is out of range.
pub fn check_fit(tray: &TrayGeometry, part: &PartType) -> Result<(), OutOfRange> {
    let inner = tray.inner_radius_m;
    OutOfRange::unless(inner > 0.0, "tray.inner_radius_m", inner, "(0, ∞) m")?;
    let outer = tray.outer_radius_m;
    OutOfRange::unless(
        outer > inner && outer <= LARGEST_TRAY_M,
        "tray.outer_radius_m",
        outer,
        format_args!("(tray.inner_radius_m = {inner}, {LARGEST_TRAY_M}] m"),
    )?;
    let rise = tray.rise_m;
    OutOfRange::unless(rise > 0.0, "tray.rise_m", rise, "(0, ∞) m")?;
    // Which side of the ramp's ends a part lies on is told by quadrants, so neither surface may span more than three.
    let ramp = tray.ramp_angle_rad;
    OutOfRange::unless(
        (FRAC_PI_2..=1.5 * PI).contains(&ramp),
        "tray.ramp_angle_rad",
        ramp,
        format_args!("[{FRAC_PI_2}, {}] rad", 1.5 * PI),
    )?;
    let (path, across) = (outer - inner, 2.0 * part.outline_radius_m());
    OutOfRange::unless(
        across < path,
        "the part's largest width",
        across,
        format_args!("(0, {path}) m, the width of the tray's path"),
    )?;
    let height = part.height_max_m();
    OutOfRange::unless(
        height < rise,
        "the part's largest height",
        height,
        format_args!("(0, {rise}) m, the height of the drop-off"),
    )
}

impl BulkSettings {
    pub(super) fn check(&self, tray: &TrayGeometry, part: &PartType) -> Result<(), OutOfRange> {
        let outermost = tray.outer_radius_m - part.outline_radius_m();
        let inner = self.loading_inner_radius_m.unwrap_or(0.0);
        OutOfRange::unless(
            (0.0..outermost).contains(&inner),
            "bulk.loading_inner_radius_m",
            inner,
            format_args!("[0, {outermost}) m, for the part's centre inside the outer wall"),
        )?;
        let shares =
            [("bulk.part_restitution", self.part_restitution), ("bulk.wall_restitution", self.wall_restitution)];
        for (key, value) in shares {
            OutOfRange::unless((0.0..=1.0).contains(&value), key, value, "[0, 1]")?;
        }
        let not_negative = [
            ("bulk.critical_radius_m", self.critical_radius_m.unwrap_or(0.0), "[0, ∞) m"),
            ("bulk.part_friction", self.part_friction, "[0, ∞)"),
            ("bulk.wall_friction", self.wall_friction, "[0, ∞)"),
            ("bulk.settling_time_s", self.settling_time_s, "[0, ∞) s"),
            ("bulk.landing_scatter_m", self.landing_scatter_m, "[0, ∞) m"),
        ];
        for (key, value, range) in not_negative {
            OutOfRange::unless(value >= 0.0, key, value, range)?;
        }
        let time = self.stranding_time_s;
        OutOfRange::unless(time > 0.0, "bulk.stranding_time_s", time, "(0, ∞) s")?;
        // The part has to lie on the ramp, clear of the drop-off's face.
        let longest = tray.inner_radius_m * tray.ramp_angle_rad.min(TAU / 8.0);
        let length = self.landing_length_m;
        OutOfRange::unless(
            (0.0..=longest).contains(&length),
            "bulk.landing_length_m",
            length,
            format_args!("[0, {longest}] m"),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::tests::disc;

    #[test]
    fn the_defaults_suit_the_paper_tray() {
        let part = disc(0.005, 0.2);
        check_fit(&TrayGeometry::PAPER, &part).unwrap();
        BulkSettings::default().check(&TrayGeometry::PAPER, &part).unwrap();
    }

    #[test]
    fn errors_name_key_value_and_range() {
        let message = |change: fn(&mut BulkSettings)| {
            let mut settings = BulkSettings::default();
            change(&mut settings);
            let checked = settings.check(&TrayGeometry::PAPER, &disc(0.004, 0.2));
            checked.unwrap_err().to_string()
        };
        assert_eq!(
            message(|settings| settings.loading_inner_radius_m = Some(0.089)),
            "bulk.loading_inner_radius_m = 0.089 is outside its range: [0, 0.088) m, \
             for the part's centre inside the outer wall"
        );
        assert_eq!(
            message(|settings| settings.wall_restitution = 1.5),
            "bulk.wall_restitution = 1.5 is outside its range: [0, 1]"
        );
        assert_eq!(
            message(|settings| settings.settling_time_s = f64::INFINITY),
            "bulk.settling_time_s = inf is outside its range: [0, ∞) s"
        );
        assert_eq!(
            message(|settings| settings.stranding_time_s = f64::NAN),
            "bulk.stranding_time_s = NaN is outside its range: (0, ∞) s"
        );
    }

    #[test]
    fn a_part_wider_than_the_path_or_higher_than_the_drop_is_refused() {
        let wide = check_fit(&TrayGeometry::PAPER, &disc(0.061, 0.2)).unwrap_err();
        assert_eq!(wide.parameter, "the part's largest width");
        let flat = TrayGeometry { rise_m: 0.0005, ..TrayGeometry::PAPER };
        let high = check_fit(&flat, &disc(0.005, 0.2)).unwrap_err();
        assert_eq!(high.parameter, "the part's largest height");
        let steep = TrayGeometry { ramp_angle_rad: 5.0, ..TrayGeometry::PAPER };
        let error = check_fit(&steep, &disc(0.005, 0.2)).unwrap_err();
        assert_eq!((&*error.parameter, error.value), ("tray.ramp_angle_rad", 5.0));
    }
}
