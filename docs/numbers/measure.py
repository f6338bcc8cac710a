"""Measures the numbers that README and guide show, and writes them to this folder.

    python3 docs/numbers/measure.py kitti     # 15 minutes; needs ../shared (or DEPTHLOOM_SHARED), or KITTI_STEREO_2015
    python3 docs/numbers/measure.py beyond    # 25 minutes; the same data
    python3 docs/numbers/measure.py speed     # 5 minutes; the same, and a quiet machine
    python3 docs/numbers/measure.py table1    # 3 minutes; a quiet machine
    python3 docs/numbers/measure.py build     # 15 minutes; a quiet machine and 6 GB of disk

Then write them into the pages:

    DEPTHLOOM_WRITE_GUIDE=1 cargo test --release -p depthloom --test end_to_end -- guide::numbers

The program is target/release/depthloom, or DEPTHLOOM. Only the standard library is needed.
"""

import datetime
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
MEASURED = HERE / "measured.json"
PROGRAM = pathlib.Path(os.environ.get("DEPTHLOOM", ROOT / "target/release/depthloom")).resolve()


def run(command, **more):
    return subprocess.run([str(part) for part in command], cwd=ROOT, check=True, text=True, **more)


def output(command, **more):
    return run(command, stdout=subprocess.PIPE, **more).stdout


def kitti_folder():
    shared = pathlib.Path(os.environ.get("DEPTHLOOM_SHARED", ROOT.parent / "shared"))
    folder = pathlib.Path(os.environ.get("KITTI_STEREO_2015", shared / "data/kitti_stereo_2015")).resolve()
    if not (folder / "training/image_2").is_dir():
        sys.exit(f"SKIPPED: {folder} has no training/image_2 (set KITTI_STEREO_2015 or DEPTHLOOM_SHARED)")
    return folder


def machine():
    lines = pathlib.Path("/proc/cpuinfo").read_text().splitlines() if pathlib.Path("/proc/cpuinfo").exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{os.cpu_count()} cores of {names[0]}" if names else f"{os.cpu_count()} cores"


def write(name, values):
    measured = json.loads(MEASURED.read_text())
    measured[name] = {"date": datetime.date.today().isoformat(), "machine": machine(), **values}
    MEASURED.write_text(json.dumps(measured, indent=2) + "\n")


def environment(run_folder):
    return json.loads((pathlib.Path(run_folder) / "environment.json").read_text())


def kitti():
    # tract is part of the program: the numbers do not depend on the ONNX Runtime of the machine.
    variables = os.environ | {"KITTI_STEREO_2015": str(kitti_folder()), "DEPTHLOOM_ONNX_ENGINE": "tract"}
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "kitti"
        begin = time.monotonic()
        run([PROGRAM, "run", "experiments/table1-kitti.yaml", "--quiet", "--no-page", "--fresh", "--out", out], env=variables)
        minutes = round((time.monotonic() - begin) / 60)
        tables(out)
        timings = json.loads(output([PROGRAM, "runs", "timings", out, "--json"]))["timings"]
        training_ns = max(row["wall_ns"] for row in timings if row["stage"] == "learn")
        write("kitti", {"engine": "tract", "training_minutes": round(training_ns / 60e9), "minutes": minutes})


def tables(out):
    """The tables of a run on KITTI."""
    run([PROGRAM, "table", out, "--pixels", "all", "--ci", "--format", "csv", "--out", HERE / "kitti-table.csv"])
    for pixels, name in [("all", "kitti-compare.csv"), ("common", "kitti-common.csv")]:
        compare = [PROGRAM, "compare", out, "stereo", "no_scaling/fused", "--metrics", "abs_rel,a1,rmse"]
        run([*compare, "--pixels", pixels, "--format", "csv", "--out", HERE / name])
        path = HERE / name
        path.write_text(path.read_text().replace(str(out), "kitti"))


def beyond():
    variables = os.environ | {"KITTI_STEREO_2015": str(kitti_folder()), "DEPTHLOOM_ONNX_ENGINE": "tract"}
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "beyond"
        run([PROGRAM, "run", "experiments/beyond-table1.yaml", "--quiet", "--no-page", "--out", out], env=variables)
        run([PROGRAM, "table", out, "--pixels", "all", "--ci", "--format", "csv", "--out", HERE / "beyond-table.csv"])
        lines = []
        for disparities in ["disparities_64", "disparities_128"]:
            names = [f"{disparities}/{name}" for name in ["no_scaling", "mixture", "mixture_learned", "learned_fusion"]]
            text = output([PROGRAM, "compare", out, *names, "--pixels", "all", "--format", "csv"])
            lines += text.replace(str(out), "beyond").splitlines()[1 if lines else 0 :]
        (HERE / "beyond-compare.csv").write_text("\n".join(lines) + "\n")
        for kind, estimates, width, file in [
            ("error-vs-distance", "stereo,mono,no_scaling,mixture", "two-columns", "beyond-distance.svg"),
            ("sparsification", "mixture,mixture_learned,learned_fusion", "one-column", "beyond-sparsification.svg"),
        ]:
            figure = [PROGRAM, "figure", out, kind, "--variant", "disparities_64", "--estimates", estimates]
            run([*figure, "--width", width, "--out", HERE.parent / "figures" / file])
        write("beyond", {"engine": "tract"})


def speed():
    kitti_folder()
    stereo = output(["bench/stereo.sh", "--threads", "1", "--modes", "sgbm", "hh", "bm"])
    fusion = output(["bench/fusion.sh"])
    found = {}
    for name in ["sgbm", "hh", "bm"]:
        theirs, ours = re.search(rf"^{name} .*OpenCV median +([\d.]+) ms.*ours median +([\d.]+) ms", stereo, re.M).groups()
        found[name] = [round(float(ours)), round(float(theirs))]
    theirs, ours = re.search(r"^1 thread\(s\): theirs ([\d.]+) .*ours ([\d.]+) ", fusion, re.M).groups()
    found["fusion"] = [round(float(ours), 1), round(float(theirs))]
    peer = re.search(r"^OpenCV ([\d]+\.[\d]+)", stereo, re.M).group(1)
    write("speed", {"peer": f"OpenCV {peer}", "ms": found})


def table1():
    with tempfile.TemporaryDirectory() as folder:
        begin = time.monotonic()
        first = [PROGRAM, "run", "experiments/table1.yaml", "--quiet", "--out"]
        run([*first, f"{folder}/one", "--fresh"])
        seconds = round(time.monotonic() - begin)
        begin = time.monotonic()
        run([*first, f"{folder}/two", "--set", "compare.fused.with.size=3"])
        values = {"seconds": seconds, "seconds_after_a_change": round(time.monotonic() - begin)}
        peak = environment(f"{folder}/one")["peak_resident_bytes"]
        write("table1", {**values, "workers": os.cpu_count(), "peak_mb": round(peak / 1e6)})


def build():
    with tempfile.TemporaryDirectory(dir=ROOT / "target") as folder:
        begin = time.monotonic()
        run(["cargo", "build", "--release", "--locked"], env=os.environ | {"CARGO_TARGET_DIR": folder})
        minutes = round((time.monotonic() - begin) / 60)
        size = sum(path.stat().st_size for path in pathlib.Path(folder).rglob("*") if path.is_file())
        write("build", {"minutes": minutes, "gigabytes": max(1, round(size / 1e9))})


if __name__ == "__main__":
    parts = {"kitti": kitti, "beyond": beyond, "speed": speed, "table1": table1, "build": build}
    if len(sys.argv) != 2 or sys.argv[1] not in parts:
        sys.exit(__doc__)
    if sys.argv[1] != "build" and not shutil.which(str(PROGRAM)):
        sys.exit(f"{PROGRAM} is absent: cargo build --release, or set DEPTHLOOM")
    parts[sys.argv[1]]()
