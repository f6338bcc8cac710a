"""Messages of a recording to NumPy arrays."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray
from PIL import Image

from ._calibration import Calibration
from ._errors import RecordingError

#: The types of outputs that are maps, which a frame can return.
MAP_TYPES = frozenset({"image", "depth", "relative-inverse-depth", "disparity", "true-disparity", "weight", "mask"})


def array(value_type: str, schema: str, message: Any) -> NDArray[Any]:
    """The map in a message.

    - depth: float32 metres, NaN = missing; `(height, width)`, as all maps
    - relative-inverse-depth: float32 without a unit, larger = nearer, NaN = missing
    - disparity: float32 pixels, NaN = missing (in ground truth: unknown)
    - weight: float32 shares in [0, 1]
    - mask: bool
    - image: uint8, `(height, width)` if grey, otherwise `(height, width, 3)` RGB
    """
    match value_type, schema:
        case "image", "foxglove.CompressedImage":
            return _decompressed(message.data)
        case "image", "foxglove.RawImage":
            grey = message.encoding == "mono8"
            shape = (message.height, message.width) if grey else (message.height, message.width, 3)
            return np.frombuffer(message.data, np.uint8).reshape(shape)
        case "mask", "foxglove.RawImage":
            is_set: NDArray[np.bool_] = _samples(message, "u1") != 0
            return is_set
        case "disparity", "foxglove.RawImage":
            # Sixteenths of a pixel. The value 0 is missing; 16 is the smallest disparity that was searched.
            sixteenths = _samples(message, "<u2").astype(np.float32)
            return np.where(sixteenths > 0, sixteenths / 16 + np.float32(message.min_disparity_px - 1), np.float32(np.nan))
        case "true-disparity", "foxglove.RawImage":
            scaled = _samples(message, "<u2").astype(np.float32)
            return np.where(scaled > 0, scaled / 256, np.float32(np.nan))
        case _, "depthloom.FloatMap":
            return _floats(message)
        case _, "foxglove.RawImage" if message.encoding == "32FC1":
            return _samples(message, "<f4").astype(np.float32)
        case _:
            raise RecordingError(f"a message of {schema} does not contain a {value_type}")


def calibration(message: Any) -> Calibration:
    """The calibration in a message."""
    return Calibration(
        width=message.width,
        height=message.height,
        focal_px=message.K[0],
        cx_px=message.K[2],
        cy_px=message.K[5],
        baseline_m=message.baseline_m,
        # Older recordings do not have this field.
        doffs_px=getattr(message, "doffs_px", 0.0),
    )


def _samples(message: Any, dtype: str) -> NDArray[Any]:
    return np.frombuffer(message.data, dtype).reshape(message.height, message.width)


def _decompressed(data: bytes) -> NDArray[np.uint8]:
    image = Image.open(io.BytesIO(data))
    return np.array(image.convert("L" if image.mode in ("1", "L") else "RGB"))


def _floats(message: Any) -> NDArray[np.float32]:
    """The samples of a `depthloom.FloatMap`: stored unchanged, or as differences of their bits.

    A difference is the bits of a sample minus those of the previous one, with the sign in the lowest bit. It has one of four classes, which store 0, 16, 20 or 32 bits.
    `lows` contains the low 16 bits. `codes` is a zstd frame with the classes (two bits each), the additional four bits of class 2, and the high 16 bits of class 3.
    """
    shape = (message.height, message.width)
    count = message.height * message.width
    if message.data:
        return np.frombuffer(message.data, "<f4").reshape(shape).astype(np.float32)
    codes = np.frombuffer(zstandard.decompress(message.codes), np.uint8)
    split = (count + 3) // 4
    classes = (codes[:split, None] >> np.array([0, 2, 4, 6], np.uint8) & 3).ravel()[:count]
    is_few, is_many = classes == 2, classes == 3
    few, many = np.count_nonzero(is_few), np.count_nonzero(is_many)
    middles, highs = codes[split : split + (few + 1) // 2], codes[split + (few + 1) // 2 :]
    lower, upper = highs.reshape(2, many).astype(np.uint32)
    differences = np.zeros(count, np.uint32)
    differences[classes > 0] = np.frombuffer(message.lows, "<u2")
    differences[is_few] |= (middles[:, None] >> np.array([0, 4], np.uint8) & 15).ravel()[:few].astype(np.uint32) << 16
    differences[is_many] |= (upper << 8 | lower) << 16
    signed = (differences >> 1) ^ (0 - (differences & 1))
    return np.cumsum(signed, dtype=np.uint32).view(np.float32).reshape(shape)
