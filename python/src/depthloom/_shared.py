"""Large rows in memory that depthloom and this program share, instead of in the pipes: docs/reference/process-protocol.md."""

from __future__ import annotations

import mmap
import os
import re
import weakref
from typing import Any

import numpy as np
import pyarrow as pa

#: Replies of at least this size go through shared memory, bytes.
_LARGE = 1 << 16
#: The content of the file that depthloom offers.
_WORD = re.compile(rb"[0-9a-f]{32}")
#: How many files are kept open: depthloom has five at most.
_OPEN = 8


class Shared:
    """The shared files of one depthloom process.

    Values in a file are passed to the node as views. A file is held as long as a view of it exists. Each reply lists the held files, and depthloom does not overwrite them.
    So a node may keep its inputs.
    """

    def __init__(self, schema: pa.Schema) -> None:
        self.schema = schema
        self.files: dict[int, mmap.mmap] = {}
        self.views: dict[int, weakref.ref[Any]] = {}
        self.sink = _Sink()
        self.writer: Any = None

    def call(self, place: dict[str, Any]) -> pa.RecordBatch:
        """The call in this file."""
        # All views refer to this array, directly or through other arrays.
        content = np.frombuffer(self._open(place, mmap.PROT_READ), np.uint8, place["bytes"])
        self.views[place["file"]] = weakref.ref(content)
        return pa.ipc.read_record_batch(pa.ipc.read_message(pa.py_buffer(content)), self.schema)

    def write(self, row: pa.RecordBatch, place: dict[str, Any]) -> int | None:
        """Write a reply to this file, and return its size in bytes. `None` if it is small, or too large for the file."""
        size = pa.ipc.get_record_batch_size(row)
        if not _LARGE <= size <= place["size"]:
            return None
        if self.writer is None:
            # A stream starts with its schema, which is written with the first row. Both are discarded here, because they go through the pipe.
            self.writer = pa.ipc.new_stream(self.sink, row.schema)
            self.writer.write_batch(row)
        self.sink.into, self.sink.at = self._open(place, mmap.PROT_READ | mmap.PROT_WRITE), 0
        self.writer.write_batch(row)
        self.sink.into = None
        return self.sink.at

    def held(self) -> list[int]:
        """The files with existing views."""
        self.views = {file: view for file, view in self.views.items() if view() is not None}
        return list(self.views)

    def _open(self, place: dict[str, Any], access: int) -> mmap.mmap:
        file: int = place["file"]
        if file not in self.files:
            while len(self.files) >= _OPEN:
                # Existing views keep the file mapped.
                del self.files[next(iter(self.files))]
            descriptor = os.open(place["path"], os.O_RDWR if access & mmap.PROT_WRITE else os.O_RDONLY)
            try:
                self.files[file] = mmap.mmap(descriptor, place["size"], mmap.MAP_SHARED, access)
            finally:
                os.close(descriptor)
        return self.files[file]


def shared_word(path: bytes) -> bytes | None:
    """The word in the file that depthloom offers. `None` if it cannot be read: then all values go through the pipes.

    In a container with its own process numbers, the path may name another file, or a missing one.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        word = os.read(descriptor, 32)
    except OSError:
        return None
    finally:
        os.close(descriptor)
    return word if _WORD.fullmatch(word) else None


class _Sink:
    """The target of an Arrow stream: memory, or nothing."""

    closed = False

    def __init__(self) -> None:
        self.into: mmap.mmap | None = None
        self.at = 0

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        if self.into is not None:
            self.into[self.at : self.at + len(view)] = view
        self.at += len(view)
        return len(view)

    def flush(self) -> None:
        """Nothing is buffered."""

    def writable(self) -> bool:
        return True

    def tell(self) -> int:
        return self.at
