#!/usr/bin/env python3
"""Draws random images and parameters and compares our disparities with OpenCV's own, pixel by pixel.

    pip install opencv-python-headless numpy
    cargo build --release -p depthloom-kernels --example sgbm_raw
    kernels/tests/sgbm_against_opencv.py TARGET/release/examples/sgbm_raw [--cases 500] [--seed 1] [--threads 1 2 5]

OpenCV runs with one thread: in `hh4` its saturated sums depend on how it cuts the image among threads. Not drawn: images
with fewer searched columns than half a block, where OpenCV reads behind a buffer (except in hh4). What OpenCV refuses
must be refused.
Prints what differs and exits 1, or says that nothing does.
"""
import argparse
import pathlib
import subprocess
import sys
import tempfile

import cv2
import numpy as np

MODES = {
    "sgbm": cv2.STEREO_SGBM_MODE_SGBM,
    "hh": cv2.STEREO_SGBM_MODE_HH,
    "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    "hh4": cv2.STEREO_SGBM_MODE_HH4,
}


def texture(rng, height, width, channels):
    """One of several kinds of image: noise, blurred noise, steps, saturated noise, nearly flat."""
    kind = rng.integers(5)
    image = rng.integers(0, 256, (height, width, channels)).astype(np.float32)
    if kind == 1:
        image = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.5, 3))).reshape(height, width, channels)
        image = (image - image.min()) * (255 / max(np.ptp(image), 1))
    elif kind == 2:
        image = np.repeat(np.repeat(image[::5, ::7], 5, 0), 7, 1)[:height, :width]
    elif kind == 3:
        image = np.where(image > 128, 255, 0)
    elif kind == 4:
        image = 100 + image / 64
    return np.clip(image, 0, 255).astype(np.uint8)


def pair(rng, height, width, channels, reach):
    """A left image, and a right image that shows it shifted by a disparity that changes along and across."""
    left = texture(rng, height, width, channels)
    if rng.random() < 0.1:
        return left, texture(rng, height, width, channels)
    rows, columns = np.mgrid[0:height, 0:width]
    shift = reach * (0.5 + 0.4 * np.sin(rows / rng.uniform(3, 40) + columns / rng.uniform(10, 80)))
    right = np.take_along_axis(left, np.clip(columns + shift.astype(int), 0, width - 1)[..., None], 1)
    noise = rng.normal(0, rng.uniform(0, 8), right.shape)
    return left, np.clip(right + noise, 0, 255).astype(np.uint8)


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
    parser.add_argument("binary", type=pathlib.Path)
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--path", default="best")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2, 5])
    args = parser.parse_args()
    cv2.setNumThreads(1)
    rng = np.random.default_rng(args.seed)
    ours = subprocess.Popen([args.binary], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    differing = answered = refused = 0
    with tempfile.TemporaryDirectory() as folder:
        files = [f"{folder}/{name}" for name in ("left", "right", "out")]
        for case in range(args.cases):
            mode, width, height, channels, params = draw(rng)
            left, right = pair(rng, height, width, channels, params["minDisparity"] + params["numDisparities"] / 2)
            if channels == 1:
                left, right = left[..., 0].copy(), right[..., 0].copy()
            left.tofile(files[0])
            right.tofile(files[1])
            try:
                expected = cv2.StereoSGBM_create(mode=MODES[mode], **params).compute(left, right)
            except cv2.error:
                expected = None
            threads = args.threads[case % len(args.threads)]
            words = [*files, width, height, channels, mode, args.path, threads, *params.values()]
            ours.stdin.write(" ".join(map(str, words)) + "\n")
            ours.stdin.flush()
            answer = ours.stdout.readline()
            if not answer:
                sys.exit(f"case {case}: no answer to {words}")
            if expected is None or answer.startswith("refused"):
                refused += 1
                if expected is not None or not answer.startswith("refused"):
                    differing += 1
                    print(f"case {case}: {mode} {width}x{height}x{channels} {params}: OpenCV "
                          f"{'refuses' if expected is None else 'accepts'}, ours: {answer}")
                continue
            got = np.fromfile(files[2], np.int16).reshape(height, width)
            answered += int((expected != (params["minDisparity"] - 1) * 16).sum())
            if not np.array_equal(got, expected):
                differing += 1
                wrong = np.argwhere(got != expected)
                y, x = wrong[0]
                print(f"case {case}: {mode} {width}x{height}x{channels} {params} threads {threads}: {len(wrong)} of "
                      f"{got.size} pixels differ, first at row {y} column {x}: ours {got[y, x]}, OpenCV's {expected[y, x]}")
    ours.stdin.close()
    ours.wait()
    print(f"{args.cases} cases with OpenCV {cv2.__version__}, {refused} refused by both, {answered} answered pixels: {differing} cases differ")
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
