//! `depthloom doctor`: what this machine offers.

use std::path::PathBuf;

use depthloom_graphs::Fault;
use depthloom_nodes::onnx;
use depthloom_runs::environment::{self, Engine};
use depthloom_terminal::{CliError, ExitCode, print};
use depthloom_threads::SLURM_VARIABLE;
use schemars::JsonSchema;
use serde::Serialize;

use crate::output;

/// The environment variables by which the shipped experiments find data.
const DATA_ROOTS: [(&str, &str); 1] = [("KITTI_STEREO_2015", "training/image_2")];

/// Of `doctor`: what this machine offers.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Doctor {
    /// The version of the program.
    depthloom: String,
    /// The cores that a process may use here: the default for every number of threads.
    cores: u64,
    /// What limits `cores`: `SLURM_CPUS_PER_TASK`, or `system` (machine, affinity and quota of the process).
    cores_from: String,
    simd: Vec<String>,
    networks: Option<Engine>,
    data: Vec<DataRoot>,
}

/// A variable that names a data set's folder.
#[derive(JsonSchema, Serialize)]
pub(crate) struct DataRoot {
    variable: String,
    root: Option<String>,
    found: bool,
}

/// Prints cores, SIMD, the engine of networks and data roots.
pub(crate) fn doctor(as_json: bool) -> Result<ExitCode, CliError> {
    let engine = onnx::find();
    let roots = DATA_ROOTS.map(|(variable, landmark)| {
        let root = std::env::var_os(variable).map(PathBuf::from);
        let there = root.as_ref().is_some_and(|root| root.join(landmark).is_dir());
        (variable, root, there, landmark)
    });
    let cores = depthloom_threads::cores();
    let is_limited = cores.number < cores.system;
    if as_json {
        let data = roots.iter().map(|(variable, root, there, _)| DataRoot {
            variable: (*variable).to_owned(),
            root: root.as_ref().map(|root| root.to_string_lossy().into_owned()),
            found: *there,
        });
        output::print(&Doctor {
            depthloom: env!("CARGO_PKG_VERSION").to_owned(),
            cores: cores.number as u64,
            cores_from: if is_limited { SLURM_VARIABLE.to_owned() } else { "system".to_owned() },
            simd: environment::simd().into_iter().map(ToOwned::to_owned).collect(),
            networks: engine.as_ref().ok().map(|&found| Engine::found(found, looked_at())),
            data: data.collect(),
        })?;
        return Ok(ExitCode::Success);
    }
    let simd = environment::simd();
    let mut text = format!("depthloom     {}\n", env!("CARGO_PKG_VERSION"));
    text += &match is_limited {
        true => format!("cores         {} (by {SLURM_VARIABLE}; {} without it)\n", cores.number, cores.system),
        false => {
            format!("cores         {} (by the machine, the affinity and the quota of this process)\n", cores.number)
        }
    };
    text += &format!("SIMD          {}\n", if simd.is_empty() { "none used".to_owned() } else { simd.join(", ") });
    text += &networks(&engine);
    for (variable, root, there, landmark) in &roots {
        text += &match (root, there) {
            (Some(root), true) => format!("{variable}  {}\n", root.display()),
            (Some(root), false) => format!("{variable}  {}: no folder {landmark} in it\n", root.display()),
            (None, _) => format!("{variable}  not set: the folder that holds {landmark}\n"),
        };
    }
    print(&text)?;
    Ok(ExitCode::Success)
}

/// Where ONNX Runtime is looked for: what led to each folder, and the folder.
fn looked_at() -> Vec<String> {
    let place = |(by, folder): (&str, PathBuf)| match by {
        "system" => folder.display().to_string(),
        by => format!("{} (by {by})", folder.display()),
    };
    onnx::search_path().into_iter().map(place).collect()
}

/// The inference engine and what it offers, or why it is not available.
fn networks(engine: &Result<&onnx::Engine, Fault>) -> String {
    let below = |line: &str| format!("\n              {line}");
    let text = match engine {
        Ok(found) => {
            let origin = match (&found.library, &found.instead_of) {
                (Some(path), _) => format!("{} (by {})", path.display(), found.found_by),
                (None, None) => format!("part of this program (by {})", found.found_by),
                (None, Some(why)) => format!("part of this program: {why}"),
            };
            let providers = environment::names(&found.providers()).join(", ");
            let choice = format!("{}=onnxruntime or tract selects the engine", onnx::VARIABLE);
            let places = format!("looked at, where ORT_DYLIB_PATH names none: {}", looked_at().join(", "));
            let lines = [format!("providers: {providers}"), places, choice].map(|line| below(&line)).concat();
            format!("{}, {origin}{lines}", found.title())
        }
        Err(fault) => format!("{fault}{}", fault.remedy_text().map(below).unwrap_or_default()),
    };
    format!("networks      {text}\n")
}
