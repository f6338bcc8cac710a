"""Runs of which not everything was recorded, frames that failed, ids that come twice."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

import depthloom
from depthloom._program import program

from conftest import EXPERIMENTS


def experiment(path: Path, source: object, **more: object) -> Path:
    """Stereo as in `first-look.yaml` on another source; JSON is YAML."""
    text = {"extends": str(EXPERIMENTS / "first-look.yaml"), "experiment": "look", "sources": {"street": source}, **more}
    path.write_text(json.dumps(text))
    return path


def street(frames: str, seed: int) -> dict[str, object]:
    return {"kind": "synthetic/road", "with": {"frames": frames, "seed": seed, "width": 320, "height": 96}}


def test_frames_with_the_same_id_are_distinguished_by_position(tmp_path: Path) -> None:
    twice = {"concat": [street("0..2", 1), street("1..3", 2)]}
    run = depthloom.run(experiment(tmp_path / "twice.yaml", twice), out=tmp_path / "run")
    assert list(run.frames) == ["000000_10", "000001_10", "000002_10"]
    with pytest.raises(depthloom.Ambiguous, match="of 1 and 2"):
        run.frames["000001_10"]
    one, other = run.stages["look"].frames[1:3]
    assert one.id == other.id == "000001_10" and one.stages == {"look": 1}
    assert (one["source/left"] != other["source/left"]).any()


def test_a_map_exists_if_it_is_readable_even_if_frames_share_a_time(tmp_path: Path) -> None:
    # Both frames have the time 0, and only the values of the first are recorded.
    twice = {"concat": [street("0..1", 1), street("0..1", 2)]}
    recorded = {"record": {"every": 2, "topics": ["source/depth"]}}
    run = depthloom.run(experiment(tmp_path / "twice.yaml", twice, **recorded), out=tmp_path / "run")
    first, second = run.stages["look"].frames
    assert "source/depth" in first and list(first) == ["/look/source/depth"]
    assert first["source/depth"].shape == (96, 320)
    assert "source/depth" not in second and list(second) == [] and second.get("source/depth") is None


def test_values_that_were_not_recorded_are_an_error_with_a_remedy(tmp_path: Path) -> None:
    recorded = {"record": {"every": 2, "topics": ["source/depth"]}}
    run = depthloom.run(experiment(tmp_path / "part.yaml", street("0..2", 1), **recorded), out=tmp_path / "run")
    first, second = run.frames.values()
    assert list(first) == ["/look/source/depth"] and list(second) == []
    assert "source/depth" in first and "source/depth" not in second and "stereo" not in first
    with pytest.raises(depthloom.NotRecorded, match="add them to `record:`"):
        first["stereo"]
    with pytest.raises(depthloom.NotRecorded, match="has no value of /look/source/depth"):
        second["source/depth"]
    with pytest.raises(depthloom.NotRecorded, match="no calibration"):
        _ = first.calibration
    assert len(run.table) == 2


def test_a_failed_frame_lists_its_failures(tmp_path: Path) -> None:
    data = tmp_path / "data"
    subprocess.run([program(), "synth", data, "--frames", "3", "--width", "320", "--height", "96", "--quiet"], check=True)
    (data / "training/image_2/000001_10.png").write_bytes(b"no image")
    pairs = {"kind": "kitti/stereo2015", "with": {"root": str(data), "ground_truth": "noc"}}
    path = experiment(tmp_path / "pairs.yaml", pairs)
    with pytest.raises(depthloom.ProgramError, match="000001_10") as error:
        depthloom.run(path, out=tmp_path / "run")
    assert error.value.exit_code == 3
    with pytest.warns(depthloom.DepthloomWarning):
        run = depthloom.run(path, out=tmp_path / "goes-on", keep_going=True)
    failed = run.frames["000001_10"]
    assert "000001_10.png" in failed.failures[0] and list(failed) == []
    assert run.frames["000000_10"].failures == ()
    with pytest.raises(depthloom.NotRecorded, match="000001_10.png"):
        failed["stereo"]
    assert run.frames["000002_10"]["stereo"].shape == (96, 320)
