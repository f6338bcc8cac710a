#!/usr/bin/env python3
"""Compares the output of `depthloom compare --json` with SciPy's, from the scores.csv of the runs.

    check_compare.py COMPARED.json RUN=scores.csv [RUN=scores.csv]
"""
import csv
import json
import math
import sys

import numpy as np

from resampling import holm, interval, wilcoxon

SHARES = {"a1", "a2", "a3"}
SQUARES = {"rmse", "rmse_log", "irmse"}


def rows_of(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def frames_of(scores, row, prefix):
    """Frame to score and pixels, of the estimate that a row is of, or of its baseline."""
    names = ("stage", "variant", "estimate")
    wanted = [row[prefix + name] or "" for name in names] + [row["set"], row["zone"] or ""]
    found = {}
    for of in scores[row[prefix + "run"]]:
        if [of[name] for name in names] + [of["set"], of.get("zone", "")] == wanted and of[row["score"]] != "":
            found[of["frame"]] = float(of[row["score"]]), float(of["pixels"])
    return found


def near(found, expected, what):
    if found is None and (expected is None or math.isnan(expected)):
        return
    assert math.isclose(found, expected, rel_tol=1e-6, abs_tol=1e-12), f"{what}: {found} is not {expected}"


def blocks(terms, size):
    """The sums of consecutive frames."""
    starts = np.arange(0, len(terms[0]), size)
    return [np.add.reduceat(np.asarray(term, dtype=float), starts) for term in terms]


def value(terms, form):
    mean = terms[1] / terms[0]
    return np.sqrt(mean) if form == "root mean" else mean


def main():
    with open(sys.argv[1]) as file:
        compared = json.load(file)
    scores = {name: rows_of(path) for name, path in (of.split("=", 1) for of in sys.argv[2:])}
    method = compared["method"]
    settings = {name: method[name] for name in ("confidence", "resamples", "seed")}
    tests = []
    for row in compared["rows"]:
        one, two = frames_of(scores, row, "baseline_"), frames_of(scores, row, "")
        both = [frame for frame in one if frame in two]
        assert len(both) == row["frames"] > 0, row
        values = [np.array([of[frame][0] for frame in both]) for of in (one, two)]
        pixels = [np.array([of[frame][1] for frame in both]) for of in (one, two)]
        form = "mean"
        if row["mean"] == "frames":
            terms = values
            means = [value.mean() for value in values]
        elif row["score"] in SQUARES:
            form = "root mean"
            terms = [[n, n * x * x, 0 * n] for n, x in zip(pixels, values)]
            means = [math.sqrt((n * x * x).sum() / n.sum()) for n, x in zip(pixels, values)]
        else:
            terms = [[n, n * x, 0 * n] for n, x in zip(pixels, values)]
            means = [(n * x).sum() / n.sum() for n, x in zip(pixels, values)]
        what = f'{row["score"]} of {row["variant"]}/{row["estimate"]}'
        near(row["baseline"], means[0], what)
        near(row["value"], means[1], what)
        near(row["difference"], means[1] - means[0], what)
        if method["unit"] != "frames":
            size = int(method["unit"].split()[2])
            if row["mean"] == "frames":
                terms = [[np.ones_like(x), x, 0 * x] for x in values]
            terms = [blocks(of, size) for of in terms]
            values = [value(of, form) for of in terms]
        low, high = interval(*terms, form=form, method=method["interval"], **settings)
        near(row["difference_low"], low, f"lower end, {what}")
        near(row["difference_high"], high, f"upper end, {what}")
        differences = values[1] - values[0]
        better = differences if row["score"] in SHARES else -differences
        counts = [int((better > 0).sum()), int((better == 0).sum()), int((better < 0).sum())]
        assert counts == [row["wins"], row["ties"], row["losses"]], what
        p = wilcoxon(differences) if differences.any() else 1.0
        near(row["p"], p, f"p, {what}")
        # What is the same estimate on both sides is not tested.
        tests += [p] if row["p_holm"] is not None else []
    tested = [row for row in compared["rows"] if row["p_holm"] is not None]
    for row, p in zip(tested, holm(tests)):
        near(row["p_holm"], p, "p_holm")
    assert method["tests"] == len(tests)
    print(len(tests))


main()
