"""Calls the program `depthloom`, which writes runs, tables and samples."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from ._errors import ProgramError

StrPath = str | os.PathLike[str]


def program() -> str:
    """The program's path: what the environment variable `DEPTHLOOM` names, else the program of the wheel, else the first on the PATH."""
    named = os.environ.get("DEPTHLOOM")
    found = shutil.which(named) if named else _installed() or shutil.which("depthloom")
    if found is None:
        what = f"DEPTHLOOM names `{named}`, which is not a program" if named else "this package contains no program, and there is no `depthloom` on the PATH"
        remedy = "build it (`cargo build --release` in its repository) and set DEPTHLOOM to `target/release/depthloom`, or install a wheel that contains it"
        raise ProgramError(f"{what}; {remedy}")
    return found


def _installed() -> str | None:
    """The program that was installed with this module. Wheels have one, `pip install ./python` installs none."""
    module = Path(__file__).resolve().parent
    try:
        files = distribution("depthloom").files or []
    except PackageNotFoundError:
        files = []
    # The list of files is of the first installation on `sys.path`: another one may have been imported.
    paths = {Path(file.locate()).resolve() for file in files}
    listed = [path for path in paths if path.name in ("depthloom", "depthloom.exe")] if module / "_program.py" in paths else []
    # `pip install --target` moves programs to `bin/`, and does not list them there.
    candidates = [*listed, module.parent / "bin/depthloom"]
    return next((str(path) for path in candidates if path.is_file() and os.access(path, os.X_OK)), None)


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
