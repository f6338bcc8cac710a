"""Exceptions and warnings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class DepthloomError(Exception):
    """Any error of this package."""


class DepthloomWarning(UserWarning):
    """A warning of a run."""


class RecordingError(DepthloomError):
    """A file that is not a recording, or has an unknown format."""


class NotRecorded(DepthloomError, KeyError):
    """A frame, a topic or an estimate that is not in the recording."""

    # `KeyError` prints the repr of its message.
    __str__ = Exception.__str__


class Ambiguous(NotRecorded):
    """A name that matches several items; the message lists unique names."""


class ProgramError(DepthloomError):
    """The program `depthloom` was not found, or failed."""

    def __init__(self, message: str, *, exit_code: int | None = None, report: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        #: 1: the engine, the disk or a training failed; 2: an error before the first frame; 3: frames failed; 130: interrupted; `None`: the program did not start.
        self.exit_code = exit_code
        #: The program's error as its `--json` prints it: `message`, `help`, `diagnostics` with file, line and column.
        self.report: Mapping[str, Any] = report or {}
