#!/usr/bin/env bash
# A training step of `unet-lite` (8 images of 320x96, forward, backward, Adam): ours beside TensorFlow on the CPU, in turn, in one run.
#
#   bench/learning.sh [--rounds N] [--steps N]
#
# Prints medians in milliseconds and `ratio step-1t VALUE`, `ratio step-2t VALUE`: theirs / ours, with one thread and two. Needs python3
# and a package index.
set -euo pipefail
cd "$(dirname "$0")/.."
. bench/shared.sh
peer venv-tensorflow 'tensorflow, numpy' tensorflow-cpu numpy
# With the whole program's features, so that no dependency is compiled twice.
build -p depthloom -p depthloom-learning --example steps
for threads in 1 2; do
    "$venv/bin/python" bench/learning.py --ours "$programs/examples/steps" --threads "$threads" "$@"
done
