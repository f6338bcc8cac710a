#!/usr/bin/env python3
"""Compares the filters of disparity maps with references on random maps, pixel by pixel.

    bm_filters_against_references.py [--cases 300] [--seed 1]

- speckle: OpenCV's own `filterSpeckles`;
- fill: `interpolateBackground` of KITTI's development kit, written down here from its description;
- left-right: the check of Hirschmueller (2008) with OpenCV's two roundings, written down here in NumPy.

Makes a private virtual environment under the target folder with opencv-python-headless and numpy in it and builds the
example `bm_raw`. Prints what differs and exits 1, or says that nothing does.
"""
import argparse
import subprocess
import sys
import tempfile

from cases import TARGET, WORKSPACE, into_private_environment


def draw(rng, shape, invalid):
    """A map of steps and noise with gaps, some of them whole rows, columns or nearly everything."""
    disparity = invalid + 16 + rng.integers(0, 64, shape) + 16 * (np.indices(shape).sum(0) // 7 % 5)
    disparity[rng.random(shape) < rng.choice([0.05, 0.3, 0.6, 0.97])] = invalid
    disparity[rng.random(shape[0]) < 0.15] = invalid
    disparity[:, rng.random(shape[1]) < 0.1] = invalid
    return disparity.astype(np.int16)


def filled(disparity, invalid):
    """Rows: nearest answers to the left and right, the smaller or the only one. Columns: nearest answer at the ends."""
    result = disparity.astype(int)
    missing = 1 << 20
    valid = result != invalid
    height, width = result.shape
    left, right = np.full_like(result, missing), np.full_like(result, missing)
    for x in range(width):
        left[:, x] = np.where(valid[:, x], result[:, x], left[:, x - 1] if x else missing)
        mirrored = width - 1 - x
        right[:, mirrored] = np.where(valid[:, mirrored], result[:, mirrored], right[:, mirrored + 1] if x else missing)
    smaller = np.minimum(left, right)
    result = np.where(valid, result, np.where(smaller == missing, invalid, smaller))
    answered = np.flatnonzero((result != invalid).any(1))
    if answered.size:
        result[:answered[0]] = result[answered[0]]
        result[answered[-1] + 1:] = result[answered[-1]]
    return result.astype(np.int16)


def consistent(left, right, invalid_left, invalid_right, most):
    """A left pixel stays if the right map, read at its partner, holds the negative of its disparity within `most`."""
    width = left.shape[1]
    padded = np.pad(right.astype(int), ((0, 0), (4096, 4096)), constant_values=invalid_right)
    columns, d = np.arange(width)[None, :], left.astype(int)
    stays = np.zeros(left.shape, bool)
    for whole in (np.floor(d / 16), np.ceil(d / 16)):
        other = np.take_along_axis(padded, (columns - whole.astype(int)) + 4096, 1)
        stays |= (other != invalid_right) & (np.abs(other + d) <= most)
    return np.where(stays, left, invalid_left).astype(np.int16)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    build = ["cargo", "build", "--release", "--quiet", "-p", "depthloom-kernels", "--example", "bm_raw"]
    subprocess.run(build, cwd=WORKSPACE, check=True)
    rng = np.random.default_rng(args.seed)
    binary = TARGET / "release" / "examples" / "bm_raw"
    ours = subprocess.Popen([binary], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    differing, changed = 0, dict(speckle=0, fill=0)
    kept = dropped = 0

    def run(job, *numbers):
        ours.stdin.write(" ".join(map(str, [*job, *numbers])) + "\n")
        ours.stdin.flush()
        if not ours.stdout.readline():
            sys.exit(f"no answer to {job} {numbers}")
        return np.fromfile(files[2], np.int16)

    with tempfile.TemporaryDirectory() as folder:
        files = [f"{folder}/{name}" for name in ("left", "right", "out")]
        for case in range(args.cases):
            shape = tuple(int(side) for side in rng.integers(1, 60, 2))
            invalid = 16 * int(rng.integers(-40, 20))
            disparity = draw(rng, shape, invalid)
            disparity.tofile(files[0])
            window, most = int(rng.integers(1, 60)), int(rng.integers(0, 40))
            speckle_free, _ = cv2.filterSpeckles(disparity.copy(), invalid, window, most)
            right = draw(rng, shape, -32 - invalid - 16 * 10)
            right.tofile(files[1])
            checked = consistent(disparity, right, invalid, -32 - invalid - 160, most)
            results = dict(
                speckle=(speckle_free, run(["speckle", files[0], files[2]], shape[1], invalid, window, most)),
                fill=(filled(disparity, invalid), run(["fill", files[0], files[2]], shape[1], invalid, 2**31 - 1)),
                check=(checked, run(["left-right", *files], shape[1], invalid, -32 - invalid - 160, most)))
            for name in changed:
                changed[name] += int((results[name][0] != disparity).sum())
            kept += int((checked != invalid).sum())
            dropped += int((checked != disparity).sum())
            for name, (expected, got) in results.items():
                wrong = np.argwhere(got.reshape(shape) != expected)
                if wrong.size:
                    differing += 1
                    y, x = wrong[0]
                    print(f"case {case}, {name}: {shape} invalid {invalid}, window {window}, most {most}: {len(wrong)} pixels "
                          f"differ, first at row {y} column {x}: {got.reshape(shape)[y, x]}, expected {expected[y, x]}")
    ours.stdin.close()
    ours.wait()
    print(f"{args.cases} maps with OpenCV {cv2.__version__}: pixels changed {changed}, kept by the check {kept} and dropped "
          f"{dropped}: {differing} results differ")
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    into_private_environment()
    import cv2
    import numpy as np

    main()
