"""Nodes in Python: what they are declared to be, and their values as columns. What depthloom makes of them is tested with the program."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import depthloom
from depthloom import _columns
from depthloom._node import declared
from depthloom._serve import _Server

CAMERA = depthloom.Calibration(4, 3, 700.0, 2.0, 1.0, 0.5, 0.0)


def there_and_back(value_type: str, value: Any) -> Any:
    column = _columns.column(value_type, value)
    column.validate(full=True)
    return _columns.value(value_type, column)


@pytest.mark.parametrize("value_type", ["depth", "relative-inverse-depth", "weight", "ground-truth-disparity"])
def test_float_maps_are_unchanged_after_a_round_trip(value_type: str) -> None:
    given = np.array([[1.5, np.nan, -0.0], [np.inf, 3.0, 1e-40]], np.float32)
    back = there_and_back(value_type, given)
    assert back.dtype == np.float32 and back.tobytes() == given.tobytes()
    assert not back.flags.writeable
    # Rows that are not contiguous, and doubles.
    wide = np.arange(24.0).reshape(4, 6)[::2, ::3]
    assert there_and_back(value_type, wide).tolist() == wide.tolist()


def test_disparities_are_floats_and_may_be_negative() -> None:
    given = np.array([[0.0, 1 / 16, np.nan], [-3.5, 3000.25, 0.03]], np.float32)
    back = there_and_back("disparity", given)
    assert back.dtype == np.float32 and back.tobytes() == given.tobytes()
    for infinite in (np.inf, -np.inf):
        with pytest.raises(ValueError, match=f"is {infinite} px at row 1, column 0: a disparity must be finite"):
            there_and_back("disparity", np.array([[0.0, np.nan], [infinite, 1.0]]))


def test_masked_pixels_are_missing() -> None:
    masked = np.ma.masked_greater(np.array([[1.0, 30.0]], np.float32), 20)
    assert np.array_equal(there_and_back("depth", masked), [[1.0, np.nan]], equal_nan=True)
    everything = np.ma.masked_array(np.ones((1, 2), np.float32), mask=True)
    assert np.isnan(there_and_back("disparity", everything)).all()
    assert there_and_back("image", np.ma.masked_array(np.zeros((1, 2), np.uint8))).tolist() == [[0, 0]]
    with pytest.raises(TypeError, match="masked pixels, and each pixel of `image` has a value"):
        there_and_back("image", np.ma.masked_array(np.zeros((1, 2), np.uint8), mask=[[True, False]]))


def test_disparities_in_fixed_point_are_read_as_pixels() -> None:
    size = [pa.array([3], pa.int32()), pa.array([1], pa.int32()), pa.array([-1], pa.int32())]
    lists = [_columns._list(np.array([-32, -16, 24], np.int16)), _columns._list(np.empty(0, np.float32))]
    column = pa.StructArray.from_arrays([*size, *lists], fields=list(_columns.TYPES["disparity"]))
    assert np.array_equal(_columns.value("disparity", column), [[np.nan, -1.0, 1.5]], equal_nan=True)


def test_images_masks_and_other_values_are_unchanged_after_a_round_trip() -> None:
    grey, rgb = np.arange(6, dtype=np.uint8).reshape(2, 3), np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
    assert np.array_equal(there_and_back("image", grey), grey) and np.array_equal(there_and_back("image", rgb), rgb)
    mask = grey > 2
    assert np.array_equal(there_and_back("mask", mask), mask)
    assert there_and_back("calibration", CAMERA) == CAMERA
    assert there_and_back("number", np.float32(2.5)) == 2.5
    assert there_and_back("model", b"onnx") == b"onnx"
    curve = {"step": [1, 2], "loss": [0.5, 0.25], "validation": [np.nan, 0.5], "learning_rate": [0.1, 0.1]}
    assert there_and_back("curve", curve)["loss"].tolist() == [0.5, 0.25]
    assert all(there_and_back(value_type, None) is None for value_type in _columns.TYPES)


@pytest.mark.parametrize(
    ("value_type", "value", "message"),
    [
        ("depth", np.zeros((2, 2, 1), np.float32), r"has the shape \(2, 2, 1\)"),
        ("depth", np.zeros((2, 2), np.uint8), "is of uint8, and a depth is of float32"),
        ("depth", np.zeros((0, 2), np.float32), "no pixel"),
        ("image", np.zeros((2, 2), np.float32), "is of float32, and an image is of uint8"),
        ("mask", np.zeros((2, 2), np.uint8), "a mask is of bool"),
        ("number", True, "is a bool, and a number is a float"),
        ("calibration", 3, r"is a int, and a calibration is depthloom.Calibration\(width, height, focal_px"),
        ("model", "text", "is a str, and a model is bytes"),
    ],
)
def test_invalid_values_are_refused(value_type: str, value: Any, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        _columns.column(value_type, value)


def test_unknown_outputs_suggest_similar_names() -> None:
    class Server(_Server):
        def __init__(self, outputs: dict[str, str]) -> None:
            self.pa, self.columns, self.outputs = pa, _columns, outputs
            self.schema = pa.schema([("outputs", pa.struct([(name, _columns.TYPES[of]) for name, of in outputs.items()]))])

    depth = np.ones((2, 3), np.float32)
    one, two = Server({"depth": "depth"}), Server({"depth": "depth", "sure": "weight"})
    for given in (depth, {"depth": depth}):
        assert one._values(given, {"depth"})["outputs"].field("depth").field("width")[0].as_py() == 3
    for server in (one, two):
        with pytest.raises(ValueError, match="the node returned a value for `dpth`, and there is no output `dpth`; did you mean `depth`?"):
            server._values({"dpth": depth}, set(server.outputs))
    with pytest.raises(ValueError, match="no output `mask`; here it has `depth`, `sure`"):
        two._values({"mask": depth}, set(two.outputs))
    # A curve is a mapping itself.
    curve = {"step": [1], "loss": [0.5], "validation": [0.5], "learning_rate": [0.1]}
    learning = Server({"curve": "curve"})
    returned: tuple[Any, ...] = (curve, {"curve": curve})
    for value in returned:
        assert learning._values(value, {"curve"})["outputs"].field("curve").field("loss")[0].as_py() == [0.5]
    with pytest.raises(ValueError, match="no output `curv`; did you mean `curve`"):
        learning._values({"curv": curve}, {"curve"})
    with pytest.raises(TypeError, match="a curve is a mapping of step, loss"):
        learning._values({"step": [1], "los": [0.5]}, {"curve"})


def test_declarations_are_stored_and_invalid_ones_refused() -> None:
    @depthloom.node(inputs={"depth": "depth"}, outputs={"weight": "weight"})
    def near(depth: Any) -> Any:
        return depth < 10

    assert declared(near).inputs == {"depth": "depth"} and near(3)
    with pytest.raises(TypeError, match="has no method read"):

        @depthloom.source(outputs={"left": "image"})
        class Empty:
            def frames(self) -> list[str]:
                return []

    with pytest.raises(TypeError, match="put @depthloom.source"):

        @depthloom.node(inputs={}, outputs={"left": "image"})
        class Camera:
            def frames(self) -> list[str]:
                return []

            def read(self, frame: Any) -> Any:
                return None

    with pytest.raises(TypeError, match="is not a node"):
        declared(len)


def test_the_package_exports_exactly_its_public_names() -> None:
    assert all(getattr(depthloom, name) is not None for name in depthloom.__all__)
    with pytest.raises(AttributeError, match="has no attribute"):
        _ = depthloom.nothing  # type: ignore[attr-defined]
