#!/usr/bin/env bash
# The 32 settings of experiments/sgbm-ablation-kitti.yaml, ours and as a loop over OpenCV and NumPy in Python, in turn on the same frames.
# Says where the two agree, and prints a line `ratio ablation-2t VALUE` (theirs / ours; over 1, we are faster).
#
#   bench/ablation.sh [ROUNDS] [FRAMES]     needs ../shared (or DEPTHLOOM_SHARED), or KITTI_STEREO_2015; FRAMES: of the frames from 150, 6 unless it is given
#
# Ours is the whole process, from its start to its end: tables, figures and the HTML page are in it. Theirs is without Python's start and imports.
set -euo pipefail
cd "$(dirname "$0")/.."
rounds=${1:-3} frames=${2:-6}
. bench/shared.sh
export KITTI_STEREO_2015=${KITTI_STEREO_2015:-$shared/data/kitti_stereo_2015}
if ! [ -d "$KITTI_STEREO_2015/training" ]; then
  echo "SKIPPED bench/ablation.sh: $KITTI_STEREO_2015 is absent (it holds the frames)" >&2
  exit 0
fi
peer bench-venv 'cv2, numpy' numpy 'opencv-python-headless==5.0.*'
build
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for round in $(seq "$rounds"); do
  timed "$programs/depthloom" run experiments/sgbm-ablation-kitti.yaml --set "sources.frames.with.frames=150..$((150 + frames))" \
    --quiet --fresh --overwrite --workers 2 --out "$work/ours" >/dev/null
  echo "$wall_s" >"$work/ours.$round"
  "$venv/bin/python" bench/ablation.py "$KITTI_STEREO_2015/training" --threads 2 --count "$frames" >"$work/theirs.$round.json"
done
"$venv/bin/python" - "$work" "$rounds" "$frames" <<'PY'
import csv, json, statistics, sys
work, rounds, frames = sys.argv[1], int(sys.argv[2]), sys.argv[3]
ours = [float(open(f"{work}/ours.{i}").read()) for i in range(1, rounds + 1)]
theirs = [json.load(open(f"{work}/theirs.{i}.json")) for i in range(1, rounds + 1)]
means = theirs[-1]["means"]
compared, worst = 0, 0.0
for row in csv.DictReader(open(f"{work}/ours/table.csv")):
    estimate = row["estimate"]
    if row["set"] != "all":
        continue
    peer = means[f"{row['block']} {row['uniqueness']} {row['mode']} {row['holes']}"]
    for name, value in peer.items():
        if row[name] and (name != "density" or estimate == "disparity"):
            compared, worst = compared + 1, max(worst, abs(float(row[name]) / value - 1))
print(f"{compared} means compared, the worst differs by {worst:.1e}")
a, b = statistics.median(ours), statistics.median([run["total_s"] for run in theirs])
print(f"median of {rounds}: ours {a:.3f} s, theirs {b:.3f} s for {frames} frames (ours is the whole process, theirs is without start and imports)")
print(f"ratio ablation-2t {b / a:.2f}")
PY
