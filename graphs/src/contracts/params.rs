//! Parameter types with a meaning the language knows.

use std::path::{Path, PathBuf};

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

/// A path in a parameter, relative to the folder of the YAML file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct DataPath(pub PathBuf);

impl DataPath {
    /// The path.
    pub fn path(&self) -> &Path {
        &self.0
    }
}

inline_schema!(DataPath, { "type": "string", "format": "path" });

/// A word of a command: the program or an argument. A word that begins with `./` or `../`, or has an extension or a
/// `/` and names a file next to the YAML file, is resolved against that folder.
///
/// Only the file's name is part of a node hash: other parameters declare its content.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Argument(pub String);

inline_schema!(Argument, { "type": "string", "format": "argument" });

/// A parameter that follows others unless it has its own value: `auto`, or the value.
///
/// [`Node::resolve`](super::Node::resolve) replaces `auto`, so keys, recordings and nodes see numbers only. The
/// parameter names those it follows, `#[schemars(extend("follows" = ["block"]))]`, and its range, `extend("minimum" =
/// 0)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Auto<T> {
    /// Follows the others.
    #[default]
    Auto,
    /// Its own value.
    Value(T),
}

impl<T: Copy> Auto<T> {
    /// Its own value, or the one that follows from the others.
    pub fn or_else(self, follow: impl FnOnce() -> T) -> T {
        match self {
            Self::Auto => follow(),
            Self::Value(value) => value,
        }
    }
}

const AUTO: &str = "auto";

impl<T: Serialize> Serialize for Auto<T> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => serializer.serialize_str(AUTO),
            Self::Value(value) => value.serialize(serializer),
        }
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Auto<T> {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        enum Word {
            #[serde(rename = "auto")]
            Auto,
        }
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "neither `auto` nor a value of its own")]
        enum Written<T> {
            Word(Word),
            Value(T),
        }
        Ok(match Written::deserialize(deserializer)? {
            Written::Word(Word::Auto) => Self::Auto,
            Written::Value(value) => Self::Value(value),
        })
    }
}

impl<T: JsonSchema> JsonSchema for Auto<T> {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        format!("Auto_{}", T::schema_name()).into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [generator.subschema_for::<T>(), { "const": AUTO }] })
    }
}
