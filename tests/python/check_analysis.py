"""Checks samples and the output of `depthloom analyse` against NumPy: check_analysis.py SAMPLES NPY_FOLDER QUERY.json..., each named after its `--by`."""
import json
import pathlib
import sys

import numpy as np
import polars

BOUNDS = 0.001, 80.0


def close(ours, theirs, what):
    if ours is None:
        assert np.isnan(theirs), (what, theirs)
    else:
        assert abs(ours - theirs) <= 1e-6 * abs(theirs) + 1e-12, (what, ours, theirs)


def rows_are_the_maps(samples, folder):
    """Truth and stereo, as they were exported: every scored pixel, in order."""
    compared = 0
    for frame in samples["frame"].unique(maintain_order=True):
        rows = samples.filter(polars.col("frame") == frame)
        (truth,) = folder.glob(f"**/source/depth/{frame}.npy")
        (stereo,) = folder.glob(f"**/depth/depth/{frame}.npy")
        truth, stereo = np.load(truth), np.load(stereo)
        y, x = np.nonzero((truth > np.float32(BOUNDS[0])) & (truth < np.float32(BOUNDS[1])))
        assert np.array_equal(rows["x"], x) and np.array_equal(rows["y"], y), frame
        assert np.array_equal(rows["ground_truth_m"].to_numpy(), truth[y, x]), frame
        expected = np.clip(stereo[y, x].astype(np.float64), *BOUNDS).astype(np.float32)
        ours = rows["stereo"].fill_null(float("nan")).to_numpy()
        assert np.array_equal(ours, expected, equal_nan=True), frame
        compared += len(rows)
    assert compared == len(samples) and compared > 0


def main():
    samples = polars.read_parquet(sys.argv[1])
    folder = pathlib.Path(sys.argv[2])
    rows_are_the_maps(samples, folder)
    told = 0
    for path in map(pathlib.Path, sys.argv[3:]):
        by = path.stem
        table = json.loads(path.read_text())["rows"]
        truth = samples["ground_truth_m"].to_numpy().astype(np.float64)
        columns = {column: samples[column].to_numpy().astype(np.float64) for column in samples.columns if samples[column].dtype == polars.Float32}
        shared = ~np.isnan(np.stack([of for column, of in columns.items() if column != "ground_truth_m" and "weight" not in column])).any(axis=0)
        unit = "_px" if by == "row" else "" if by == "weight" else "_m"
        seen = {}
        for row in table:
            label = row["estimate"] if row["variant"] is None else f"{row['variant']}/{row['estimate']}"
            if by == "frame":
                inside = (samples["position"] == row["position"]).to_numpy()
                assert set(samples["frame"].to_numpy()[inside]) == {row["frame"]}
            else:
                if by == "weight":
                    of = columns["weight.weight"]
                else:
                    of = samples["y"].to_numpy() if by == "row" else columns[label] if by == "estimate" else truth
                edges = row["bin_from" + unit], row["bin_to" + unit]
                last = by != "distance" and edges[1] == max(
                    other["bin_to" + unit] for other in table if (other["variant"], other["estimate"]) == (row["variant"], row["estimate"])
                )
                inside = (of >= edges[0]) & ((of <= edges[1]) if last else (of < edges[1]))
            if row["set"] == "common":
                inside &= shared
            assert row["pixels"] == inside.sum(), (path, row)
            signed = (columns[label] - truth)[inside]
            signed = signed[~np.isnan(signed)]
            error = np.abs(signed)
            assert row["count"] == len(error), (path, row)
            seen[label, row["set"]] = seen.get((label, row["set"]), 0) + len(error)
            for percentile in (0, 5, 50, 97.5):
                close(row[f"error_p{percentile}_m"], np.percentile(error, percentile) if len(error) else np.nan, (path, percentile, row))
            if len(error):
                close(row["error_mean_m"], error.mean(), path)
                assert abs(row["bias_m"] - signed.mean()) <= 1e-6 * error.mean(), path
                close(row["rmse_m"], np.sqrt((signed**2).mean()), path)
                close(row["outlier_share"], (error > 0.25 * truth[inside][~np.isnan(columns[label][inside])]).mean(), path)
            told += 1
        for (label, of), count in seen.items():
            expected = ~np.isnan(columns[label]) & (shared if of == "common" else True)
            if by == "weight":
                expected &= ~np.isnan(columns["weight.weight"])
            assert count == expected.sum(), (path, label, of, count, expected.sum())
    print(json.dumps({"samples": len(samples), "rows": told}))


main()
