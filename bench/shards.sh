#!/usr/bin/env bash
# What splitting a run costs: many trivial shards as processes here, and the run that joins large ones beside `cp`.
#
#   bench/shards.sh [--shards N] [--frames N] [--parts N]
#
# Prints the time of one trivial shard (median, ms), of the step and of the last run of N shards, and of a last run over shards of full images: its MB/s, that of `cp` of the
# same files, and the line `ratio join-copy VALUE` (time of cp / time of the last run without reports; over 1, joining is faster). Needs python3.
set -euo pipefail
cd "$(dirname "$0")/.."
. bench/shared.sh
build
exec python3 bench/shards.py "$programs/depthloom" "$@"
