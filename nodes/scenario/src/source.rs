//! What a scenario states by name or spells out.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeOwned, Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

/// A thing as a scenario states it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Source<T> {
    /// By a name that comes with the feeder, or by that of a file that is still to be read.
    Name(String),
    /// Spelled out.
    Here(Box<T>),
}

impl<'de, T: DeserializeOwned> Deserialize<'de> for Source<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Other than an untagged enum, this tells which key of the thing is wrong.
        struct NameOrThing<T>(PhantomData<T>);
        impl<'de, T: DeserializeOwned> Visitor<'de> for NameOrThing<T> {
            type Value = Source<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the name of a file, or its content")
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<Source<T>, E> {
                Ok(Source::Name(name.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Source<T>, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map)).map(|thing| Source::Here(Box::new(thing)))
            }
        }
        deserializer.deserialize_any(NameOrThing(PhantomData))
    }
}

impl<T: JsonSchema> JsonSchema for Source<T> {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        format!("SourceOf{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        json_schema!({"anyOf": [generator.subschema_for::<String>(), generator.subschema_for::<T>()]})
    }
}
