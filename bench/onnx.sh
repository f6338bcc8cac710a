#!/usr/bin/env bash
# A network by our node `onnx` beside the same network in Python's onnxruntime, on the same images and the same library, in turn, in one run. Both begin with an
# 8-bit RGB image of the network's size and end with its map.
#
#   bench/onnx.sh [--model NET.onnx] [--count 4] [--rounds 40] [--threads 1 2]
#
# Prints medians in milliseconds, and for each number of threads `ratio onnx-THREADSt VALUE`: theirs / ours. The model is one of a fixed size;
# by default ../shared/models/ssl_unet.onnx (or of DEPTHLOOM_SHARED). Needs python3 and a package index.
set -euo pipefail
model=""
if [ "${1:-}" = "--model" ]; then
    case "$2" in
        /*) model="$2" ;;
        *) model="$PWD/$2" ;;
    esac
    shift 2
fi
cd "$(dirname "$0")/.."
. bench/shared.sh
model="${model:-$shared/models/ssl_unet.onnx}"
if [ ! -f "$model" ]; then
    echo "SKIPPED bench/onnx.sh: there is no model $model" >&2
    exit 0
fi
peer venv-onnx 'onnxruntime, numpy' 'onnxruntime==1.31.*' numpy
# With the binary: alone it would resolve other features, and its dependencies compile again.
build -p depthloom -p depthloom-nodes --example onnx_call
exec "$venv/bin/python" bench/onnx.py "$programs/examples/onnx_call" "$model" "$@"
