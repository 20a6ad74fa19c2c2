//! How something fares, for `/diagnostics`.

use minifactory_msgs::diagnostic_msgs::msg::{DiagnosticArray, DiagnosticStatus, KeyValue};
use minifactory_msgs::std_msgs::msg::Header;

/// How good or bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HealthLevel {
    /// All is well.
    Good,
    /// It goes on, but somebody should look.
    Warning,
    /// It does not go on.
    Error,
}

/// How a node, or a part of one, fares.
#[derive(Clone, Debug, PartialEq)]
pub struct Health {
    /// What it is about: the full name of a node, or that and a word more.
    pub name: String,
    /// How good or bad it is.
    pub level: HealthLevel,
    /// The same for people.
    pub message: String,
    /// The machine that it is about; empty: none.
    pub hardware_id: String,
    /// What else there is to know: names, with units, and values.
    pub values: Vec<(String, String)>,
}

impl Health {
    /// The message.
    #[must_use]
    pub fn into_message(self, header: Header) -> DiagnosticArray {
        let Self { name, level, message, hardware_id, values } = self;
        let level = match level {
            HealthLevel::Good => DiagnosticStatus::OK,
            HealthLevel::Warning => DiagnosticStatus::WARN,
            HealthLevel::Error => DiagnosticStatus::ERROR,
        };
        let values = values.into_iter().map(|(key, value)| KeyValue { key, value }).collect();
        DiagnosticArray { header, status: vec![DiagnosticStatus { level, name, message, hardware_id, values }] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_in_its_place_in_the_message() {
        for (level, number) in [(HealthLevel::Good, 0), (HealthLevel::Warning, 1), (HealthLevel::Error, 2)] {
            let text = |text: &str| text.to_owned();
            let (name, message, hardware_id) = (text("/feeder/driver"), text("stuck"), text("motor 7"));
            let values = vec![(text("error (m)"), text("0.1"))];
            let header = Header { frame_id: text("frame"), ..Header::default() };
            let health = Health {
                name: name.clone(),
                level,
                message: message.clone(),
                hardware_id: hardware_id.clone(),
                values,
            };
            let values = vec![KeyValue { key: text("error (m)"), value: text("0.1") }];
            let status = DiagnosticStatus { level: number, name, message, hardware_id, values };
            assert_eq!(health.into_message(header.clone()), DiagnosticArray { header, status: vec![status] });
        }
    }
}
