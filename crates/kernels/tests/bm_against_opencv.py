#!/usr/bin/env python3
"""Draws random images and parameters and compares `bm` with OpenCV's own StereoBM, pixel by pixel.

    bm_against_opencv.py [--cases 400] [--seed 1] [--threads 1 2 5]

Makes a private virtual environment under the target folder and builds the example `bm_raw` (`cases.py`). OpenCV runs with one thread: with several, what it writes beyond the right border at a positive
minDisparity depends on which stripe ends last. Its output is filled with "no answer" first: where no block lies inside
both images it writes nothing. Not drawn is what OpenCV answers from memory it never wrote or does not own (`undefined`).
What OpenCV refuses must be refused. Prints what differs and exits 1, or says that nothing does.
"""
import argparse

import cases

cases.into_private_environment()

import cv2  # noqa: E402
import numpy as np  # noqa: E402


def draw(rng):
    """A size and parameters, under OpenCV's names."""
    odd = lambda low, high: int(rng.integers(low // 2, high // 2)) * 2 + 1
    block = int(rng.choice([5, 7, 9, 11, 15, 21, 21, 23, 31, odd(5, 63)]))
    count = 16 * int(rng.choice([1, 2, 3, 4, 4, 5, 6, 8, 9, 12, 16]))
    smallest = int(rng.choice([0, 0, rng.integers(-40, 40), rng.integers(1, 20), rng.integers(-300, 0)]))
    border = max(smallest + count - 1, 0) + 2 * (block // 2)
    roomy = [border + rng.integers(10, 200)] * 3
    width = int(rng.choice([rng.integers(1, 90), border + rng.integers(0, 12), *roomy]))
    roomy = [block + rng.integers(1, 120)] * 4
    height = int(rng.choice([rng.integers(1, 40), block + rng.integers(0, 5), *roomy]))
    params = dict(
        PreFilterType=int(rng.choice([0, 1, 1])), PreFilterSize=int(rng.choice([5, 7, 9, 9, 21, odd(5, 255)])),
        PreFilterCap=int(rng.choice([1, 10, 31, 31, 31, 32, 63, rng.integers(1, 64)])), BlockSize=block,
        MinDisparity=smallest, NumDisparities=count, TextureThreshold=int(rng.choice([0, 10, 10, 10, 500, 5000])),
        UniquenessRatio=int(rng.choice([0, 0, 5, 5, 15, 15, 40, 100, 1000])),
        SpeckleWindowSize=int(rng.choice([0, 0, 1, 20, 100])), SpeckleRange=int(rng.choice([-1, 0, 1, 2, 16, 32])),
        Disp12MaxDiff=int(rng.choice([-1, -1, 0, 1, 2, 5, 1000])))
    if rng.random() < 0.08:  # something that OpenCV refuses
        wrong = dict(PreFilterSize=[4, 6, 257], PreFilterCap=[0, 64], BlockSize=[1, 3, 8, 257], NumDisparities=[0, 24, -16],
                     TextureThreshold=[-1], UniquenessRatio=[-5])
        name = str(rng.choice(list(wrong)))
        params[name] = int(rng.choice(wrong[name]))
    return width, height, params


def undefined(width, height, params):
    """Why OpenCV's answer is not determined by the images and parameters, or None."""
    size = params["PreFilterSize"]
    if params["PreFilterType"] == 0 and size // 2 > height:
        return "the prefilter's window reads behind the image"
    if params["PreFilterType"] == 0 and (size in (51, 53) or 73 <= size <= 89):
        return "the prefilter's response leaves its table"
    if params["Disp12MaxDiff"] >= 0 and (params["PreFilterCap"] > 31 or params["BlockSize"] > 21):
        return "32-bit costs are checked as if they were 16-bit, in part without having been written"
    return None


def opencv(left, right, params):
    matcher = cv2.StereoBM_create()
    for name, value in params.items():
        getattr(matcher, "set" + name)(value)
    disparity = np.full(left.shape, (params["MinDisparity"] - 1) * 16, np.int16)
    try:
        return matcher.compute(left, right, disparity)
    except cv2.error:
        return None


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2, 5])
    args = parser.parse_args()
    cv2.setNumThreads(1)
    rng = np.random.default_rng(args.seed)
    comparison = cases.Comparison(cases.built("bm_raw"))
    left_out = 0
    while comparison.done < args.cases:
        width, height, params = draw(rng)
        left, right = cases.pair(rng, height, width, 1, params["MinDisparity"] + params["NumDisparities"] / 2)
        if undefined(width, height, params):
            left_out += 1
            continue
        threads = args.threads[(comparison.done + 1) % len(args.threads)]
        comparison.compare(
            f"{width}x{height} {params} threads {threads}", left, right,
            lambda files: ["bm", *files, width, height, threads, *params.values()],
            opencv(left, right, params), (params["MinDisparity"] - 1) * 16)
    comparison.end(f"with OpenCV {cv2.__version__}, {left_out} more undefined in OpenCV")


if __name__ == "__main__":
    main()
