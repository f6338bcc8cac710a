#!/usr/bin/env python3
"""Checks ONNX files as strangers would: the `onnx` package's checker, then ONNX Runtime against the outputs given.

    check_networks.py FOLDER

Of each NAME.onnx in the folder: NAME.input and NAME.output are little-endian f32, NAME.json tells their shapes, the output's
name, how large it can become (range) and the largest difference allowed as a share of that (tolerance). Prints a line for each.
"""
import json
import pathlib
import sys

import numpy as np
import onnx
import onnxruntime

if len(sys.argv) != 2:
    sys.exit(__doc__)

for path in sorted(pathlib.Path(sys.argv[1]).glob("*.onnx"), key=lambda path: path.stem):
    about = json.loads(path.with_suffix(".json").read_text())
    model = onnx.load(path)
    # Shapes are inferred, strictly, and must be those that the file announces.
    onnx.checker.check_model(model, full_check=True)
    assert [opset.version for opset in model.opset_import] == [13], model.opset_import
    said = {entry.key: entry.value for entry in model.metadata_props}
    [image], [output] = model.graph.input, model.graph.output
    sides = [side.dim_value for side in image.type.tensor_type.shape.dim]
    assert said["depthloom.input_size"] == f"{sides[3]}x{sides[2]}", said
    assert said["depthloom.output"] == output.name.replace("_", "-") and output.name == about["output_name"], said
    for side, wanted in zip(output.type.tensor_type.shape.dim, about["output"]):
        assert side.dim_param or side.dim_value == wanted, f"{path.stem}: the file announces {output.type}"

    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    given = np.fromfile(path.with_suffix(".input"), "<f4").reshape(about["input"])
    wanted = np.fromfile(path.with_suffix(".output"), "<f4").reshape(about["output"])
    [found] = session.run([about["output_name"]], {image.name: given})
    assert found.shape == wanted.shape, f"{path.stem}: {found.shape} where {wanted.shape} is wanted"
    largest = float(np.abs(found.astype(np.float64) - wanted).max()) / about["range"]
    print(f"{path.stem} {largest:.2e} of the range, which is {about['range']:g}")
    assert largest <= about["tolerance"], f"{path.stem}: outputs differ by {largest} of their range"
