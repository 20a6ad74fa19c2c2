//! Definitions given as text.

use ros2_msggen::{Catalogue, DefinitionFile, Error, PackageFolder, Structure, TypeName};

/// Parses one message `demo_msgs/Spot`, whose fields may be `Point`s.
pub(crate) fn parse(text: &str) -> Result<Structure, Error> {
    let catalogue = Catalogue::new(&with_needed([source(PackageFolder::Msg, "Spot", text)]))?;
    let spot = catalogue.get(&TypeName::message("demo_msgs", "Spot"));
    Ok(spot.expect("the message").clone())
}

/// A definition in the package `demo_msgs`.
pub(crate) fn source(namespace: PackageFolder, name: &str, text: &str) -> DefinitionFile {
    DefinitionFile {
        package: "demo_msgs".to_owned(),
        namespace,
        name: name.to_owned(),
        file: format!("{0}/{name}.{0}", namespace.as_str()).into(),
        text: text.to_owned(),
    }
}

/// Adds a message `Point`, and what services and actions need, with fields of no matter.
pub(crate) fn with_needed<const N: usize>(sources: [DefinitionFile; N]) -> Vec<DefinitionFile> {
    let of = |package: &str, name| DefinitionFile {
        package: package.to_owned(),
        ..source(PackageFolder::Msg, name, "int32 a\n")
    };
    let needed = [
        of("demo_msgs", "Point"),
        of("service_msgs", "ServiceEventInfo"),
        of("unique_identifier_msgs", "UUID"),
        of("builtin_interfaces", "Time"),
    ];
    needed.into_iter().chain(sources).collect()
}
