"""A run: tables, experiment, estimates."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import depthloom

from conftest import EXPERIMENTS


def test_a_run_is_opened_by_its_folder_its_recording_and_its_name(look: depthloom.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    assert depthloom.open(look.path).name == "first-look"
    assert depthloom.open(look.path / "recording.mcap").path == look.path
    monkeypatch.chdir(look.path.parent)
    assert depthloom.open(Path("run")).path == Path("run")
    with pytest.raises(depthloom.ProgramError) as error:
        depthloom.open("@latest")
    assert error.value.exit_code == 2


def test_tables_equal_the_files_in_the_folder(table1: depthloom.Run) -> None:
    theirs = pl.read_parquet(table1.path / "table.parquet")
    assert table1.table.equals(theirs)
    assert len(table1.table) == 9 + 1, "nine estimates, stereo over two sets"
    assert table1.learning_curves["loss"].is_finite().all()
    assert {"stage", "node"} <= set(table1.timings.columns)
    units = table1.units("error_vs_distance")
    assert set(units) <= set(table1.error_vs_distance.columns) and units["error_p50_m"] == "m"
    assert table1.units("table")["abs_rel"] == "1"


def test_the_table_is_the_mean_of_the_scores(table1: depthloom.Run) -> None:
    means = table1.scores.filter(set="all")["abs_rel"].mean()
    table = table1.table.filter(set="all")["abs_rel"].mean()
    assert means == pytest.approx(table, rel=1e-12)
    assert set(table1.scores["frame"]) == {frame.id for frame in table1.stages["compare"].frames}


def test_scores_of_zones_do_not_mix_with_those_of_whole_images(tmp_path: Path) -> None:
    run = depthloom.run(
        EXPERIMENTS / "first-look.yaml",
        set={"sources.street.with": {"frames": "0..2", "width": 320, "height": 96}, "look.score.zones": {"distance_m": [0, 20, 80]}},
        out=tmp_path / "run",
        fresh=True,
    )
    assert "zone" not in run.scores.columns and len(run.scores) == 2 * 2
    means, table = run.scores.filter(set="all")["abs_rel"].mean(), run.table.filter(set="all")["abs_rel"]
    assert means == pytest.approx(table[0], rel=1e-12)
    zones = run.zone_scores
    assert len(zones) > 0 and zones["zone"].null_count() == 0
    assert set(zones["frame"]) == set(run.frames)


def test_without_zones_there_are_no_rows(look: depthloom.Run) -> None:
    assert len(look.zone_scores) == 0 and "zone" in look.zone_scores.columns


def test_a_missing_table_is_an_error_with_a_remedy(look: depthloom.Run) -> None:
    with pytest.raises(depthloom.DepthloomError, match="depthloom report"):
        _ = look.learning_curves


def test_an_estimate_has_its_variant_and_scoring(table1: depthloom.Run) -> None:
    assert table1.variants == ("full", "no_weighting", "no_scaling", "average_scaling")
    assert [estimate.label for estimate in table1.estimates][:3] == ["stereo", "full/mono", "full/fused"]
    by_label = {estimate.label: estimate for estimate in table1.estimates}
    assert by_label["stereo"].variant is None
    assert by_label["no_scaling/fused"].variant == "no_scaling"
    # A map that variants share was recorded once.
    assert by_label["no_weighting/mono"].topic == by_label["full/mono"].topic == "/compare/full/scaled/depth"
    assert by_label["stereo"].scoring["sets"] == ["valid", "all"]


def test_every_estimate_has_a_row_in_the_table(table1: depthloom.Run) -> None:
    for estimate in table1.estimates:
        rows = table1.table.filter(pl.col("variant").eq_missing(pl.lit(estimate.variant)), stage=estimate.stage, estimate=estimate.name)
        assert set(rows["set"]) == set(estimate.scoring["sets"])


def test_factors_are_those_of_the_matrix(look: depthloom.Run) -> None:
    assert look.factors == {f"block={block}": {"block": str(block)} for block in (3, 5, 9)}
    assert set(look.table["block"]) == {3, 5, 9}


def test_the_experiment_is_the_one_that_was_run(look: depthloom.Run) -> None:
    assert look.experiment["sources"]["street"]["with"]["frames"] == "3..6"
    assert look.experiment["experiment"] == look.name == "first-look"
    (stereo,) = [node for node in look.stages["look"].nodes if node.name == "stereo" and node.variants == ("block=9",)]
    assert stereo.params["block"] == 9
    assert stereo.inputs == {"left": "/look/source/left", "right": "/look/source/right"}


def test_a_run_can_be_passed_to_another_process(look: depthloom.Run) -> None:
    there = pickle.loads(pickle.dumps(look))
    assert list(there.frames) == list(look.frames)


def test_a_recording_without_a_folder_has_frames_and_experiment_but_no_tables(look: depthloom.Run, tmp_path: Path) -> None:
    alone = tmp_path / "alone.mcap"
    alone.write_bytes((look.path / "recording.mcap").read_bytes())
    run = depthloom.open(alone)
    assert run.experiment == look.experiment and len(run.frames) == 3
    with pytest.raises(depthloom.DepthloomError, match="without a run's folder"):
        _ = run.table


def test_samples_are_a_query_over_the_existing_file(look: depthloom.Run, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "recording.mcap").symlink_to(look.path / "recording.mcap")
    pl.DataFrame({"x": [1, 2], "ground_truth_m": [4.0, 5.0]}).write_parquet(folder / "samples.parquet")
    samples = depthloom.open(folder).samples()
    assert isinstance(samples, pl.LazyFrame)
    assert samples.select(pl.col("ground_truth_m").max()).collect().item() == 5


def test_the_readmes_example_works(table1: depthloom.Run) -> None:
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    lines = readme.partition("```python\n")[2].partition("```")[0]
    lines = lines.replace("runs/table1/2026-11-21T10-00-00Z", str(table1.path)).replace("000150_10", "000002_10")
    names: dict[str, object] = {}
    exec(lines, names)
    assert np.array_equal(names["depth"], table1.frames["000002_10"]["no_scaling/fused"])  # type: ignore[arg-type]
