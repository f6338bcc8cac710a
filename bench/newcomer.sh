#!/usr/bin/env bash
# A newcomer's path, timed, in two parts:
# - with the wheel: from no virtual environment to the first table, as the README says, without Rust on the PATH. The wheel is made before, untimed.
# - from a built clone to "which of 12 settings of SGBM is best, where, and is it significant?" in three commands, on a street that the program renders,
#   and on KITTI's frames where they are. docs/tutorial/own-ablation.md goes the same way, with a word on every step.
# Prints the answers, and a line `newcomer NAME PHASE SECONDS` for every phase. `newcomer wheel download` depends on the network and is not part of
# `newcomer wheel first-table`, the sum of the other phases: at most one minute is the aim.
#
#   bench/newcomer.sh [FRAMES]     FRAMES: 16 of the street and 20 of KITTI unless it is given; KITTI: ../shared (or DEPTHLOOM_SHARED), or KITTI_STEREO_2015
set -euo pipefail
cd "$(dirname "$0")/.."
. bench/shared.sh
export KITTI_STEREO_2015=${KITTI_STEREO_2015:-$shared/data/kitti_stereo_2015}
build
PATH=$programs:$PATH
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# phase NAME PHASE COMMAND...: says the command, runs it, and says how long it took.
phase() {
    local name=$1 phase=$2 begin
    shift 2
    printf '\n$ %s\n' "$*"
    begin=$(date +%s.%N)
    "$@"
    times+="newcomer $name $phase $(date +%s.%N | awk -v begin="$begin" '{ printf "%.1f", $1 - begin }')"$'\n'
}

# first_table WHEEL: a new environment, the wheel in it, and the README's first commands.
first_table() (
    wheel=$1 times= folder=$work/first
    python=$(python3 -c 'import sys; print(sys.executable)')
    # Neither cargo nor the program of this checkout, nor another one.
    unset DEPTHLOOM PYTHONPATH
    PATH=$folder/venv/bin:/usr/bin:/bin
    mkdir "$folder"
    cd "$folder"
    printf '\n== wheel\n'
    phase wheel environment "$python" -m venv venv
    phase wheel download pip download --quiet --dest packages "$wheel"
    phase wheel install pip install --quiet --no-index --find-links packages "$wheel"
    phase wheel new depthloom new first.yaml
    phase wheel run depthloom run first.yaml --quiet --fresh
    phase wheel table depthloom table @latest --estimates 'base/*' --columns abs_rel,rmse,a1,density
    phase wheel import python -c 'import depthloom; print(depthloom.open("@latest").scores.shape)'
    awk '{ print } $3 != "download" && $3 != "import" { sum += $4 } END { printf "newcomer wheel first-table %.1f\n", sum }' \
        <<<"${times%$'\n'}" >"$work/first-table"
)

# path NAME EXPERIMENT FRAMES: 3 x 2 x 2 settings of block, uniqueness and mode, holes kept.
path() {
    local name=$1 experiment=$2 frames=$3 run=$work/runs/$1
    printf '\n== %s\n' "$name"
    phase "$name" run depthloom run "$experiment" --matrix 'block=[3,5,9]' --variant '*+holes=kept' --set "sources.frames.with.frames=$frames" \
        --fresh --quiet --out "$run"
    phase "$name" where depthloom table "$run" --best-per-zone abs_rel
    phase "$name" significant depthloom compare "$run" --baseline best --metrics abs_rel
}

times=
peer venv-maturin maturin 'maturin>=1.9,<2'
first_table "$("$venv/bin/python" packaging/wheel.py "$programs/depthloom" "$work/wheel")"
path street experiments/sgbm-ablation.yaml "0..${1:-16}"
if [ -d "$KITTI_STEREO_2015/training/disp_noc_0" ]; then
    # Twenty frames that have a truth: with six, eleven comparisons are never sure.
    path kitti experiments/sgbm-ablation-kitti.yaml "1..=${1:-20} available"
else
    echo "SKIPPED bench/newcomer.sh, kitti: $KITTI_STEREO_2015 is absent (it holds the frames)" >&2
fi
printf '\n%s\n%s' "$(cat "$work/first-table")" "$times"
