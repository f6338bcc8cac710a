//! The ONNX files that we write, in engines of others: their outputs equal those of the training library.

mod cases;

use std::process::Command;

use depthloom_test_needs::{python, shared, workspace};
use tract_onnx::prelude::{Framework, InferenceModelExt, IntoRunnable, TValue, Tensor, tvec};

use self::cases::{Case, cases, with_spread};
use crate::onnx::weights::decode_weights;

/// The largest difference that is allowed, as a share of the output's range.
const TOLERANCE: f32 = 1e-4;

#[test]
fn tract_computes_what_the_training_library_does() {
    for case in cases() {
        let (shape, found) = in_tract(&case).unwrap_or_else(|error| panic!("{}: {error:#}", case.name));
        assert_eq!(shape, case.output.shape, "{}", case.name);
        let differences = found.iter().zip(&case.output.values).map(|(a, b)| (a - b).abs());
        let largest = differences.fold(0.0, f32::max);
        // A map of one value would agree whatever the layers do.
        let spread = case.output.values.iter().copied().fold(f32::MIN, f32::max)
            - case.output.values.iter().copied().fold(f32::MAX, f32::min);
        assert!(spread > 0.05 * case.range, "{}: the outputs spread over {spread} only", case.name);
        assert!(largest <= TOLERANCE * case.range, "{}: {largest} of {}", case.name, case.range);
    }
}

fn in_tract(case: &Case) -> tract_onnx::prelude::TractResult<(Vec<usize>, Vec<f32>)> {
    let outputs = outputs_in_tract(case)?;
    Ok(outputs.into_iter().next().expect("an output"))
}

fn outputs_in_tract(case: &Case) -> tract_onnx::prelude::TractResult<Vec<(Vec<usize>, Vec<f32>)>> {
    let model = tract_onnx::onnx().model_for_read(&mut case.file.as_slice())?;
    let image = Tensor::from_shape(&case.input.shape, &case.input.values)?;
    let outputs = model.into_optimized()?.into_runnable()?.run(tvec![TValue::from(image)])?;
    let numbers = |output: &TValue| {
        let output = output.to_plain_array_view::<f32>()?;
        Ok((output.shape().to_vec(), output.iter().copied().collect()))
    };
    outputs.iter().map(numbers).collect()
}

#[test]
fn the_spread_is_a_second_output_that_leaves_the_first_as_it_is() {
    let (case, spread) = with_spread();
    let outputs = outputs_in_tract(&case).expect("tract runs it");
    assert_eq!(outputs.len(), 2);
    for ((shape, found), (expected, range)) in outputs.iter().zip([(&case.output, case.range), (&spread, 2_f32.sqrt())])
    {
        assert_eq!(shape, &expected.shape);
        let differences = found.iter().zip(&expected.values).map(|(a, b)| (a - b).abs());
        assert!(differences.fold(0.0, f32::max) <= TOLERANCE * range);
    }
}

#[test]
fn onnx_checks_and_onnx_runtime_computes_what_the_training_library_does() {
    let Some(python) = python("onnx_checks_and_onnx_runtime_computes_what_the_training_library_does") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let cases = cases();
    for case in &cases {
        let write = |ending: &str, bytes: &[u8]| {
            std::fs::write(folder.path().join(format!("{}.{ending}", case.name)), bytes).expect("written");
        };
        let floats = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
        write("onnx", &case.file);
        write("input", &floats(&case.input.values));
        write("output", &floats(&case.output.values));
        let about = serde_json::json!({
            "input": case.input.shape, "output": case.output.shape, "output_name": case.output_name,
            "range": case.range, "tolerance": TOLERANCE,
        });
        write("json", about.to_string().as_bytes());
    }
    let script = workspace().join("tests/python/check_networks.py");
    let output = printed(Command::new(python).arg(script).arg(folder.path()));
    let names: Vec<&str> = output.lines().filter_map(|line| line.split_whitespace().next()).collect();
    let mut expected: Vec<&str> = cases.iter().map(|case| case.name).collect();
    expected.sort_unstable();
    assert_eq!(names, expected, "{output}");
}

#[test]
fn weights_of_a_network_we_did_not_write_are_those_that_the_onnx_package_reads() {
    const TEST: &str = "weights_of_a_network_we_did_not_write_are_those_that_the_onnx_package_reads";
    let (Some(shared), Some(python)) = (shared(TEST), python(TEST)) else { return };
    let path = shared.join("models/ssl_unet.onnx");
    let code = "import sys, onnx, numpy, zlib\n\
                for of in onnx.load(sys.argv[1]).graph.initializer:\n    \
                    values = onnx.numpy_helper.to_array(of)\n    \
                    if values.dtype.kind == 'f': print(of.name, list(values.shape), zlib.crc32(values.astype('<f4').tobytes()))";
    let theirs = printed(Command::new(python).args(["-c", code]).arg(&path));
    let ours: String = decode_weights(&path, &std::fs::read(&path).expect("a file"))
        .expect("weights")
        .iter()
        .map(|tensor| {
            let bytes: Vec<u8> = tensor.values.iter().flat_map(|value| value.to_le_bytes()).collect();
            format!("{} {:?} {}\n", tensor.name, tensor.dims, crc32(&bytes))
        })
        .collect();
    assert!(theirs.lines().count() > 10, "{theirs}");
    assert_eq!(ours, theirs);
}

fn printed(command: &mut Command) -> String {
    let output = command.output().expect("it starts");
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

fn crc32(bytes: &[u8]) -> u32 {
    let shift = |crc: u32| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
    !bytes.iter().fold(u32::MAX, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), |crc, _| shift(crc)))
}
