#!/usr/bin/env bash
# Runs what a release publishes: the program of the archive, and command and module of the wheel in a new virtual environment.
#
#   packaging/smoke.sh PYTHON FOLDER    FOLDER has one wheel and one archive of this machine
set -euo pipefail
if [ $# != 2 ]; then
    echo "usage: $0 PYTHON FOLDER" >&2
    exit 2
fi
python=$1
folder=$(cd "$2" && pwd)
experiment=$(cd "$(dirname "$0")/.." && pwd)/experiments/first-look.yaml
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# Neither another program nor the module of this checkout.
unset DEPTHLOOM PYTHONPATH
one() { if [ $# != 1 ] || ! [ -e "$1" ]; then echo "expected one file: $*" >&2; exit 1; fi; }

wheels=("$folder"/*.whl)
archives=("$folder"/*.tar.gz)
one "${wheels[@]}"
one "${archives[@]}"
tar -C "$work" -xzf "${archives[0]}"
"$python" -m venv "$work/venv"
"$work/venv/bin/python" -m pip install --quiet "${wheels[0]}"
cd "$work"
"$work"/depthloom-*/depthloom run "$experiment" --quiet --out archive
"$work/venv/bin/depthloom" run "$experiment" --quiet --out wheel --fresh
"$work/venv/bin/python" - "$experiment" <<'END'
import sys

import depthloom

for run in (depthloom.run(sys.argv[1], out="module", fresh=True), depthloom.open("archive"), depthloom.open("wheel")):
    assert len(run.frames) == 4, run.frames
    print(run.path, run.scores["abs_rel"].max())
END
cmp archive/recording.mcap wheel/recording.mcap
cmp archive/recording.mcap module/recording.mcap
echo "both run, and write the same recording"
