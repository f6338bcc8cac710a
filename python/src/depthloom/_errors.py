"""What can go wrong."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class DepthloomError(Exception):
    """Any error of this package."""


class DepthloomWarning(UserWarning):
    """A warning of a run."""


class RecordingError(DepthloomError):
    """A file that is not a recording, or has a format that this package does not know."""


class NotRecorded(DepthloomError, KeyError):
    """A frame, a topic or an estimate that is not in the recording."""

    # `KeyError` prints the repr of its message.
    __str__ = Exception.__str__


class Ambiguous(NotRecorded):
    """A name that stands for several things; the message lists names that stand for one."""


class ProgramError(DepthloomError):
    """The program `depthloom` is not there, or did not do what it was asked."""

    def __init__(self, message: str, *, exit_code: int | None = None, told: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        #: 1: the engine, the disk or learning failed; 2: found before any frame; 3: frames failed; 130: interrupted; `None`: it never ran.
        self.exit_code = exit_code
        #: The program's error as its `--json` prints it: `message`, `help`, `diagnostics` with file, line and column.
        self.told: Mapping[str, Any] = told or {}
