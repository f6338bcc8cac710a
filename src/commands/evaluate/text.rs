//! The experiment that evaluates predictions, as YAML.

use std::fmt::Write as _;

use depthloom_terminal::CliError;
use serde_json::{Map, Value as Json, json};

use super::detect::Reference;
use super::matching::Matched;
use super::{Prediction, Target};
use crate::args::{AlignOption, EvaluateArgs, ProtocolOption, QuantityOption, ResizeOption, UnitOption};

/// Ports with ground-truth disparity, in the order of preference.
const TRUE_DISPARITIES: [&str; 3] = ["disp_occ", "disp_noc", "disparity"];

pub(super) fn experiment(
    args: &EvaluateArgs,
    target: &Target,
    first: &Reference,
    predictions: &[Prediction],
) -> Result<String, CliError> {
    let is_of_disparity = args.protocol.is_of_disparity();
    let truth = if is_of_disparity {
        // A data set may lack the files of one of them.
        TRUE_DISPARITIES.into_iter().find(|port| first.has(port)).ok_or_else(|| {
            let what = format!("{} has no ground-truth disparity, which this --protocol needs", target.kind);
            CliError::usage(what, "set the source's parameters by --with, or choose another --protocol")
        })?
    } else if first.has("depth") {
        "depth"
    } else {
        let what = format!("{} has no ground-truth depth with these parameters", target.kind);
        return Err(CliError::usage(what, "set its parameters by --with; `depthloom nodes KIND` lists them"));
    };
    let source = json!({ "kind": target.kind, "with": target.with });
    let mut text = format!(
        "# Written by `depthloom evaluate`; run it with `depthloom run FILE`.\nexperiment: evaluate\n\nsources:\n  data: {}\n\nstages:\n  evaluate:\n    source: data\n    nodes:\n",
        flow(&source)
    );
    let mut estimates = Map::new();
    for prediction in predictions {
        let Prediction { name, detected, .. } = prediction;
        let reader = reader(args, target, prediction);
        if detected.quantity == QuantityOption::Disparity && !is_of_disparity {
            let disparity = format!("{name}_disparity");
            let depth = json!({
                "kind": "depth/from-disparity",
                "inputs": { "disparity": format!("{disparity}/disparity"), "calibration": "source/calibration" },
                "with": { "cap": null },
            });
            let _ = write!(text, "      {disparity}: {}\n      {name}: {}\n", flow(&reader), flow(&depth));
            estimates.insert(name.clone(), format!("{name}/depth").into());
        } else {
            let port = if is_of_disparity { "disparity" } else { "depth" };
            let _ = writeln!(text, "      {name}: {}", flow(&reader));
            estimates.insert(name.clone(), format!("{name}/{port}").into());
        }
    }
    let mut score = Map::new();
    score.insert("ground_truth".to_owned(), format!("source/{truth}").into());
    score.extend(protocol(args));
    score.insert("estimates".to_owned(), Json::Object(estimates));
    text.push_str("    score:\n");
    for (key, value) in score {
        let _ = writeln!(text, "      {key}: {}", flow(&value));
    }
    Ok(text)
}

/// The node that reads the files.
fn reader(args: &EvaluateArgs, target: &Target, prediction: &Prediction) -> Json {
    let Prediction { matched, detected, invalid, array, .. } = prediction;
    let mut with = Map::new();
    let ids = || Json::from(target.frames().iter().map(|frame| Json::from(&*frame.id)).collect::<Vec<_>>());
    match matched {
        Matched::Array(path, _) => {
            with.insert("files".to_owned(), path.to_string_lossy().into());
            with.insert("frames".to_owned(), ids());
        }
        Matched::Files { files, .. } => {
            let files: Vec<String> = files.iter().map(|path| path.to_string_lossy().into_owned()).collect();
            match template(&files, target) {
                Some(template) => drop(with.insert("files".to_owned(), template.into())),
                None => {
                    with.insert("files".to_owned(), files.into());
                    with.insert("frames".to_owned(), ids());
                }
            }
        }
    }
    if let Some(array) = array {
        with.insert("array".to_owned(), array.clone().into());
    }
    let is_disparity = detected.quantity == QuantityOption::Disparity;
    if detected.quantity == QuantityOption::InverseDepth {
        with.insert("quantity".to_owned(), "inverse-depth".into());
    }
    match detected.unit {
        UnitOption::Millimetres => drop(with.insert("unit".to_owned(), "millimetres".into())),
        UnitOption::Share => drop(with.insert("unit".to_owned(), "share".into())),
        UnitOption::Metres | UnitOption::Pixels => {}
    }
    if detected.divide_by != 1.0 {
        with.insert("divide_by".to_owned(), detected.divide_by.into());
    }
    if let Some(invalid) = invalid {
        with.insert("invalid".to_owned(), (*invalid).into());
    }
    if let Some(resize) = args.resize {
        let method = match resize {
            ResizeOption::Nearest => "nearest",
            ResizeOption::Bilinear => "bilinear",
        };
        with.insert("resize".to_owned(), method.into());
    }
    let kind = if is_disparity { "disparity/files" } else { "depth/files" };
    json!({ "kind": kind, "inputs": { "image": "source/left" }, "with": with })
}

/// One path with `{frame}` for all files, if there is one.
fn template(files: &[String], target: &Target) -> Option<String> {
    let ids: Vec<&str> = target.frames().iter().map(|frame| &*frame.id).collect();
    let template = files.first()?.replacen(ids.first()?, "{frame}", 1);
    let fits = |(file, id): (&String, &&str)| template.replace("{frame}", id) == *file;
    (template.contains("{frame}") && ids.len() > 1 && files.iter().zip(&ids).all(fits)).then_some(template)
}

/// The parameters of the scores.
fn protocol(args: &EvaluateArgs) -> Map<String, Json> {
    let score = match args.protocol {
        ProtocolOption::Martins2018 => json!({ "preset": "martins2018", "sets": ["all", "valid"] }),
        ProtocolOption::Monodepth2 => json!({ "preset": "monodepth2" }),
        ProtocolOption::KittiDepth => json!({ "preset": "kitti-depth", "sets": ["all", "valid"] }),
        ProtocolOption::Eigen => json!({ "preset": "martins2018", "crop": "eigen", "sets": ["valid"] }),
        ProtocolOption::Garg => json!({ "preset": "martins2018", "crop": "garg", "sets": ["valid"] }),
        ProtocolOption::Nyu => json!({ "preset": "martins2018", "max_m": 10, "sets": ["valid"] }),
        ProtocolOption::KittiStereo => {
            json!({ "sets": ["valid", "filled", "all"], "mean": "pixels", "metrics": ["epe", "d1"] })
        }
        ProtocolOption::Middlebury => {
            json!({ "sets": ["valid", "all"], "metrics": ["epe", "bad_0.5", "bad_1", "bad_2", "bad_4"] })
        }
    };
    let Json::Object(mut score) = score else { return Map::new() };
    let align = args.align.map(|align| match align {
        AlignOption::None => "none",
        AlignOption::Median => "median",
        AlignOption::ScaleAndShift => "scale-and-shift",
    });
    if let Some(align) = align {
        score.insert("align".to_owned(), align.into());
    }
    score
}

/// JSON is YAML in flow style; names of keys need no quotes.
fn flow(value: &Json) -> String {
    match value {
        Json::Object(map) => {
            let entries: Vec<String> = map.iter().map(|(key, value)| format!("{key}: {}", flow(value))).collect();
            if entries.is_empty() { "{}".to_owned() } else { format!("{{ {} }}", entries.join(", ")) }
        }
        Json::Array(items) => format!("[{}]", items.iter().map(flow).collect::<Vec<_>>().join(", ")),
        Json::String(text) => json!(text).to_string(),
        other => other.to_string(),
    }
}
