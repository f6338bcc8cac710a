#!/usr/bin/env python3
"""Holds what `depthloom compare --by distance --json` says against NumPy and SciPy, from exported maps.

    check_distance.py COMPARED.json TRUTH_FOLDER BASELINE_FOLDER OTHER_FOLDER, each with FRAME.npy
"""
import json
import math
import pathlib
import sys

import numpy as np
from scipy import stats

from resampling import Ours, holm, wilcoxon

BOUNDS = 0.001, 80.0


def near(found, expected, what):
    if found is None and (expected is None or math.isnan(expected)):
        return
    assert math.isclose(found, expected, rel_tol=1e-6, abs_tol=1e-9), f"{what}: {found} is not {expected}"


def frames_of(folders):
    """By frame: truth, and the absolute errors of both, where both are valid."""
    frames = []
    for path in sorted(folders[0].glob("*.npy")):
        truth, one, two = (np.load(folder / path.name).astype(np.float32) for folder in folders)
        scored = (truth > np.float32(BOUNDS[0])) & (truth < np.float32(BOUNDS[1])) & np.isfinite(one) & np.isfinite(two)
        errors = [np.abs(np.clip(of[scored].astype(np.float64), *BOUNDS).astype(np.float32).astype(np.float64) - truth[scored]) for of in (one, two)]
        frames.append((truth[scored].astype(np.float64), *errors))
    return frames


def within(truth, row, rows):
    """The last bin has its upper edge, too, as NumPy's histogram has it."""
    is_last = row["bin_to_m"] == max(of["bin_to_m"] for of in rows)
    return (truth >= row["bin_from_m"]) & ((truth <= row["bin_to_m"]) if is_last else (truth < row["bin_to_m"]))


def statistic(name, errors):
    # Medians are of errors in single precision.
    return errors.mean() if name == "mean" else np.median(errors.astype(np.float32).astype(np.float64))


def handover(middles, differences, counts, near_is_baseline):
    """The crossing at which one change costs least; NaN where one estimate alone is as good."""
    total = np.cumsum(differences * counts)
    if len(total) < 2:
        return math.nan
    cost = (total[-1] - total[:-1]) if near_is_baseline else total[:-1]
    at = int(np.argmin(cost))
    if not cost[at] < min(total[-1], 0.0):
        return math.nan
    one, two = differences[at], differences[at + 1]
    if one == two or not 0 <= one / (one - two) <= 1:
        return math.nan
    return middles[at] + one / (one - two) * (middles[at + 1] - middles[at])


def main():
    compared = json.loads(pathlib.Path(sys.argv[1]).read_text())
    frames = frames_of([pathlib.Path(folder) for folder in sys.argv[2:5]])
    method = compared["method"]
    rows = compared["rows"]
    for name in ("mean", "median"):
        of_name = [row for row in rows if row["statistic"] == name]
        tests = []
        for row in of_name:
            what = f'{name} from {row["bin_from_m"]} m'
            inside = [within(truth, row, of_name) for truth, *_ in frames]
            both = [[of[at] for of, at in zip([frame[side] for frame in frames], inside) if at.any()] for side in (1, 2)]
            assert row["frames"] == len(both[0]) and row["pixels"] == sum(map(len, both[0])), what
            values = [statistic(name, np.concatenate(of)) for of in both]
            near(row["baseline_m"], values[0], what)
            near(row["value_m"], values[1], what)
            near(row["difference_m"], values[1] - values[0], what)
            differences = np.array([statistic(name, two) - statistic(name, one) for one, two in zip(*both)])
            counts = [int((differences < 0).sum()), int((differences == 0).sum()), int((differences > 0).sum())]
            assert counts == [row["wins"], row["ties"], row["losses"]], what
            tests.append(wilcoxon(differences) if differences.any() else 1.0)
            near(row["p"], tests[-1], f"p, {what}")
            if len(both[0]) > 1:
                def difference(places, both=both):
                    return np.diff([statistic(name, np.concatenate([of[int(at)] for at in places])) for of in both])[0]

                with np.errstate(all="ignore"):
                    found = stats.bootstrap(
                        (np.arange(len(both[0])),), difference, vectorized=False, n_resamples=method["resamples"], method=method["interval"],
                        confidence_level=method["confidence"], rng=Ours(method["seed"]), batch=method["resamples"]).confidence_interval
                if math.isfinite(found.low):
                    near(row["difference_low_m"], float(found.low), f"lower end, {what}")
                    near(row["difference_high_m"], float(found.high), f"upper end, {what}")
        for row, p in zip(of_name, holm(tests)):
            near(row["p_holm"], p, "p_holm")
        # The handover, on frames drawn as SciPy draws them.
        (told,) = [of for of in compared["handovers"] if of["statistic"] == name]

        def curve(places):
            points = []
            for row in of_name:
                errors = [np.concatenate([frames[at][side][within(frames[at][0], row, of_name)] for at in places]) for side in (1, 2)]
                if len(errors[0]) >= method["thin_pixels"]:
                    points.append((0.5 * (row["bin_from_m"] + row["bin_to_m"]), statistic(name, errors[1]) - statistic(name, errors[0]), len(errors[0])))
            return [np.array(of) for of in zip(*points)] if points else [np.array([])] * 3

        everything = range(len(frames))
        if told["near"] is None:
            assert math.isnan(handover(*curve(everything), True)) and math.isnan(handover(*curve(everything), False))
            continue
        near_is_baseline = told["near"] == told["baseline"]
        near(told["distance_m"], handover(*curve(everything), near_is_baseline), f"handover by the {name}")
        drawn = Ours(method["seed"]).integers(0, len(frames), size=(method["resamples"], len(frames)))
        distances = np.array([handover(*curve(places), near_is_baseline) for places in drawn])
        some = distances[np.isfinite(distances)]
        near(told["share"], len(some) / len(distances), "share")
        alpha = 50 * (1 - method["confidence"])
        if len(some) > 1:
            low, high = np.percentile(some, [alpha, 100 - alpha])
            near(told["distance_low_m"], low, "lower end of the handover")
            near(told["distance_high_m"], high, "upper end of the handover")
    print(len(rows))


main()
