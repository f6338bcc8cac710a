#!/usr/bin/env python3
"""Compares training samples with what OpenCV makes of the same frames.

    check_samples.py SAMPLES TRAINING DISPARITIES

SAMPLES are bytes of `learn/samples` with a right image, version 1, read here as their format is documented. TRAINING holds
image_2 and image_3 of KITTI stereo 2015; DISPARITIES holds OpenCV's own SGBM, ID.disparity.png, 1/16 px, 0 = none.

Images are INTER_AREA of the 8-bit image, every byte equal. Targets are INTER_AREA of disparity * valid over that of valid, over
the width: relative difference up to 1e-3 (they are IEEE halves: 2^-11). Which pixels have one must be the same but where the
coverage is within 1e-3 of the limit, and those are at most one in a thousand.
"""
import pathlib
import struct
import sys

import cv2
import numpy as np

COVERAGE, LEAST_PX = 0.2, 0.5

if len(sys.argv) != 4:
    sys.exit(__doc__)
data, training, disparities = pathlib.Path(sys.argv[1]).read_bytes(), *map(pathlib.Path, sys.argv[2:])

magic, version, flags, width, height, count = struct.unpack_from("<8sIIIIQ", data)
assert (magic, version, flags) == (b"DLSAMPLE", 1, 1), "other samples than are read here"
at, pixels = 32, width * height


def take(length):
    global at
    assert at + length <= len(data), "the samples are cut off"
    at += length
    return data[at - length : at]


def check_image(frame, planes, file):
    image = cv2.cvtColor(cv2.imread(str(file), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    wanted = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    off = (planes.transpose(1, 2, 0) != wanted).sum()
    assert off == 0, f"{frame}: {off} bytes of {file.parent.name} differ"
    return image


for _ in range(count):
    [length] = struct.unpack("<I", take(4))
    frame = take(length).decode()
    [scale] = struct.unpack("<d", take(8))
    left, right = (np.frombuffer(take(3 * pixels), np.uint8).reshape(3, height, width) for _ in range(2))
    share = np.frombuffer(take(2 * pixels), "<f2").astype(np.float64).reshape(height, width)

    image = check_image(frame, left, training / "image_2" / f"{frame}.png")
    check_image(frame, right, training / "image_3" / f"{frame}.png")
    columns = image.shape[1]
    focal = {1242: 721.5377, 1241: 718.856, 1224: 707.0493, 1238: 718.3351, 1226: 707.0912}[columns]
    assert abs(scale - focal * 0.532725 / columns) < 1e-9, f"{frame}: a share of 1 is {scale} m away"

    edges = np.abs(cv2.Sobel(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.CV_32F, 1, 0, ksize=3)) > 100
    disparity_px = cv2.imread(str(disparities / f"{frame}.disparity.png"), cv2.IMREAD_UNCHANGED) / np.float32(16)
    valid = (edges & (disparity_px > LEAST_PX)).astype(np.float32)
    small = (width, height)
    covered = cv2.resize(valid, small, interpolation=cv2.INTER_AREA).astype(np.float64)
    total = cv2.resize(disparity_px * valid, small, interpolation=cv2.INTER_AREA).astype(np.float64)
    wanted = np.where(covered >= COVERAGE, total / np.maximum(covered, 1e-12) / columns, np.nan)

    other = np.isnan(share) != np.isnan(wanted)
    assert (np.abs(covered - COVERAGE)[other] < 1e-3).all() and other.mean() < 1e-3, f"{frame}: other pixels have a target"
    both = ~np.isnan(share) & ~np.isnan(wanted)
    assert both.sum() > 500, f"{frame}: {both.sum()} targets"
    largest = (np.abs(share - wanted)[both] / wanted[both]).max()
    assert largest <= 1e-3, f"{frame}: targets are {largest} off"
    print(f"{frame}: {both.sum()} targets, relative difference up to {largest:.1e}, {other.sum()} by one side only")
assert at == len(data), "bytes follow the last sample"
