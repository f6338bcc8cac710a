"""Runs for the tests, written by the program that `DEPTHLOOM` names, or by the one on the PATH."""

from __future__ import annotations

from pathlib import Path

import pytest

import depthloom

EXPERIMENTS = Path(__file__).parents[2] / "experiments"

#: Small frames.
SMALL = {f"sources.{source}.with.{side}": pixels for source in ("train", "test") for side, pixels in (("width", 320), ("height", 96))}


@pytest.fixture(scope="session")
def look(tmp_path_factory: pytest.TempPathFactory) -> depthloom.Run:
    """Stereo with three blocks on three frames, scored."""
    return depthloom.run(
        EXPERIMENTS / "first-look.yaml",
        set={"sources.street.with": {"frames": "3..6", "width": 320, "height": 96}},
        matrix={"look.stereo.with.block": [3, 5, 9]},
        out=tmp_path_factory.mktemp("look") / "run",
        fresh=True,
    )


@pytest.fixture(scope="session")
def table1(tmp_path_factory: pytest.TempPathFactory) -> depthloom.Run:
    """Two stages, four variants, and a network that learned next to nothing. Frames 2 and 3 ran through both stages."""
    frames = {"sources.train.with.frames": "0..4", "sources.test.with.frames": "2..6"}
    return depthloom.run(
        EXPERIMENTS / "table1.yaml",
        set={**SMALL, **frames, "learn.train.with.steps": 3},
        out=tmp_path_factory.mktemp("table1") / "run",
        fresh=True,
    )
