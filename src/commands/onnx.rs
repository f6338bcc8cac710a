//! `depthloom onnx`: what an ONNX file takes, gives and costs, and the lines that put it into an experiment.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use depthloom_graphs::render::ByName;
use depthloom_graphs::{Key, regular_file};
use depthloom_nodes::onnx::{self, Description, Tensor};
use depthloom_terminal::{CliError, ExitCode, print};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::OnnxArgs;
use crate::output;

/// The largest file that is looked at: ONNX's own limit.
const MOST_BYTES: u64 = 2 << 30;

/// Of `onnx`: what an ONNX file takes, gives and costs.
#[derive(JsonSchema, Serialize)]
pub struct Onnx {
    file: String,
    bytes: u64,
    /// The hash of its content, by which it enters keys.
    hash: String,
    producer: String,
    ir_version: i64,
    opsets: Vec<Opset>,
    inputs: Vec<TensorJson>,
    outputs: Vec<TensorJson>,
    metadata: ByName<String>,
    /// How often each operator stands in it.
    operators: BTreeMap<String, u64>,
    /// Numbers in its weights.
    parameters: u64,
    /// The first file of weights that is not in its own.
    external: Option<String>,
    /// Of one run with inputs of `counted_for`; `null` where they cannot be counted.
    multiply_adds: Option<u64>,
    /// Why they cannot.
    not_counted: Option<String>,
    /// By input, the shape that multiply-adds are counted for.
    counted_for: Vec<Vec<u64>>,
    /// The kind that the stanza is of: `mono/onnx`, `stereo/onnx` or `onnx`; `null` if none runs the model.
    kind: Option<String>,
    /// YAML: the node, to put under `nodes:`; `null` if no kind runs the model.
    stanza: Option<String>,
    /// Why no kind runs the model; `null` if one does.
    refusal: Option<String>,
}

/// An operator set.
#[derive(JsonSchema, Serialize)]
pub struct Opset {
    /// Empty of the standard one.
    domain: String,
    version: i64,
}

/// An input or output of a model.
#[derive(JsonSchema, Serialize)]
#[schemars(rename = "Tensor")]
pub struct TensorJson {
    name: String,
    element: String,
    /// -1 where a side is open.
    shape: Vec<i64>,
}

impl From<&Tensor> for TensorJson {
    fn from(of: &Tensor) -> Self {
        Self { name: of.name.clone(), element: of.element.clone(), shape: of.shape.clone() }
    }
}

/// Shows a model.
pub fn onnx(args: &OnnxArgs) -> Result<ExitCode, CliError> {
    let file = &args.file;
    let bytes = regular_file::read(file, MOST_BYTES)
        .map_err(|error| CliError::new(ExitCode::Usage, format!("failed to read {}: {error}", file.display())))?;
    let told = Description::read(&bytes).map_err(|what| {
        CliError::usage(
            format!("{}: {what}", file.display()),
            "a model of PyTorch becomes one by `torch.onnx.export(network, example, \"net.onnx\")`",
        )
    })?;
    let shapes: Vec<Vec<usize>> = told.inputs.iter().map(|input| closed(input, args.size)).collect();
    let cost = match &told.external {
        None => onnx::multiply_adds(&bytes, &shapes),
        Some(other) => Err(format!("its weights are in another file, `{other}`")),
    };
    let node = stanza(&told, file);
    let hash = Key::of_content(&bytes);
    if args.output.json {
        let opset = |(domain, version): &(String, i64)| Opset { domain: domain.clone(), version: *version };
        output::print(&Onnx {
            file: file.to_string_lossy().into_owned(),
            bytes: bytes.len() as u64,
            hash: hash.to_string(),
            producer: told.producer.clone(),
            ir_version: told.ir_version,
            opsets: told.opsets.iter().map(opset).collect(),
            inputs: told.inputs.iter().map(TensorJson::from).collect(),
            outputs: told.outputs.iter().map(TensorJson::from).collect(),
            metadata: told.metadata.iter().cloned().collect(),
            operators: told.operators.clone(),
            parameters: told.parameters,
            external: told.external.clone(),
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
    let opsets: Vec<String> = told
        .opsets
        .iter()
        .map(|(domain, version)| if domain.is_empty() { version.to_string() } else { format!("{domain} {version}") })
        .collect();
    let producer = if told.producer.is_empty() { "a program that does not say so" } else { &told.producer };
    let _ = writeln!(text, "written by     {producer}, form {}, operator set {}", told.ir_version, opsets.join(", "));
    for (what, tensors) in [("input ", &told.inputs), ("output", &told.outputs)] {
        for tensor in tensors {
            let _ = writeln!(text, "{what}         {}  {} {}", tensor.name, tensor.element, shown(&tensor.shape));
        }
    }
    for (key, value) in &told.metadata {
        let _ = writeln!(text, "says           {key} = {}", value.replace('\n', " "));
    }
    let operators: Vec<String> = told.operators.iter().map(|(name, count)| format!("{name} {count}")).collect();
    let _ = writeln!(text, "operators      {}", operators.join(", "));
    let _ = writeln!(text, "parameters     {}", told.parameters);
    if let Some(other) = &told.external {
        let _ = writeln!(text, "weights        in another file, `{other}`: save it whole before it is run");
    }
    let _ = match &cost {
        Ok(count) => {
            let shapes: Vec<String> = shapes.iter().map(|shape| join(shape)).collect();
            let giga = *count as f64 / 1e9;
            writeln!(text, "multiply-adds  {giga:.3} billion a run, of {}", shapes.join(" and "))
        }
        Err(why) => writeln!(text, "multiply-adds  not counted: {why}"),
    };
    let _ = match &node {
        Ok((kind, stanza)) => {
            write!(text, "\n# under `nodes:` of a stage; `depthloom nodes {kind}` explains every parameter\n{stanza}")
        }
        Err(why) => writeln!(text, "\nno kind of node runs this model: {why}"),
    };
    print(&text)?;
    Ok(ExitCode::Success)
}

fn join(shape: &[usize]) -> String {
    shape.iter().map(ToString::to_string).collect::<Vec<_>>().join("x")
}

fn shown(shape: &[i64]) -> String {
    let side = |&side: &i64| if side < 0 { "?".to_owned() } else { side.to_string() };
    shape.iter().map(side).collect::<Vec<_>>().join("x")
}

/// How many channels an input of images has, and whether they come last; `None` if it is none.
fn channels(input: &Tensor) -> Option<(i64, bool)> {
    let is = |side: i64| matches!(side, 1 | 2 | 3 | 6);
    match input.shape[..] {
        [_, channels, ..] if input.shape.len() == 4 && is(channels) => Some((channels, false)),
        [.., channels] if input.shape.len() == 4 && is(channels) => Some((channels, true)),
        _ => None,
    }
}

/// The shape of an input with every open side closed.
fn closed(input: &Tensor, (width, height): (usize, usize)) -> Vec<usize> {
    let rank = input.shape.len();
    let last = channels(input).is_some_and(|(_, last)| last);
    let of_axis = |axis: usize| match rank - axis {
        1 if last => 3,
        2 if last => width,
        3 if last => height,
        1 if rank > 1 => width,
        2 => height,
        3 if rank == 4 => 3,
        _ => 1,
    };
    input
        .shape
        .iter()
        .enumerate()
        .map(|(axis, &side)| usize::try_from(side).unwrap_or_else(|_| of_axis(axis)))
        .collect()
}

/// The first output that can be a map of the image that the first input takes, which the kinds take by themselves.
fn map_output(model: &Description) -> Option<&Tensor> {
    let first = model.inputs.first();
    let is_last = first.and_then(channels).is_some_and(|(_, last)| last);
    let axis = |from_end: usize| {
        let shape = &first?.shape;
        usize::try_from(*shape.get(shape.len().checked_sub(from_end + usize::from(is_last))?)?).ok()
    };
    let of_image = (axis(1), axis(2));
    let numbers = || model.outputs.iter().filter(|output| output.is_number());
    numbers().find(|output| onnx::may_be_map(&output.shape, of_image)).or_else(|| numbers().find(|one| is_open(one)))
}

/// Whether all sides of a tensor are open.
fn is_open(tensor: &Tensor) -> bool {
    tensor.shape.iter().all(|side| *side == -1)
}

/// Why no kind runs a model; `None` if one does.
fn refusal(model: &Description) -> Option<String> {
    if let Some(other) = &model.external {
        return Some(format!("its weights are in another file, `{other}`: save it as one file first"));
    }
    for Tensor { name, element, shape } in &model.inputs {
        if !matches!(element.as_str(), "f32" | "f16" | "u8") {
            return Some(format!("input `{name}` holds {element}: export the model with inputs of f32, f16 or u8"));
        }
        if !(2..=4).contains(&shape.len()) {
            return Some(format!("input `{name}` has the shape {}: an image or a map has 2 to 4 axes", shown(shape)));
        }
        if shape.len() > 2 && !matches!(shape[0], -1 | 1) {
            return Some(format!(
                "input `{name}` takes {} images at once: export the model with a batch of 1, or an open one",
                shape[0]
            ));
        }
    }
    if model.inputs.is_empty() || map_output(model).is_none() {
        let outputs: Vec<String> =
            model.outputs.iter().map(|one| format!("{} ({})", one.name, shown(&one.shape))).collect();
        return Some(format!("no output can be a map of its image: it has {}", outputs.join(", ")));
    }
    None
}

/// The kind that takes such inputs, and a node of it.
///
/// # Errors
/// Why there is none.
fn stanza(model: &Description, file: &Path) -> Result<(&'static str, String), String> {
    if let Some(why) = refusal(model) {
        return Err(why);
    }
    let seen: Vec<Option<(i64, bool)>> = model.inputs.iter().map(channels).collect();
    let path = text(&file.to_string_lossy());
    let layout = |last: bool| if last { ", layout: nhwc" } else { "" };
    let output = map_output(model).ok_or("it has no output")?;
    let holds_several = output.shape.len() == 4 && output.shape[1] > 1 && output.shape[3] != 1;
    let name = text(&output.name);
    let head = if holds_several { "head: 0, " } else { "" };
    // A network of one size sees images of any other resized.
    let is_of_one_size = model.inputs.iter().all(|input| input.shape.iter().skip(1).all(|side| *side > 0));
    let fit = if is_of_one_size { "fit: resize" } else { "multiple: 32" };
    // Images of bytes are given as they are, those of numbers from 0 to 1.
    let white = if model.inputs.iter().any(|input| input.element == "u8") { ", white: 255" } else { "" };
    match (&seen[..], &model.inputs[..]) {
        ([Some((1 | 3, last))], [input]) => {
            let size = if is_of_one_size { "" } else { ", multiple: 14" };
            let means = mono_output(&output.name);
            Ok((
                "mono/onnx",
                format!(
                    "depth:\n  kind: mono/onnx\n  # white, mean, std, multiple (or size): as the network was trained; output: disparity-share, disparity-px, inverse-depth or depth\n  \
                     with: {{ input_name: {}, output_name: {name}, {head}output: {means}{size}{}{white} }}\n  \
                     inputs: {{ image: source/left, calibration: source/calibration, model: {{ file: {path} }} }}\n",
                    text(&input.name),
                    layout(*last)
                ),
            ))
        }
        ([Some((2 | 6, last))], [_]) => {
            let layout = layout(*last);
            let with =
                format!("order: left-right, output_name: {name}, {head}output: disparity-px, {fit}{layout}{white}");
            Ok(("stereo/onnx", stereo(&with, &path)))
        }
        ([Some((a @ (1 | 3), last)), Some((b, _))], [left, right]) if a == b => {
            let (left, right, layout) = (text(&left.name), text(&right.name), layout(*last));
            let with = format!(
                "left_name: {left}, right_name: {right}, output_name: {name}, {head}output: disparity-px, {fit}{layout}{white}"
            );
            Ok(("stereo/onnx", stereo(&with, &path)))
        }
        _ => network(model, &seen, &path, fit).map(|lines| ("onnx", lines)),
    }
}

/// What the map of a monocular network most likely is, by its name.
fn mono_output(name: &str) -> &'static str {
    let name = name.to_lowercase();
    match (name.contains("depth"), name.contains("inv")) {
        (true, true) => "inverse-depth",
        (true, false) => "depth",
        (false, _) => "disparity-share",
    }
}

/// A node of the kind `onnx`, all of whose ports are declared.
///
/// # Errors
/// If an input takes neither an image nor a map.
fn network(model: &Description, seen: &[Option<(i64, bool)>], path: &str, fit: &str) -> Result<String, String> {
    let mut lines = format!("network:\n  kind: onnx\n  with:\n    {fit}\n    ports:\n      inputs:\n");
    let mut wired = Vec::new();
    for (index, (input, seen)) in model.inputs.iter().zip(seen).enumerate() {
        let (value_type, layout) = match seen {
            Some((3, last)) => ("image", if *last { ", layout: nhwc" } else { "" }),
            Some((1, true)) => ("depth", ", layout: nhwc"),
            None if input.shape.len() == 4 && input.shape[1] == -1 => ("image", ""),
            Some((1, false)) => ("depth", ""),
            _ if input.shape.len() < 4 => ("depth", ""),
            _ => {
                let (name, shape) = (&input.name, shown(&input.shape));
                return Err(format!(
                    "input `{name}` has the shape {shape}: an image has 1 or 3 channels, a map has one"
                ));
            }
        };
        let port = port(&input.name, "input", index);
        let _ = writeln!(lines, "        {port}: {{ type: {value_type}, name: {}{layout} }}", text(&input.name));
        wired.push(format!("{port}: {}", if value_type == "image" { "source/left" } else { "NODE/depth" }));
    }
    lines.push_str("      outputs:\n");
    let is_map =
        |output: &&Tensor| output.is_number() && (is_open(output) || onnx::may_be_map(&output.shape, (None, None)));
    for (index, output) in model.outputs.iter().filter(is_map).enumerate() {
        let port = port(&output.name, "output", index);
        let holds_several = output.shape.len() == 4 && output.shape[1] > 1 && output.shape[3] != 1;
        let head = if holds_several { ", head: 0" } else { "" };
        let _ = writeln!(lines, "        {port}: {{ type: depth, name: {}{head} }}", text(&output.name));
    }
    let _ = writeln!(
        lines,
        "  # type: image, depth, disparity, weight or mask; white, mean, std: as the network was trained"
    );
    let _ = writeln!(lines, "  inputs: {{ {}, model: {{ file: {path} }} }}", wired.join(", "));
    Ok(lines)
}

fn stereo(with: &str, path: &str) -> String {
    format!(
        "stereo:\n  kind: stereo/onnx\n  # white, mean, std: as the network was trained\n  with: {{ {with} }}\n  \
         inputs: {{ left: source/left, right: source/right, calibration: source/calibration, model: {{ file: {path} }} }}\n"
    )
}

/// A text as YAML writes it within braces.
fn text(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '/' | '.' | '-');
    let begins = text.starts_with(|c: char| c.is_ascii_alphabetic() || matches!(c, '/' | '.' | '_'));
    if begins && text.chars().all(is_plain) && !matches!(text, "true" | "false" | "null") {
        return text.to_owned();
    }
    serde_json::Value::from(text).to_string()
}

/// A port's name for a tensor's.
fn port(name: &str, side: &str, index: usize) -> String {
    let port: String = name.to_lowercase().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    match depthloom_graphs::contracts::check_name(&port) {
        Ok(()) if port != "model" => port,
        _ => format!("{side}{index}"),
    }
}

#[cfg(test)]
mod tests {
    use super::{closed, port, text};
    use depthloom_nodes::onnx::Tensor;

    fn tensor(shape: &[i64]) -> Tensor {
        Tensor { name: "x".to_owned(), element: "f32".to_owned(), shape: shape.to_vec() }
    }

    #[test]
    fn open_sides_are_closed_where_they_stand() {
        for (shape, expected) in [
            (&[-1, 3, -1, -1][..], &[1, 3, 48, 96][..]),
            (&[1, -1, -1, 3], &[1, 48, 96, 3]),
            (&[-1, -1, 384, -1], &[1, 3, 384, 96]),
            (&[-1, -1], &[48, 96]),
            (&[-1], &[1]),
        ] {
            assert_eq!(closed(&tensor(shape), (96, 48)), expected, "{shape:?}");
        }
    }

    #[test]
    fn names_are_written_so_that_they_can_be_read() {
        assert_eq!(
            ["net.onnx", "a b.onnx", "1", "null", "x: y"].map(text),
            ["net.onnx", "\"a b.onnx\"", "\"1\"", "\"null\"", "\"x: y\""]
        );
        assert_eq!(
            [port("input.1", "input", 0), port("1", "input", 0), port("Model", "output", 2)],
            ["input_1", "input0", "output2"]
        );
    }
}
