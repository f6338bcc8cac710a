"""Frames, and their recorded maps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from numpy.typing import NDArray

from . import _maps
from ._calibration import Calibration
from ._errors import Ambiguous, NotRecorded
from ._maps import MAP_TYPES
from ._plan import Output, Plan
from ._recording import Commit, Recording


@dataclass(frozen=True)
class Place:
    """A frame of a stage."""

    #: Its position in the stage, from 0.
    position: int
    commit: Commit


class Frame(Mapping[str, NDArray[Any]]):
    """The recorded maps of a frame, by name; each is read on access.

    A name is that of an estimate (`"no_scaling/fused"`), a topic (`"/compare/weight/weight"`), its end (`"weight/weight"`) or that of its node (`"weight"`). If stages
    or variants share a name, put more of the topic before it: `"compare/source/left"`.

    All arrays are `(height, width)`. Depths are float32 metres and disparities float32 pixels, both NaN = missing. Confidences are float32 in [0, 1], masks bool, images
    uint8; colour images are `(height, width, 3)` RGB. Maps are those before alignment (`score.align`) and clamping.
    """

    def __init__(self, recording: Recording, plan: Plan, places: tuple[Place, ...]) -> None:
        self._recording = recording
        self._plan = plan
        self._places = {place.commit.run: place for place in places}

    @property
    def id(self) -> str:
        """The frame's id, e.g. `000150_10`."""
        return next(iter(self._places.values())).commit.frame

    @property
    def stages(self) -> dict[str, int]:
        """The stages that processed it, and its position in each."""
        return {self._plan.stages[run]: place.position for run, place in self._places.items()}

    @property
    def failures(self) -> tuple[str, ...]:
        """The failures on it."""
        return tuple(failure for place in self._places.values() for failure in place.commit.failures)

    def truth(self, estimate: str) -> NDArray[Any]:
        """The ground truth that an estimate is compared with: float32 metres (pixels for a disparity), NaN = unknown."""
        found = self._plan.estimate(estimate, self._runs)
        if found.truth_topic is None:
            raise NotRecorded(f"the ground truth of `{estimate}` was not recorded: add it to `record:`, and run the experiment again")
        return self[found.truth_topic]

    @property
    def calibration(self) -> Calibration:
        """Focal length, principal point and baseline of its cameras."""
        found = {message for output in self._outputs("calibration") for message in self._calibrations(output)}
        if not found:
            raise NotRecorded(f"no calibration of frame `{self.id}` was recorded")
        if len(found) > 1:
            raise Ambiguous(f"frame `{self.id}` has several calibrations: choose a stage, `run.stages[...].frames[...]`")
        return found.pop()

    def __getitem__(self, name: str) -> NDArray[Any]:
        output = self._named(name)
        commit = self._places[output.run].commit
        for schema, message in self._recording.messages(output.topic, commit.time_ns, commit.sequence):
            return _maps.array(output.value_type, schema, message)
        why = f": {commit.failures[0]}" if commit.failures else ""
        raise NotRecorded(f"frame `{self.id}` has no value of {output.topic}{why}")

    def __contains__(self, name: object) -> bool:
        try:
            return isinstance(name, str) and self._is_there(self._named(name))
        except NotRecorded:
            return False

    def __iter__(self) -> Iterator[str]:
        return (output.topic for output in self._outputs(*MAP_TYPES) if self._is_there(output))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __repr__(self) -> str:
        stages = ", ".join(f"{stage} {position}" for stage, position in self.stages.items())
        return f"<Frame {self.id!r} ({stages}): {len(self)} maps>"

    @property
    def _runs(self) -> frozenset[int]:
        return frozenset(self._places)

    def _named(self, name: str) -> Output:
        output = self._plan.output(name, self._runs)
        if output.value_type not in MAP_TYPES:
            raise NotRecorded(f"{output.topic} carries {output.value_type}, which is not a map")
        return output

    def _outputs(self, *types: str) -> Iterator[Output]:
        return (output for output in self._plan.outputs if output.run in self._places and output.value_type in types)

    def _is_there(self, output: Output) -> bool:
        commit = self._places[output.run].commit
        return self._recording.has(output.topic, commit.time_ns, commit.sequence)

    def _calibrations(self, output: Output) -> Iterator[Calibration]:
        commit = self._places[output.run].commit
        messages = self._recording.messages(output.topic, commit.time_ns, commit.sequence)
        return (_maps.calibration(message) for _, message in messages)


class Frames(Mapping[str, Frame]):
    """The frames of a run by their ids, in the order in which they were recorded."""

    def __init__(self, recording: Recording, plan: Plan, places: list[Place]) -> None:
        self._recording = recording
        self._plan = plan
        self._places: dict[str, list[Place]] = {}
        for place in places:
            self._places.setdefault(place.commit.frame, []).append(place)

    def __getitem__(self, frame: str) -> Frame:
        places = self._places.get(frame)
        if places is None:
            near = get_close_matches(frame, self._places, n=1)
            also = f"did you mean `{near[0]}`?" if near else f"there are {len(self)}, from `{next(iter(self), '')}` on"
            raise NotRecorded(f"the recording has no frame `{frame}`; {also}")
        runs = [place.commit.run for place in places]
        twice = next((run for run in runs if runs.count(run) > 1), None)
        if twice is not None:
            stage = self._plan.stages[twice]
            at = " and ".join(str(place.position) for place in places if place.commit.run == twice)
            raise Ambiguous(f'`{frame}` is the id of several frames of stage `{stage}`: choose one by its position, `run.stages["{stage}"].frames[...]`, of {at}')
        return Frame(self._recording, self._plan, tuple(places))

    def __contains__(self, frame: object) -> bool:
        return frame in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __repr__(self) -> str:
        return f"<Frames: {len(self)}>"
