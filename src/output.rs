//! What commands print with `--json`: a struct with a name and a version.
//!
//! The types that commands fill define the outputs. Tests compare the schemas in `docs/schemas` with these types, and
//! what commands print with the schemas. The version is raised when a key goes or changes its meaning, not when there
//! is a new key.

pub(crate) mod delivery;
pub(crate) mod diagnostics;
pub(crate) mod frame_progress;
pub(crate) mod live;
pub(crate) mod progress;
pub(crate) mod warnings;

use depthloom_terminal::{CliError, print_quoted};
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde::Serialize;
use serde_json::{Map, Value as Json, json};

/// The version of the keys of all outputs.
const VERSION: u32 = 1;

/// What a command prints with `--json`: the type that it fills is the type that its schema describes.
pub(crate) trait CommandOutput: Serialize + JsonSchema {
    /// Its name, as `schema --of` takes it.
    const NAME: &'static str;
}

/// An output of a command as indented JSON, its format in front.
pub(crate) fn text<T: CommandOutput>(value: &T) -> String {
    let value = serde_json::to_value(value).expect("texts, numbers and lists have JSON");
    let mut stamped = Map::from_iter([("format".to_owned(), format::<T>())]);
    match value {
        Json::Object(object) => stamped.extend(object),
        other => _ = stamped.insert("value".to_owned(), other),
    }
    format!("{:#}\n", Json::Object(stamped))
}

/// Prints an output of a command as indented JSON, its format in front.
pub(crate) fn print<T: CommandOutput>(value: &T) -> Result<(), CliError> {
    print_quoted(&text(value))
}

/// The name and the version, under `format` in every output.
fn format<T: CommandOutput>() -> Json {
    json!({ "name": format!("depthloom.{}", T::NAME), "version": VERSION })
}

pub(crate) fn schema<T: CommandOutput>() -> Json {
    // Of what is written: a key that may be null is there.
    let settings = SchemaSettings::draft2020_12().for_serialize();
    let mut schema = settings.into_generator().into_root_schema_for::<T>().to_value();
    let Some(object) = schema.as_object_mut() else { return schema };
    object.insert("title".to_owned(), format!("depthloom.{}", T::NAME).into());
    let format = json!({ "description": "What this is, and the version of its keys.", "const": format::<T>() });
    let mut properties = Map::from_iter([("format".to_owned(), format)]);
    if let Some(Json::Object(own)) = object.get_mut("properties").map(Json::take) {
        properties.extend(own);
    }
    object.insert("properties".to_owned(), properties.into());
    let mut required = vec![Json::from("format")];
    if let Some(Json::Array(own)) = object.get_mut("required").map(Json::take) {
        required.extend(own);
    }
    object.insert("required".to_owned(), required.into());
    schema
}
