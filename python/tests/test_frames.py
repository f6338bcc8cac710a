"""Frames and their maps."""

from __future__ import annotations

import numpy as np
import pytest

import depthloom


def test_an_estimate_is_in_metres_with_nan_for_missing_pixels(look: depthloom.Run) -> None:
    frame = look.frames["000003_10"]
    depth, disparity = frame["block=9/stereo"], frame["block=9/stereo/disparity"]
    assert depth.dtype == disparity.dtype == np.float32
    assert depth.shape == disparity.shape == (96, 320)
    calibration = frame.calibration
    assert (calibration.width, calibration.height) == (320, 96)
    answered = np.isfinite(depth)
    assert 0.5 < answered.mean() < 1
    # `depth/from-disparity` caps at 80 m.
    expected = np.minimum(calibration.focal_px * calibration.baseline_m / disparity[answered], 80)
    np.testing.assert_allclose(depth[answered], expected, rtol=1e-6)


def test_metrics_can_be_computed_from_the_maps(table1: depthloom.Run) -> None:
    for frame in table1.stages["compare"].frames:
        for label, variant, name in (("no_scaling/fused", "no_scaling", "fused"), ("no_weighting/mono", "no_weighting", "mono")):
            estimate, truth = frame[label].astype(np.float64), frame.truth(label).astype(np.float64)
            scored = (truth > 0.001) & (truth < 80)
            error = np.abs(np.clip(estimate, 0.001, 80) - truth)[scored] / truth[scored]
            (row,) = table1.scores.filter(frame=frame.id, variant=variant, estimate=name, set="all").to_dicts()
            assert row["pixels"] == scored.sum()
            assert row["abs_rel"] == pytest.approx(error.mean(), rel=1e-6)


def test_maps_have_the_documented_types(table1: depthloom.Run) -> None:
    frame = table1.frames["000004_10"]
    kinds = {"source/left": np.uint8, "mono/depth": np.float32, "weight": np.float32, "source/occluded": np.bool_}
    for name, dtype in kinds.items():
        assert frame[name].dtype == dtype, name
    assert frame["source/left"].shape == (96, 320, 3)
    assert set(np.unique(frame["source/occluded"])) == {False, True}
    weight = frame["weight"]
    assert weight.min() >= 0 and 0 < weight.max() <= 1


def test_a_map_is_named_by_label_topic_end_or_node(table1: depthloom.Run) -> None:
    frame = table1.stages["compare"].frames[0]
    first = frame["/compare/no_scaling/fused/depth"]
    for name in ("no_scaling/fused", "compare/no_scaling/fused", "no_scaling/fused/depth", "compare/no_scaling/fused/depth"):
        np.testing.assert_array_equal(frame[name], first)
    # Another variant's name of a map that was recorded once.
    np.testing.assert_array_equal(frame["/compare/no_weighting/scaled/depth"], frame["full/scaled/depth"])
    # An estimate takes precedence over a node of the same name.
    np.testing.assert_array_equal(frame["stereo"], frame["depth/depth"])


def test_an_ambiguous_name_lists_the_topics(table1: depthloom.Run) -> None:
    frame = table1.stages["compare"].frames[0]
    with pytest.raises(depthloom.Ambiguous, match="`/compare/full/fused/depth`, `/compare/no_weighting/fused/depth`"):
        frame["fused/depth"]
    assert "fused/depth" not in frame


def test_an_unknown_name_suggests_similar_names(table1: depthloom.Run) -> None:
    frame = table1.stages["compare"].frames[0]
    with pytest.raises(depthloom.NotRecorded, match="did you mean `no_scaling/fused`"):
        frame["no_scaling/fusd"]
    with pytest.raises(KeyError, match="did you mean `000004_10`"):
        table1.frames["00004_10"]
    assert frame.get("nothing") is None
    with pytest.raises(depthloom.NotRecorded, match="not a map"):
        frame["compare/source/calibration"]


def test_the_error_for_an_unknown_name_is_one_line(table1: depthloom.Run) -> None:
    frame = table1.stages["compare"].frames[0]
    with pytest.raises(depthloom.NotRecorded) as error:
        frame["left"]
    assert str(error.value) == "no recorded map is named `left`; did you mean `source/left`?"
    with pytest.raises(depthloom.NotRecorded) as error:
        frame["qqqqqqq"]
    assert str(error.value) == "no recorded map is named `qqqqqqq`; `list(frame)` has all names"
    # On a frame of both stages, the stage is part of the name.
    with pytest.raises(depthloom.NotRecorded, match="did you mean `learn/source/left` or `compare/source/left`"):
        table1.frames["000002_10"]["left"]


def test_a_frame_of_two_stages_has_the_maps_of_both(table1: depthloom.Run) -> None:
    assert list(table1.frames) == [f"{index:06}_10" for index in range(6)]
    frame = table1.frames["000002_10"]
    assert frame.stages == {"learn": 2, "compare": 0}
    with pytest.raises(depthloom.Ambiguous):
        frame["source/left"]
    # Streets with two seeds.
    assert (frame["learn/source/left"] != frame["compare/source/left"]).any()
    assert len(frame) == len(list(frame)) == len(table1.stages["learn"].frames[2]) + len(table1.stages["compare"].frames[0])
    assert all(frame[name].shape[:2] == (96, 320) for name in frame)


def test_a_label_does_not_match_a_node_of_another_stage(table1: depthloom.Run) -> None:
    learned = table1.frames["000000_10"]
    # `learn` has a node `stereo`, whose output is a disparity, not a depth.
    with pytest.raises(depthloom.NotRecorded, match="estimate of stage `compare`"):
        learned["stereo"]
    assert learned["stereo/disparity"].shape == (96, 320)
