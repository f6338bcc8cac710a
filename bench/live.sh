#!/usr/bin/env bash
# The on-board experiment at 640x480, live, with everything recorded, beside a Python loop that does the same work with OpenCV, ONNX Runtime and NumPy. Both play the same
# frames from memory; where one is late, the newest frame wins.
#
#   bench/live.sh [--seconds N] [--steps N] [--frames N]
#
# Prints rate, drops and latency of both at 30 and at 25 frames per second, the highest rate of both, ours at twice its highest rate, and lines `ratio NAME VALUE`: live-rate
# (our highest rate / theirs), live-p99 (their 99th percentile / ours, at 25 frames per second). Needs python3 and a package index.
set -euo pipefail
cd "$(dirname "$0")/.."
. bench/shared.sh
peer bench-venv 'cv2, mcap_protobuf, onnxruntime' \
  numpy 'opencv-python-headless==5.0.*' pandas mcap mcap-protobuf-support foxglove-schemas-protobuf onnxruntime
build
ORT_DYLIB_PATH=$(ls "$venv"/lib/python3*/site-packages/onnxruntime/capi/libonnxruntime.so.* | head -1)
export ORT_DYLIB_PATH
exec "$venv/bin/python" bench/live.py "$programs/depthloom" experiments/onboard.yaml "$@"
