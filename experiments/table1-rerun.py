#!/usr/bin/env python3
"""Opens a run of table1.yaml (or of what extends it) in Rerun, laid out.

    pip install rerun-sdk==0.41.0
    python experiments/table1-rerun.py RUN/recording.mcap              # opens the viewer
    python experiments/table1-rerun.py RUN/recording.mcap table1.rrd   # writes recording and layout, for `rerun table1.rrd`
    python experiments/table1-rerun.py table1.rbl                      # writes the layout alone

Pictures of stage `compare`, of its first variant; the other variants' are /compare/view/VARIANT.NODE.depth. Curves: a score of mono and of the fused depth
against the frames, and the loss of the learning against its steps, a millisecond each.
"""
import sys

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

APPLICATION = "depthloom"
VIEWS = {
    "left": "/compare/source/left/image",
    "stereo": "/compare/view/depth.depth",
    "mono": "/compare/view/full.scaled.depth",
    "fused": "/compare/view/full.fused.depth",
    "truth": "/compare/view/source.depth",
    "weight": "/compare/view/weight.weight",
}
SCORES = {"mono": "/compare/full/score.mono/rows", "fused": "/compare/full/score.fused/rows"}
CURVE = "/learn/train/curve"


def series(name, schema, field):
    """A line of one number of a topic's messages."""
    mapping = VisualizerComponentMapping(
        target="Scalars:scalars",
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=f"{schema}:message",
        selector=f".{field}",
    )
    looks = [rr.SeriesLines(names=name), rr.SeriesPoints(names=name, marker_sizes=3)]
    return [look.visualizer(mappings=[mapping]) for look in looks]


def plot(name, topics):
    """A view of lines, by topic."""
    return rrb.TimeSeriesView(name=name, origin="/", contents=list(topics), overrides=topics)


def blueprint():
    pictures = [rrb.Spatial2DView(name=name, origin=topic, contents=topic) for name, topic in VIEWS.items()]
    scores = {topic: series(name, "depthloom.Score", "abs_rel") for name, topic in SCORES.items()}
    curve = {CURVE: series("loss", "depthloom.CurvePoint", "loss")}
    plots = rrb.Horizontal(plot("abs_rel", scores), plot("loss", curve))
    time = rrb.TimePanel(state="collapsed", timeline="message_log_time", play_state="paused")
    return rrb.Blueprint(rrb.Vertical(rrb.Grid(*pictures, grid_columns=2), plots, row_shares=[3, 1]), time, collapse_panels=True)


def main(files):
    match files:
        case [layout] if layout.endswith(".rbl"):
            blueprint().save(APPLICATION, layout)
            return
        case [recording]:
            rr.init(APPLICATION, spawn=True)
        case [recording, both]:
            rr.init(APPLICATION)
            rr.save(both)
        case _:
            sys.exit(__doc__)
    rr.send_blueprint(blueprint(), make_active=True, make_default=True)
    rr.log_file_from_path(recording)


if __name__ == "__main__":
    main(sys.argv[1:])
