#!/usr/bin/env python3
"""Draws random images and parameters and compares our disparities with OpenCV's own, pixel by pixel.

    sgbm_against_opencv.py [--cases 500] [--seed 1] [--threads 1 2 5] [--path best]

Makes a private virtual environment under the target folder and builds the example `sgbm_raw` (`cases.py`). OpenCV runs with
one thread: in `hh4` its saturated sums depend on how it cuts the image among threads. Not drawn: images with fewer searched
columns than half a block, where OpenCV reads behind a buffer (except in hh4). What OpenCV refuses must be refused. In a third of the
cases the left border is extended: by us, and for OpenCV by `copyMakeBorder`.
Prints what differs and exits 1, or says that nothing does.
"""
import argparse

import cases

cases.into_private_environment()

import cv2  # noqa: E402
import numpy as np  # noqa: E402

MODES = {
    "sgbm": cv2.STEREO_SGBM_MODE_SGBM,
    "hh": cv2.STEREO_SGBM_MODE_HH,
    "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    "hh4": cv2.STEREO_SGBM_MODE_HH4,
}


def draw(rng):
    channels = int(rng.choice([1, 1, 3]))
    block = int(rng.choice([1, 3, 3, 5, 5, 7, 9, 11, 15, 21, 31]))
    disparities = 16 * int(rng.choice([1, 2, 3, 4, 4, 5, 6, 8, 9, 12, 16]))
    smallest = int(rng.choice([0, 0, rng.integers(-40, 40), rng.integers(-300, 0)]))
    border = max(smallest + disparities, 0) + max(-smallest, 0)
    width = int(rng.choice([rng.integers(1, 60), border + rng.integers(1, 50), border + rng.integers(50, 200)]))
    mode = str(rng.choice(list(MODES)))
    if 0 < width - border <= block // 2 and mode != "hh4":
        width = border + block // 2 + 1
    height = int(rng.choice([rng.integers(1, 12), rng.integers(1, 70), rng.integers(60, 120)]))
    if rng.random() < 0.2:
        p1, p2 = 0, 0
    elif rng.random() < 0.15:
        p1 = int(rng.integers(1, 30000))
        p2 = int(rng.integers(p1 + 1, 32768))
    else:
        scale = channels * block * block
        p1 = int(8 * scale * rng.uniform(0.1, 1.5)) + 1
        p2 = min(p1 + 1 + int(32 * scale * rng.uniform(0.1, 1.5)), 32767)
        p1 = min(p1, p2 - 1)
    return mode, width, height, channels, dict(
        minDisparity=smallest, numDisparities=disparities, blockSize=block, P1=p1, P2=p2,
        disp12MaxDiff=int(rng.choice([-1, 0, 1, 2, 5, 1000])), preFilterCap=int(rng.choice([0, 1, 15, 31, 63, 63, 96, 97, 127, 200])),
        uniquenessRatio=int(rng.choice([0, 0, 5, 10, 15, 50, 99])), speckleWindowSize=int(rng.choice([0, 0, 1, 20, 100])),
        speckleRange=int(rng.choice([0, 1, 2, 32])))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--path", default="best")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2, 5])
    args = parser.parse_args()
    cv2.setNumThreads(1)
    rng = np.random.default_rng(args.seed)
    comparison = cases.Comparison(cases.built("sgbm_raw"))
    for case in range(args.cases):
        mode, width, height, channels, params = draw(rng)
        columns = max(params["minDisparity"] + params["numDisparities"], 0) if rng.random() < 1 / 3 else 0
        left, right = cases.pair(rng, height, width, channels, params["minDisparity"] + params["numDisparities"] / 2)
        try:
            wide = [cv2.copyMakeBorder(image, 0, 0, columns, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
            expected = cv2.StereoSGBM_create(mode=MODES[mode], **params).compute(*wide)[:, columns:]
        except cv2.error:
            expected = None
        threads = args.threads[case % len(args.threads)]
        comparison.compare(
            f"{mode} {width}x{height}x{channels} {params} virtual columns {columns} threads {threads}", left, right,
            lambda files: [*files, width, height, channels, mode, args.path, threads, *params.values(), int(columns > 0)],
            expected, (params["minDisparity"] - 1) * 16)
    comparison.end(f"with OpenCV {cv2.__version__}")


if __name__ == "__main__":
    main()
