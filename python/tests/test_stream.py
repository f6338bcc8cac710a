"""Streams: a program that delivers frames as they arrive, called as depthloom calls it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

import depthloom
from depthloom._node import declared

PACKAGE = Path(depthloom.__file__).parents[1]
EXAMPLE = Path(__file__).parents[2] / "examples" / "camera.py"


class Engine:
    """The other side of the protocol: starts a program, and requests its frames."""

    def __init__(self, *command: str, outputs: dict[str, str], contract: str = "stream") -> None:
        ports = {name: {"type": value_type, "rate": "frame", "optional": False} for name, value_type in outputs.items()}
        node = {"contract": contract, "inputs": {}, "outputs": ports, "params": {"grey": 7}}
        frame = pa.struct([("id", pa.string()), ("index", pa.int64()), ("time_ns", pa.int64())])
        place = pa.struct([("file", pa.int64()), ("path", pa.string()), ("size", pa.int64()), ("bytes", pa.int64())])
        columns = [("number", pa.int64()), ("call", pa.string()), ("frame", frame), ("inputs", pa.struct([])), ("lies_in", place), ("answer_in", place)]
        self.schema = pa.schema(columns, metadata={"depthloom.protocol": "1", "depthloom.node": json.dumps(node)})
        paths = [str(PACKAGE), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
        self.program = subprocess.Popen([sys.executable, *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)
        assert self.program.stdin is not None and self.program.stdout is not None
        self.stdin = self.program.stdin
        self.send(self.schema)
        self.stdout = self.program.stdout
        self.reader: Any = None
        self.number = 0

    def send(self, message: pa.Schema | pa.RecordBatch) -> None:
        self.stdin.write(message.serialize())
        self.stdin.flush()

    def row(self) -> dict[str, Any]:
        # The first message is a schema, which the program sends after it has read the one of depthloom.
        self.reader = self.reader or pa.ipc.open_stream(self.stdout)
        row: dict[str, Any] = self.reader.read_next_batch().to_pylist()[0]
        return row

    def next(self) -> dict[str, Any]:
        self.number += 1
        columns = {"number": self.number, "call": "next"}
        rows = [pa.array([columns.get(field.name)], field.type) for field in self.schema]
        self.send(pa.record_batch(rows, schema=self.schema))
        row = self.row()
        assert row["number"] == self.number
        return row

    def close(self) -> int:
        self.stdin.close()
        return self.program.wait(timeout=30)


PROGRAM = """
import time
import numpy as np
import depthloom

@depthloom.stream(outputs={"left": "image"})
def camera(params):
    grey = np.full((2, 3), params["grey"], np.uint8)
    yield {"left": grey}
    depthloom.warn("is warm")
    yield depthloom.StreamFrame({"left": grey}, id="b", index=4, time_ns=5, missed=2, captured_ns=time.monotonic_ns() - 10**9)
    yield grey
    yield depthloom.StreamFrame({"right": grey})

depthloom.serve(camera)
"""


def test_each_call_of_a_stream_returns_the_next_frame(tmp_path: Path) -> None:
    program = tmp_path / "camera.py"
    program.write_text(PROGRAM)
    engine = Engine(str(program), outputs={"left": "image"})
    assert engine.row()["says"] == "ready"
    row = engine.next()
    frame = row["frame"]
    assert (row["says"], frame["id"], frame["index"], frame["time_ns"], frame["missed"]) == ("frame", None, None, None, 0)
    assert 0 <= frame["age_ns"] < 10**9 and row["outputs"]["left"]["data"] == [7] * 6
    row = engine.next()
    assert (row["says"], row["message"]) == ("warning", "is warm")
    row = engine.row()
    age_ns = row["frame"].pop("age_ns")
    assert row["frame"] == {"id": "b", "index": 4, "time_ns": 5, "missed": 2} and 10**9 <= age_ns < 2 * 10**9
    assert engine.next()["says"] == "frame", "a stream with one output yields the value itself"
    row = engine.next()
    assert row["says"] == "failure" and "there is no output `right`" in row["message"]
    assert engine.next()["says"] == "end"
    assert engine.close() == 0


def test_a_stream_is_not_a_source_with_a_list(tmp_path: Path) -> None:
    program = tmp_path / "camera.py"
    program.write_text(PROGRAM)
    engine = Engine(str(program), outputs={"left": "image"}, contract="source")
    row = engine.row()
    assert row["says"] == "failure" and "`process/source` with `stream: true`" in row["message"]
    engine.close()


def test_generators_functions_and_classes_are_streams() -> None:
    @depthloom.stream(outputs={"left": "image"})
    class Camera:
        def __iter__(self) -> Iterator[Any]:
            return iter(())

    @depthloom.stream(outputs={"left": "image"})
    def camera() -> Iterator[Any]:
        yield from ()

    assert declared(Camera).is_stream and declared(camera).is_stream and list(camera()) == []
    generator: Any = camera()
    with pytest.raises(TypeError, match="a stream is a generator function or a class with __iter__"):
        depthloom.stream(outputs={"left": "image"})(generator)


def test_the_example_camera_splits_the_images_of_a_video(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed")
    import numpy as np

    video = cv2.VideoWriter(str(tmp_path / "pair.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 20, (1280, 480))
    image = np.zeros((480, 1280, 3), np.uint8)
    image[:, :640] = (0, 0, 200)
    for _ in range(3):
        video.write(image)
    video.release()
    engine = Engine(str(EXAMPLE), str(tmp_path / "pair.avi"), outputs={"left": "image", "right": "image", "calibration": "calibration"})
    assert engine.row()["says"] == "ready"
    start = time.monotonic()
    for _ in range(3):
        outputs = engine.next()["outputs"]
        assert (outputs["left"]["width"], outputs["left"]["height"], outputs["calibration"]["width"]) == (640, 480, 640)
        assert outputs["left"]["data"][0] > 190 and outputs["right"]["data"][0] < 10, "RGB, and left is left"
    assert time.monotonic() - start > 0.08, "a file is read at its own rate"
    assert engine.next()["says"] == "end" and engine.close() == 0
