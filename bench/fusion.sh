#!/usr/bin/env bash
# The fusion chain (edges, confidence, depth, scale, fuse, median 5x5; variants full, no_weighting, no_scaling and
# average_scaling) of real frames: ours beside the oracle's on OpenCV and NumPy, in turn, in one run.
#
#   bench/fusion.sh [--frames 150,151] [--rounds N]
#
# Prints medians in milliseconds and `ratio fusion-1t VALUE`, `ratio fusion-2t VALUE`: theirs / ours, with one thread and
# with two threads for one frame (ours: scalings and variants at the same time, as the runner does it). Needs python3 and a package index, and ../shared (or DEPTHLOOM_SHARED).
set -euo pipefail
cd "$(dirname "$0")/.."
. bench/shared.sh
if [ ! -d "$shared/oracle" ]; then
    echo "SKIPPED bench/fusion.sh: $shared is absent" >&2
    exit 0
fi
peer bench-venv 'cv2, numpy' numpy 'opencv-python-headless==5.0.*'
build -p depthloom-kernels --example fusion_chain
exec "$venv/bin/python" bench/fusion.py --shared "$shared" --ours "$programs/examples/fusion_chain" "$@"
