"""Runs experiments with the program `depthloom`."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from ._errors import DepthloomWarning, ProgramError
from ._program import StrPath, ask
from ._run import Run, open

#: The exit code of a run with frames that failed.
_FRAMES_FAILED = 3


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
        set: Values to set before variants are applied, by path: `{"compare.stereo.with.block": 7}`. `None` removes the key.
        matrix: One variant per value. Paths to lists of values, or to ranges, `{"from": 0, "to": 20, "steps": 3}`.
        variants: Names of the variants to run; `*` matches any characters.
        out: The folder to write; by default `runs/<experiment>/<UTC time>`.
        overwrite: Replace the folder if it holds a finished run.
        fresh: Reuse nothing from earlier runs.
        keep_going: Continue after a failed frame, with a warning.
        workers: Number of worker threads, by default one per core. It does not change results.
        allow_exec: Allow the experiment to start the programs that it names (`process`, `process/source`). Check these programs first.

    Raises:
        ProgramError: If there is no program, the experiment has errors (`report["diagnostics"]` has the places), or a frame failed.
    """
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
    report = ask(*arguments, accepted=(0, _FRAMES_FAILED) if keep_going else (0,))
    if "run" not in report:
        error = report.get("error") or {}
        raise ProgramError(error.get("message") or "the program did not report the run", exit_code=_FRAMES_FAILED, report=error)
    for warning in report.get("warnings") or []:
        warnings.warn(str(warning), DepthloomWarning, stacklevel=2)
    if report.get("error"):
        warnings.warn(report["error"]["message"], DepthloomWarning, stacklevel=2)
    return open(report["run"])


def _text(value: object) -> str:
    """A value in JSON, which is valid YAML; NumPy's numbers as numbers, paths as text."""

    def other(value: Any) -> object:
        return os.fspath(value) if isinstance(value, os.PathLike) else value.item()

    return json.dumps(value, allow_nan=False, default=other)
