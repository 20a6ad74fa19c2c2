//! Definitions given as text.

use minifactory_msggen::{Catalogue, Error, Namespace, Source, Structure, TypeName};

/// Parses one message `demo_msgs/Spot`, whose fields may be `Point`s.
pub(crate) fn parse(text: &str) -> Result<Structure, Error> {
    let point = source(Namespace::Msg, "Point", "float64 x_m\n");
    let catalogue = Catalogue::new(&[point, source(Namespace::Msg, "Spot", text)])?;
    let spot = catalogue.get(&TypeName::message("demo_msgs", "Spot"));
    Ok(spot.expect("the message").clone())
}

pub(crate) fn source(namespace: Namespace, name: &str, text: &str) -> Source {
    Source {
        package: "demo_msgs".to_owned(),
        namespace,
        name: name.to_owned(),
        file: format!("{0}/{name}.{0}", namespace.as_str()).into(),
        text: text.to_owned(),
    }
}
