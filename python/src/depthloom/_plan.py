"""The plan of a recording."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from ._errors import Ambiguous, NotRecorded

#: How many names an error lists.
_LISTED = 8
#: How many near names an error suggests.
_NEAR = 2


@dataclass(frozen=True)
class Estimate:
    """An estimate under `score:`."""

    #: Its name in a frame: `name` if all variants share it, otherwise `variant/name`.
    label: str
    #: Its name in the experiment: `estimate` in tables.
    name: str
    #: The variant; `None` if all share it.
    variant: str | None
    #: The stage.
    stage: str
    #: The topic of its maps; `None` if they were not recorded.
    topic: str | None
    #: The topic of the ground truth that it is compared with; `None` if it was not recorded.
    truth_topic: str | None
    #: How it was scored: preset, bounds, crop, pixel sets, with every default.
    scoring: Mapping[str, Any]


@dataclass(frozen=True)
class Node:
    """A node of a stage."""

    name: str
    kind: str
    version: int
    #: Its parameters, every default filled in.
    params: Mapping[str, Any]
    #: The source of each input, by port; `None` for an optional input that is not connected.
    inputs: Mapping[str, str | None]
    #: The variants that use it.
    variants: tuple[str, ...]
    #: The node hash: a hash of kind, version, parameters and the hashes of its inputs.
    node_hash: str


@dataclass(frozen=True)
class Output:
    """An output port whose values are in the recording, frame by frame."""

    #: The stage run, as an index.
    run: int
    topic: str
    #: The topic, and the names that other variants have for it.
    names: tuple[str, ...]
    value_type: str

    def matches(self, name: str) -> bool:
        """Whether a name is the topic (`/look/depth/depth`), or its end: `depth/depth`, or of its node: `depth`."""
        if name.startswith("/"):
            return name in self.names
        for topic in self.names:
            node = topic.rpartition("/")[0]
            # A port alone is not a name: `depth` is the node, not any port of depths.
            if f"{node}/".endswith(f"/{name}/") or ("/" in name and topic.endswith(f"/{name}")):
                return True
        return False


class Plan:
    """The plan of a recording."""

    def __init__(self, text: str) -> None:
        plan = json.loads(text)
        self.name: str = plan["experiment"]
        self.description: str = plan["description"]
        self.variants: tuple[str, ...] = tuple(variant for variant in plan["variants"] if variant)
        factors = plan.get("factors") or [[] for _ in plan["variants"]]
        #: By variant, the values of the matrix' axes.
        self.factors: dict[str, dict[str, str]] = {
            variant: {factor["axis"]: factor["value"] for factor in axes}
            for variant, axes in zip(plan["variants"], factors, strict=True)
            if variant
        }
        #: The names of the stage runs.
        self.stages: tuple[str, ...] = tuple(run["prefix"].lstrip("/") for run in plan["runs"])
        self.nodes: tuple[tuple[Node, ...], ...] = tuple(
            tuple(_node(node, plan["variants"]) for node in run["nodes"]) for run in plan["runs"]
        )
        #: The estimates by stage run.
        self._scored: tuple[tuple[Estimate, ...], ...] = tuple(
            tuple(_estimate(estimate, run["stage"], plan["variants"]) for estimate in run["estimates"]) for run in plan["runs"]
        )
        self.estimates: tuple[Estimate, ...] = tuple(estimate for estimates in self._scored for estimate in estimates)
        self.outputs: tuple[Output, ...] = tuple(
            output for index, run in enumerate(plan["runs"]) for output in _outputs(index, run)
        )
        self._by_topic = {output.topic: output for output in self.outputs}

    def output(self, name: str, runs: frozenset[int]) -> Output:
        """The output of this name, among those of some stage runs: an estimate by its label, or a topic."""
        # A label always means an estimate. On a frame of another stage it must not match a node with the same name.
        if self._labelled(name):
            estimate = self.estimate(name, runs)
            if estimate.topic is None:
                raise NotRecorded(f"the maps of `{name}` were not recorded: add them to `record:`, and run the experiment again")
            return self._by_topic[estimate.topic]
        matching = [output for output in self.outputs if output.matches(name)]
        here = [output for output in matching if output.run in runs]
        if len(here) == 1:
            return here[0]
        if here:
            raise Ambiguous(f"`{name}` matches several topics: {_listed([output.topic for output in here])}")
        if matching:
            raise NotRecorded(f"{matching[0].topic} is of stage `{self.stages[matching[0].run]}`; {self._not_there(runs)}")
        raise NotRecorded(self._unknown(name, runs))

    def estimate(self, name: str, runs: frozenset[int]) -> Estimate:
        """The estimate of that label, among those of some stage runs."""
        labelled = self._labelled(name)
        here = [estimate for estimate in labelled if estimate in self._estimates(runs)]
        if len(here) == 1:
            return here[0]
        if here:
            names = _listed([f"{estimate.stage}/{estimate.label}" for estimate in here])
            raise Ambiguous(f"`{name}` is an estimate of several stages: {names}")
        if labelled:
            raise NotRecorded(f"`{name}` is an estimate of stage `{labelled[0].stage}`; {self._not_there(runs)}")
        labels = _listed([estimate.label for estimate in self._estimates(runs)])
        raise NotRecorded(f"there is no estimate `{name}` here; there is {labels}")

    def _labelled(self, name: str) -> list[Estimate]:
        return [estimate for estimate in self.estimates if name in (estimate.label, f"{estimate.stage}/{estimate.label}")]

    def _estimates(self, runs: frozenset[int]) -> list[Estimate]:
        return [estimate for run in sorted(runs) for estimate in self._scored[run]]

    def _not_there(self, runs: frozenset[int]) -> str:
        return f"this frame is of {_listed([self.stages[run] for run in sorted(runs)])}"

    def _unknown(self, name: str, runs: frozenset[int]) -> str:
        labels = [estimate.label for estimate in self._estimates(runs)]
        topics = [output.topic for output in self.outputs if output.run in runs]
        # A port alone is not a name, but suggests topics: `left` those that end in `/left`.
        ports = [_end(topic, topics) for topic in topics if topic.rpartition("/")[2] == name]
        ends = [end for topic in topics for end in (topic, _end(topic, topics), topic.rpartition("/")[0].rpartition("/")[2])]
        near = ports[:_NEAR] or get_close_matches(name, dict.fromkeys(labels + ends), n=_NEAR)
        also = f"did you mean {' or '.join(f'`{candidate}`' for candidate in near)}?" if near else "`list(frame)` has all names"
        return f"no recorded map is named `{name}`; {also}"


def _end(topic: str, topics: list[str]) -> str:
    """The shortest unique suffix of a topic that has at least two parts."""
    parts = topic.split("/")
    ends = ("/".join(parts[-count:]) for count in range(2, len(parts)))
    return next((end for end in ends if sum(f"/{end}" == other[-len(end) - 1 :] for other in topics) == 1), topic)


def _node(node: Mapping[str, Any], variants: list[str]) -> Node:
    return Node(
        name=node["name"],
        kind=node["kind"],
        version=node["version"],
        params=node["params"],
        inputs={port["port"]: port["from"] for port in node["inputs"]},
        variants=tuple(variants[variant] for variant in node["variants"] if variants[variant]),
        node_hash=node["node_hash"],
    )


def _estimate(estimate: Mapping[str, Any], stage: str, variants: list[str]) -> Estimate:
    variant = estimate["variant"]
    return Estimate(
        label=estimate["label"],
        name=estimate["name"],
        variant=None if variant is None else variants[variant],
        stage=stage,
        topic=estimate["estimate_topic"],
        truth_topic=estimate["truth_topic"],
        scoring=estimate["score_params"],
    )


def _outputs(index: int, run: Mapping[str, Any]) -> Iterator[Output]:
    node_outputs = (output for node in run["nodes"] for output in node["outputs"])
    for output in (*run["source"]["outputs"], *node_outputs):
        if output["recorded"] and not output["once"]:
            topic = output["topic"]
            names = (topic, *(alias for alias in output["aliases"] if alias != topic))
            yield Output(run=index, topic=topic, names=names, value_type=output["type"])


def _listed(names: list[str]) -> str:
    text = ", ".join(f"`{name}`" for name in names[:_LISTED])
    return f"{text}, ..." if len(names) > _LISTED else text or "none"
