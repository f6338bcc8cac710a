#!/usr/bin/env bash
# Reading against OpenCV's imread: all frames of KITTI stereo 2015 (two colour images and the truth, PNG), on as many threads. Prints medians, frames a
# second, and lines `ratio read-THREADSt VALUE` (OpenCV's time / ours; over 1, we are faster); the last, `ratio read VALUE`, is that of most threads.
# Ours also hashes the files for the frame's key, and makes depth of the disparities.
#
#   bench/reading.sh [--rounds 7] [--threads 1 2]
#
# Frames: KITTI_STEREO_2015, or data/kitti_stereo_2015 of ../shared (or DEPTHLOOM_SHARED). Builds the example `read_frames` of nodes/, and installs OpenCV from
# PyPI into a virtual environment under target/.
set -euo pipefail
cd "$(dirname "$0")/.."

. bench/shared.sh
root="${KITTI_STEREO_2015:-$shared/data/kitti_stereo_2015}"
if [ ! -d "$root/training/image_2" ]; then
    echo "SKIPPED bench/reading.sh: $root is absent (set DEPTHLOOM_SHARED, or KITTI_STEREO_2015 to the folder that holds training/image_2 and image_3)" >&2
    exit 0
fi
peer bench-venv 'cv2, numpy' numpy 'opencv-python-headless==5.0.*'
# With the binary: alone it would resolve other features, and its dependencies compile again.
build -p depthloom -p depthloom-nodes --example read_frames
exec "$venv/bin/python" bench/reading.py "$programs/examples/read_frames" "$root" "$@"
