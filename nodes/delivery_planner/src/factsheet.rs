//! What the feeder tells other agents about itself.

use feeder_scenario::plan::DeliveryPlannerConfig;
use feeder_wire::{frames, services};
use minifactory_msgs::geometry_msgs::msg::Point;
use minifactory_msgs::msg::{Factsheet, Recipe, StationFact};

/// Version of the protocol that `msgs/PROTOCOL.md` describes.
const PROTOCOL_VERSION: &str = "3.1";

/// The factsheet of a feeder, with its first recipe in force.
pub(crate) fn of(config: &DeliveryPlannerConfig) -> Factsheet {
    let delivery = config.delivery();
    let (gentle, limits) = (delivery.gentle, &config.limits);
    let by_friction_m_s2 = gentle.friction_share * gentle.friction * gentle.gravity_m_s2;
    let by_motor_m_s2 = limits.translation_acceleration_m_s2_max(&config.load);
    let stations = config.stations.iter().map(|station| StationFact {
        name: station.name.clone(),
        tool_in_platen: Point { x: station.x_m, y: station.y_m, z: config.tray.plateau_height_m() },
        rechecked: station.rechecked,
    });
    let flat = |x: f64, y: f64| Point { x, y, z: 0.0 };
    Factsheet {
        protocol_version: PROTOCOL_VERSION.to_owned(),
        feeder: config.feeder.clone(),
        platen_frame: frames::PLATEN.to_owned(),
        tray_frame: frames::tray(&config.feeder),
        recipe: config.recipes.first().map(|recipe| recipe.name.clone()).unwrap_or_default(),
        recipes: config
            .recipes
            .iter()
            .map(|recipe| Recipe {
                name: recipe.name.clone(),
                part_class: config.part_class.clone(),
                pose_classes: recipe.pose_classes.clone(),
                part_diameter_m: config.part_diameter_m,
                part_height_m: config.part_height_m,
            })
            .collect(),
        stations: stations.collect(),
        tolerance_m_min: delivery.tolerance_m_min,
        hand_over_timeout_s: delivery.hand_over_timeout_s,
        starvation_s: delivery.starvation_s,
        feeding_place: flat(delivery.feeding_place.x, delivery.feeding_place.y),
        reach_min: flat(limits.x_m_min, limits.y_m_min),
        reach_max: flat(limits.x_m_max, limits.y_m_max),
        footprint_radius_m: delivery.footprint_radius_m,
        speed_m_s_max: limits.speed_m_s_max,
        acceleration_m_s2_max: by_friction_m_s2.min(by_motor_m_s2),
        reserve_area: if delivery.arbitrated { services::RESERVE_AREA.name_in("") } else { String::new() },
    }
}
