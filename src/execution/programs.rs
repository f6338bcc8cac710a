//! What the programs of a run printed.

use depthloom_nodes::process;
use depthloom_runs::run_folder::RunFolder;
use depthloom_terminal::CliError;

/// The file in the run's folder for what programs wrote to standard error.
pub(super) const PRINTED: &str = "programs.log";

/// Writes what programs printed; returns whether there is any, and warnings about programs that failed after their last
/// reply.
pub(super) fn write_printed(folder: &RunFolder) -> Result<(bool, Vec<String>), CliError> {
    let ended = process::take_ended();
    let text = process::printed_text(&ended);
    if !text.is_empty() {
        folder.write(PRINTED, &text)?;
    }
    let failed =
        ended.iter().filter_map(|program| Some(format!("`{}` {}", program.command, program.failure.as_ref()?)));
    Ok((!text.is_empty(), failed.chain(process::take_import_warnings()).collect()))
}
