"""Large rows in memory that depthloom and this program share, instead of in the pipes: docs/reference/process-protocol.md."""

from __future__ import annotations

import mmap
import os
import re
import weakref
from typing import Any

import numpy as np
import pyarrow as pa

#: From this size on an answer lies in memory, bytes.
_LARGE = 1 << 16
#: What depthloom writes into the file that it offers.
_WORD = re.compile(rb"[0-9a-f]{32}")
#: How many files are kept open: depthloom has five at most.
_OPEN = 8


class Shared:
    """The files of one depthloom.

    What lies in a file is handed out as views. A file is held as long as one of them is there, and depthloom is told so at each answer: it writes nothing into such a
    file. So a node may keep what it was given.
    """

    def __init__(self, schema: pa.Schema) -> None:
        self.schema = schema
        self.files: dict[int, mmap.mmap] = {}
        self.views: dict[int, weakref.ref[Any]] = {}
        self.sink = _Sink()
        self.writer: Any = None

    def call(self, place: dict[str, Any]) -> pa.RecordBatch:
        """The call that lies there."""
        # All that is made of it refers to this array, directly or by others that do.
        whole = np.frombuffer(self._open(place, mmap.PROT_READ), np.uint8, place["bytes"])
        self.views[place["file"]] = weakref.ref(whole)
        return pa.ipc.read_record_batch(pa.ipc.read_message(pa.py_buffer(whole)), self.schema)

    def lay(self, row: pa.RecordBatch, place: dict[str, Any]) -> int | None:
        """Lays an answer there: how many bytes it takes. `None`: it is small, or too large."""
        size = pa.ipc.get_record_batch_size(row)
        if not _LARGE <= size <= place["size"]:
            return None
        if self.writer is None:
            # A stream begins with its schema, which is written with the first row: nowhere, for it went through the pipe.
            self.writer = pa.ipc.new_stream(self.sink, row.schema)
            self.writer.write_batch(row)
        self.sink.into, self.sink.at = self._open(place, mmap.PROT_READ | mmap.PROT_WRITE), 0
        self.writer.write_batch(row)
        self.sink.into = None
        return self.sink.at

    def held(self) -> list[int]:
        """The files that somebody still has a view of."""
        self.views = {file: view for file, view in self.views.items() if view() is not None}
        return list(self.views)

    def _open(self, place: dict[str, Any], access: int) -> mmap.mmap:
        file: int = place["file"]
        if file not in self.files:
            while len(self.files) >= _OPEN:
                # Whoever has a view of it keeps it mapped.
                del self.files[next(iter(self.files))]
            descriptor = os.open(place["path"], os.O_RDWR if access & mmap.PROT_WRITE else os.O_RDONLY)
            try:
                self.files[file] = mmap.mmap(descriptor, place["size"], mmap.MAP_SHARED, access)
            finally:
                os.close(descriptor)
        return self.files[file]


def agreed(path: bytes) -> bytes | None:
    """The word that lies in the file that depthloom offers; `None` where there is none: then all goes through the pipes.

    Where process numbers are a container's own, the path may name another file, or none.
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
    """What Arrow writes a stream to: into memory, or nowhere."""

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
        """All is there already."""

    def writable(self) -> bool:
        return True

    def tell(self) -> int:
        return self.at
