//! What commands print with `--json`: the name and version of each output, and its JSON Schema.
//!
//! The types that commands fill define the outputs. Tests compare the schemas in `docs/schemas` with these types, and what commands print with the
//! schemas. A version is raised when a key goes or changes its meaning, not when there is a new key.

use clap::ValueEnum;
use depthloom_graphs::render;
use depthloom_terminal::{Stop, print_quoted};
use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema};
use serde::Serialize;
use serde_json::{Map, Value as Json, json};

use crate::commands;
use crate::diagnostics;

/// What a command prints with `--json`: the type that it fills is the type that its schema describes.
pub trait CommandOutput: Serialize + JsonSchema {
    /// Its name and version.
    const OUTPUT: Output;
}

/// An output of a command as indented JSON, its format in front.
pub fn text<T: CommandOutput>(value: &T) -> String {
    let value = serde_json::to_value(value).expect("texts, numbers and lists have JSON");
    format!("{:#}\n", T::OUTPUT.stamped(value))
}

/// Prints an output of a command as indented JSON, its format in front.
pub fn print<T: CommandOutput>(value: &T) -> Result<(), Stop> {
    print_quoted(&text(value))
}

/// An output of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Output {
    /// Of `analyse`.
    Analyse,
    /// Of `check`.
    Check,
    /// Of `compare`.
    Compare,
    /// Of `compare --by distance`.
    CompareByDistance,
    /// Of `data`.
    Data,
    /// Of `doctor`.
    Doctor,
    /// Of any command that ends before it has anything else to print.
    Error,
    /// Of `explain`.
    Explain,
    /// Of `export`.
    Export,
    /// Of `figure`.
    Figure,
    /// Of `graph`.
    Graph,
    /// Of `info`.
    Info,
    /// Of `nodes`.
    Nodes,
    /// Of `nodes KIND`.
    NodesKind,
    /// Of `onnx`.
    Onnx,
    /// Of `plan`.
    Plan,
    /// Of `plan --reuse`.
    PlanReuse,
    /// Of `recover`.
    Recover,
    /// Of `replay`.
    Replay,
    /// Of `report`.
    Report,
    /// Of `run`.
    Run,
    /// Of `runs`.
    RunsList,
    /// Of `runs prune`.
    RunsPrune,
    /// Of `runs rm`.
    RunsRm,
    /// Of `runs show`.
    RunsShow,
    /// Of `runs why`.
    RunsWhy,
    /// Of `samples`.
    Samples,
    /// Of `table`.
    Table,
    /// Of `timings`.
    Timings,
}

impl Output {
    /// Its name as `schema --output` takes it.
    fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// The version of its keys.
    const fn version(self) -> u32 {
        1
    }

    /// What every output says of itself, under `format`.
    fn format(self) -> Json {
        json!({ "name": format!("depthloom.{}", self.name()), "version": self.version() })
    }

    /// An object with its `format` in front.
    fn stamped(self, value: Json) -> Json {
        let mut stamped = Map::new();
        stamped.insert("format".to_owned(), self.format());
        match value {
            Json::Object(object) => stamped.extend(object),
            other => _ = stamped.insert("value".to_owned(), other),
        }
        Json::Object(stamped)
    }

    /// Its JSON Schema.
    pub fn schema(self) -> Json {
        match self {
            Self::Analyse => self.schema_of::<commands::samples::Analyse>(),
            Self::Check => self.schema_of::<commands::check::Check>(),
            Self::Compare => self.schema_of::<commands::compare::Compare>(),
            Self::CompareByDistance => self.schema_of::<depthloom_analysis::DistanceComparisonOutput>(),
            Self::Data => self.schema_of::<commands::data::Data>(),
            Self::Doctor => self.schema_of::<commands::doctor::Doctor>(),
            Self::Error => self.schema_of::<diagnostics::Failed>(),
            Self::Explain => self.schema_of::<depthloom_analysis::Explain>(),
            Self::Export => self.schema_of::<commands::export::Export>(),
            Self::Figure => self.schema_of::<commands::figure::Figure>(),
            Self::Graph => self.schema_of::<render::Graph>(),
            Self::Info => self.schema_of::<commands::info::Info>(),
            Self::Nodes => self.schema_of::<render::Nodes>(),
            Self::NodesKind => self.schema_of::<render::NodesKind>(),
            Self::Onnx => self.schema_of::<commands::onnx::Onnx>(),
            Self::Plan => self.schema_of::<render::Plan>(),
            Self::PlanReuse => self.schema_of::<commands::plan::PlanReuse>(),
            Self::Recover => self.schema_of::<commands::recover::Recover>(),
            Self::Replay => self.schema_of::<commands::replay::Replay>(),
            Self::Report => self.schema_of::<commands::report::Report>(),
            Self::Run => self.schema_of::<commands::run::Run>(),
            Self::RunsList => self.schema_of::<commands::runs::RunsList>(),
            Self::RunsPrune => self.schema_of::<commands::runs::RunsPrune>(),
            Self::RunsRm => self.schema_of::<commands::runs::RunsRm>(),
            Self::RunsShow => self.schema_of::<commands::runs::RunsShow>(),
            Self::RunsWhy => self.schema_of::<commands::runs::RunsWhy>(),
            Self::Samples => self.schema_of::<commands::samples::Samples>(),
            Self::Table => self.schema_of::<depthloom_analysis::TableOutput>(),
            Self::Timings => self.schema_of::<commands::report::Timings>(),
        }
    }

    fn schema_of<T: JsonSchema>(self) -> Json {
        // Of what is written: a key that may be null is there.
        let schema: Schema =
            SchemaSettings::draft2020_12().for_serialize().into_generator().into_root_schema_for::<T>();
        let mut schema = schema.to_value();
        let Some(object) = schema.as_object_mut() else { return schema };
        object.insert("title".to_owned(), format!("depthloom.{}", self.name()).into());
        let format = json!({ "description": "What this is, and the version of its keys.", "const": self.format() });
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
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// `DEPTHLOOM_WRITE_SCHEMAS=1` writes them.
    #[test]
    fn published_schemas_are_those_of_the_types() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/schemas");
        let write = std::env::var_os("DEPTHLOOM_WRITE_SCHEMAS").is_some();
        let mut names = Vec::new();
        for output in Output::value_variants() {
            let name = format!("{}.json", output.name());
            let schema = format!("{:#}\n", output.schema());
            if write {
                std::fs::write(folder.join(&name), &schema).unwrap();
            }
            let published = std::fs::read_to_string(folder.join(&name)).unwrap_or_default();
            assert!(
                published == schema,
                "stale: DEPTHLOOM_WRITE_SCHEMAS=1 cargo test --release -p depthloom --lib outputs"
            );
            names.push(name);
        }
        let files = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut files: Vec<String> = files.collect();
        files.sort();
        names.sort();
        assert_eq!(files, names);
    }

    #[test]
    fn the_format_stands_in_front_and_is_what_the_schema_asks_for() {
        let stamped = Output::RunsRm.stamped(json!({ "removed": [], "bytes": 0 }));
        assert_eq!(
            stamped.to_string(),
            r#"{"format":{"name":"depthloom.runs-rm","version":1},"removed":[],"bytes":0}"#
        );
        let schema = Output::RunsRm.schema();
        assert_eq!(schema["properties"]["format"]["const"], stamped["format"]);
        assert_eq!(schema["required"], json!(["format", "removed", "bytes"]));
    }
}
