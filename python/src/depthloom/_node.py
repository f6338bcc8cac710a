"""Nodes and sources written in Python, for the kinds `process` and `process/source`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

_Any = TypeVar("_Any", bound=Callable[..., Any])

#: The attribute of a decorated function or class that contains its declaration.
_MARK = "__depthloom_node__"


@dataclass(frozen=True)
class Instant:
    """The frame of a call."""

    #: The source's name of the frame.
    id: str
    #: Its index in the source, before any selection.
    index: int
    #: Nanoseconds.
    time_ns: int


@dataclass(frozen=True)
class StreamFrame:
    """A frame of a stream with more than its values."""

    #: The outputs by name.
    values: Mapping[str, Any]
    #: Its name; by default its number.
    id: str | None = None
    #: Its number, which increases; gaps count as missed frames. By default frames are counted.
    index: int | None = None
    #: Nanoseconds; by default the time of its capture by the system's clock.
    time_ns: int | None = None
    #: The number of frames that were lost since the previous one. It is not used if there is an `index`.
    missed: int = 0
    #: The time of its capture by `time.monotonic_ns()`; by default the time at which it was yielded.
    captured_ns: int | None = None


@dataclass(frozen=True)
class Declared:
    """The declaration of a function or a class."""

    #: The types of its ports, by name. Sources have no inputs.
    inputs: dict[str, str]
    outputs: dict[str, str]
    is_source: bool
    is_stream: bool = False


def node(*, inputs: Mapping[str, str], outputs: Mapping[str, str]) -> Callable[[_Any], _Any]:
    """Declare a function, or a class with `process` and optionally `finish`, as a node.

    >>> @depthloom.node(inputs={"stereo": "depth", "mono": "depth"}, outputs={"depth": "depth"})
    ... def fuse(stereo, mono):
    ...     return np.where(np.isnan(stereo), mono, stereo)

    Ports have the names and types of the experiment's `ports`. Inputs are passed as keywords; an optional input without a value on a frame is `None`. The result is a
    mapping of outputs, or the value itself if there is one output. An output that is left out, or `None`, is absent on this frame.

    | type | value |
    |---|---|
    | `depth` | float32 `(height, width)`, metres, finite and greater than 0, NaN = missing |
    | `relative-inverse-depth` | float32 `(height, width)`, without a unit, larger = nearer, NaN = missing |
    | `disparity` | float32 `(height, width)`, pixels, NaN = missing |
    | `ground-truth-disparity` | float32 `(height, width)`, pixels, NaN = unknown |
    | `weight` | float32 `(height, width)`, shares in [0, 1], without NaN |
    | `mask` | bool `(height, width)` |
    | `image` | uint8 `(height, width)`, grey, or `(height, width, 3)`, RGB |
    | `calibration` | :class:`depthloom.Calibration`: `width`, `height`, `focal_px`, `cx_px`, `cy_px`, `baseline_m`, `doffs_px` |
    | `number` | `float` |
    | `model`, `samples` | bytes |
    | `curve` | a mapping of `step`, `loss`, `validation`, `learning_rate` to arrays |

    Input arrays are read-only views of the received memory.

    A function is `contract: pure`, or `once`. A class is `contract: ordered`: one object gets all frames in order. `process` returns the outputs of a frame, `finish` those that
    are declared with `rate: once`. A parameter `params`, of a function or of a class' `__init__`, gets the experiment's `params`. A parameter `frame` of a class' `process` gets
    the :class:`Instant`.
    """

    def mark(what: _Any) -> _Any:
        if inspect.isclass(what) and not hasattr(what, "process") and hasattr(what, "frames") and hasattr(what, "read"):
            raise TypeError(f"class {what.__name__} has frames() and read(), as a source has: put @depthloom.source(outputs=...) before it")
        return _marked(what, Declared(dict(inputs), dict(outputs), is_source=False))

    return mark


def source(*, outputs: Mapping[str, str]) -> Callable[[_Any], _Any]:
    """Declare a class with `frames` and `read` as a source.

    `frames()` returns the ids of all frames in order, or pairs of id and time in nanoseconds. `read(frame)` returns the outputs of one :class:`Instant`, as a node does.
    Several processes call it, in any order, so it must return the same values every time.
    """

    def mark(what: _Any) -> _Any:
        return _marked(what, Declared({}, dict(outputs), is_source=True))

    return mark


def stream(*, outputs: Mapping[str, str]) -> Callable[[_Any], _Any]:
    """Declare a generator function as a source that delivers frames as they arrive: `process/source` with `stream: true`.

    >>> @depthloom.stream(outputs={"left": "image", "right": "image"})
    ... def camera():
    ...     while True:
    ...         left, right = device.read()
    ...         yield {"left": left, "right": right}

    Each item is a mapping of outputs, as a node returns it, or a :class:`StreamFrame`, which also has the frame's id, number and times. A class with `__iter__` works, too. A
    parameter `params` gets the experiment's `params`. The stream ends when the iterator ends. After an exception, depthloom starts the program again.
    """

    def mark(what: _Any) -> _Any:
        if not callable(what):
            raise TypeError(f"a stream is a generator function or a class with __iter__(), and {what!r} is neither")
        setattr(what, _MARK, Declared({}, dict(outputs), is_source=True, is_stream=True))
        return what

    return mark


def _marked(what: _Any, declared: Declared) -> _Any:
    required = ("frames", "read") if declared.is_source else ("process",)
    if inspect.isclass(what):
        missing = [name for name in required if not callable(getattr(what, name, None))]
        if missing:
            raise TypeError(f"class {what.__name__} has no method {missing[0]}()")
    elif declared.is_source:
        raise TypeError("a source is a class with frames() and read(frame)")
    setattr(what, _MARK, declared)
    return what


def declared(what: Any) -> Declared:
    """The declaration of a function or a class."""
    declaration = getattr(what, _MARK, None)
    if not isinstance(declaration, Declared):
        raise TypeError(f"{getattr(what, '__name__', what)!r} is not a node: put @depthloom.node(inputs=..., outputs=...) before it")
    return declaration


def accepts(function: Callable[..., Any], name: str) -> bool:
    """Whether a function has a parameter of this name."""
    parameters = inspect.signature(function).parameters.values()
    return any(parameter.name == name and parameter.kind is not parameter.VAR_KEYWORD for parameter in parameters)
