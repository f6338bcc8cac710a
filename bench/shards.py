"""Times shards and the run that joins them. Called by shards.sh."""
import argparse
import os
import pathlib
import shutil
import statistics
import subprocess
import tempfile
import time

EXPERIMENT = """experiment: shards
sources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..{frames}, width: {width}, height: {height} }} }} }}
stages:
  look:
    source: street
    nodes:
      stereo: {{ kind: stereo/sgbm, inputs: {{ left: source/left, right: source/right }}, with: {{ disparities: {disparities} }} }}
      depth: {{ kind: depth/from-disparity, inputs: {{ disparity: stereo/disparity, calibration: source/calibration }} }}
    score: {{ ground_truth: source/depth, estimates: {{ depth: depth/depth }} }}
"""


def run(folder, *command):
    began = time.perf_counter()
    done = subprocess.run([str(word) for word in command], cwd=folder, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, command))} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return time.perf_counter() - began, done.stderr


def experiment(folder, frames, width, height, disparities):
    text = EXPERIMENT.format(frames=frames, width=width, height=height, disparities=disparities)
    (folder / "shards.yaml").write_text(text)


def trivial(program, folder, shards):
    experiment(folder, shards, 64, 32, 16)
    times = []
    for number in range(1, min(shards, 50) + 1):
        seconds, _ = run(folder, program, "run", "shards.yaml", "--shard", f"{number}/{shards}", "--runs", "single", "--workers", "1", "--quiet")
        times.append(seconds)
    began = time.perf_counter()
    _, errors = run(folder, program, "submit", "shards.yaml", "--to", "local", "--shards", str(shards), "--runs", "all", "--no-page")
    seconds = time.perf_counter() - began
    steps = [line for line in errors.splitlines() if line.startswith("step ") and " in " in line]
    print(f"trivial shards: {shards}, one process each: {1000 * statistics.median(times):.1f} ms (median), {seconds:.1f} s with the last run")
    print("  " + "\n  ".join(steps))


def join(program, folder, frames, parts):
    experiment(folder, frames, 1242, 375, 64)
    for number in range(1, parts + 1):
        run(folder, program, "run", "shards.yaml", "--shard", f"{number}/{parts}", "--runs", "large", "--quiet")
    recordings = sorted(folder.glob("large/*/shards/*/*/recording.mcap"))
    size = sum(path.stat().st_size for path in recordings) / 1e6
    os.sync()
    copied = folder / "copied"
    copied.mkdir()
    began = time.perf_counter()
    for index, path in enumerate(recordings):
        subprocess.run(["cp", str(path), str(copied / str(index))], check=True)
    subprocess.run(["sync", str(copied)], check=True)
    copy_s = time.perf_counter() - began
    shutil.rmtree(copied)
    os.sync()
    join_s, errors = run(folder, program, "run", "shards.yaml", "--runs", "large", "--audit", "none", "--no-page", "--quiet")
    print(f"joining {parts} shards of {frames} frames, {size:.0f} MB: {join_s:.2f} s with the tables ({size / join_s:.0f} MB/s); cp {copy_s:.2f} s ({size / copy_s:.0f} MB/s)")
    print(f"ratio join-copy {copy_s / join_s:.2f}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("--shards", type=int, default=1000)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--parts", type=int, default=8)
    args = parser.parse_args()
    os.environ.pop("DEPTHLOOM_FRESH", None)
    with tempfile.TemporaryDirectory() as name:
        trivial(args.program.resolve(), pathlib.Path(name), args.shards)
    with tempfile.TemporaryDirectory() as name:
        join(args.program.resolve(), pathlib.Path(name), args.frames, args.parts)


main()
