"""Memory that is shared with depthloom: views of it, what is held, what is size into it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from depthloom._shared import Shared, shared_word

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="there is such memory on Linux alone")

SCHEMA = pa.schema([("number", pa.int64()), ("data", pa.list_(pa.float32()))])
SIZE = 1 << 20


def row(number: int, samples: int = 50_000) -> pa.RecordBatch:
    return pa.record_batch([pa.array([number]), pa.array([np.full(samples, number, np.float32)], SCHEMA.field(1).type)], schema=SCHEMA)


@pytest.fixture
def descriptors() -> Iterator[list[int]]:
    made = [os.memfd_create("test") for _ in range(20)]
    for descriptor in made:
        os.truncate(descriptor, SIZE)
    yield made
    for descriptor in made:
        os.close(descriptor)


def place(descriptors: list[int], file: int, number: int | None = None) -> dict[str, Any]:
    """A file as depthloom names it, with a call in it."""
    message = b"" if number is None else row(number).serialize().to_pybytes()
    os.pwrite(descriptors[file], message, 0)
    return {"file": file, "path": f"/proc/{os.getpid()}/fd/{descriptors[file]}", "size": SIZE, "bytes": len(message)}


def data(batch: pa.RecordBatch) -> Any:
    return batch.column("data").flatten().to_numpy(zero_copy_only=True)


def test_files_are_held_until_their_views_are_gone(descriptors: list[int]) -> None:
    shared = Shared(SCHEMA)
    batch = shared.call(place(descriptors, 1, 7))
    assert batch.column("number")[0].as_py() == 7
    kept = data(batch)[10:20]
    assert not kept.flags.writeable
    del batch
    assert shared.held() == [1] and kept.tolist() == [7.0] * 10
    other = memoryview(data(shared.call(place(descriptors, 2, 8))))
    assert shared.held() == [1, 2]
    del kept
    assert shared.held() == [2]
    # The same file again, with other content.
    assert data(shared.call(place(descriptors, 1, 9)))[0] == 9
    assert shared.held() == [2] and other[3] == 8
    del other
    assert shared.held() == []


def test_old_files_are_closed_and_held_ones_stay_mapped(descriptors: list[int]) -> None:
    shared = Shared(SCHEMA)
    kept = data(shared.call(place(descriptors, 0, 5)))
    for file in range(1, 20):
        assert data(shared.call(place(descriptors, file, file)))[0] == file
    assert len(shared.files) == 8 and 0 not in shared.files
    assert shared.held() == [0] and (kept == 5).all()


def test_replies_are_written_to_shared_memory_if_they_fit(descriptors: list[int]) -> None:
    shared = Shared(SCHEMA)
    there = place(descriptors, 3)
    assert shared.write(row(1, 100), there) is None, "small replies go through the pipe"
    assert shared.write(row(1, SIZE), there) is None, "replies that are too large go through the pipe"
    for number in (1, 2):
        size = shared.write(row(number), there)
        assert size is not None
        message = pa.ipc.read_message(os.pread(descriptors[3], size, 0))
        assert pa.ipc.read_record_batch(message, SCHEMA).equals(row(number))


def test_an_unreadable_word_is_none(tmp_path: Any) -> None:
    (tmp_path / "word").write_text("0123456789" * 4)
    assert shared_word(os.fsencode(tmp_path / "word")) == b"01234567890123456789012345678901"
    assert shared_word(b"/proc/1/fd/99999") is None
    assert shared_word(os.fsencode(tmp_path)) is None
    # Another file at that path, as in a container with its own process numbers.
    for other in (b"", b"0123456789", b"the first bytes of another file ...", b"\xff" * 40):
        (tmp_path / "word").write_bytes(other)
        assert shared_word(os.fsencode(tmp_path / "word")) is None
