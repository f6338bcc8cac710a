"""Runs that Python starts."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import depthloom

from conftest import EXPERIMENTS, SMALL


def test_values_are_set_unchanged(look: depthloom.Run, tmp_path: Path) -> None:
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
        set={**SMALL, "sources.train.with.frames": "0..2", "sources.test.with.frames": "0..1", "learn.train.with.steps": 1},
        variants=["no_*"],
        workers=1,
        fresh=True,
        out=tmp_path / "run",
    )
    assert run.variants == ("no_weighting", "no_scaling")


NODE = """
import sys
import depthloom

@depthloom.node(inputs={"depth": "depth"}, outputs={"depth": "depth"})
def same(depth):
    print("looking at", depth.shape)
    depthloom.warn("pixels that were looked at", depth.size)
    return {NAME: depth}

depthloom.serve(same)
sys.exit(CODE)
"""


def with_node(folder: Path, name: str, code: int) -> Path:
    """An experiment with a node in Python that returns its input under a name, and ends with an exit code."""
    (folder / "node.py").write_text(NODE.replace("NAME", repr(name)).replace("CODE", str(code)))
    path = folder / "own.yaml"
    ports = "{ inputs: { depth: depth }, outputs: { depth: depth } }"
    path.write_text(
        f"""
experiment: own
sources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..2, width: 64, height: 32 }} }} }}
stages:
  look:
    source: street
    nodes:
      own: {{ kind: process, inputs: {{ depth: source/depth }}, with: {{ command: [{sys.executable}, node.py], version: 1, ports: {ports} }} }}
    score: {{ ground_truth: source/depth, estimates: {{ own: {{ from: own/depth, sets: [all] }} }} }}
"""
    )
    return path


def test_programs_start_with_permission_and_their_output_is_stored(tmp_path: Path) -> None:
    path = with_node(tmp_path, "depth", 0)
    with pytest.raises(depthloom.ProgramError, match="it would start"):
        depthloom.run(path, out=tmp_path / "refused")
    with pytest.warns(depthloom.DepthloomWarning, match=r"look.own: 4096 pixels that were looked at, on 2 frames"):
        run = depthloom.run(path, out=tmp_path / "run", allow_exec=True, fresh=True, workers=1)
    assert run.scores["abs_rel"].max() == 0
    assert "4096 pixels that were looked at, on 2 frames" in (run.path / "report.html").read_text()
    printed = (run.path / "programs.log").read_text()
    assert printed == f"== {Path(sys.executable).name} node.py: its standard error\nlooking at (32, 64)\nlooking at (32, 64)\n"


def test_a_failure_after_the_last_reply_is_a_warning(tmp_path: Path) -> None:
    with pytest.warns(depthloom.DepthloomWarning) as warned:
        depthloom.run(with_node(tmp_path, "depth", 3), out=tmp_path / "run", allow_exec=True, fresh=True, workers=1)
    assert any("node.py` ended with exit code 3 after its last reply; its standard error" in str(one.message) for one in warned)


def test_an_unknown_output_suggests_similar_names(tmp_path: Path) -> None:
    with pytest.raises(depthloom.ProgramError, match="there is no output `dpth`; did you mean `depth`"):
        depthloom.run(with_node(tmp_path, "dpth", 0), out=tmp_path / "run", allow_exec=True, fresh=True)


def test_errors_in_the_experiment_have_a_place(tmp_path: Path) -> None:
    with pytest.raises(depthloom.ProgramError, match="there is no stage `nonsense`") as error:
        depthloom.run(EXPERIMENTS / "first-look.yaml", set={"nonsense.x": 1}, out=tmp_path / "run")
    assert error.value.exit_code == 2
    assert error.value.report["diagnostics"][0]["file"] == "--set"
    assert not (tmp_path / "run").exists()


def executable(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path.resolve()


def found(site: Path, **environment: str) -> Path:
    """The program that the package in the folder `site` calls."""
    code = "import depthloom._program; print(depthloom._program.program())"
    paths = os.pathsep.join([str(site), *sys.path])
    inherited = {name: value for name, value in os.environ.items() if name != "DEPTHLOOM"}
    done = subprocess.run([sys.executable, "-c", code], env={**inherited, "PYTHONPATH": paths, **environment}, check=True, capture_output=True, text=True)
    return Path(done.stdout.strip())


def test_the_variable_precedes_the_installed_program_which_precedes_the_path(tmp_path: Path) -> None:
    site = tmp_path / "lib/python3/site-packages"
    shutil.copytree(Path(depthloom.__file__).parent, site / "depthloom")
    on_path = executable(tmp_path / "elsewhere/depthloom")
    named = executable(tmp_path / "named/other-name")
    records = site / "depthloom-0.2.0.dist-info/RECORD"
    records.parent.mkdir()
    records.with_name("METADATA").write_text("Metadata-Version: 2.4\nName: depthloom\nVersion: 0.2.0\n")
    path = str(on_path.parent)

    # `pip install ./python` installs the module alone, also beside a program that it did not install.
    records.write_text("depthloom/__init__.py,,\ndepthloom/_program.py,,\n")
    installed = executable(tmp_path / "bin/depthloom")
    assert found(site, PATH=path) == on_path
    # A wheel lists its program.
    records.write_text("../../../bin/depthloom,,\ndepthloom/__init__.py,,\ndepthloom/_program.py,,\n")
    assert found(site, PATH=path) == installed
    assert found(site, PATH=path, DEPTHLOOM=str(named)) == named
    # A list without this module is of another installation.
    records.write_text("../../../bin/depthloom,,\n")
    assert found(site, PATH=path) == on_path
    # `pip install --target` moves the program into `bin/` of its folder.
    beside = executable(site / "bin/depthloom")
    assert found(site, PATH=path) == beside


def test_without_the_program_the_error_names_a_remedy(look: depthloom.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DEPTHLOOM", "/nowhere/depthloom")
    with pytest.raises(depthloom.ProgramError, match="/nowhere/depthloom"):
        depthloom.run(EXPERIMENTS / "first-look.yaml")
    monkeypatch.delenv("DEPTHLOOM")
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setattr("depthloom._program._installed", lambda: None)
    with pytest.raises(depthloom.ProgramError, match="cargo build --release"):
        depthloom.run(EXPERIMENTS / "first-look.yaml")
    # Recorded values can be read without the program.
    assert len(depthloom.open(look.path).frames) == 3
