//! The commands, one file each, and what they print with `--json`.

pub(crate) mod analyse;
pub(crate) mod check;
pub(crate) mod compare;
pub(crate) mod completions;
pub(crate) mod data;
pub(crate) mod doctor;
pub(crate) mod dora;
pub(crate) mod dora_node;
pub(crate) mod explain;
pub(crate) mod export;
pub(crate) mod figure;
pub(crate) mod graph;
pub(crate) mod info;
pub(crate) mod man;
pub(crate) mod new;
pub(crate) mod nodes;
pub(crate) mod onnx;
pub(crate) mod plan;
pub(crate) mod recover;
pub(crate) mod replay;
pub(crate) mod report;
pub(crate) mod run;
pub(crate) mod runs;
pub(crate) mod samples;
pub(crate) mod schema;
pub(crate) mod synth;
pub(crate) mod table;
pub(crate) mod timings;

use depthloom_graphs::render;
use serde_json::Value as Json;

use crate::output::{CommandOutput, schema};

/// Names the outputs, and lists their schemas by name.
macro_rules! outputs {
    ($($name:literal => $output:ty,)+) => {
        $(impl CommandOutput for $output {
            const NAME: &'static str = $name;
        })+

        /// The JSON Schemas of what commands print with `--json`, by name.
        pub(crate) const SCHEMAS: &[(&str, fn() -> Json)] = &[$(($name, schema::<$output>)),+];
    };
}

outputs! {
    "analyse" => analyse::Analyse,
    "check" => check::Check,
    "compare" => compare::Compare,
    "compare-by-distance" => depthloom_analysis::DistanceComparisonOutput,
    "data" => data::Data,
    "doctor" => doctor::Doctor,
    "error" => crate::diagnostics::Failed,
    "explain" => depthloom_analysis::Explain,
    "export" => export::Export,
    "figure" => figure::Figure,
    "graph" => render::Graph,
    "info" => info::Info,
    "nodes" => render::Nodes,
    "nodes-kind" => render::NodesKind,
    "onnx" => onnx::Onnx,
    "plan" => render::Plan,
    "plan-reuse" => plan::PlanReuse,
    "recover" => recover::Recover,
    "replay" => replay::Replay,
    "report" => crate::report::Report,
    "run" => crate::execution::Run,
    "runs-list" => runs::RunsList,
    "runs-prune" => runs::RunsPrune,
    "runs-rm" => runs::RunsRm,
    "runs-show" => runs::RunsShow,
    "runs-why" => depthloom_runs::RunDifference,
    "samples" => samples::Samples,
    "table" => depthloom_analysis::TableOutput,
    "timings" => timings::Timings,
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::SCHEMAS;
    use serde_json::json;

    use crate::output::text;

    /// `DEPTHLOOM_WRITE_SCHEMAS=1` writes them.
    #[test]
    fn published_schemas_are_those_of_the_types() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/schemas");
        let write = std::env::var_os("DEPTHLOOM_WRITE_SCHEMAS").is_some();
        let mut names = Vec::new();
        for (name, schema) in SCHEMAS {
            let name = format!("{name}.json");
            let schema = format!("{:#}\n", schema());
            if write {
                std::fs::write(folder.join(&name), &schema).unwrap();
            }
            let published = std::fs::read_to_string(folder.join(&name)).unwrap_or_default();
            assert!(
                published == schema,
                "stale: DEPTHLOOM_WRITE_SCHEMAS=1 cargo test --release -p depthloom --lib schemas"
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
        let printed = text(&super::runs::RunsRm::default());
        let printed: serde_json::Value = serde_json::from_str(&printed).unwrap();
        assert_eq!(
            printed.to_string(),
            r#"{"format":{"name":"depthloom.runs-rm","version":1},"removed":[],"bytes":0}"#
        );
        let (_, schema) = SCHEMAS.iter().find(|(name, _)| *name == "runs-rm").unwrap();
        let schema = schema();
        assert_eq!(schema["properties"]["format"]["const"], printed["format"]);
        assert_eq!(schema["required"], json!(["format", "removed", "bytes"]));
    }
}
