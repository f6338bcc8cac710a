"""A run: its tables, its frames, its experiment."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import polars as pl
from ruamel.yaml import YAML

from ._errors import DepthloomError, NotRecorded, RecordingError
from ._frames import Frame, Frames, Place
from ._plan import Estimate, Node, Plan
from ._program import StrPath, ask
from ._recording import Recording

#: The recording in a run's folder.
RECORDING = "recording.mcap"


class Stage:
    """A stage of a run. If variants have different sources, each has its own stage."""

    def __init__(self, name: str, nodes: tuple[Node, ...], frames: tuple[Frame, ...]) -> None:
        #: Its name in tables.
        self.name = name
        #: Its nodes. A node that several variants share occurs once.
        self.nodes = nodes
        #: Its frames by position, also if several have the same id.
        self.frames: Sequence[Frame] = frames

    def __repr__(self) -> str:
        return f"<Stage {self.name!r}: {len(self.frames)} frames, {len(self.nodes)} nodes>"


class Run:
    """A run, or a recording without a run's folder. Created by `depthloom.open`.

    Tables are polars DataFrames of the files in the run's folder (`docs/tables.md` explains each column). They are read on first access and cached.
    """

    def __init__(self, recording: Recording, folder: Path | None) -> None:
        self._recording = recording
        self._folder = folder
        self._plan = Plan(recording.plan)
        self._places: list[Place] = []
        counted: dict[int, int] = {}
        for commit in recording.commits:
            position = counted.get(commit.run, 0)
            counted[commit.run] = position + 1
            self._places.append(Place(position, commit))

    # Other processes, such as workers of data loaders, get the path and open the run again.
    def __reduce__(self) -> tuple[Callable[[StrPath], Run], tuple[str]]:
        return open, (str(self.path),)

    def __repr__(self) -> str:
        variants = f", {len(self.variants)} variants" if self.variants else ""
        unfinished = "" if self.is_complete else ", unfinished"
        return f"<Run {self.name!r} at {self.path}: {len(self.frames)} frames{variants}, {len(self.estimates)} estimates{unfinished}>"

    @property
    def path(self) -> Path:
        """The run's folder, or the file of a recording without one."""
        return self._folder or self._recording.path

    @property
    def name(self) -> str:
        """The experiment's name."""
        return self._plan.name

    @property
    def description(self) -> str:
        """The experiment's description."""
        return self._plan.description

    @property
    def is_complete(self) -> bool:
        """Whether the run finished. An unfinished run has its complete frames."""
        return self._recording.is_complete

    @property
    def variants(self) -> tuple[str, ...]:
        """The variants' names; empty if the experiment has no variants."""
        return self._plan.variants

    @property
    def factors(self) -> dict[str, dict[str, str]]:
        """The values of the matrix' axes by variant, as written in the file. In tables they are columns."""
        return self._plan.factors

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The estimates that were scored."""
        return self._plan.estimates

    @cached_property
    def experiment(self) -> dict[str, Any]:
        """The experiment as it was run, with `extends`, environment variables and `--set` resolved."""
        text = self._recording.attachment("experiment.resolved.yaml")
        if text is None and self._folder is not None:
            try:
                text = (self._folder / "experiment.resolved.yaml").read_bytes()
            except FileNotFoundError:
                pass
        if text is None:
            raise NotRecorded(f"{self.path} does not contain its experiment")
        # YAML 1.2, as the program reads it: `no` is a text, `1e-3` a number.
        experiment: dict[str, Any] = YAML(typ="safe", pure=True).load(text)
        return experiment

    @cached_property
    def frames(self) -> Frames:
        """The frames by id: `run.frames["000150_10"]["no_scaling/fused"]` is an array, float32 metres."""
        return Frames(self._recording, self._plan, self._places)

    @cached_property
    def stages(self) -> dict[str, Stage]:
        """The stages by name, in the order in which they ran."""
        by_run: dict[int, list[Frame]] = {}
        for place in self._places:
            by_run.setdefault(place.commit.run, []).append(Frame(self._recording, self._plan, (place,)))
        return {
            name: Stage(name, self._plan.nodes[run], tuple(by_run.get(run, ()))) for run, name in enumerate(self._plan.stages)
        }

    @cached_property
    def table(self) -> pl.DataFrame:
        """The means of the metrics: one row per stage, variant, estimate and pixel set."""
        return self._table("table")

    @cached_property
    def scores(self) -> pl.DataFrame:
        """The metrics of whole images: one row per frame, stage, variant, estimate and pixel set. Choose a pixel set before you average: `run.scores.filter(set="all")`."""
        scores = self._table("scores")
        return scores.filter(pl.col("zone").is_null()).drop("zone") if "zone" in scores.columns else scores

    @cached_property
    def zone_scores(self) -> pl.DataFrame:
        """The metrics of parts of images: like :attr:`scores`, with one row per zone."""
        scores = self._table("scores")
        return scores.filter(pl.col("zone").is_not_null()) if "zone" in scores.columns else scores.clear().with_columns(pl.lit(None, pl.String).alias("zone"))

    @cached_property
    def error_vs_distance(self) -> pl.DataFrame:
        """Percentiles of the absolute error, metres: one row per stage, variant, estimate, pixel set and bin of ground-truth distance."""
        return self._table("error_vs_distance")

    @cached_property
    def learning_curves(self) -> pl.DataFrame:
        """Losses of training nodes: one row per point."""
        return self._table("learning_curves")

    @cached_property
    def timings(self) -> pl.DataFrame:
        """CPU times: one row per node and phase."""
        return self._table("timings")

    def units(self, table: str) -> dict[str, str]:
        """The units of a table's columns, e.g. `run.units("scores")`: `m`, `px`, ..., or `1` for numbers without a unit. Columns of text are left out."""
        units: dict[str, str] = json.loads(pl.read_parquet_metadata(self._table_file(table)).get("depthloom.units", "{}"))
        return units

    def samples(self) -> pl.LazyFrame:
        """One row per scored pixel: `stage`, `frame`, `x`, `y`, `ground_truth_m`, one column per estimate, metres, and one per confidence.

        A lazy query over `samples.parquet`, which reads only what it needs. If the file does not exist, the program writes it, which takes time and disk space.
        """
        path = self._file("samples.parquet")
        if not path.exists():
            ask("analyse", "--samples-only", path.parent)
        return pl.scan_parquet(path)

    def _file(self, name: str) -> Path:
        if self._folder is None:
            raise DepthloomError(f"{self.path} is a recording without a run's folder, so there is no {name}")
        return self._folder / name

    def _table(self, name: str) -> pl.DataFrame:
        return pl.read_parquet(self._table_file(name))

    def _table_file(self, name: str) -> Path:
        path = self._file(f"{name}.parquet")
        if not path.exists():
            raise DepthloomError(f"{path} does not exist: `depthloom report {path.parent}` writes the tables for which the recording has data")
        return path


def open(run: StrPath) -> Run:
    """Opens a run.

    Args:
        run: Its folder, its recording, or a name that `depthloom` accepts: `"@latest"`, `"table1/@latest"`, or the beginning of its name under `runs/`.

    Raises:
        RecordingError: If there is no recording, or it cannot be read.
        ProgramError: If it is not a path, and the program finds no run of that name.
    """
    path = Path(run)
    if not path.exists():
        path = Path(_named(os.fspath(run)))
    if path.is_dir():
        file = path / RECORDING
        if not file.exists():
            raise RecordingError(f"{path} is not a run's folder: it has no {RECORDING}")
        return Run(Recording(file), path)
    in_folder = path.name == RECORDING
    return Run(Recording(path), path.parent if in_folder else None)


def _named(name: str) -> str:
    path = ask("runs", "show", name)["path"]
    return str(path)
