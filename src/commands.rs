//! The commands by workflow, and what they print with `--json`.

pub(crate) mod analysis;
pub(crate) mod cluster;
pub(crate) mod evaluate;
pub(crate) mod experiments;
pub(crate) mod inspect;
pub(crate) mod recordings;
pub(crate) mod reference;

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
    "analyse" => analysis::analyse::Analyse,
    "analyse-samples" => analysis::samples::Samples,
    "check" => experiments::check::Check,
    "compare" => analysis::compare::Compare,
    "compare-by-distance" => depthloom_analysis::DistanceComparisonOutput,
    "doctor" => reference::doctor::Doctor,
    "error" => crate::output::diagnostics::Failed,
    "explain" => depthloom_analysis::Explain,
    "export" => recordings::export::Export,
    "figure" => analysis::figure::Figure,
    "graph" => render::Graph,
    "inspect-data-set" => inspect::data_set::Data,
    "inspect-onnx" => inspect::network::Onnx,
    "inspect-recording" => inspect::recording::Info,
    "jobs" => cluster::show::Jobs,
    "live" => crate::execution::live::LiveOutput,
    "nodes" => render::Nodes,
    "nodes-kind" => render::NodesKind,
    "plan" => render::Plan,
    "plan-cost" => experiments::cost::PlanCost,
    "plan-reuse" => experiments::plan::PlanReuse,
    "report" => crate::results::report::Report,
    "run" => crate::execution::Run,
    "runs-diff" => depthloom_verify::RunDifference,
    "runs-list" => recordings::runs::RunsList,
    "runs-notes" => recordings::runs::RunsNotes,
    "runs-prune" => recordings::runs::RunsPrune,
    "runs-recover" => recordings::runs::Recover,
    "runs-rm" => recordings::runs::RunsRm,
    "runs-show" => recordings::runs::RunsShow,
    "runs-timings" => recordings::runs::Timings,
    "table" => depthloom_analysis::TableOutput,
    "verify" => recordings::verify::Verify,
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::SCHEMAS;
    use serde_json::json;

    use crate::output::text;

    /// `DEPTHLOOM_WRITE_SCHEMAS=1` writes them.
    #[test]
    fn published_schemas_match_the_types() {
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
    fn outputs_begin_with_the_format_that_the_schema_requires() {
        let printed = text(&super::recordings::runs::RunsRm::default());
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
