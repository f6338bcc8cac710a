#!/usr/bin/env bash
# Error against distance of many samples, against pandas and polars in Python: five percentiles, mean, bias, RMSE and count of nine estimates in sixty bins. All read
# the same Parquet file, on as many threads as the machine has, in turn in one run. Prints medians, peak memory, and lines `ratio analysis-PEER VALUE`
# (their time / ours; over 1, we are faster).
#
#   bench/analysis.sh [--samples 100000000] [--rounds 3]
#
# The file (50 bytes a sample, about 4 GB of a hundred million) is made under target/ and kept. Peers take one estimate at a time, for all nine at once do not fit in
# the memory of a small machine. Installs pandas, polars and pyarrow from PyPI into a virtual environment under target/.
set -euo pipefail
cd "$(dirname "$0")/.."
. bench/shared.sh

peer venv-analysis 'numpy, pandas, polars, pyarrow' numpy pandas polars pyarrow
build
exec "$venv/bin/python" bench/analysis.py "$programs/depthloom" "$target/analysis-samples" "$@"
