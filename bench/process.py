"""A call of a process against the function itself and against dora: see process.sh, which calls this. Called with the name of a role it is one of the programs that are measured."""

import argparse
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[1]
SHAPE = (375, 1242)


def fuse(mono, stereo, weight):
    n_s, n_m = stereo / np.nanmax(stereo), mono / np.nanmax(mono)
    w_s = np.minimum(n_s, n_m) / np.maximum(n_s, n_m)
    both = weight * stereo + (1 - weight) * (w_s * stereo + (1 - w_s) * mono)
    return np.where(np.isnan(stereo), mono, np.where(np.isnan(both), stereo, both))


def maps():
    k = np.arange(SHAPE[0] * SHAPE[1]).reshape(SHAPE)
    stereo = np.where(k % 5 == 0, np.nan, 5 + k % 64)
    return [of.astype(np.float32) for of in (5 + k % 71, stereo, k % 17 / 16)]


def node(function):
    """A node `process`."""
    sys.path.insert(0, str(ROOT / "python/src"))
    import depthloom

    def first(mono, stereo, weight):
        return mono

    ports = {"mono": "depth", "stereo": "depth", "weight": "weight"}
    depthloom.serve(depthloom.node(inputs=ports, outputs={"depth": "depth"})({"first": first, "fuse": fuse}[function]))


def dora_asks(rounds):
    """The dora node that sends three maps, and waits for one."""
    import pyarrow as pa
    from dora import Node

    dataflow = Node()
    sent = pa.array(np.concatenate([of.ravel() for of in maps()]))
    times = []
    for _ in range(rounds + 5):
        begun = time.perf_counter()
        dataflow.send_output("maps", sent)
        while True:
            event = dataflow.next()
            if event is None or event["type"] == "INPUT":
                break
        if event is None:
            raise SystemExit("dora ended")
        got = event["value"].to_numpy()
        assert got.size == SHAPE[0] * SHAPE[1]
        times.append((time.perf_counter() - begun) * 1e3)
    print("ROUNDTRIP", *times[5:], flush=True)
    pathlib.Path(os.environ["TIMES"]).write_text(" ".join(map(str, times[5:])))


def dora_answers():
    """The dora node that returns the first of three maps."""
    import pyarrow as pa
    from dora import Node

    dataflow = Node()
    for event in dataflow:
        if event["type"] == "INPUT":
            got = event["value"].to_numpy()
            dataflow.send_output("map", pa.array(got[: SHAPE[0] * SHAPE[1]]))


DATAFLOW = """
nodes:
  - id: asks
    path: {python}
    args: {script} dora-asks {rounds}
    env: {{ TIMES: {times} }}
    inputs: {{ map: answers/map }}
    outputs: [maps]
  - id: answers
    path: {python}
    args: {script} dora-answers
    inputs: {{ maps: asks/maps }}
    outputs: [map]
"""


def dora(rounds):
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        times = folder / "times.txt"
        dataflow = folder / "dataflow.yml"
        dataflow.write_text(DATAFLOW.format(python=sys.executable, script=__file__, rounds=rounds, times=times))
        program = pathlib.Path(sys.executable).with_name("dora")
        ran = subprocess.run([program, "run", dataflow], cwd=folder, capture_output=True, text=True, timeout=300)
        if not times.exists():
            print(re.sub(r"\x1b\[[0-9;]*m", "", ran.stdout + ran.stderr)[-2000:], file=sys.stderr)
            raise SystemExit("dora gave no times")
        return sorted(map(float, times.read_text().split()))


def ours(program, function, rounds):
    ran = subprocess.run([program, sys.executable, __file__, function, str(rounds)], capture_output=True, text=True, check=True)
    return [float(number) for number in ran.stdout.split()]


def inside(rounds):
    given, times = maps(), []
    for _ in range(rounds):
        begun = time.perf_counter()
        fuse(*given)
        times.append((time.perf_counter() - begun) * 1e3)
    return statistics.median(times)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--ours", required=True)
    parser.add_argument("--rounds", type=int, default=200)
    arguments = parser.parse_args()
    first, fused = (ours(arguments.ours, name, arguments.rounds) for name in ("first", "fuse"))
    function = inside(arguments.rounds)
    round_trip = dora(arguments.rounds)
    at = lambda share: round_trip[int((len(round_trip) - 1) * share)]
    print(f"a call that computes nothing   {first[0]:7.2f} ms (quartiles {first[1]:.2f} to {first[2]:.2f})")
    print(f"a call of the fusion           {fused[0]:7.2f} ms (quartiles {fused[1]:.2f} to {fused[2]:.2f})")
    print(f"the fusion inside Python       {function:7.2f} ms")
    print(f"dora, there and back           {at(0.5):7.2f} ms (quartiles {at(0.25):.2f} to {at(0.75):.2f})")
    print(f"overhead process {first[0]:.2f}")
    print(f"ratio process {at(0.5) / first[0]:.2f}")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["first" | "fuse" as function]:
            node(function)
        case ["dora-asks", rounds]:
            dora_asks(int(rounds))
        case ["dora-answers"]:
            dora_answers()
        case _:
            main()
