"""Recordings of runs that did not come to their end, and damaged ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import depthloom


def test_a_killed_run_has_its_complete_frames(look: depthloom.Run, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    whole = (look.path / "recording.mcap").read_bytes()
    commits = []
    for share in (0.5, 0.9, 0.999):
        cut.write_bytes(whole[: int(len(whole) * share)])
        killed = depthloom.open(cut)
        assert not killed.is_complete and look.is_complete
        assert list(killed.frames) == list(look.frames)[: len(killed.frames)]
        for name, frame in killed.frames.items():
            assert list(frame) == list(look.frames[name])
            for topic in frame:
                np.testing.assert_array_equal(frame[topic], look.frames[name][topic])
        commits.append(len(killed.frames))
    assert commits == [1, 2, 3]


def test_a_damaged_chunk_is_an_error(look: depthloom.Run, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.mcap"
    data = bytearray((look.path / "recording.mcap").read_bytes())
    middle = len(data) // 2
    data[middle] ^= 1
    damaged.write_bytes(data)
    run = depthloom.open(damaged)
    wrong = 0
    for frame in run.frames.values():
        for topic in frame:
            try:
                same = np.array_equal(frame[topic], look.frames[frame.id][topic], equal_nan=frame[topic].dtype == np.float32)
                assert same, topic
            except depthloom.RecordingError as error:
                assert "damaged at byte" in str(error)
                wrong += 1
    assert wrong <= 1
    # Without its index, the recording is read up to the damage.
    damaged.write_bytes(data[:-8])
    assert len(depthloom.open(damaged).frames) < len(look.frames)


def test_files_that_are_not_recordings_are_refused(tmp_path: Path) -> None:
    for name, data in {"empty": b"", "text": b"frame,estimate\n", "magic": b"\x89MCAP0\r\n", "twice": b"\x89MCAP0\r\n" * 2}.items():
        path = tmp_path / f"{name}.mcap"
        path.write_bytes(data)
        with pytest.raises(depthloom.RecordingError):
            depthloom.open(path)
    with pytest.raises(depthloom.RecordingError, match="has no recording.mcap"):
        depthloom.open(tmp_path)
