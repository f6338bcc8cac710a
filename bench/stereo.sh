#!/usr/bin/env bash
# Stereo against OpenCV on real frames: prints medians, and lines `ratio MATCHER-THREADSt VALUE` (OpenCV's time / ours);
# `census-sgm`, which OpenCV has not, is timed alone. Several threads are those of the runner: the budget and tiles of `threads/`.
#
#   bench/stereo.sh [--count 5] [--repeat 6] [--modes sgbm hh 3way hh4 bm census-sgm] [--threads 1 2] [--path best]
#
# Frames: KITTI_STEREO_2015, or data/kitti_stereo_2015 of ../shared (or DEPTHLOOM_SHARED), its folder `training`. Builds the examples
# `sgbm_raw`, `bm_raw` and `census_raw`, and installs OpenCV from PyPI into a virtual environment under target/.
set -euo pipefail
cd "$(dirname "$0")/.."

. bench/shared.sh
root="${KITTI_STEREO_2015:-$shared/data/kitti_stereo_2015}"
frames="$root/training"
if [ ! -d "$frames/image_2" ]; then
    echo "SKIPPED bench/stereo.sh: $frames is absent (set DEPTHLOOM_SHARED, or KITTI_STEREO_2015 to the folder that holds training/image_2 and image_3)" >&2
    exit 0
fi
peer bench-venv 'cv2, numpy' numpy 'opencv-python-headless==5.0.*'
build -p depthloom-kernels --example sgbm_raw --example bm_raw --example census_raw
exec "$venv/bin/python" bench/stereo.py "$programs/examples" "$frames" "$@"
