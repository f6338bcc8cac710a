//! `depthloom doctor`: what this machine offers.

use std::path::PathBuf;

use depthloom_graphs::Fault;
use depthloom_nodes::onnx::{self, Engine};
use serde_json::json;

use crate::environment;
use crate::exit::{Exit, Stop};
use crate::outputs::Output;
use crate::streams::{print, print_output};

/// The environment variables by which the shipped experiments find data.
const DATA_ROOTS: [(&str, &str); 1] = [("KITTI_STEREO_2015", "training/image_2")];

/// Prints cores, SIMD, the engine of networks and data roots.
pub fn doctor(as_json: bool) -> Result<Exit, Stop> {
    let engine = onnx::find();
    let roots = DATA_ROOTS.map(|(variable, landmark)| {
        let root = std::env::var_os(variable).map(PathBuf::from);
        let there = root.as_ref().is_some_and(|root| root.join(landmark).is_dir());
        (variable, root, there, landmark)
    });
    if as_json {
        let data: Vec<_> = roots
            .iter()
            .map(|(variable, root, there, _)| {
                let root = root.as_ref().map(|root| root.to_string_lossy());
                json!({ "variable": variable, "root": root, "found": there })
            })
            .collect();
        print_output(
            Output::Doctor,
            json!({
                "depthloom": env!("CARGO_PKG_VERSION"),
                "cores": environment::cores(),
                "simd": environment::simd(),
                "networks": engine.as_ref().ok().map(|found| {
                    let mut described = environment::engine(found);
                    described["providers"] = environment::names(&found.providers()).into();
                    described["looked_at"] = looked_at().into();
                    described
                }),
                "data": data,
            }),
        )?;
        return Ok(Exit::Whole);
    }
    let simd = environment::simd();
    let mut text = format!("depthloom     {}\n", env!("CARGO_PKG_VERSION"));
    text += &format!("cores         {}\n", environment::cores());
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
    Ok(Exit::Whole)
}

/// Where ONNX Runtime is looked for: what led to each folder, and the folder.
fn looked_at() -> Vec<String> {
    let place = |(by, folder): (&str, PathBuf)| match by {
        "system" => folder.display().to_string(),
        by => format!("{} (by {by})", folder.display()),
    };
    onnx::looked_at().into_iter().map(place).collect()
}

/// The engine of networks, with what it offers; or why there is none.
fn networks(engine: &Result<&Engine, Fault>) -> String {
    let below = |line: &str| format!("\n              {line}");
    let text = match engine {
        Ok(found) => {
            let origin = match (&found.library, &found.instead_of) {
                (Some(path), _) => format!("{} (by {})", path.display(), found.found_by),
                (None, None) => format!("part of this program (by {})", found.found_by),
                (None, Some(why)) => format!("part of this program: {why}"),
            };
            let providers = environment::names(&found.providers()).join(", ");
            let choice = format!("{}=onnxruntime or tract asks for an engine by name", onnx::VARIABLE);
            let places = format!("looked at, where ORT_DYLIB_PATH names none: {}", looked_at().join(", "));
            let lines = [format!("providers: {providers}"), places, choice].map(|line| below(&line)).concat();
            format!("{}, {origin}{lines}", found.title())
        }
        Err(fault) => format!("{fault}{}", fault.remedy_text().map(below).unwrap_or_default()),
    };
    format!("networks      {text}\n")
}
