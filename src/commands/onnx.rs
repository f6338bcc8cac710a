//! `depthloom onnx`: what an ONNX file takes, gives and costs, and the lines that put it into an experiment.

use std::fmt::Write as _;
use std::path::Path;

use depthloom_graphs::{Key, regular_file};
use depthloom_nodes::onnx::{self, Description, Tensor};
use serde_json::{Map, json};

use crate::args::OnnxArgs;
use crate::exit::{Exit, Stop};
use crate::outputs::Output;
use crate::streams::{print, print_output};

/// The largest file that is looked at: ONNX's own limit.
const MOST_BYTES: u64 = 2 << 30;

/// Shows a model.
pub fn onnx(args: &OnnxArgs) -> Result<Exit, Stop> {
    let file = &args.file;
    let bytes = regular_file::read(file, MOST_BYTES)
        .map_err(|error| Stop::new(Exit::Before, format!("failed to read {}: {error}", file.display())))?;
    let told = Description::read(&bytes).map_err(|what| {
        Stop::new(Exit::Before, format!("{}: {what}", file.display()))
            .remedy("a model of PyTorch becomes one by `torch.onnx.export(network, example, \"net.onnx\")`")
    })?;
    let shapes: Vec<Vec<usize>> = told.inputs.iter().map(|input| closed(input, args.size)).collect();
    let cost = match &told.external {
        None => onnx::multiply_adds(&bytes, &shapes),
        Some(other) => Err(format!("its weights are in another file, `{other}`")),
    };
    let (kind, stanza) = stanza(&told, file);
    let hash = Key::of_content(&bytes);
    if args.json {
        let tensors = |tensors: &[Tensor]| -> Vec<_> {
            tensors.iter().map(|one| json!({ "name": one.name, "element": one.element, "shape": one.shape })).collect()
        };
        let metadata: Map<String, _> =
            told.metadata.iter().map(|(key, value)| (key.clone(), value.clone().into())).collect();
        let opsets = told.opsets.iter().map(|(domain, version)| json!({ "domain": domain, "version": version }));
        print_output(
            Output::Onnx,
            json!({
                "file": file.to_string_lossy(),
                "bytes": bytes.len(),
                "hash": hash.to_string(),
                "producer": told.producer,
                "ir_version": told.ir_version,
                "opsets": opsets.collect::<Vec<_>>(),
                "inputs": tensors(&told.inputs),
                "outputs": tensors(&told.outputs),
                "metadata": metadata,
                "operators": told.operators,
                "parameters": told.parameters,
                "external": told.external,
                "multiply_adds": cost.as_ref().ok(),
                "not_counted": cost.as_ref().err(),
                "counted_for": shapes,
                "kind": kind,
                "stanza": stanza,
            }),
        )?;
        return Ok(Exit::Whole);
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
    let _ = write!(text, "\n# under `nodes:` of a stage; `depthloom nodes {kind}` explains every parameter\n{stanza}");
    print(&text)?;
    Ok(Exit::Whole)
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

/// The kind that takes such inputs, and a node of it.
fn stanza(told: &Description, file: &Path) -> (&'static str, String) {
    let seen: Vec<Option<(i64, bool)>> = told.inputs.iter().map(channels).collect();
    let model = text(&file.to_string_lossy());
    let layout = |last: bool| if last { ", layout: nhwc" } else { "" };
    let is_pair = told.inputs.len() == 2 || matches!(seen[..], [Some((2 | 6, _))]);
    let output = |name: &str| {
        let Some(first) = told.outputs.first() else { return String::new() };
        let holds_several = first.shape.len() == 4 && first.shape[1] > 1 && first.shape[3] != 1;
        let head = if holds_several && is_pair { "head: 0, " } else { "" };
        format!("{name}: {}, {head}", text(&first.name))
    };
    let usual = "# white, mean, std: as the network was trained\n";
    // A network of one size sees images of any other resized.
    let is_of_one_size = told.inputs.iter().all(|input| input.shape.iter().skip(1).all(|side| *side > 0));
    let fit = if is_of_one_size { "fit: resize" } else { "multiple: 32" };
    match (&seen[..], &told.inputs[..]) {
        ([Some((1 | 3, last))], [input]) => {
            let (with, layout) = (output("output_name"), layout(*last));
            let lines = format!(
                "depth:\n  kind: mono/onnx\n  {usual}  with: {{ input_name: {}, {with}output: disparity-share{layout} }}\n  \
                 inputs: {{ image: source/left, calibration: source/calibration, model: {{ file: {model} }} }}\n",
                text(&input.name)
            );
            ("mono/onnx", lines)
        }
        ([Some((2 | 6, last))], [_]) => {
            let (with, layout) = (output("output_name"), layout(*last));
            (
                "stereo/onnx",
                stereo(&format!("order: left-right, {with}output: disparity-px, {fit}{layout}"), usual, &model),
            )
        }
        ([Some((a @ (1 | 3), last)), Some((b, _))], [left, right]) if a == b => {
            let (with, layout) = (output("output_name"), layout(*last));
            let names = format!("left_name: {}, right_name: {}", text(&left.name), text(&right.name));
            ("stereo/onnx", stereo(&format!("{names}, {with}output: disparity-px, {fit}{layout}"), usual, &model))
        }
        _ => {
            let mut lines = String::from("network:\n  kind: onnx\n  with:\n    ports:\n      inputs:\n");
            let mut wired = Vec::new();
            for (index, (input, seen)) in told.inputs.iter().zip(&seen).enumerate() {
                let (value_type, layout) = match seen {
                    Some((3, last)) => ("image", layout(*last)),
                    _ => ("depth", ""),
                };
                let port = port(&input.name, "input", index);
                let _ =
                    writeln!(lines, "        {port}: {{ type: {value_type}, name: {}{layout} }}", text(&input.name));
                wired.push(format!("{port}: {}", if value_type == "image" { "source/left" } else { "NODE/depth" }));
            }
            lines.push_str("      outputs:\n");
            for (index, output) in told.outputs.iter().enumerate() {
                let port = port(&output.name, "output", index);
                let _ = writeln!(lines, "        {port}: {{ type: depth, name: {} }}", text(&output.name));
            }
            let _ = writeln!(lines, "  # type: image, depth, disparity, weight or mask, as the network was trained");
            let _ = writeln!(lines, "  inputs: {{ {}, model: {{ file: {model} }} }}", wired.join(", "));
            ("onnx", lines)
        }
    }
}

fn stereo(with: &str, usual: &str, model: &str) -> String {
    format!(
        "stereo:\n  kind: stereo/onnx\n  {usual}  with: {{ {with} }}\n  \
         inputs: {{ left: source/left, right: source/right, calibration: source/calibration, model: {{ file: {model} }} }}\n"
    )
}

/// A text as YAML writes it within braces.
fn text(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '/' | '.' | '-');
    let begins = text.starts_with(|c: char| c.is_ascii_alphabetic() || matches!(c, '/' | '.' | '_'));
    if begins && text.chars().all(is_plain) && !matches!(text, "true" | "false" | "null") {
        return text.to_owned();
    }
    json!(text).to_string()
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
