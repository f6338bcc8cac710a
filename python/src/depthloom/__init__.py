"""Runs of depthloom in Python.

>>> import depthloom
>>> run = depthloom.open("runs/table1/2026-11-21T10-00-00Z")    # or "@latest"
>>> run.table                                                   # a polars DataFrame; so are run.scores, run.timings, ...
>>> run.frames["000150_10"]["no_scaling/fused"]                 # a NumPy array: float32 metres, NaN = missing
>>> run.samples()                                               # a polars LazyFrame: one row per scored pixel
>>> run.experiment["stages"]["compare"]["nodes"]["stereo"]      # the experiment as it was run
>>> depthloom.run("experiments/table1.yaml", set={"compare.stereo.with.block": 7})

A node or a source of an experiment is written with :func:`node`, :func:`source`, :func:`stream` and :func:`serve`:

>>> @depthloom.node(inputs={"stereo": "depth", "mono": "depth"}, outputs={"depth": "depth"})
... def fuse(stereo, mono):
...     return np.where(np.isnan(stereo), mono, stereo)
>>> depthloom.serve(fuse)

The package reads recordings without the program `depthloom`. It calls the program for new runs, samples and tables. The program must be on the PATH, or the
environment variable `DEPTHLOOM` must name it.
"""

import os
from typing import TYPE_CHECKING

from . import _opened

if os.environ.get(_opened.STARTED):
    _opened.watch()

if TYPE_CHECKING:
    from ._calibration import Calibration
    from ._errors import Ambiguous, DepthloomError, DepthloomWarning, NotRecorded, ProgramError, RecordingError
    from ._experiment import run
    from ._frames import Frame, Frames
    from ._node import Instant, StreamFrame, node, source, stream
    from ._plan import Estimate, Node
    from ._run import Run, Stage, open
    from ._serve import progress, serve, warn
else:
    # Imported on first use: a node needs neither polars nor recordings, and is started once per worker.
    _MODULES = {
        "_calibration": ["Calibration"],
        "_errors": ["Ambiguous", "DepthloomError", "DepthloomWarning", "NotRecorded", "ProgramError", "RecordingError"],
        "_experiment": ["run"],
        "_frames": ["Frame", "Frames"],
        "_node": ["Instant", "StreamFrame", "node", "source", "stream"],
        "_plan": ["Estimate", "Node"],
        "_run": ["Run", "Stage", "open"],
        "_serve": ["progress", "serve", "warn"],
    }

    def __getattr__(name):
        from importlib import import_module

        for module, names in _MODULES.items():
            if name in names:
                found = getattr(import_module(f".{module}", __name__), name)
                globals()[name] = found
                return found
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__():
        return __all__


__all__ = [
    "Ambiguous",
    "Calibration",
    "DepthloomError",
    "DepthloomWarning",
    "Estimate",
    "Frame",
    "Frames",
    "Instant",
    "Node",
    "NotRecorded",
    "ProgramError",
    "RecordingError",
    "Run",
    "Stage",
    "StreamFrame",
    "node",
    "open",
    "progress",
    "run",
    "serve",
    "source",
    "stream",
    "warn",
]
