//! `depthloom inspect` of an ONNX file: inputs, outputs, cost, and the `nodes:` entry for an experiment.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use depthloom_graphs::render::ByName;
use depthloom_graphs::{Key, regular_file};
use depthloom_nodes::onnx::{self, Description, Tensor};
use depthloom_terminal::{CliError, ExitCode, print};
use schemars::JsonSchema;
use serde::Serialize;

use super::Subject;
use crate::args::InspectArgs;
use crate::output;

/// The largest file that is read: the limit of ONNX.
const MOST_BYTES: u64 = 2 << 30;

/// Output of `inspect` for an ONNX file.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Onnx {
    /// The kind of thing that was inspected: `onnx`.
    subject: Subject,
    file: String,
    bytes: u64,
    /// The hash of its content, as it enters keys.
    hash: String,
    producer: String,
    ir_version: i64,
    opsets: Vec<Opset>,
    inputs: Vec<Tensor>,
    outputs: Vec<Tensor>,
    metadata: ByName<String>,
    /// The number of uses of each operator.
    operators: BTreeMap<String, u64>,
    /// The number of its parameters.
    parameters: u64,
    /// The first external file of weights; null if the file has all weights.
    external: Option<String>,
    /// The multiply-adds of one inference on inputs of `counted_for`; null if they cannot be counted.
    multiply_adds: Option<u64>,
    /// Why they cannot be counted.
    not_counted: Option<String>,
    /// The shape of each input that multiply-adds are counted for.
    counted_for: Vec<Vec<u64>>,
    /// The kind of the node in `stanza`: `mono/onnx`, `stereo/onnx` or `onnx`; null if no kind runs the model.
    kind: Option<String>,
    /// YAML: the entry for `nodes:`; null if no kind runs the model.
    stanza: Option<String>,
    /// Why no kind runs the model; null if one does.
    refusal: Option<String>,
}

/// An operator set.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Opset {
    /// Empty for the standard operator set.
    domain: String,
    version: i64,
}

/// The image size that multiply-adds are counted for by default: columns, rows.
const SIZE: (usize, usize) = (1248, 384);

pub(super) fn inspect(args: &InspectArgs, file: &Path) -> Result<ExitCode, CliError> {
    let size = args.size.unwrap_or(SIZE);
    let bytes = regular_file::read(file, MOST_BYTES)
        .map_err(|error| CliError::new(ExitCode::Usage, format!("failed to read {}: {error}", file.display())))?;
    let model = Description::read(&bytes).map_err(|what| {
        CliError::usage(
            format!("{}: {what}", file.display()),
            "a PyTorch model is exported with `torch.onnx.export(network, example, \"net.onnx\")`",
        )
    })?;
    let shapes: Vec<Vec<usize>> = model.inputs.iter().map(|input| onnx::closed_shape(input, size)).collect();
    let cost = match &model.external {
        None => onnx::multiply_adds(&bytes, &shapes),
        Some(other) => Err(format!("its weights are in another file, `{other}`")),
    };
    let node = onnx::stanza(&model, file);
    let hash = Key::of_content(&bytes);
    if args.output.json {
        let opset = |(domain, version): &(String, i64)| Opset { domain: domain.clone(), version: *version };
        output::print(&Onnx {
            subject: Subject::Onnx,
            file: file.to_string_lossy().into_owned(),
            bytes: bytes.len() as u64,
            hash: hash.to_string(),
            producer: model.producer.clone(),
            ir_version: model.ir_version,
            opsets: model.opsets.iter().map(opset).collect(),
            inputs: model.inputs.clone(),
            outputs: model.outputs.clone(),
            metadata: model.metadata.iter().cloned().collect(),
            operators: model.operators.clone(),
            parameters: model.parameters,
            external: model.external.clone(),
            multiply_adds: cost.as_ref().ok().copied(),
            not_counted: cost.as_ref().err().cloned(),
            counted_for: shapes.iter().map(|shape| shape.iter().map(|&side| side as u64).collect()).collect(),
            kind: node.as_ref().ok().map(|(kind, _)| (*kind).to_owned()),
            stanza: node.as_ref().ok().map(|(_, stanza)| stanza.clone()),
            refusal: node.as_ref().err().cloned(),
        })?;
        return Ok(ExitCode::Success);
    }
    let mut text = format!("{}  {} bytes, {hash}\n", file.display(), bytes.len());
    let opsets: Vec<String> = model
        .opsets
        .iter()
        .map(|(domain, version)| if domain.is_empty() { version.to_string() } else { format!("{domain} {version}") })
        .collect();
    let producer = if model.producer.is_empty() { "an unnamed program" } else { &model.producer };
    let _ = writeln!(text, "written by     {producer}, form {}, operator set {}", model.ir_version, opsets.join(", "));
    for (what, tensors) in [("input ", &model.inputs), ("output", &model.outputs)] {
        for tensor in tensors {
            let _ = writeln!(
                text,
                "{what}         {}  {} {}",
                tensor.name,
                tensor.element,
                onnx::shape_text(&tensor.shape)
            );
        }
    }
    for (key, value) in &model.metadata {
        let _ = writeln!(text, "metadata       {key} = {}", value.replace('\n', " "));
    }
    let operators: Vec<String> = model.operators.iter().map(|(name, count)| format!("{name} {count}")).collect();
    let _ = writeln!(text, "operators      {}", operators.join(", "));
    let _ = writeln!(text, "parameters     {}", model.parameters);
    if let Some(other) = &model.external {
        let _ = writeln!(text, "weights        in another file, `{other}`: save the model in one file to run it");
    }
    let _ = match &cost {
        Ok(count) => {
            let shapes: Vec<String> = shapes.iter().map(|shape| join(shape)).collect();
            let giga = *count as f64 / 1e9;
            writeln!(text, "multiply-adds  {giga:.3} billion per inference, for {}", shapes.join(" and "))
        }
        Err(why) => writeln!(text, "multiply-adds  not counted: {why}"),
    };
    let _ = match &node {
        Ok((kind, stanza)) => {
            write!(text, "\n# for `nodes:` of a stage; `depthloom nodes {kind}` explains every parameter\n{stanza}")
        }
        Err(why) => writeln!(text, "\nno kind of node runs this model: {why}"),
    };
    print(&text)?;
    Ok(ExitCode::Success)
}

fn join(shape: &[usize]) -> String {
    shape.iter().map(ToString::to_string).collect::<Vec<_>>().join("x")
}
