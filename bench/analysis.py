"""Times percentiles of errors by distance: ours, pandas' and polars' on the same file of samples. Called by analysis.sh."""
import argparse
import json
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

ESTIMATES = [f"v{variant}/{name}" for variant in range(4) for name in ("mono", "fused")] + ["stereo"]
BINS = 60
PERCENTILES = [5, 25, 50, 75, 95]
A_FRAME = 250_000


def make(path, samples):
    """A file as `depthloom analyse --samples-only` writes it: a row group a frame; distances as on a street, errors that grow with them."""
    import pyarrow
    from pyarrow import parquet

    described = {
        "format": 2,
        "run": "",
        "experiment": "benchmark",
        "recording": "",
        "estimates": [
            {
                "column": label,
                "label": label,
                "stage": "compare",
                "variant": label.split("/")[0] if "/" in label else None,
                "estimate": label.split("/")[-1],
                "scoring": "preset martins2018",
                "factors": [],
            }
            for label in ESTIMATES
        ],
        "weights": [],
    }
    columns = [("stage", pyarrow.string()), ("scoring", pyarrow.string()), ("position", pyarrow.uint32()), ("frame", pyarrow.string())]
    columns += [("x", pyarrow.uint32()), ("y", pyarrow.uint32()), ("ground_truth_m", pyarrow.float32())]
    columns += [(label, pyarrow.float32()) for label in ESTIMATES]
    schema = pyarrow.schema(columns, {"depthloom.samples": json.dumps(described)})
    random = np.random.default_rng(1)
    partial = path.with_suffix(".partial")
    with parquet.ParquetWriter(partial, schema, compression="zstd", compression_level=1) as writer:
        for frame in range((samples + A_FRAME - 1) // A_FRAME):
            rows = min(A_FRAME, samples - frame * A_FRAME)
            truth = (60 * random.random(rows, np.float32) ** 2).clip(0.01, 59.99)
            at = random.integers(0, 1242 * 375, rows)
            table = [["compare"] * rows, ["preset martins2018"] * rows, np.full(rows, frame, np.uint32), [f"{frame:06d}_10"] * rows]
            table += [(at % 1242).astype(np.uint32), (at // 1242).astype(np.uint32), truth]
            for place in range(len(ESTIMATES)):
                estimate = truth * (1 + (0.05 + 0.01 * place) * random.standard_normal(rows, np.float32))
                # A tenth of the pixels has no answer.
                table.append(pyarrow.array(estimate.clip(0.001, 80), mask=random.random(rows, np.float32) < 0.1))
            writer.write_table(pyarrow.table(dict(zip(schema.names, table)), schema=schema), row_group_size=A_FRAME)
    partial.rename(path)


def pandas_(path):
    import pandas

    found = {}
    for label in ESTIMATES:
        table = pandas.read_parquet(path, columns=["ground_truth_m", label])
        error = (table[label] - table["ground_truth_m"]).dropna()
        groups = pandas.DataFrame({"bin": np.floor(table["ground_truth_m"][error.index]), "signed": error, "error": error.abs()}).groupby("bin")
        found[label] = groups["error"].quantile([p / 100 for p in PERCENTILES]).unstack().to_numpy()
        groups["error"].agg(["count", "mean"]), groups["signed"].agg(["mean", lambda of: (of**2).mean() ** 0.5])
    return found


def polars_(path):
    import polars

    found = {}
    for label in ESTIMATES:
        signed = polars.col(label).cast(polars.Float64) - polars.col("ground_truth_m").cast(polars.Float64)
        error = signed.abs().cast(polars.Float32)
        query = (
            polars.scan_parquet(path)
            .filter(polars.col(label).is_not_null())
            .group_by(polars.col("ground_truth_m").floor().alias("bin"))
            .agg(
                *[error.quantile(p / 100, "linear").alias(f"p{p}") for p in PERCENTILES],
                error.count().alias("count"), error.mean().alias("mean"), signed.mean().alias("bias"), (signed**2).mean().sqrt().alias("rmse"),
            )
        )
        table = query.collect().sort("bin")
        found[label] = table.select([f"p{p}" for p in PERCENTILES]).to_numpy()
    return found


def ours(binary, path):
    import polars

    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "bins.parquet"
        subprocess.run([binary, "analyse", path, "--format", "parquet", "--out", out], check=True)
        table = polars.read_parquet(out)
    found = {}
    for label in ESTIMATES:
        variant, _, estimate = label.rpartition("/")
        of = table.filter((polars.col("estimate") == estimate) & (polars.col("variant").fill_null("") == variant)).sort("bin_from_m")
        found[label] = of.select([f"error_p{p}_m" for p in PERCENTILES]).to_numpy()
    return found


PEERS = {"ours": ours, "pandas": pandas_, "polars": polars_}


def one(who, binary, path):
    """In a process of its own, for its peak memory."""
    start = time.perf_counter()
    found = ours(binary, path) if who == "ours" else PEERS[who](path)
    seconds = time.perf_counter() - start
    whose = resource.RUSAGE_CHILDREN if who == "ours" else resource.RUSAGE_SELF
    print(json.dumps({
        "seconds": seconds,
        "peak_gib": resource.getrusage(whose).ru_maxrss / 2**20,
        "found": {label: of.tolist() for label, of in found.items()},
    }))


def main():
    if sys.argv[1] == "--one":
        return one(*sys.argv[2:])
    parser = argparse.ArgumentParser()
    parser.add_argument("binary")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--samples", type=int, default=100_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    path = args.folder / f"{args.samples}.parquet"
    if not path.exists():
        make(path, args.samples)
    print(f"{args.samples} samples, {len(ESTIMATES)} estimates, {BINS} bins, {len(PERCENTILES)} percentiles, {path.stat().st_size / 1e9:.1f} GB", flush=True)
    seconds, peaks, first = {who: [] for who in PEERS}, {who: 0 for who in PEERS}, {}
    for _ in range(args.rounds):
        for who in PEERS:
            process = subprocess.run([sys.executable, __file__, "--one", who, args.binary, path], stdout=subprocess.PIPE, text=True)
            if process.returncode != 0:
                # As a rule killed for its memory.
                print(f"{who} ended with {process.returncode}", flush=True)
                continue
            told = json.loads(process.stdout)
            seconds[who].append(told["seconds"])
            peaks[who] = max(peaks[who], told["peak_gib"])
            first.setdefault(who, {label: np.array(of) for label, of in told["found"].items()})
    for who in PEERS:
        if seconds[who]:
            print(f"{who:7} {statistics.median(seconds[who]):8.2f} s   peak {peaks[who]:.2f} GiB")
    for who in ("pandas", "polars"):
        if who in first:
            worst = max(np.max(np.abs(first[who][label] / first["ours"][label] - 1)) for label in ESTIMATES)
            print(f"percentiles differ from {who}'s by {worst:.1e} of themselves at most")
            print(f"ratio analysis-{who} {statistics.median(seconds[who]) / statistics.median(seconds['ours']):.2f}")


if __name__ == "__main__":
    main()
