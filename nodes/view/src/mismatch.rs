//! Whether what runs is what is shown: the scenario that a view was given against what the graph says of itself.
//!
//! No topic tells all that the page draws, so a view must be told the scenario. Told another than the one that runs, it would
//! draw parts that are none on a tray that is not there.

use feeder_wire::markers;
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::visualization_msgs::msg::MarkerArray;

use crate::description::{Description, Feeder};
use crate::heard::FeederHeard;

/// Farthest that a station may be from where the scenario has it, m.
const STATION_M: f64 = 1e-6;

/// How what is heard of a feeder contradicts what is shown, for people.
pub(crate) fn mismatch(cell: &Description, feeder: &Feeder, heard: &FeederHeard) -> Option<String> {
    let said: Vec<String> =
        [part(cell, heard), tray(feeder, heard), station(cell, heard)].into_iter().flatten().collect();
    let runs = "what runs is not the scenario that is shown";
    (!said.is_empty()).then(|| format!("{runs}: {}; give --scenario what was given to the run", said.join(", ")))
}

fn part(cell: &Description, heard: &FeederHeard) -> Option<String> {
    let sheet = heard.factsheet.latest()?;
    let shown = &cell.part.name;
    let other = sheet.recipes.iter().find(|recipe| recipe.part_class != *shown)?;
    Some(format!("it feeds {}, not {shown}", other.part_class))
}

fn tray(feeder: &Feeder, heard: &FeederHeard) -> Option<String> {
    let points =
        |array: &MarkerArray| array.markers.iter().flat_map(|marker| marker.points.clone()).collect::<Vec<_>>();
    let drawn = points(&heard.tray.latest()?);
    (drawn != points(&markers::tray(&Header::default(), &feeder.tray))).then(|| "its tray has another shape".to_owned())
}

fn station(cell: &Description, heard: &FeederHeard) -> Option<String> {
    let sheet = heard.factsheet.latest()?;
    let shown = cell.stations.iter().filter(|station| station.serves.contains(&sheet.feeder));
    let missing = shown.into_iter().find(|shown| {
        let here = sheet.stations.iter().find(|station| station.name == shown.name);
        here.is_none_or(|here| (here.tool_in_platen.x - shown.x_m).hypot(here.tool_in_platen.y - shown.y_m) > STATION_M)
    })?;
    Some(format!("its {} is elsewhere or missing", missing.name))
}
