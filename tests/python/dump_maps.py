"""Writes all maps of a run as the package `depthloom` reads them, each as the raw bytes of its array.

    dump_maps.py RUN OUT

`OUT/maps.json` is a list of [stage, position, topic, NumPy's name of the type, shape]; the file `OUT/N` holds the bytes of the Nth.
"""
import json
import sys
from pathlib import Path

import depthloom

run, out = depthloom.open(sys.argv[1]), Path(sys.argv[2])
told = []
for stage in run.stages.values():
    for position, frame in enumerate(stage.frames):
        for topic in frame:
            array = frame[topic]
            (out / str(len(told))).write_bytes(array.tobytes())
            told.append([stage.name, position, topic, array.dtype.name, array.shape])
(out / "maps.json").write_text(json.dumps(told))
