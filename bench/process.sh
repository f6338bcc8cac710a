#!/usr/bin/env bash
# What it costs that a node is a program: a call of a node `process` in Python at KITTI's size (1242x375), three maps in and one out, beside the same function called inside Python and
# beside a dataflow of two Python nodes in dora (dora-rs-cli, `dora run` on this machine) that exchange the same bytes.
#
#   bench/process.sh [--rounds N]
#
# Prints medians in milliseconds, `overhead process VALUE` (a call of a function that gives back one of its inputs) and `ratio process VALUE`: dora's round trip / that. Needs python3 and a
# package index.
set -euo pipefail
cd "$(dirname "$0")/.."
. bench/shared.sh
peer process-bench-venv 'numpy, pyarrow, dora' 'numpy==2.4.*' 'pyarrow>=17' 'dora-rs==1.1.0' 'dora-rs-cli==1.1.0'
build -p depthloom -p depthloom-nodes --example process_call
exec "$venv/bin/python" bench/process.py --ours "$programs/examples/process_call" "$@"
