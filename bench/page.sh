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
target=${CARGO_TARGET_DIR:-$PWD/target}
cargo build --release --quiet
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$target/release/depthloom" run experiments/table1.yaml --quiet --fresh --no-page --out "$work/run" --set sources.train.with.frames=0..8 --set learn.teacher.with.steps=60 \
  --set "sources.test.with.frames=0..$frames" >/dev/null
timed() { # NAME ARGUMENTS...
  local name=$1 begun ended
  shift
  begun=$(date +%s.%N)
  "$target/release/depthloom" report "$work/run" --out "$work/report" "$@" >/dev/null
  ended=$(date +%s.%N)
  echo "page $name $(python3 -c "print(f'{$ended - $begun:.1f}')")"
}
timed report-without-s --no-page
timed report-with-s
python3 bench/page.py "$chromium" "$work/report/report.html" "$rounds"
