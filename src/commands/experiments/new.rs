//! `depthloom new`: writes a first experiment, and the network that it runs.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write as _};
use std::path::Path;

use depthloom_terminal::{CliError, ExitCode, print_path};

use crate::args::NewArgs;

/// An experiment that runs anywhere, with a comment on every part.
const EXPERIMENT: &str = include_str!("new.yaml");
/// The network that it names, and how that was trained: `experiments/street-network.yaml`.
const NETWORK: &[u8] = include_bytes!("../../../experiments/street-network.onnx");
const NETWORK_FILE: &str = "street-network.onnx";

/// Writes the first experiment and its network. It replaces no file.
pub(crate) fn new(args: &NewArgs) -> Result<ExitCode, CliError> {
    let file = &args.file;
    if file.as_os_str() == "-" {
        // It comes with a network, which standard output cannot hold.
        return Err(CliError::usage(
            "`-` is not a file name: the experiment is written with its network beside it",
            "give a file: depthloom new first.yaml",
        ));
    }
    let network = file.with_file_name(NETWORK_FILE);
    if file == &network {
        return Err(CliError::usage(
            format!("{NETWORK_FILE} is the network's file"),
            "choose another name: first.yaml",
        ));
    }
    create(file, EXPERIMENT.as_bytes(), "choose another name")?;
    if let Err(error) = create_network(&network) {
        // An experiment without its network would not run.
        let _ = fs::remove_file(file);
        return Err(error);
    }
    print_path("wrote ", file)?;
    print_path("its network, trained on other streets: ", &network)?;
    print_path("run it: depthloom run ", file)?;
    Ok(ExitCode::Success)
}

/// Writes the network, unless the same file is there from an earlier experiment.
fn create_network(path: &Path) -> Result<(), CliError> {
    if fs::read(path).is_ok_and(|bytes| bytes == NETWORK) {
        return Ok(());
    }
    create(path, NETWORK, "choose another folder, or rename that file: its content differs from the network's")
}

fn create(path: &Path, bytes: &[u8], remedy: &'static str) -> Result<(), CliError> {
    let failed = |error: io::Error| match error.kind() {
        ErrorKind::AlreadyExists => CliError::usage(format!("{} exists already", path.display()), remedy),
        kind => {
            let stop =
                CliError::of_writing(ExitCode::Usage, format_args!("failed to write {}", path.display()), &error);
            match kind {
                ErrorKind::NotFound => stop.remedy("create its folder first, or choose another file"),
                ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
                    stop.remedy("choose a file in a folder that you may write to")
                }
                _ => stop,
            }
        }
    };
    File::create_new(path).and_then(|mut file| file.write_all(bytes)).map_err(failed)
}
