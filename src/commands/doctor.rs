//! `depthloom doctor`: what this machine offers.

use std::path::Path;

use serde_json::json;

use super::{print, print_json};
use crate::environment;
use crate::exit::{Exit, Stop};

/// The environment variables by which the shipped experiments find data.
const DATA_ROOTS: [(&str, &str); 1] = [("KITTI_STEREO_2015", "training/image_2")];

/// Prints cores, SIMD, ONNX Runtime and data roots.
pub fn doctor(as_json: bool) -> Result<Exit, Stop> {
    let runtime = depthloom_nodes::onnx_runtime::find();
    let roots = DATA_ROOTS.map(|(variable, landmark)| {
        let root = std::env::var(variable).ok();
        let there = root.as_ref().is_some_and(|root| Path::new(root).join(landmark).is_dir());
        (variable, root, there, landmark)
    });
    if as_json {
        let data: Vec<_> = roots
            .iter()
            .map(|(variable, root, there, _)| json!({ "variable": variable, "root": root, "found": there }))
            .collect();
        print_json(&json!({
            "depthloom": env!("CARGO_PKG_VERSION"),
            "cores": environment::cores(),
            "simd": environment::simd(),
            "onnx_runtime": runtime.as_ref().ok().map(|found| json!({
                "path": found.path, "version": found.version, "found_by": found.found_by,
            })),
            "data": data,
        }))?;
        return Ok(Exit::Whole);
    }
    let simd = environment::simd();
    let mut text = format!("depthloom     {}\n", env!("CARGO_PKG_VERSION"));
    text += &format!("cores         {}\n", environment::cores());
    text += &format!("SIMD          {}\n", if simd.is_empty() { "none used".to_owned() } else { simd.join(", ") });
    text += &match &runtime {
        Ok(found) => format!("ONNX Runtime  {} at {} (by {})\n", found.version, found.path.display(), found.found_by),
        Err(fault) => {
            let remedy = fault.remedy_text().map(|remedy| format!("\n              {remedy}")).unwrap_or_default();
            format!("ONNX Runtime  {fault}{remedy}\n")
        }
    };
    for (variable, root, there, landmark) in &roots {
        text += &match (root, there) {
            (Some(root), true) => format!("{variable}  {root}\n"),
            (Some(root), false) => format!("{variable}  {root}: no folder {landmark} in it\n"),
            (None, _) => format!("{variable}  not set: the folder that holds {landmark}\n"),
        };
    }
    print(&text)?;
    Ok(Exit::Whole)
}
