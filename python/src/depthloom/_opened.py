"""The files that a program opened for reading before it serves, such as settings, weights and archives of modules: their content enters cache keys."""

from __future__ import annotations

import os
import sys
from typing import Any

#: Set by depthloom for the programs that it starts.
STARTED = "DEPTHLOOM_PROGRAM"

#: Folders of virtual files.
_SYSTEM = ("/dev/", "/proc/", "/run/", "/sys/")

_read: set[str] = set()
_written: set[str] = set()
#: Files that were opened for reading and writing, with their state at that time: time of the last change, and size.
_both: dict[str, tuple[int, int] | None] = {}
_is_on = False
_is_installed = False


def watch() -> None:
    """Record which files are opened, until :func:`take`."""
    global _is_on, _is_installed
    _is_on = True
    if not _is_installed:
        _is_installed = True
        sys.addaudithook(_note)


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if event != "open" or not _is_on:
        return
    file, mode, flags = arguments
    if isinstance(file, int):
        return
    path = os.path.abspath(os.fsdecode(file))
    if isinstance(mode, str):
        is_both, is_written = "+" in mode and "w" not in mode and "x" not in mode, any(letter in mode for letter in "wax")
    else:
        is_both, is_written = bool(flags & os.O_RDWR) and not flags & (os.O_TRUNC | os.O_CREAT), bool(flags & (os.O_WRONLY | os.O_RDWR))
    if is_both:
        _both.setdefault(path, _state(path))
    elif is_written:
        _written.add(path)
    else:
        _read.add(path)


def _state(path: str) -> tuple[int, int] | None:
    try:
        state = os.stat(path)
    except OSError:
        return None
    return state.st_mtime_ns, state.st_size


def take() -> list[str]:
    """The regular files that were opened for reading and not written by the program itself."""
    global _is_on
    _is_on = False
    unchanged = {path for path, state in _both.items() if state is not None and state == _state(path)}
    files = {_source(file) for file in (_read | unchanged) - _written}
    _read.clear()
    _both.clear()
    return sorted(file for file in files if not file.startswith(_SYSTEM) and os.path.isfile(file))


def _source(file: str) -> str:
    """The module that a compiled file in `__pycache__` was made from."""
    folder, name = os.path.split(file)
    if os.path.basename(folder) != "__pycache__" or not name.endswith(".pyc"):
        return file
    return os.path.join(os.path.dirname(folder), name.partition(".")[0] + ".py")
