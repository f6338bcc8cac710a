//! `depthloom schema`: the JSON Schema of experiment files, or of what a command prints.

use depthloom_graphs::{Registry, language};
use depthloom_terminal::{CliError, ExitCode, print_json};
use serde_json::Value as Json;

/// Prints the schema of an output, or that of experiment files.
pub(crate) fn schema(output: Option<fn() -> Json>, registry: &Registry) -> Result<ExitCode, CliError> {
    print_json(&output.map_or_else(|| language::schema(registry), |output| output()))?;
    Ok(ExitCode::Success)
}
