//! Keys that a scenario had elsewhere before.

use serde_json::Value;

use crate::ScenarioError;

/// Section and key of before, and where that is stated now.
const MOVED: [(&str, &[&str], &str); 8] = [
    ("courier", &["plant"], "world.motor"),
    ("camera", &["light"], "world.light"),
    ("camera", &["sensor"], "world.sensor"),
    ("camera", &["tray"], "world.tray"),
    (
        "delivery",
        &["gentle", "friction"],
        "the part's friction_static, or believed.part_friction where control is to err",
    ),
    ("delivery", &["tether"], "courier.limits.tether_anchor_m and tether_length_m"),
    ("delivery", &["stations_m"], "stations"),
    ("selector", &["wanted_poses"], "the part's wanted_poses"),
];

/// Refuses a scenario with such a key, and says where it belongs now.
pub(crate) fn check(yaml: &str) -> Result<(), ScenarioError> {
    // A text that is no YAML is refused with better words by whoever reads it next.
    let Ok(tree) = serde_saphyr::from_str::<Value>(yaml) else { return Ok(()) };
    for (section, path, now) in MOVED {
        let found = path.iter().try_fold(&tree[section], |branch, key| branch.get(key));
        if found.is_some() {
            let problem = format!("{} is not stated here any more, but in {now}", path.join("."));
            return Err(ScenarioError::Invalid { section, problem });
        }
    }
    Ok(())
}
