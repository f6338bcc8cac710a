"""Prints the mean scores of a run of cross-validation.yaml over all held-out frames, one parameter per line.

    python3 experiments/cross_validation.py runs/folds

A change is worth adopting if it is better with both numbers of disparities and in every fold. Only the standard library is
needed.
"""

import collections
import csv
import pathlib
import sys

METRICS = ["a1", "abs_rel", "sq_rel", "rmse", "rmse_log", "coverage", "ause"]


def main(folder):
    scores = collections.defaultdict(list)
    with open(pathlib.Path(folder) / "scores.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["estimate"] == "mixture" and row["set"] == "all":
                fold, disparities, *change = row["variant"].split("+")
                values = [float(row[metric]) for metric in METRICS]
                scores[disparities, "".join(change) or "as it is"].append((fold, values))
    mean = {key: [sum(column) / len(rows) for column in zip(*(values for _, values in rows))] for key, rows in scores.items()}
    worse = METRICS.index("abs_rel")
    for disparities in sorted({key[0] for key in scores}):
        frames = max(len(rows) for key, rows in scores.items() if key[0] == disparities)
        print(f"\n{disparities}, mean over {frames} frames; folds: those where abs_rel is lower than as it is")
        print(f"{'':28}" + "".join(f"{metric:>10}" for metric in METRICS) + "     folds")
        base = by_fold(scores.get((disparities, "as it is"), []), worse)
        changes = sorted((key[1] for key in scores if key[0] == disparities), key=lambda change: mean[disparities, change][worse])
        for change in changes:
            folds = by_fold(scores[disparities, change], worse)
            better = sum(folds[fold] < base[fold] for fold in folds if fold in base)
            numbers = "".join(f"{value:10.4f}" for value in mean[disparities, change])
            print(f"{change:28}{numbers}" + (f"{better:7} of {len(folds)}" if base else ""))


def by_fold(rows, metric):
    folds = collections.defaultdict(list)
    for fold, values in rows:
        folds[fold].append(values[metric])
    return {fold: sum(values) / len(values) for fold, values in folds.items()}


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
