//! Concatenated schemas, as bags carry them.

use crate::{
    catalogue::Catalogue,
    model::{Role, Structure},
};

impl Catalogue {
    /// Definition of a type, followed by those of all types it refers to, by name, each under a heading, as bags carry
    /// it (`ros2msg`).
    #[must_use]
    pub fn schema(&self, structure: &Structure) -> String {
        let name = &structure.name;
        // The text of a service or action states the fields of its parts itself.
        let parts: Vec<_> = match structure.role {
            Role::Service => ["_Request", "_Response"].map(|suffix| name.with_suffix(suffix)).into(),
            Role::Action => ["_Goal", "_Result", "_Feedback"].map(|suffix| name.with_suffix(suffix)).into(),
            Role::Message | Role::Wrapper | Role::Event => vec![name.clone()],
        };
        let mut references: Vec<_> = parts.iter().flat_map(|part| self.references(part)).collect();
        references.sort();
        references.dedup();
        let rule = "=".repeat(80);
        let mut text = structure.text.clone();
        for reference in references.into_iter().filter_map(|reference| self.get(reference)) {
            let heading = format!("{rule}\nMSG: {}\n", reference.name.short());
            text.push_str(&heading);
            text.push_str(&reference.text);
        }
        text
    }
}
