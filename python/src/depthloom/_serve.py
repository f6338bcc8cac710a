"""The side of a process: answers what depthloom asks on the standard streams."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any, BinaryIO

from . import _opened
from ._errors import DepthloomError
from ._node import Declared, Instant, accepts, declared

_VERSION = "1"
_INSTALL = "pip install 'depthloom[node]'"

_current: _Server | None = None


def serve(*nodes: Any) -> None:
    """Answers calls until there are no more: the last line of a program that is a node.

    Of several nodes the program's first argument names the one, as the function or class is called: `command: [python3, nodes.py, fuse]`.

    Standard output belongs to the protocol: while this runs, what is printed goes to standard error. depthloom shows the end of it where something fails, and keeps it in
    `programs.log` in the run's folder.
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
    # glibc's malloc takes the largest block that was freed as a measure of what to keep. Where calls lie in shared memory nothing large is read here, and the temporary maps of a
    # function would be given back to the system, and their pages asked for anew, at every call.
    bytearray(1 << 24)
    with _Server(*streams) as server:
        server.run(nodes)


def progress(done: int, total: int, message: str = "") -> None:
    """Says how far the call is that is answered now; its time begins anew."""
    if _current is not None:
        _current.says("progress", done=done, total=total, message=message)


def warn(message: str, count: int = 0) -> None:
    """Tells the person of something that is no failure, as a lower-case fragment: `warn("pixels that are no numbers", 3)`. Counts of equal messages are added up."""
    if _current is not None:
        _current.says("warning", message=message, count=count)


def _streams() -> tuple[BinaryIO, BinaryIO]:
    """Standard input and output, taken away from whoever prints."""
    sys.stdout.flush()
    calls, answers = os.dup(0), os.dup(1)
    os.dup2(2, 1)
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.close(null)
    for pipe in (calls, answers):
        _widen(pipe)
    return open(calls, "rb", buffering=1 << 16), open(answers, "wb", buffering=1 << 16)


def _widen(pipe: int) -> None:
    """Lets a pipe hold as much as the system allows by itself, a megabyte: fewer changes between the two processes."""
    with contextlib.suppress(ImportError, OSError):
        import fcntl

        fcntl.fcntl(pipe, 1031, 1 << 20)  # F_SETPIPE_SZ


class _Server:
    def __init__(self, calls: BinaryIO, answers: BinaryIO) -> None:
        import pyarrow as pa

        from . import _columns, _modules, _shared

        self.pa, self.columns = pa, _columns
        self.calls, self.answers = calls, answers
        self.number = 0
        self.reader = pa.ipc.open_stream(calls)
        said = self.reader.schema.metadata or {}
        version = said.get(b"depthloom.protocol", b"?").decode()
        if version != _VERSION:
            raise DepthloomError(f"depthloom speaks version {version} of the protocol, and this package version {_VERSION}")
        self.node = json.loads(said[b"depthloom.node"])
        asked = said.get(b"depthloom.modules")
        self.imports = _modules.Imports() if asked else None
        self.ends_after_report = asked == b"first"
        self.inputs = {name: of["type"] for name, of in self.node["inputs"].items()}
        self.outputs = {name: of["type"] for name, of in self.node["outputs"].items()}
        self.at_finish = {name for name, of in self.node["outputs"].items() if of["rate"] == "once"}
        frames = pa.struct([("id", pa.list_(pa.string())), ("time_ns", pa.list_(pa.int64()))])
        texts = [(name, pa.string()) for name in ("says", "message", "trace")]
        numbers = [(name, pa.int64()) for name in ("number", "done", "total", "count", "cpu_ns", "bytes")]
        outputs = pa.struct([(name, _columns.TYPES[of]) for name, of in self.outputs.items()])
        columns = [*texts, *numbers, ("held", pa.list_(pa.int64())), ("frames", frames), ("outputs", outputs)]
        word = _shared.agreed(said[b"depthloom.shared"]) if b"depthloom.shared" in said else None
        self.shared = _shared.Shared(self.reader.schema) if word else None
        metadata = {b"depthloom.protocol": _VERSION.encode()} | ({b"depthloom.shared": word} if word else {})
        self.schema = pa.schema(columns, metadata=metadata)
        self.writer = pa.ipc.new_stream(answers, self.schema)

    def __enter__(self) -> _Server:
        global _current
        _current = self
        return self

    def __exit__(self, *_: object) -> None:
        global _current
        _current = None

    def says(self, what: str, **columns: Any) -> None:
        self._write(self._row(what, columns))

    def _write(self, row: Any) -> None:
        """Writes one row."""
        self.writer.write_batch(row)
        self.answers.flush()

    def _row(self, what: str, columns: dict[str, Any]) -> Any:
        pa = self.pa
        columns |= {"says": what, "number": self.number, "held": self.shared.held() if self.shared else None}
        arrays = []
        for field in self.schema:
            given = columns.get(field.name)
            if given is None:
                arrays.append(pa.nulls(1, field.type))
            elif isinstance(given, pa.Array):
                arrays.append(given)
            else:
                arrays.append(pa.array([given], field.type))
        return pa.record_batch(arrays, schema=self.schema)

    def _failure(self, error: BaseException) -> Any:
        """What was raised, and where."""
        frames = [of for of in traceback.extract_tb(error.__traceback__) if of.filename != __file__]
        trace = "".join(traceback.format_list(frames))
        message = "".join(traceback.format_exception_only(error)).strip()
        return self._row("failure", {"message": message, "trace": trace})

    def _report_imports(self) -> None:
        news = self.imports.news() if self.imports else None
        if news:
            self.says("modules", message=news)

    def run(self, nodes: tuple[Any, ...]) -> None:
        if self.ends_after_report:
            self._report_imports()
            return
        try:
            if self.imports:
                _opened.watch()
            answer = self._answering(nodes)
        except Exception as error:
            self._write(self._failure(error))
            return
        self._report_imports()
        self.says("ready")
        for batch in self.reader:
            self.number = batch.column("number")[0].as_py()
            if self.imports:
                _opened.watch()
            row = self._answer(answer, batch)
            self._report_imports()
            place = batch.column("answer_in")[0].as_py() if self.shared else None
            laid = self.shared.lay(row, place) if self.shared and place else None
            if laid is not None:
                # What the node gave may be what it was given: now nobody but the node holds that.
                del row
                row = self._row("shared", {"bytes": laid})
            self._write(row)

    def _answer(self, answer: Callable[[str, Any], dict[str, Any]], batch: Any) -> Any:
        """The row that answers a call."""
        try:
            place = batch.column("lies_in")[0].as_py() if self.shared else None
            if self.shared and place:
                batch = self.shared.call(place)
            began = time.process_time_ns()
            says = answer(batch.column("call")[0].as_py(), batch)
            return self._row(says.pop("says"), {**says, "cpu_ns": time.process_time_ns() - began})
        except Exception as error:
            return self._failure(error)

    def _answering(self, nodes: tuple[Any, ...]) -> Callable[[str, Any], dict[str, Any]]:
        """What answers a call, made of the node that is meant."""
        chosen = _chosen(nodes)
        of = declared(chosen)
        self._check(of)
        params, is_class = self.node["params"], isinstance(chosen, type)
        contract = self.node["contract"]
        if of.is_source != (contract == "source"):
            raise TypeError("a source is declared by @depthloom.source, and stands under `sources:` as `process/source`; a node by @depthloom.node, as `process`")
        if of.is_source:
            return self._of_source(chosen(params) if accepts(chosen, "params") else chosen())
        if is_class:
            if contract != "ordered":
                raise TypeError(f"{chosen.__name__} is a class, which sees all frames in order: write `contract: ordered`")
            made = chosen(params) if accepts(chosen, "params") else chosen()
            return self._of_node(made.process, getattr(made, "finish", dict), {})
        return self._of_node(chosen, dict, {"params": params} if accepts(chosen, "params") else {})

    def _check(self, of: Declared) -> None:
        for side, here, there in (("inputs", of.inputs, self.inputs), ("outputs", of.outputs, self.outputs)):
            if here != there:
                raise TypeError(f"the {side} of the node in Python are {_ports(here)}; the experiment declares {_ports(there)}")

    def _of_node(self, process: Callable[..., Any], finish: Callable[[], Any], more: dict[str, Any]) -> Callable[[str, Any], dict[str, Any]]:
        wants_frame = accepts(process, "frame") and "frame" not in self.inputs

        def answer(call: str, batch: Any) -> dict[str, Any]:
            if call == "finish":
                return self._values(finish(), self.at_finish)
            column = batch.column("inputs")
            inputs = {name: self.columns.value(of, column.field(name)) for name, of in self.inputs.items()}
            if wants_frame:
                if batch.column("frame")[0].as_py() is None:
                    raise TypeError("a function gets its parameter `frame` if the experiment says under `reads` which files it opens: `reads: \"predictions/{frame}.npy\"`")
                inputs["frame"] = _instant(batch)
            given = set(self.outputs) if call == "run" else set(self.outputs) - self.at_finish
            return self._values(process(**inputs, **more), given)

        return answer

    def _of_source(self, source: Any) -> Callable[[str, Any], dict[str, Any]]:
        def answer(call: str, batch: Any) -> dict[str, Any]:
            if call == "frames":
                return self._frames(list(source.frames()))
            return self._values(source.read(_instant(batch)), set(self.outputs))

        return answer

    def _frames(self, frames: list[Any]) -> dict[str, Any]:
        have_times = bool(frames) and not isinstance(frames[0], str)
        ids = [of[0] for of in frames] if have_times else frames
        times = [int(of[1]) for of in frames] if have_times else None
        return {"says": "frames", "frames": {"id": ids, "time_ns": times}}

    def _is_value(self, port: str, given: Any) -> bool:
        """Whether what a node with one output gave is the value itself, not a mapping of outputs. A curve is a mapping too."""
        if not isinstance(given, Mapping):
            return True
        return self.outputs[port] == "curve" and port not in given and not self.columns.CURVE.isdisjoint(given)

    def _values(self, given: Any, ports: set[str]) -> dict[str, Any]:
        if given is None:
            given = {}
        elif len(ports) == 1 and self._is_value(next(iter(ports)), given):
            given = {next(iter(ports)): given}
        if not isinstance(given, Mapping):
            raise TypeError(f"the node gave a {type(given).__name__}; of several outputs it gives a mapping: {_ports(self.outputs)}")
        strange = [name for name in given if name not in ports]
        if strange:
            raise ValueError(_no_output(strange[0], ports))
        arrays = []
        for name, of in self.outputs.items():
            try:
                arrays.append(self.columns.column(of, given.get(name)))
            except (TypeError, ValueError) as error:
                raise type(error)(f"what the node gave at {name!r} {error}") from None
        struct = self.schema.field("outputs").type
        if not arrays:
            return {"says": "values"}
        return {"says": "values", "outputs": self.pa.StructArray.from_arrays(arrays, fields=list(struct))}


def _no_output(name: object, ports: set[str]) -> str:
    """That a node gave a value at what is none of its outputs, with the nearest of them."""
    near = get_close_matches(str(name), ports, n=1)
    also = f"did you mean `{near[0]}`?" if near else f"here it has {', '.join(f'`{port}`' for port in sorted(ports)) or 'none'}"
    return f"the node returned a value for `{name}`, and there is no output `{name}`; {also}"


def _chosen(nodes: tuple[Any, ...]) -> Any:
    if len(nodes) == 1:
        return nodes[0]
    names = {of.__name__: of for of in nodes}
    asked = sys.argv[1] if len(sys.argv) > 1 else None
    if asked not in names:
        raise LookupError(f"the first argument names one of the nodes {', '.join(names)}; it is {asked!r}")
    return names[asked]


def _instant(batch: Any) -> Instant:
    return Instant(**batch.column("frame")[0].as_py())


def _ports(ports: Mapping[str, str]) -> str:
    return ", ".join(f"{name}: {of}" for name, of in ports.items()) or "none"
