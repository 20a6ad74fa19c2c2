//! Where on the tray parts climb, and so where they may be loaded.

use super::{Scenario, ScenarioError, invalid};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::MechanicsError;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::mechanics::map::TrayMap;
use feeder_model::part::PartType;
use feeder_model::tray::Surface;
use feeder_sim::parts::{BulkSettings, check_fit};

/// Parts are loaded where they climb at least at this share of the speed they have at the outer wall.
pub(crate) const LOADING_SPEED_SHARE: f64 = 0.5;

/// Radii tried for that.
const RADII: u32 = 60;

impl Scenario {
    /// How parts behave in bulk, with the radii that follow from waveform, tray and friction where the scenario leaves
    /// them out: the critical radius, inside which parts slide back, and a loading radius outside it.
    ///
    /// # Errors
    /// A waveform under which parts climb nowhere, or a loading radius inside the critical one.
    pub fn bulk_settings(&self, part: &PartType) -> Result<BulkSettings, ScenarioError> {
        check_fit(&self.tray.geometry, part).map_err(|error| invalid("bulk", &error))?;
        let mut settings = self.bulk;
        if settings.critical_radius_m.is_none() || settings.loading_inner_radius_m.is_none() {
            let climbing = self.climbing(part).map_err(|error| invalid("bulk", &error))?;
            let Some((critical_m, loading_m)) = climbing else {
                let problem = "with this waveform and friction parts climb nowhere on the ramp; set critical_radius_m and \
                               loading_inner_radius_m to run it all the same";
                return Err(invalid("bulk", &problem));
            };
            let critical_m = *settings.critical_radius_m.get_or_insert(critical_m);
            settings.loading_inner_radius_m.get_or_insert(loading_m.max(critical_m));
        }
        let (critical_m, loading_m) =
            (settings.critical_radius_m.unwrap_or(0.0), settings.loading_inner_radius_m.unwrap_or(0.0));
        if loading_m < critical_m {
            let problem = format!(
                "loading_inner_radius_m = {loading_m} lies where parts cannot climb, allowed is critical_radius_m = \
                 {critical_m} or more"
            );
            return Err(invalid("bulk", &problem));
        }
        Ok(settings)
    }

    /// The critical radius (0 if there is none) and the loading radius, m; `None` if parts climb nowhere.
    fn climbing(&self, part: &PartType) -> Result<Option<(f64, f64)>, MechanicsError> {
        let tray = self.tray.geometry;
        let track = AnnularTrack::new(tray, part.friction, STANDARD_GRAVITY_M_S2)?;
        let Ok(waveform) = self.waveform() else { return Ok(None) };
        let map = TrayMap::new(&track, &waveform)?;
        let outermost_m = self.outermost_m(part);
        let speed_m_s = |radius_m: f64| -> Result<f64, MechanicsError> {
            Ok(map.rate_rad_s(radius_m, Surface::Ramp)?.map_or(0.0, |rate_rad_s| rate_rad_s * radius_m))
        };
        let fastest_m_s = speed_m_s(outermost_m)?;
        if fastest_m_s <= 0.0 {
            return Ok(None);
        }
        let innermost_m = tray.inner_radius_m;
        let mut loading_m = outermost_m;
        for step in (0..RADII).rev() {
            let radius_m = innermost_m + (outermost_m - innermost_m) * f64::from(step) / f64::from(RADII);
            if speed_m_s(radius_m)? < LOADING_SPEED_SHARE * fastest_m_s {
                break;
            }
            loading_m = radius_m;
        }
        Ok(Some((map.critical_radius_m()?.unwrap_or(0.0), loading_m)))
    }
}
