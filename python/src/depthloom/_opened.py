"""The files that a program opened for reading before it serves, such as settings, weights and archives of modules: their content enters cache keys."""

from __future__ import annotations

import os
import sys
from typing import Any

#: Set by depthloom for the programs that it starts.
STARTED = "DEPTHLOOM_PROGRAM"

#: Files that a system makes up.
_SYSTEM = ("/dev/", "/proc/", "/run/", "/sys/")

_read: set[str] = set()
_written: set[str] = set()
_is_on = False


def watch() -> None:
    """Notes from now on which files are opened, until they are taken."""
    global _is_on
    if not _is_on:
        _is_on = True
        sys.addaudithook(_note)


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if event != "open" or not _is_on:
        return
    file, mode, flags = arguments
    if isinstance(file, int):
        return
    is_written = any(letter in mode for letter in "wax+") if isinstance(mode, str) else bool(flags & (os.O_WRONLY | os.O_RDWR))
    (_written if is_written else _read).add(os.path.abspath(os.fsdecode(file)))


def take() -> list[str]:
    """The regular files that were opened for reading, and that the program did not write itself."""
    global _is_on
    _is_on = False
    files = {_source(file) for file in _read - _written}
    return sorted(file for file in files if not file.startswith(_SYSTEM) and os.path.isfile(file))


def _source(file: str) -> str:
    """The module that a compiled file in `__pycache__` was made from."""
    folder, name = os.path.split(file)
    if os.path.basename(folder) != "__pycache__" or not name.endswith(".pyc"):
        return file
    return os.path.join(os.path.dirname(folder), name.partition(".")[0] + ".py")
