#!/usr/bin/env bash
# The 32 settings of experiments/sgbm-ablation-kitti.yaml, ours and as a loop over OpenCV and NumPy in Python, in turn on the same frames.
# Says where the two agree, and prints a line `ratio ablation-2t VALUE` (theirs / ours; over 1, we are faster).
#
#   bench/ablation.sh [ROUNDS]     needs ../shared (or DEPTHLOOM_SHARED), or KITTI_STEREO_2015
set -euo pipefail
cd "$(dirname "$0")/.."
rounds=${1:-3}
. bench/shared.sh
export KITTI_STEREO_2015=${KITTI_STEREO_2015:-$shared/data/kitti_stereo_2015}
if ! [ -d "$KITTI_STEREO_2015/training" ]; then
  echo "SKIPPED bench/ablation.sh: $KITTI_STEREO_2015 is absent (it holds the frames)" >&2
  exit 0
fi
peer bench-venv 'cv2, numpy' numpy 'opencv-python-headless==5.0.*'
cargo build --release --quiet
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for round in $(seq "$rounds"); do
  "$target/release/depthloom" run experiments/sgbm-ablation-kitti.yaml --quiet --fresh --overwrite --workers 2 --out "$work/ours" >/dev/null
  cp "$work/ours/environment.json" "$work/ours.$round.json"
  "$venv/bin/python" bench/ablation.py "$KITTI_STEREO_2015/training" --threads 2 >"$work/theirs.$round.json"
done
"$venv/bin/python" - "$work" "$rounds" <<'PY'
import csv, json, statistics, sys
work, rounds = sys.argv[1], int(sys.argv[2])
ours = [json.load(open(f"{work}/ours.{i}.json"))["wall_s"] for i in range(1, rounds + 1)]
theirs = [json.load(open(f"{work}/theirs.{i}.json")) for i in range(1, rounds + 1)]
means = theirs[-1]["means"]
compared, worst = 0, 0.0
for row in csv.DictReader(open(f"{work}/ours/table.csv")):
    estimate = row["estimator"]
    if row["set"] != "all":
        continue
    peer = means[f"{row['block']} {row['uniqueness']} {row['mode']} {row['holes']}"]
    for name, value in peer.items():
        if row[name] and (name != "density" or estimate == "disparity"):
            compared, worst = compared + 1, max(worst, abs(float(row[name]) / value - 1))
print(f"{compared} means compared, the worst differs by {worst:.1e}")
a, b = statistics.median(ours), statistics.median([run["total_s"] for run in theirs])
print(f"median of {rounds}: ours {a:.3f} s, theirs {b:.3f} s for 6 frames (imports and start-up left out)")
print(f"ratio ablation-2t {b / a:.2f}")
PY
