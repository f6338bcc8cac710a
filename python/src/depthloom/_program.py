"""Calls the program `depthloom`, which writes runs, tables and samples."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Mapping
from typing import Any

from ._errors import ProgramError

StrPath = str | os.PathLike[str]


def program() -> str:
    """The program's path, from the environment variable `DEPTHLOOM` or the PATH."""
    named = os.environ.get("DEPTHLOOM")
    found = shutil.which(named or "depthloom")
    if found is None:
        what = f"DEPTHLOOM names `{named}`, which is not a program" if named else "there is no program `depthloom` on the PATH"
        remedy = "build it (`cargo build --release` in its repository), and set DEPTHLOOM to `target/release/depthloom`"
        raise ProgramError(f"{what}; {remedy}")
    return found


def ask(*arguments: StrPath, accepted: tuple[int, ...] = (0,)) -> dict[str, Any]:
    """The program's report as JSON.

    It shares the terminal, so that it receives interrupts as well. After an interrupt, wait until it has written finished frames.
    """
    command = [program(), *(os.fspath(argument) for argument in arguments), "--json"]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8") as process:
        try:
            out, errors = process.communicate()
        except KeyboardInterrupt:
            process.communicate()
            raise
    try:
        report = json.loads(out)
    except ValueError:
        report = {}
    if process.returncode in accepted and report:
        return dict(report)
    error = report.get("error") or {}
    message = error.get("message") or errors.strip() or f"depthloom ended with {process.returncode}"
    lines = [message, *_diagnosed(error), error.get("help")]
    raise ProgramError("\n".join(line for line in lines if line), exit_code=process.returncode, report=error)


def _diagnosed(error: Mapping[str, Any]) -> list[str]:
    lines = []
    for found in error.get("diagnostics") or []:
        place = f"{found['file']}:{found['line']}:{found['column']}: " if found.get("file") else ""
        lines.append(f"{place}{found['message']}")
        if found.get("help"):
            lines.append(f"  help: {found['help']}")
    return lines
