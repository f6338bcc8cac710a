//! The lines that put a model into an experiment: the kind that runs it, by the shapes of its inputs and outputs.

use std::fmt::Write as _;
use std::path::Path;

use depthloom_graphs::contracts::check_name;

use super::model::{Description, Tensor};
use super::shapes::{may_be_map, shape_text};

/// Channels of an input of images, and whether they come last.
fn channels(input: &Tensor) -> Option<(i64, bool)> {
    let is = |side: i64| matches!(side, 1 | 2 | 3 | 6);
    match input.shape[..] {
        [_, channels, ..] if input.shape.len() == 4 && is(channels) => Some((channels, false)),
        [.., channels] if input.shape.len() == 4 && is(channels) => Some((channels, true)),
        _ => None,
    }
}

/// The shape of an input with every open side closed.
pub fn closed_shape(input: &Tensor, (width, height): (usize, usize)) -> Vec<usize> {
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

/// The first output that may be a map of the first input's image.
fn map_output(model: &Description) -> Option<&Tensor> {
    let first = model.inputs.first();
    let is_last = first.and_then(channels).is_some_and(|(_, last)| last);
    let axis = |from_end: usize| {
        let shape = &first?.shape;
        usize::try_from(*shape.get(shape.len().checked_sub(from_end + usize::from(is_last))?)?).ok()
    };
    let of_image = (axis(1), axis(2));
    let numbers = || model.outputs.iter().filter(|output| output.is_number());
    numbers().find(|output| may_be_map(&output.shape, of_image)).or_else(|| numbers().find(|one| is_open(one)))
}

const fn layout_text(channels_last: bool) -> &'static str {
    if channels_last { ", layout: nhwc" } else { "" }
}

fn holds_several(output: &Tensor) -> bool {
    output.shape.len() == 4 && output.shape[1] > 1 && output.shape[3] != 1
}

fn is_open(tensor: &Tensor) -> bool {
    tensor.shape.iter().all(|side| *side == -1)
}

fn refusal(model: &Description) -> Option<String> {
    if let Some(other) = &model.external {
        return Some(format!("its weights are in another file, `{other}`: save it as one file first"));
    }
    for Tensor { name, element, shape } in &model.inputs {
        if !matches!(element.as_str(), "f32" | "f16" | "u8") {
            return Some(format!("input `{name}` holds {element}: export the model with inputs of f32, f16 or u8"));
        }
        if !(2..=4).contains(&shape.len()) {
            return Some(format!(
                "input `{name}` has the shape {}: an image or a map has 2 to 4 axes",
                shape_text(shape)
            ));
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
            model.outputs.iter().map(|one| format!("{} ({})", one.name, shape_text(&one.shape))).collect();
        return Some(format!("no output can be a map of its image: it has {}", outputs.join(", ")));
    }
    None
}

/// The kind for such inputs, and a node of this kind.
///
/// # Errors
/// Why the model cannot be run.
pub fn stanza(model: &Description, file: &Path) -> Result<(&'static str, String), String> {
    if let Some(why) = refusal(model) {
        return Err(why);
    }
    let seen: Vec<Option<(i64, bool)>> = model.inputs.iter().map(channels).collect();
    let path = text(&file.to_string_lossy());
    let output = map_output(model).ok_or("it has no output")?;
    let name = text(&output.name);
    let head = if holds_several(output) { "head: 0, " } else { "" };
    // A network of one size sees images of any other resized.
    let is_of_one_size = model.inputs.iter().all(|input| input.shape.iter().skip(1).all(|side| *side > 0));
    let fit = if is_of_one_size { "fit: resize" } else { "multiple: 32" };
    // Byte inputs get the pixels unchanged, float inputs numbers from 0 to 1.
    let white = if model.inputs.iter().any(|input| input.element == "u8") { ", white: 255" } else { "" };
    match (&seen[..], &model.inputs[..]) {
        ([Some((1 | 3, last))], [input]) => {
            let size = if is_of_one_size { "" } else { ", multiple: 14" };
            let means = mono_output(&output.name);
            Ok((
                "mono/onnx",
                format!(
                    "depth:\n  kind: mono/onnx\n  # white, mean, std, multiple (or size): as the network was trained; output: disparity-share, disparity-px, inverse-depth, relative-inverse-depth or depth\n  \
                     with: {{ input_name: {}, output_name: {name}, {head}output: {means}{size}{}{white} }}\n  \
                     inputs: {{ image: source/left, calibration: source/calibration, model: {{ file: {path} }} }}\n",
                    text(&input.name),
                    layout_text(*last)
                ),
            ))
        }
        ([Some((2 | 6, last))], [_]) => {
            let layout = layout_text(*last);
            let with =
                format!("order: left-right, output_name: {name}, {head}output: disparity-px, {fit}{layout}{white}");
            Ok(("stereo/onnx", stereo(&with, &path)))
        }
        ([Some((a @ (1 | 3), last)), Some((b, _))], [left, right]) if a == b => {
            let (left, right, layout) = (text(&left.name), text(&right.name), layout_text(*last));
            let with = format!(
                "left_name: {left}, right_name: {right}, output_name: {name}, {head}output: disparity-px, {fit}{layout}{white}"
            );
            Ok(("stereo/onnx", stereo(&with, &path)))
        }
        _ => network(model, &seen, &path, fit).map(|lines| ("onnx", lines)),
    }
}

fn mono_output(name: &str) -> &'static str {
    let name = name.to_lowercase();
    match (name.contains("depth"), name.contains("inv")) {
        (true, true) => "inverse-depth",
        (true, false) => "depth",
        (false, _) => "disparity-share",
    }
}

fn network(model: &Description, seen: &[Option<(i64, bool)>], path: &str, fit: &str) -> Result<String, String> {
    let mut lines = format!("network:\n  kind: onnx\n  with:\n    {fit}\n    ports:\n      inputs:\n");
    let mut wired = Vec::new();
    for (index, (input, seen)) in model.inputs.iter().zip(seen).enumerate() {
        let (value_type, layout) = match seen {
            Some((3, last)) => ("image", layout_text(*last)),
            Some((1, true)) => ("depth", ", layout: nhwc"),
            None if input.shape.len() == 4 && input.shape[1] == -1 => ("image", ""),
            Some((1, false)) => ("depth", ""),
            _ if input.shape.len() < 4 => ("depth", ""),
            _ => {
                let (name, shape) = (&input.name, shape_text(&input.shape));
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
    let is_map = |output: &&Tensor| output.is_number() && (is_open(output) || may_be_map(&output.shape, (None, None)));
    for (index, output) in model.outputs.iter().filter(is_map).enumerate() {
        let port = port(&output.name, "output", index);
        let head = if holds_several(output) { ", head: 0" } else { "" };
        let _ = writeln!(lines, "        {port}: {{ type: depth, name: {}{head} }}", text(&output.name));
    }
    lines.push_str("  # type: image, depth, disparity, weight or mask; white, mean, std: as the network was trained\n");
    let _ = writeln!(lines, "  inputs: {{ {}, model: {{ file: {path} }} }}", wired.join(", "));
    Ok(lines)
}

fn stereo(with: &str, path: &str) -> String {
    format!(
        "stereo:\n  kind: stereo/onnx\n  # white, mean, std: as the network was trained\n  with: {{ {with} }}\n  \
         inputs: {{ left: source/left, right: source/right, calibration: source/calibration, model: {{ file: {path} }} }}\n"
    )
}

/// Quoted for a YAML flow mapping where necessary.
fn text(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '/' | '.' | '-');
    let begins = text.starts_with(|c: char| c.is_ascii_alphabetic() || matches!(c, '/' | '.' | '_'));
    if begins && text.chars().all(is_plain) && !matches!(text, "true" | "false" | "null") {
        return text.to_owned();
    }
    serde_json::Value::from(text).to_string()
}

fn port(name: &str, side: &str, index: usize) -> String {
    let port: String = name.to_lowercase().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    match check_name(&port) {
        Ok(()) if port != "model" => port,
        _ => format!("{side}{index}"),
    }
}

#[cfg(test)]
mod tests {
    use super::{Tensor, closed_shape, port, text};

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
            assert_eq!(closed_shape(&tensor(shape), (96, 48)), expected, "{shape:?}");
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
