"""Runs that Python starts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import depthloom

from conftest import EXPERIMENTS, SMALL


def test_a_value_is_set_as_it_is(look: depthloom.Run, tmp_path: Path) -> None:
    run = depthloom.run(
        EXPERIMENTS / "first-look.yaml",
        set={"sources.street.with": {"frames": "3..4", "width": np.int64(320), "height": 96}, "look.stereo.with.block": np.int32(7)},
        out=tmp_path / "run",
    )
    assert list(run.frames) == ["000003_10"]
    (stereo,) = [node for node in run.stages["look"].nodes if node.name == "stereo"]
    assert stereo.params["block"] == 7
    with pytest.raises(depthloom.ProgramError) as error:
        depthloom.run(EXPERIMENTS / "first-look.yaml", out=tmp_path / "run")
    assert error.value.exit_code == 2
    again = depthloom.run(EXPERIMENTS / "first-look.yaml", set={"sources.street.with.frames": "0..1"}, out=tmp_path / "run", overwrite=True)
    assert list(again.frames) == ["000000_10"]


def test_variants_and_workers_are_chosen(tmp_path: Path) -> None:
    run = depthloom.run(
        EXPERIMENTS / "table1.yaml",
        set={**SMALL, "sources.train.with.frames": "0..2", "sources.test.with.frames": "0..1", "learn.teacher.with.steps": 1},
        variants=["no_*"],
        workers=1,
        fresh=True,
        out=tmp_path / "run",
    )
    assert run.variants == ("no_weighting", "no_scaling")


def test_a_mistake_says_where_it_is(tmp_path: Path) -> None:
    with pytest.raises(depthloom.ProgramError, match="there is no stage `nonsense`") as error:
        depthloom.run(EXPERIMENTS / "first-look.yaml", set={"nonsense.x": 1}, out=tmp_path / "run")
    assert error.value.exit_code == 2
    assert error.value.told["diagnostics"][0]["file"] == "--set"
    assert not (tmp_path / "run").exists()


def test_without_the_program_the_error_says_how_to_have_it(look: depthloom.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DEPTHLOOM", "/nowhere/depthloom")
    with pytest.raises(depthloom.ProgramError, match="/nowhere/depthloom"):
        depthloom.run(EXPERIMENTS / "first-look.yaml")
    monkeypatch.delenv("DEPTHLOOM")
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(depthloom.ProgramError, match="cargo build --release"):
        depthloom.run(EXPERIMENTS / "first-look.yaml")
    # What is recorded is read without it.
    assert len(depthloom.open(look.path).frames) == 3
