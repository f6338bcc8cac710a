#!/usr/bin/env bash
# report.html of 200 frames and 4 variants (experiments/table1.yaml at KITTI's size, a network of few steps): how long it takes to make, how large it is, how
# long a browser takes to open it, and how many frames a second its slider shows. Prints lines `page NAME VALUE`.
#
#   bench/page.sh [FRAMES] [ROUNDS]     needs Chromium ($CHROMIUM, or `chromium` in $PATH), Python, and 20 MB of disk a frame
set -euo pipefail
cd "$(dirname "$0")/.."
frames=${1:-200} rounds=${2:-3}
chromium=${CHROMIUM:-$(command -v chromium || command -v google-chrome || true)}
if [ -z "$chromium" ]; then
  echo "SKIPPED bench/page.sh: there is no Chromium here" >&2
  exit 0
fi
. bench/shared.sh
build
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$programs/depthloom" run experiments/table1.yaml --quiet --fresh --no-page --out "$work/run" --set sources.train.with.frames=0..8 --set learn.train.with.steps=60 \
  --set "sources.test.with.frames=0..$frames" >/dev/null
report() { # NAME ARGUMENTS...
  local name=$1
  shift
  timed "$programs/depthloom" report "$work/run" --out "$work/report" "$@" >/dev/null
  echo "page $name $wall_s"
}
report report-without-s --no-page
report report-with-s
python3 bench/page.py "$chromium" "$work/report/report.html" "$rounds"
