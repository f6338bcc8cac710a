#!/usr/bin/env python3
"""The rules of KITTI's stereo evaluation, transcribed from its development kit (devkit_scene_flow, C++) with NumPy, loop by loop.

    kitti_devkit.py WIDTH HEIGHT ESTIMATE TRUTH OBJECTS

The files hold rows of little-endian numbers: ESTIMATE int16 in 1/16 px (0 and below: invalid), TRUTH uint16 in 1/256 px (0: invalid), OBJECTS
uint8 (0: background). Prints one JSON object: of `valid` (valid results), `filled` (after interpolateBackground) and `all` (what is invalid
counted as wrong) the number of pixels, `epe`, `bad_x` and `d1`; `d1_bg` and `d1_fg` of `filled`; and `density`.

From the kit: `DisparityImage::interpolateBackground` (io_disp.h) and `disparityErrorsOutlier` (evaluate_scene_flow.cpp: ABS_THRESH 3.0,
REL_THRESH 0.05, both strict). End-point error and bad-x are KITTI stereo 2012's (evaluate_stereo.cpp: `err > t`, mean of errors).
"""
import json
import sys

import numpy as np


def interpolate_background(disparity):
    """interpolateBackground; invalid is below 0."""
    d = disparity.copy()
    height, width = d.shape
    for v in range(height):
        count = 0
        for u in range(width):
            if d[v, u] >= 0:
                if count >= 1:
                    u1, u2 = u - count, u - 1
                    if u1 > 0 and u2 < width - 1:
                        d[v, u1:u2 + 1] = min(d[v, u1 - 1], d[v, u2 + 1])
                count = 0
            else:
                count += 1
        for u in range(width):
            if d[v, u] >= 0:
                d[v, :u] = d[v, u]
                break
        for u in range(width - 1, -1, -1):
            if d[v, u] >= 0:
                d[v, u + 1:] = d[v, u]
                break
    for u in range(width):
        for v in range(height):
            if d[v, u] >= 0:
                d[:v, u] = d[v, u]
                break
        for v in range(height - 1, -1, -1):
            if d[v, u] >= 0:
                d[v + 1:, u] = d[v, u]
                break
    return d


def scores(estimate, truth, pixels, invalid_is_wrong):
    d, t = estimate[pixels], truth[pixels]
    valid = d >= 0
    error = np.abs(t - d)
    # What interpolation leaves invalid is -1 px in the kit, and compared as that.
    wrong = ~valid & invalid_is_wrong
    told = {"pixels": int(pixels.sum()), "epe": float(error[valid].mean())}
    for x in (0.5, 1, 2, 3, 4):
        told[f"bad_{x}"] = float((wrong | (error > x)).mean())
    told["d1"] = float((wrong | (error > 3.0) & (error / np.abs(t) > 0.05)).mean())
    return told


def main():
    width, height = int(sys.argv[1]), int(sys.argv[2])
    estimate, truth, objects = (
        np.fromfile(path, kind).reshape(height, width) for path, kind in zip(sys.argv[3:], ("<i2", "<u2", "u1")))
    estimate = np.where(estimate > 0, estimate / 16.0, -1.0)
    true = truth > 0
    truth = truth / 256.0
    filled = interpolate_background(estimate)
    told = {
        "valid": scores(estimate, truth, true & (estimate >= 0), False),
        "filled": scores(filled, truth, true, False),
        "all": scores(estimate, truth, true, True),
        "d1_bg": scores(filled, truth, true & (objects == 0), False)["d1"],
        "d1_fg": scores(filled, truth, true & (objects > 0), False)["d1"],
        "density": float((estimate[true] >= 0).mean()),
    }
    print(json.dumps(told))


main()
