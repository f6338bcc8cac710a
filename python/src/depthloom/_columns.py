"""Values of ports as Arrow columns of one row, and back: docs/reference/process-protocol.md."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ._calibration import Calibration

_SIZE = [pa.field("width", pa.int32()), pa.field("height", pa.int32())]
_CAMERA = ["focal_px", "cx_px", "cy_px", "baseline_m", "doffs_px"]
_CURVE = ["step", "loss", "validation", "learning_rate"]
#: The parts of a curve.
CURVE = frozenset(_CURVE)

#: The struct of the columns, by type.
TYPES: dict[str, pa.StructType] = {
    "image": pa.struct([*_SIZE, pa.field("channels", pa.int32()), pa.field("data", pa.list_(pa.uint8()))]),
    "disparity": pa.struct([*_SIZE, pa.field("min_disparity", pa.int32()), pa.field("data", pa.list_(pa.int16())), pa.field("px", pa.list_(pa.float32()))]),
    "mask": pa.struct([*_SIZE, pa.field("data", pa.list_(pa.uint8()))]),
    "calibration": pa.struct([*_SIZE, *(pa.field(name, pa.float64()) for name in _CAMERA)]),
    "number": pa.struct([pa.field("value", pa.float64())]),
    "curve": pa.struct([pa.field(name, pa.list_(pa.int64() if name == "step" else pa.float64())) for name in _CURVE]),
    **{name: pa.struct([*_SIZE, pa.field("data", pa.list_(pa.float32()))]) for name in ("depth", "relative-inverse-depth", "weight", "ground-truth-disparity")},
    **{name: pa.struct([pa.field("media_type", pa.string()), pa.field("data", pa.large_binary())]) for name in ("model", "samples", "reliability")},
}
_MEDIA_TYPES = {"model": "application/onnx", "samples": "samples/depthloom", "reliability": "application/json"}


def value(value_type: str, column: pa.StructArray) -> Any:
    """The value in a column of one row; `None` if it is missing. Maps are views of the received memory."""
    if not column[0].is_valid:
        return None
    part = {field.name: column.field(position) for position, field in enumerate(column.type)}
    if value_type == "calibration":
        return Calibration(**{name: values[0].as_py() for name, values in part.items()})
    if value_type == "number":
        return part["value"][0].as_py()
    if value_type in _MEDIA_TYPES:
        return part["data"][0].as_py()
    if value_type == "curve":
        return {name: _numbers(values) for name, values in part.items()}
    shape = (part["height"][0].as_py(), part["width"][0].as_py())
    if value_type == "disparity" and "px" in part and len(part["px"].flatten()) > 0:
        return _numbers(part["px"]).reshape(shape)
    numbers = _numbers(part["data"])
    if value_type == "image":
        channels = part["channels"][0].as_py()
        return numbers.reshape(shape if channels == 1 else (*shape, channels))
    numbers = numbers.reshape(shape)
    if value_type == "mask":
        return numbers != 0
    if value_type == "disparity":
        minimum = part["min_disparity"][0].as_py()
        px = numbers.astype(np.float32) / np.float32(16)
        px[numbers < minimum * 16] = np.nan
        return px
    return numbers


def _numbers(lists: pa.ListArray) -> NDArray[Any]:
    numbers: NDArray[Any] = lists.flatten().to_numpy(zero_copy_only=True)
    return numbers


def column(value_type: str, item: Any) -> pa.StructArray:
    """A value as a column of one row.

    Raises `TypeError` or `ValueError` for an invalid value. The message continues a sentence that starts with the port's name.
    """
    struct = TYPES[value_type]
    if item is None:
        return pa.nulls(1, struct)
    if value_type == "calibration":
        if not isinstance(item, Calibration):
            raise TypeError(f"is {_type_name(item)}, and a calibration is depthloom.Calibration(width, height, focal_px, cx_px, cy_px, baseline_m, doffs_px)")
        arrays = [pa.array([getattr(item, field.name)], field.type) for field in struct]
    elif value_type == "number":
        if isinstance(item, bool) or not isinstance(item, Real):
            raise TypeError(f"is {_type_name(item)}, and a number is a float")
        arrays = [pa.array([float(item)], pa.float64())]
    elif value_type in _MEDIA_TYPES:
        if not isinstance(item, (bytes, bytearray, memoryview)):
            raise TypeError(f"is {_type_name(item)}, and a {value_type} is bytes")
        arrays = [pa.array([_MEDIA_TYPES[value_type]]), pa.array([bytes(item)], pa.large_binary())]
    elif value_type == "curve":
        if not isinstance(item, Mapping) or set(item) != set(_CURVE):
            raise TypeError(f"is {_type_name(item)}, and a curve is a mapping of {', '.join(_CURVE)}")
        arrays = [_list(np.asarray(item[name], np.int64 if name == "step" else np.float64)) for name in _CURVE]
    else:
        arrays = _map(value_type, _filled(value_type, item))
    return pa.StructArray.from_arrays(arrays, fields=list(struct))


def _filled(value_type: str, item: Any) -> NDArray[Any]:
    """A map as an array; masked pixels are NaN."""
    array = np.asarray(item)
    if not np.ma.is_masked(item):
        return array
    if not np.issubdtype(array.dtype, np.floating):
        raise TypeError(f"is of {array.dtype} with masked pixels, and each pixel of `{value_type}` has a value")
    return np.ma.filled(item, np.nan)


def _map(value_type: str, array: NDArray[Any]) -> list[pa.Array]:
    is_colours = value_type == "image" and array.ndim == 3 and array.shape[2] == 3
    if array.ndim != 2 and not is_colours:
        shapes = "(height, width) or (height, width, 3)" if value_type == "image" else "(height, width)"
        raise ValueError(f"has the shape {array.shape}, and the shape of a {value_type} is {shapes}")
    if 0 in array.shape:
        raise ValueError(f"has the shape {array.shape}: there is no pixel in it")
    size = [pa.array([array.shape[1]], pa.int32()), pa.array([array.shape[0]], pa.int32())]
    if value_type == "image":
        _require_dtype(array, np.uint8, value_type)
        return [*size, pa.array([3 if is_colours else 1], pa.int32()), _list(array)]
    if value_type == "mask":
        if array.dtype != np.bool_:
            raise TypeError(f"is of {array.dtype}, and a mask is of bool")
        return [*size, _list(array.astype(np.uint8) * np.uint8(255))]
    if not np.issubdtype(array.dtype, np.floating):
        raise TypeError(f"is of {array.dtype}, and a {value_type} is of float32")
    if value_type == "disparity":
        return [*size, pa.array([0], pa.int32()), _list(np.empty(0, np.int16)), _finite_px(array)]
    return [*size, _list(array.astype(np.float32, copy=False))]


def _require_dtype(array: NDArray[Any], dtype: type, value_type: str) -> None:
    if array.dtype != dtype:
        raise TypeError(f"is of {array.dtype}, and an {value_type} is of {np.dtype(dtype)}")


def _finite_px(px: NDArray[Any]) -> pa.ListArray:
    """Disparities in floating point, NaN = missing. depthloom stores multiples of 1/16 px as integers."""
    infinite = np.argwhere(np.isinf(px))
    if len(infinite):
        row, column = infinite[0]
        raise ValueError(f"is {px[row, column]} px at row {row}, column {column}: a disparity must be finite, or NaN if missing")
    return _list(px.astype(np.float32, copy=False))


def _list(array: NDArray[Any]) -> pa.ListArray:
    numbers = np.ascontiguousarray(array).reshape(-1)
    return pa.ListArray.from_arrays(pa.array([0, numbers.size], pa.int32()), pa.array(numbers))


def _type_name(item: Any) -> str:
    return f"a {type(item).__name__}"
