#!/usr/bin/env python3
"""Compares our census stereo with an implementation in NumPy, written from the papers, pixel by pixel.

    cargo build --release -p depthloom-kernels --example census_raw
    crates/kernels/tests/census_against_numpy.py TARGET/release/examples/census_raw [--cases 120] [--seed 1] [--threads 1 2 5]

Papers: Zabih and Woodfill 1994 (census), Spangenberg et al. 2013 (centre-symmetric census), Hirschmueller 2008 (paths,
sub-pixel parabola, left-right check). Images: random ones, teddy and cones (Middlebury), a crop of a KITTI frame; the real
ones are in DEPTHLOOM_SHARED, by default ../shared beside the workspace. Also prints the share of bad pixels on teddy and
cones beside OpenCV's StereoSGBM in mode hh, and milliseconds of both on a KITTI frame with one thread.

Packages come from PyPI into a private virtual environment under the target folder (`cases.py`).
Prints what differs and exits 1, or says that nothing does.
"""
import argparse
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import cases

cases.into_private_environment()

import cv2  # noqa: E402
import numpy as np  # noqa: E402

BITS = {"symmetric": 31, "off-axis": 48, "full": 62}
STEPS = [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]
NO_ANSWER = 1 << 20  # larger than any disparity, also to the median


def census(image, kind):
    """One bool a comparison, in a last axis; all false within 4 columns and 3 rows of the border."""
    height, width = image.shape
    bits = np.zeros((height, width, BITS[kind]), bool)
    if height < 7 or width < 9:
        return bits

    def shifted(dy, dx):
        return image[3 + dy:height - 3 + dy, 4 + dx:width - 4 + dx]

    around = [(dy, dx) for dy in range(-3, 4) for dx in range(-4, 5) if (dy, dx) != (0, 0)]
    if kind == "symmetric":
        pairs = [((dy, dx), (-dy, -dx)) for dy, dx in around if dy < 0 or (dy == 0 and dx < 0)]
    elif kind == "full":
        pairs = [((0, 0), offset) for offset in around]
    else:
        pairs = [((0, 0), (dy, dx)) for dy, dx in around if dy and dx]
    for number, (one, other) in enumerate(pairs):
        bits[3:height - 3, 4:width - 4, number] = shifted(*one) > shifted(*other)
    return bits


def match_costs(left, right, p):
    """Hamming distance of each left pixel to each candidate; outside of the right image all bits are 0."""
    left, right = census(left, p["census"]), census(right, p["census"])
    height, width, _ = left.shape
    costs = np.empty((height, width, p["disparities"]), np.int32)
    for index in range(p["disparities"]):
        columns = np.arange(width) - index - p["min_disparity"]
        inside = (columns >= 0) & (columns < width)
        candidates = np.where(inside[None, :, None], right[:, np.clip(columns, 0, width - 1)], False)
        costs[..., index] = (left != candidates).sum(-1)
    return costs


def follow(costs, before, p):
    """Hirschmueller's equation 13 for pixels side by side: costs of (n, disparities), and those at the pixels before."""
    least = before.min(-1, keepdims=True)
    best = np.minimum(before, least + p["p2"])
    best[:, 1:] = np.minimum(best[:, 1:], before[:, :-1] + p["p1"])
    best[:, :-1] = np.minimum(best[:, :-1], before[:, 1:] + p["p1"])
    return costs + best - least


def along(costs, dy, dx, p):
    """Costs along the paths of one direction, which begin at the border with nothing before them."""
    if dy == 0:
        return along(costs.transpose(1, 0, 2), dx, 0, p).transpose(1, 0, 2)
    if dy < 0:
        return along(costs[::-1], -dy, dx, p)[::-1]
    result = np.empty_like(costs)
    result[0] = costs[0]
    for y in range(1, len(costs)):
        before = np.zeros_like(costs[0])
        if dx == 0:
            before[:] = result[y - 1]
        elif dx > 0:
            before[1:] = result[y - 1, :-1]
        else:
            before[:-1] = result[y - 1, 1:]
        result[y] = follow(costs[y], before, p)
    return result


def median(disparities):
    """3x3, border replicated."""
    height, width = disparities.shape
    padded = np.pad(disparities, 1, mode="edge")
    windows = [padded[dy:dy + height, dx:dx + width] for dy in range(3) for dx in range(3)]
    return np.sort(windows, 0)[4]


def reference(left, right, p):
    """Disparities in 1/16 px, (min_disparity - 1) * 16 where there is no answer."""
    costs = match_costs(left.astype(int), right.astype(int), p)
    sums = sum(along(costs, dy, dx, p) for dy, dx in STEPS[:p["paths"]])
    height, width, count = sums.shape
    rows, columns = np.mgrid[0:height, 0:width]
    winner = sums.argmin(-1)
    cost = sums.min(-1)

    # Unique: cost <= (1 - u / 100) * every cost except the neighbours'.
    far = np.abs(np.arange(count) - winner[..., None]) > 1
    rivals = far & ((100 - p["uniqueness"]) * sums < 100 * cost[..., None])
    answers = winner * 16
    if p["subpixel"]:
        inner = (winner > 0) & (winner < count - 1)
        nearer = sums[rows, columns, np.clip(winner - 1, 0, None)]
        farther = sums[rows, columns, np.clip(winner + 1, None, count - 1)]
        curvature = np.where(inner, nearer - 2 * cost + farther, 1)
        offset = np.trunc((16 * (nearer - farther) + curvature) / (2 * curvature)).astype(int)
        answers = answers + np.where(inner, offset, 0)
    answers[rivals.any(-1)] = NO_ANSWER

    # The right image's answers come from the same sums, along the diagonal.
    best = np.full((height, width), 1 << 30)
    back = np.full((height, width), NO_ANSWER)
    for index in range(count):
        partner = np.arange(width) + index + p["min_disparity"]
        inside = (partner >= 0) & (partner < width)
        candidate = np.where(inside, sums[:, np.clip(partner, 0, width - 1), index], 1 << 30)
        better = candidate < best
        best[better] = candidate[better]
        back[better] = index

    answers, back = median(answers), median(back)
    whole = answers // 16
    partner = columns - whole - p["min_disparity"]
    good = (answers < NO_ANSWER) & (partner >= 0) & (partner < width)
    if p["lr_max_diff"] >= 0:
        there = back[rows, np.clip(partner, 0, width - 1)]
        good &= (there < NO_ANSWER) & (np.abs(there - whole) <= p["lr_max_diff"])
    return np.where(good, answers + 16 * p["min_disparity"], (p["min_disparity"] - 1) * 16).astype(np.int16)


class Ours:
    """The example `census_raw`, fed with jobs."""

    def __init__(self, binary, folder):
        self.files = [f"{folder}/{name}" for name in ("left", "right", "out")]
        self.process = subprocess.Popen([binary], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def match(self, left, right, p, path="best", threads=1):
        np.ascontiguousarray(left).tofile(self.files[0])
        np.ascontiguousarray(right).tofile(self.files[1])
        height, width = left.shape
        words = [*self.files, width, height, p["census"], p["paths"], path, threads, p["min_disparity"], p["disparities"],
                 p["p1"], p["p2"], p["uniqueness"], int(p["subpixel"]), p["lr_max_diff"]]
        self.process.stdin.write(" ".join(map(str, words)) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        try:
            return np.fromfile(self.files[2], np.int16).reshape(height, width), float(answer)
        except ValueError:
            sys.exit(f"{words}: {answer!r}")


def draw_pair(rng):
    """Texture of several kinds, and the same seen from the side with a little noise; or two that have nothing in common."""
    width, height = int(rng.integers(1, 150)), int(rng.integers(1, 50))
    left = rng.integers(0, 256, (height, width)).astype(np.uint8)
    kind = rng.integers(4)
    if kind == 1:
        left = left // 64 * 64
    elif kind == 2:
        left = np.repeat(np.repeat(left[::3, ::5], 3, 0), 5, 1)[:height, :width]
    elif kind == 3:
        left = cv2.GaussianBlur(left, (0, 0), 1.2).reshape(height, width)
    if rng.random() < 0.1:
        return left, rng.integers(0, 256, left.shape).astype(np.uint8)
    rows, columns = np.mgrid[0:height, 0:width]
    shift = rng.integers(1, 40) * (0.6 + 0.4 * np.sin(rows / 9 + columns / 25))
    right = np.take_along_axis(left, np.clip(columns + shift.astype(int), 0, width - 1), 1)
    return left, np.clip(right + rng.normal(0, rng.uniform(0, 6), right.shape), 0, 255).astype(np.uint8)


DEFAULTS = dict(census="symmetric", paths=8, min_disparity=0, disparities=64, p1=10, p2=120, uniqueness=5, subpixel=True,
                lr_max_diff=1)


def draw_params(rng):
    kind = str(rng.choice(list(BITS)))
    p2 = int(rng.choice([rng.integers(0, 256 - BITS[kind]), 255 - BITS[kind], 120]))
    return dict(census=kind, paths=int(rng.choice([4, 8])), min_disparity=int(rng.choice([0, 0, rng.integers(-60, 60)])),
                disparities=16 * int(rng.choice([1, 2, 3, 4, 5, 8, 16])), p1=int(rng.integers(0, p2 + 1)), p2=p2,
                uniqueness=int(rng.choice([0, 5, 5, 15, 40, 99])), subpixel=bool(rng.random() < 0.7),
                lr_max_diff=int(rng.choice([-1, 0, 1, 1, 3])))


def bad(disparity, truth, unknown):
    """Shares of pixels with truth: wrong by more than 1 px of those answered; without an answer; either."""
    known = truth > 0
    answered = known & (disparity > unknown)
    wrong = answered & (np.abs(disparity / 16 - truth) > 1)
    return wrong.sum() / answered.sum(), 1 - answered.sum() / known.sum(), (wrong.sum() + (known & ~answered).sum()) / known.sum()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("binary", type=pathlib.Path)
    parser.add_argument("--cases", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--path", default="best")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2, 5])
    parser.add_argument("--timed", type=int, default=15, help="repetitions of the timed frame; 0: none")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    rng = np.random.default_rng(args.seed)
    differing = answered = pixels = 0
    with tempfile.TemporaryDirectory() as folder:
        ours = Ours(args.binary, folder)

        def compare(name, left, right, p, threads):
            nonlocal differing, answered, pixels
            expected = reference(left, right, p)
            got, _ = ours.match(left, right, p, args.path, threads)
            pixels += got.size
            answered += int((expected != (p["min_disparity"] - 1) * 16).sum())
            if not np.array_equal(got, expected):
                differing += 1
                y, x = np.argwhere(got != expected)[0]
                print(f"{name}: {left.shape} {p} threads {threads}: {(got != expected).sum()} of {got.size} pixels differ, first at "
                      f"row {y} column {x}: ours {got[y, x]}, NumPy's {expected[y, x]}")

        for case in range(args.cases):
            compare(f"case {case}", *draw_pair(rng), draw_params(rng), args.threads[case % len(args.threads)])
        print(f"{args.cases} random pairs, {answered} of {pixels} pixels answered: {differing} differ")

        shared = os.environ.get("DEPTHLOOM_SHARED")
        shared = pathlib.Path(shared) if shared else cases.WORKSPACE.parent / "shared"
        if not shared.is_dir():
            print(f"SKIPPED real images: {shared} is absent")
            sys.exit(1 if differing else 0)
        real = {}
        for name in ("teddy", "cones"):
            real[name] = [cv2.imread(str(shared / "data/middlebury" / name / file), cv2.IMREAD_GRAYSCALE)
                          for file in ("im2.png", "im6.png", "disp2.png")]
        training = shared / "data/kitti_stereo_2015/training"
        frame = [cv2.imread(str(training / side / "000150_10.png"), cv2.IMREAD_GRAYSCALE) for side in ("image_2", "image_3")]
        real["kitti crop"] = [image[150:330, 300:900] for image in frame]
        count = 0
        for name, (left, right, *_) in real.items():
            for paths in (4, 8):
                for kind in BITS:
                    compare(f"{name}", left, right, DEFAULTS | dict(paths=paths, census=kind), args.threads[count % len(args.threads)])
                    count += 1
        print(f"{count} comparisons on real pairs, {answered} of {pixels} pixels answered in all: {differing} differ")

        print("\nbad pixels, more than 1 px from the truth: of those answered; no answer; both, of all with truth")
        for name in ("teddy", "cones"):
            left, right, truth = real[name]
            truth = truth / 4
            for kind in BITS:
                for paths in (4, 8):
                    got, _ = ours.match(left, right, DEFAULTS | dict(paths=paths, census=kind))
                    print(f"  {name} census {kind} {paths} paths: " + " ".join(f"{share:6.2%}" for share in bad(got, truth, -16)))
            for block in (3, 5):
                hh = cv2.StereoSGBM_create(minDisparity=0, numDisparities=64, blockSize=block, P1=8 * block**2, P2=32 * block**2,
                                           disp12MaxDiff=1, preFilterCap=63, uniquenessRatio=5, mode=cv2.STEREO_SGBM_MODE_HH)
                got = hh.compute(left, right)
                print(f"  {name} OpenCV hh, block {block}:      " + " ".join(f"{share:6.2%}" for share in bad(got, truth, -16)))

        if args.timed:
            left, right = frame
            print(f"\nmilliseconds for {left.shape[1]}x{left.shape[0]}, one thread, median (least) of {args.timed} in turn")
            for disparities in (64, 128):
                times = {}
                hh = cv2.StereoSGBM_create(minDisparity=0, numDisparities=disparities, blockSize=5, P1=200, P2=800, disp12MaxDiff=1,
                                           preFilterCap=63, uniquenessRatio=5, mode=cv2.STEREO_SGBM_MODE_HH)
                for _ in range(args.timed):
                    start = time.perf_counter()
                    hh.compute(left, right)
                    times.setdefault("OpenCV hh", []).append((time.perf_counter() - start) * 1e3)
                    for kind, paths in (("symmetric", 8), ("symmetric", 4), ("full", 8)):
                        p = DEFAULTS | dict(disparities=disparities, census=kind, paths=paths)
                        times.setdefault(f"census {kind} {paths}", []).append(ours.match(left, right, p, args.path)[1])
                for name, taken in times.items():
                    print(f"  {disparities} disparities, {name}: {np.median(taken):.1f} ({min(taken):.1f})")
        ours.process.stdin.close()
        ours.process.wait()
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
