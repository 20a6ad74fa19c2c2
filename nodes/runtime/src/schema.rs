//! What the JSON Schema of a configuration says of each of its values.

use schemars::JsonSchema;
use serde_json::Value as Json;

use crate::parameters::{Range, Value};

/// The JSON Schema of a configuration.
pub(crate) struct ConfigSchema(Json);

/// A schema that a value may follow.
#[derive(Clone, Copy)]
struct Place<'a> {
    schema: &'a Json,
    /// Its own description, or that of what it is an element of.
    description: Option<&'a str>,
    /// Whether it is a variant of an enum: what a variant holds may be described by the variant alone.
    variant: bool,
}

impl ConfigSchema {
    pub(crate) fn of<C: JsonSchema>() -> Self {
        Self(schemars::schema_for!(C).into())
    }

    /// Description and range of the value with a dotted name, as far as they are stated.
    pub(crate) fn of_value(&self, name: &str, value: &Value) -> (Option<String>, Option<Range>) {
        let root = self.unfold(Place { schema: &self.0, description: None, variant: false });
        let places = name.split('.').fold(root, |places, key| {
            let below = places.iter().flat_map(|place| below(place, key));
            below.flat_map(|place| self.unfold(place)).collect()
        });
        // What is said of a value in its place goes before what is said of its type.
        let description = places.iter().find_map(|place| place.description);
        let description = description.map(|text| text.split_whitespace().collect::<Vec<_>>().join(" "));
        (description, places.iter().find_map(|place| range(place.schema, value)))
    }

    /// A place, the type it refers to, and its alternatives.
    fn unfold<'a>(&'a self, place: Place<'a>) -> Vec<Place<'a>> {
        let mut places = vec![place];
        let mut next = 0;
        while let Some(&Place { schema, description, .. }) = places.get(next) {
            next += 1;
            let further = |schema: &'a Json, variant| Place {
                schema,
                description: schema["description"].as_str().or(description),
                variant,
            };
            let referred = schema["$ref"].as_str().and_then(|name| self.0.pointer(name.strip_prefix('#')?));
            places.extend(referred.map(|schema| further(schema, false)));
            let variants = ["oneOf", "anyOf"].iter().filter_map(|key| schema[key].as_array()).flatten();
            places.extend(variants.map(|schema| further(schema, schema.get("properties").is_some())));
        }
        places
    }
}

/// What follows under a key, or under an index of a list.
fn below<'a>(place: &Place<'a>, key: &str) -> Option<Place<'a>> {
    let schema = place.schema;
    let (found, inherits) = match (schema["properties"].get(key), key.parse::<usize>()) {
        (Some(field), _) => (field, place.variant),
        (None, Ok(index)) => (schema["prefixItems"].get(index).or_else(|| schema.get("items"))?, true),
        (None, Err(_)) => (schema.get("additionalProperties").filter(|schema| schema.is_object())?, true),
    };
    let description = found["description"].as_str().or(place.description.filter(|_| inherits));
    Some(Place { schema: found, description, variant: false })
}

/// The range of a number, where both of its ends are stated: ROS knows no other.
fn range(schema: &Json, value: &Value) -> Option<Range> {
    let (from, to) = (schema.get("minimum")?, schema.get("maximum")?);
    match value {
        Value::Integer(_) => Some(Range::Integer { from: from.as_i64()?, to: to.as_i64()?, step: 0 }),
        Value::Double(_) => Some(Range::Double { from: from.as_f64()?, to: to.as_f64()?, step: 0.0 }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(JsonSchema)]
    #[expect(dead_code, reason = "only its schema is read")]
    struct Config {
        /// How high,
        /// in metres
        #[schemars(range(min = -0.5, max = 2.0))]
        height_m: f64,
        /// How good, 1 to 100
        #[schemars(range(min = 1, max = 100))]
        quality: u8,
        undescribed: u32,
        /// Where it looks
        eye: Eye,
        /// Further ones
        others: Option<Vec<Eye>>,
        /// What it is like
        shape: Shape,
        /// Rows of numbers
        rows: Vec<Vec<f64>>,
    }

    /// An eye
    #[derive(JsonSchema)]
    #[expect(dead_code, reason = "only its schema is read")]
    struct Eye {
        /// Its colour
        colour: Colour,
        undescribed: bool,
    }

    /// A colour
    #[derive(JsonSchema)]
    #[expect(dead_code, reason = "only its schema is read")]
    #[serde(rename_all = "snake_case")]
    enum Colour {
        /// As the sky
        Blue,
        /// As grass
        Green,
    }

    #[derive(JsonSchema)]
    #[expect(dead_code, reason = "only its schema is read")]
    #[serde(rename_all = "snake_case")]
    enum Shape {
        /// Radius of a disc
        Disc(f64),
        /// A slab
        Slab {
            /// Its width
            width_m: f64,
        },
    }

    #[test]
    fn a_value_is_described_where_it_stands() {
        let schema = ConfigSchema::of::<Config>();
        for (name, expected) in [
            ("height_m", Some("How high, in metres")),
            ("undescribed", None),
            ("eye.colour", Some("Its colour")),
            ("eye.undescribed", None),
            ("others.3.colour", Some("Its colour")),
            ("shape.disc", Some("Radius of a disc")),
            ("shape.slab.width_m", Some("Its width")),
            ("rows.2", Some("Rows of numbers")),
            ("nothing", None),
        ] {
            assert_eq!(schema.of_value(name, &Value::Bool(true)).0.as_deref(), expected, "{name}");
        }
    }

    #[test]
    fn a_number_has_the_range_that_is_stated() {
        let schema = ConfigSchema::of::<Config>();
        let height = schema.of_value("height_m", &Value::Double(0.0)).1;
        assert_eq!(height, Some(Range::Double { from: -0.5, to: 2.0, step: 0.0 }));
        let quality = schema.of_value("quality", &Value::Integer(90)).1;
        assert_eq!(quality, Some(Range::Integer { from: 1, to: 100, step: 0 }));
        assert_eq!(schema.of_value("undescribed", &Value::Integer(1)).1, None);
    }
}
