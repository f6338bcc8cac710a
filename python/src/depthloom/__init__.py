"""Runs of depthloom in Python.

>>> import depthloom
>>> run = depthloom.open("runs/table1/2026-11-21T10-00-00Z")    # or "@latest"
>>> run.table                                                   # a polars DataFrame; so are run.scores, run.timings, ...
>>> run.frames["000150_10"]["no_scaling/fused"]                 # a NumPy array: float32 metres, NaN = no answer
>>> run.samples()                                               # a polars LazyFrame: a row a scored pixel
>>> run.experiment["stages"]["compare"]["nodes"]["stereo"]      # the experiment as it was run
>>> depthloom.run("experiments/table1.yaml", set={"compare.stereo.with.block": 7})

What a recording holds is read here, without the program. The program `depthloom` makes what is not there yet: runs, samples and tables. It is looked for
on the PATH, or where the environment's `DEPTHLOOM` says.
"""

from ._errors import Ambiguous, DepthloomError, DepthloomWarning, NotRecorded, ProgramError, RecordingError
from ._frames import Frame, Frames
from ._maps import Calibration
from ._plan import Estimate, Node
from ._program import run
from ._run import Run, Stage, open

__all__ = [
    "Ambiguous",
    "Calibration",
    "DepthloomError",
    "DepthloomWarning",
    "Estimate",
    "Frame",
    "Frames",
    "Node",
    "NotRecorded",
    "ProgramError",
    "RecordingError",
    "Run",
    "Stage",
    "open",
    "run",
]
