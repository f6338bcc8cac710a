#!/usr/bin/env bash
# The whole golden experiment, ours and the peer's (OpenCV, NumPy, MCAP and pandas in Python), in turn on the same frames.
# Prints both sides' phases, the CPU time and the share of the page, and lines `ratio NAME VALUE` (theirs / ours; over 1, we are faster).
#
#   bench/pipeline.sh [ROUNDS] [--model] [--forty] [--one]     needs ../shared (or DEPTHLOOM_SHARED); --model: a network as mono estimate;
#                                                              --forty: frames 1..=40 instead of 150..=155; --one: frame 150 alone
#
# Ours is the whole process, from its start to its end: tables, figures and the HTML page are in it. Theirs is without Python's start and imports.
set -euo pipefail
cd "$(dirname "$0")/.."
rounds=5 model="" first=150 last=155
for argument in "$@"; do
  case "$argument" in
    --model) model=1 ;;
    --forty) first=1 last=40 ;;
    --one) last=150 ;;
    *) rounds=$argument ;;
  esac
done
. bench/shared.sh
if ! [ -d "$shared/oracle" ]; then
  echo "SKIPPED bench/pipeline.sh: $shared is absent (it holds the frames and the peer)" >&2
  exit 0
fi
peer bench-venv 'cv2, pandas, mcap_protobuf, onnxruntime' \
  numpy 'opencv-python-headless==5.0.*' pandas mcap mcap-protobuf-support foxglove-schemas-protobuf onnxruntime
build
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export KITTI_STEREO_2015=$shared/data/kitti_stereo_2015
experiment=tests/experiments/golden-ground-plane.yaml
peer_model=()
if [ -n "$model" ]; then
  experiment=tests/experiments/golden-onnx.yaml
  export MONO_MODEL=$shared/models/ssl_unet.onnx
  ORT_DYLIB_PATH=$(ls "$venv"/lib/python3*/site-packages/onnxruntime/capi/libonnxruntime.so.* | head -1)
  export ORT_DYLIB_PATH
  peer_model=(--model "$shared/models/ssl_unet.onnx")
fi
for round in $(seq "$rounds"); do
  # Four variants, as the peer runs them; the golden experiment has a fifth.
  timed "$programs/depthloom" run "$experiment" --set "sources.test.with.frames=$first..=$last" --quiet --fresh --overwrite --workers 2 --out "$work/ours" >/dev/null
  echo "$wall_s $cpu_s" >"$work/ours.$round"
  timed "$programs/depthloom" run "$experiment" --set "sources.test.with.frames=$first..=$last" --quiet --fresh --overwrite --no-page --workers 2 --out "$work/ours" >/dev/null
  echo "$wall_s $cpu_s" >"$work/without.$round"
  mkdir -p "$work/theirs"
  "$venv/bin/python" "$shared/oracle/peer_pipeline.py" "$KITTI_STEREO_2015/training" "$work/theirs" \
    --first "$first" --last "$last" --threads 2 "${peer_model[@]}" >"$work/theirs.$round.json"
done
echo "ours, the last round, by phase:"
"$programs/depthloom" runs timings "$work/ours"
echo "theirs, the last round:"
cat "$work/theirs.$rounds.json"
"$venv/bin/python" - "$work" "$rounds" "$((last - first + 1))" <<'PY'
import json, statistics, sys
work, rounds, frames = sys.argv[1], int(sys.argv[2]), sys.argv[3]
times = lambda name: list(zip(*([float(word) for word in open(f"{work}/{name}.{i}").read().split()] for i in range(1, rounds + 1))))
(ours, ours_cpu), (without, without_cpu) = times("ours"), times("without")
theirs = [json.load(open(f"{work}/theirs.{i}.json"))["total_s"] for i in range(1, rounds + 1)]
a, b = statistics.median(ours), statistics.median(theirs)
print(f"median of {rounds}: ours {a:.3f} s, theirs {b:.3f} s for {frames} frames (5 variants ours, 4 theirs; ours is the whole process, theirs is without start and imports)")
c, cpu, without_cpu = statistics.median(without), statistics.median(ours_cpu), statistics.median(without_cpu)
print(f"without page {c:.3f} s; CPU time {cpu:.2f} s, {without_cpu / int(frames) * 1000:.0f} core-ms a frame without page; page {100 * (1 - without_cpu / cpu):.0f} % of CPU time")
print(f"ratio pipeline-2t {b / a:.2f}")
print(f"ratio pipeline-without-page-2t {b / c:.2f}")
PY
