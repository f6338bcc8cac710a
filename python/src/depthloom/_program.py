"""The program `depthloom`: what it alone can do, runs, tables and samples, is asked of it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ._errors import DepthloomWarning, ProgramError

if TYPE_CHECKING:
    from ._run import Run

StrPath = str | os.PathLike[str]

#: The exit code of a run with frames that failed.
_FRAMES_FAILED = 3


def program() -> str:
    """Where the program is: what `DEPTHLOOM` in the environment names, or what is found on the PATH."""
    named = os.environ.get("DEPTHLOOM")
    found = shutil.which(named or "depthloom")
    if found is None:
        what = f"DEPTHLOOM names `{named}`, which is no program" if named else "there is no program `depthloom` on the PATH"
        remedy = "build it (`cargo build --release` in its repository), and let DEPTHLOOM name `target/release/depthloom`"
        raise ProgramError(f"{what}; {remedy}")
    return found


def ask(*arguments: StrPath, accepted: tuple[int, ...] = (0,)) -> dict[str, Any]:
    """What the program says as JSON.

    It shares the terminal, so that an interrupt reaches it too: it is waited for while it puts down what it has.
    """
    command = [program(), *(os.fspath(argument) for argument in arguments), "--json"]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8") as process:
        try:
            out, complaints = process.communicate()
        except KeyboardInterrupt:
            process.communicate()
            raise
    try:
        told = json.loads(out)
    except ValueError:
        told = {}
    if process.returncode in accepted and told:
        return dict(told)
    error = told.get("error") or {}
    message = error.get("message") or complaints.strip() or f"depthloom ended with {process.returncode}"
    lines = [message, *_diagnosed(error), error.get("help")]
    raise ProgramError("\n".join(line for line in lines if line), exit_code=process.returncode, told=error)


def _diagnosed(error: Mapping[str, Any]) -> list[str]:
    lines = []
    for found in error.get("diagnostics") or []:
        place = f"{found['file']}:{found['line']}:{found['column']}: " if found.get("file") else ""
        lines.append(f"{place}{found['message']}")
        if found.get("help"):
            lines.append(f"  help: {found['help']}")
    return lines


def run(
    experiment: StrPath,
    *,
    set: Mapping[str, object] | None = None,
    matrix: Mapping[str, object] | None = None,
    variants: Sequence[str] = (),
    out: StrPath | None = None,
    overwrite: bool = False,
    fresh: bool = False,
    keep_going: bool = False,
    workers: int | None = None,
    allow_exec: bool = False,
) -> Run:
    """Runs an experiment, and opens the run.

    Args:
        experiment: The experiment file (YAML).
        set: What to set in it before its variants do: paths to values, `{"compare.stereo.with.block": 7}`. `None` takes away.
        matrix: A variant of each value: paths to lists of values, or to ranges, `{"from": 0, "to": 20, "steps": 3}`.
        variants: Of the variants those that are so called; `*` stands for any run of characters.
        out: The folder to write; by default `runs/<experiment>/<UTC time>`.
        overwrite: Replace the folder if it holds a run that is over.
        fresh: Take nothing from earlier runs.
        keep_going: Go on after a frame failed: then failed frames are a warning.
        workers: Worker threads, by default one a core; never changes a result.
        allow_exec: Allow the experiment to start the programs that it names (`process`, `process/source`). Read what it starts first.

    Raises:
        ProgramError: If there is no program, the experiment has mistakes (`told["diagnostics"]` says where), or a frame failed.
    """
    from ._run import open

    arguments: list[StrPath] = ["run", experiment]
    for option, values in (("--set", set), ("--matrix", matrix)):
        for path, value in (values or {}).items():
            arguments += [option, f"{path}={_text(value)}"]
    for variant in variants:
        arguments += ["--variant", variant]
    if out is not None:
        arguments += ["--out", out]
    if workers is not None:
        arguments += ["--workers", str(workers)]
    flags = {"--overwrite": overwrite, "--fresh": fresh, "--keep-going": keep_going, "--allow-exec": allow_exec}
    arguments += [flag for flag, is_set in flags.items() if is_set]
    told = ask(*arguments, accepted=(0, _FRAMES_FAILED) if keep_going else (0,))
    if "run" not in told:
        error = told.get("error") or {}
        raise ProgramError(error.get("message") or "the run is not told", exit_code=_FRAMES_FAILED, told=error)
    for warning in told.get("warnings") or []:
        warnings.warn(str(warning), DepthloomWarning, stacklevel=2)
    if told.get("error"):
        warnings.warn(told["error"]["message"], DepthloomWarning, stacklevel=2)
    return open(told["run"])


def _text(value: object) -> str:
    """A value as the program reads it: JSON, which is YAML; NumPy's numbers as numbers, paths as text."""

    def other(value: Any) -> object:
        return os.fspath(value) if isinstance(value, os.PathLike) else value.item()

    return json.dumps(value, allow_nan=False, default=other)
