"""The process side of the protocol: replies to depthloom's calls on the standard streams."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any, BinaryIO

from . import _opened
from ._errors import DepthloomError
from ._node import Declared, Instant, StreamFrame, accepts, declared

_VERSION = "1"
_INSTALL = "pip install 'depthloom[node]'"

_current: _Server | None = None


def serve(*nodes: Any) -> None:
    """Reply to calls until there are no more. This is the last line of a program that is a node.

    With several nodes, the program's first argument names the function or class: `command: [python3, nodes.py, fuse]`.

    Standard output belongs to the protocol, so printed text goes to standard error. If something fails, depthloom shows the end of it; all of it is in `programs.log` in the
    run's folder.
    """
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise DepthloomError(f"a node in Python needs pyarrow: {_INSTALL}") from error
    if not nodes:
        raise TypeError("serve() takes the node: depthloom.serve(fuse)")
    if os.isatty(0):
        raise DepthloomError("this is a node of an experiment: name it under `command`, and `depthloom run` starts it")
    streams = _streams()
    # glibc's malloc keeps freed memory up to the size of the largest freed block. With shared memory, this process reads no large blocks, so malloc would return the temporary
    # maps of a function to the system at every call, and request their pages again.
    bytearray(1 << 24)
    with _Server(*streams) as server:
        server.run(nodes)


def progress(done: int, total: int, message: str = "") -> None:
    """Report the progress of the current call; its time-out starts again."""
    if _current is not None:
        _current.send("progress", done=done, total=total, message=message)


def warn(message: str, count: int = 0) -> None:
    """Print a warning, as a lower-case fragment: `warn("pixels are NaN", 3)`. Counts of equal messages are added up."""
    if _current is not None:
        _current.send("warning", message=message, count=count)


def _streams() -> tuple[BinaryIO, BinaryIO]:
    """Standard input and output, replaced so that other code cannot write to the protocol's streams."""
    sys.stdout.flush()
    calls, replies = os.dup(0), os.dup(1)
    os.dup2(2, 1)
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.close(null)
    for pipe in (calls, replies):
        _widen(pipe)
    return open(calls, "rb", buffering=1 << 16), open(replies, "wb", buffering=1 << 16)


def _widen(pipe: int) -> None:
    """Set the capacity of a pipe to one megabyte, the usual limit, for fewer switches between the two processes."""
    with contextlib.suppress(ImportError, OSError):
        import fcntl

        fcntl.fcntl(pipe, 1031, 1 << 20)  # F_SETPIPE_SZ


class _Server:
    def __init__(self, calls: BinaryIO, replies: BinaryIO) -> None:
        import pyarrow as pa

        from . import _columns, _modules, _shared

        self.pa, self.columns = pa, _columns
        self.calls, self.replies = calls, replies
        self.number = 0
        self.reader = pa.ipc.open_stream(calls)
        metadata = self.reader.schema.metadata or {}
        version = metadata.get(b"depthloom.protocol", b"?").decode()
        if version != _VERSION:
            raise DepthloomError(f"depthloom speaks version {version} of the protocol, and this package version {_VERSION}")
        self.node = json.loads(metadata[b"depthloom.node"])
        report = metadata.get(b"depthloom.modules")
        self.imports = _modules.Imports() if report else None
        self.ends_after_report = report == b"first"
        self.inputs = {name: port["type"] for name, port in self.node["inputs"].items()}
        self.outputs = {name: port["type"] for name, port in self.node["outputs"].items()}
        self.at_finish = {name for name, port in self.node["outputs"].items() if port["rate"] == "once"}
        frames = pa.struct([("id", pa.list_(pa.string())), ("time_ns", pa.list_(pa.int64()))])
        texts = [(name, pa.string()) for name in ("says", "message", "trace")]
        numbers = [(name, pa.int64()) for name in ("number", "done", "total", "count", "cpu_ns", "bytes")]
        outputs = pa.struct([(name, _columns.TYPES[value_type]) for name, value_type in self.outputs.items()])
        columns = [*texts, *numbers, ("held", pa.list_(pa.int64())), ("frames", frames), ("outputs", outputs)]
        if self.node["contract"] == "stream":
            stated = [("id", pa.string()), *((name, pa.int64()) for name in ("index", "time_ns", "age_ns", "missed"))]
            columns.append(("frame", pa.struct(stated)))
        word = _shared.shared_word(metadata[b"depthloom.shared"]) if b"depthloom.shared" in metadata else None
        self.shared = _shared.Shared(self.reader.schema) if word else None
        reply_metadata = {b"depthloom.protocol": _VERSION.encode()} | ({b"depthloom.shared": word} if word else {})
        self.schema = pa.schema(columns, metadata=reply_metadata)
        self.writer = pa.ipc.new_stream(replies, self.schema)

    def __enter__(self) -> _Server:
        global _current
        _current = self
        return self

    def __exit__(self, *_: object) -> None:
        global _current
        _current = None

    def send(self, what: str, **columns: Any) -> None:
        self._write(self._row(what, columns))

    def _write(self, row: Any) -> None:
        """Write one row."""
        self.writer.write_batch(row)
        self.replies.flush()

    def _row(self, what: str, columns: dict[str, Any]) -> Any:
        pa = self.pa
        columns |= {"says": what, "number": self.number, "held": self.shared.held() if self.shared else None}
        arrays = []
        for field in self.schema:
            value = columns.get(field.name)
            if value is None:
                arrays.append(pa.nulls(1, field.type))
            elif isinstance(value, pa.Array):
                arrays.append(value)
            else:
                arrays.append(pa.array([value], field.type))
        return pa.record_batch(arrays, schema=self.schema)

    def _failure(self, error: BaseException) -> Any:
        """The row for an exception, with its traceback."""
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename != __file__]
        trace = "".join(traceback.format_list(frames))
        message = "".join(traceback.format_exception_only(error)).strip()
        return self._row("failure", {"message": message, "trace": trace})

    def _report_imports(self) -> None:
        news = self.imports.news() if self.imports else None
        if news:
            self.send("modules", message=news)

    def run(self, nodes: tuple[Any, ...]) -> None:
        if self.ends_after_report:
            self._report_imports()
            return
        try:
            if self.imports:
                _opened.watch()
            respond = self._responder(nodes)
        except Exception as error:
            self._write(self._failure(error))
            return
        self._report_imports()
        self.send("ready")
        for batch in self.reader:
            self.number = batch.column("number")[0].as_py()
            if self.imports:
                _opened.watch()
            row = self._reply(respond, batch)
            self._report_imports()
            place = batch.column("answer_in")[0].as_py() if self.shared else None
            size = self.shared.write(row, place) if self.shared and place else None
            if size is not None:
                # The reply may refer to inputs, if the node returned one. Drop it, so that only the node itself keeps them.
                del row
                row = self._row("shared", {"bytes": size})
            self._write(row)

    def _reply(self, respond: Callable[[str, Any], dict[str, Any]], batch: Any) -> Any:
        """The row that replies to a call."""
        try:
            place = batch.column("lies_in")[0].as_py() if self.shared else None
            if self.shared and place:
                batch = self.shared.call(place)
            start = time.process_time_ns()
            reply = respond(batch.column("call")[0].as_py(), batch)
            return self._row(reply.pop("says"), {**reply, "cpu_ns": time.process_time_ns() - start})
        except Exception as error:
            return self._failure(error)

    def _responder(self, nodes: tuple[Any, ...]) -> Callable[[str, Any], dict[str, Any]]:
        """The function that replies to calls of the selected node."""
        chosen = _chosen(nodes)
        declaration = declared(chosen)
        self._check(declaration)
        params, is_class = self.node["params"], isinstance(chosen, type)
        contract = self.node["contract"]
        if declaration.is_stream != (contract == "stream"):
            raise TypeError("a stream is declared by @depthloom.stream and used under `sources:` as `process/source` with `stream: true`")
        if declaration.is_stream:
            return self._stream_responder(iter(chosen(params) if accepts(chosen, "params") else chosen()))
        if declaration.is_source != (contract == "source"):
            raise TypeError("a source is declared by @depthloom.source and used under `sources:` as `process/source`; a node is declared by @depthloom.node and used as `process`")
        if declaration.is_source:
            return self._source_responder(chosen(params) if accepts(chosen, "params") else chosen())
        if is_class:
            if contract != "ordered":
                raise TypeError(f"{chosen.__name__} is a class, which gets all frames in order: write `contract: ordered`")
            instance = chosen(params) if accepts(chosen, "params") else chosen()
            return self._node_responder(instance.process, getattr(instance, "finish", dict), {})
        return self._node_responder(chosen, dict, {"params": params} if accepts(chosen, "params") else {})

    def _check(self, declaration: Declared) -> None:
        for side, own, expected in (("inputs", declaration.inputs, self.inputs), ("outputs", declaration.outputs, self.outputs)):
            if own != expected:
                raise TypeError(f"the {side} of the node in Python are {_ports(own)}; the experiment declares {_ports(expected)}")

    def _node_responder(self, process: Callable[..., Any], finish: Callable[[], Any], more: dict[str, Any]) -> Callable[[str, Any], dict[str, Any]]:
        takes_frame = accepts(process, "frame") and "frame" not in self.inputs

        def respond(call: str, batch: Any) -> dict[str, Any]:
            if call == "finish":
                return self._values(finish(), self.at_finish)
            column = batch.column("inputs")
            inputs = {name: self.columns.value(value_type, column.field(name)) for name, value_type in self.inputs.items()}
            if takes_frame:
                if batch.column("frame")[0].as_py() is None:
                    raise TypeError("the parameter `frame` of a function needs `reads` in the experiment, with the files that it opens: `reads: \"predictions/{frame}.npy\"`")
                inputs["frame"] = _instant(batch)
            ports = set(self.outputs) if call == "run" else set(self.outputs) - self.at_finish
            return self._values(process(**inputs, **more), ports)

        return respond

    def _source_responder(self, source: Any) -> Callable[[str, Any], dict[str, Any]]:
        def respond(call: str, batch: Any) -> dict[str, Any]:
            if call == "frames":
                return self._frames(list(source.frames()))
            return self._values(source.read(_instant(batch)), set(self.outputs))

        return respond

    def _stream_responder(self, frames: Iterator[Any]) -> Callable[[str, Any], dict[str, Any]]:
        def respond(call: str, batch: Any) -> dict[str, Any]:
            try:
                item = next(frames)
            except StopIteration:
                return {"says": "end"}
            yielded_ns = time.monotonic_ns()
            frame = item if isinstance(item, StreamFrame) else StreamFrame(item)
            reply = self._values(frame.values, set(self.outputs))
            captured_ns = yielded_ns if frame.captured_ns is None else frame.captured_ns
            age_ns = max(0, time.monotonic_ns() - captured_ns)
            stated = {"id": frame.id, "index": frame.index, "time_ns": frame.time_ns, "age_ns": age_ns, "missed": frame.missed}
            return {**reply, "says": "frame", "frame": stated}

        return respond

    def _frames(self, frames: list[Any]) -> dict[str, Any]:
        have_times = bool(frames) and not isinstance(frames[0], str)
        ids = [frame[0] for frame in frames] if have_times else frames
        times = [int(frame[1]) for frame in frames] if have_times else None
        return {"says": "frames", "frames": {"id": ids, "time_ns": times}}

    def _is_value(self, port: str, result: Any) -> bool:
        """Whether the result of a node with one output is the value itself, not a mapping of outputs. A curve is a mapping as well."""
        if not isinstance(result, Mapping):
            return True
        return self.outputs[port] == "curve" and port not in result and not self.columns.CURVE.isdisjoint(result)

    def _values(self, result: Any, ports: set[str]) -> dict[str, Any]:
        if result is None:
            result = {}
        elif len(ports) == 1 and self._is_value(next(iter(ports)), result):
            result = {next(iter(ports)): result}
        if not isinstance(result, Mapping):
            raise TypeError(f"the node returned a {type(result).__name__}; a node with several outputs returns a mapping: {_ports(self.outputs)}")
        unknown = [name for name in result if name not in ports]
        if unknown:
            raise ValueError(_no_output(unknown[0], ports))
        arrays = []
        for name, value_type in self.outputs.items():
            try:
                arrays.append(self.columns.column(value_type, result.get(name)))
            except (TypeError, ValueError) as error:
                raise type(error)(f"the value of output {name!r} {error}") from None
        struct = self.schema.field("outputs").type
        if not arrays:
            return {"says": "values"}
        return {"says": "values", "outputs": self.pa.StructArray.from_arrays(arrays, fields=list(struct))}


def _no_output(name: object, ports: set[str]) -> str:
    """The error for a value of an unknown output, with the most similar name."""
    near = get_close_matches(str(name), ports, n=1)
    also = f"did you mean `{near[0]}`?" if near else f"here it has {', '.join(f'`{port}`' for port in sorted(ports)) or 'none'}"
    return f"the node returned a value for `{name}`, and there is no output `{name}`; {also}"


def _chosen(nodes: tuple[Any, ...]) -> Any:
    if len(nodes) == 1:
        return nodes[0]
    names = {node.__name__: node for node in nodes}
    name = sys.argv[1] if len(sys.argv) > 1 else None
    if name not in names:
        raise LookupError(f"the first argument must be one of the nodes {', '.join(names)}; it is {name!r}")
    return names[name]


def _instant(batch: Any) -> Instant:
    return Instant(**batch.column("frame")[0].as_py())


def _ports(ports: Mapping[str, str]) -> str:
    return ", ".join(f"{name}: {value_type}" for name, value_type in ports.items()) or "none"
