#!/usr/bin/env python3
"""The rules of monodepth2's `generate_depth_map`, written down again in NumPy: truth of KITTI raw as much published work has it.

  monodepth2.py DATE_DIR SCAN WIDTH HEIGHT [--scanner-depth] > depth.f32       float32, row-major, 0 = nothing
"""
import collections
import pathlib
import sys

import numpy as np


def calibration(path):
    rows = {}
    for line in path.read_text().splitlines():
        name, _, values = line.partition(":")
        try:
            rows[name] = np.array([float(value) for value in values.split()])
        except ValueError:
            pass
    return rows


date, scan, width, height = pathlib.Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
scanner_depth = "--scanner-depth" in sys.argv
camera, scanner = calibration(date / "calib_cam_to_cam.txt"), calibration(date / "calib_velo_to_cam.txt")
camera_from_scanner, rectify = np.eye(4), np.eye(4)
camera_from_scanner[:3, :3], camera_from_scanner[:3, 3] = scanner["R"].reshape(3, 3), scanner["T"]
rectify[:3, :3] = camera["R_rect_00"].reshape(3, 3)
image_from_scanner = camera["P_rect_02"].reshape(3, 4) @ rectify @ camera_from_scanner

points = np.fromfile(scan, np.float32).reshape(-1, 4)
points[:, 3] = 1
points = points[points[:, 0] >= 0]
seen = (image_from_scanner @ points.T).T
seen[:, :2] = seen[:, :2] / seen[:, 2:]
if scanner_depth:
    seen[:, 2] = points[:, 0]
# "minus 1 to get the exact same value as the KITTI matlab code"
seen[:, :2] = np.round(seen[:, :2]) - 1
inside = (seen[:, 0] >= 0) & (seen[:, 1] >= 0) & (seen[:, 0] < width) & (seen[:, 1] < height)
seen = seen[inside]
columns, rows = seen[:, 0].astype(int), seen[:, 1].astype(int)
depth = np.zeros((height, width))
for column, row, metres in zip(columns, rows, seen[:, 2]):
    depth[row, column] = metres
# The number by which duplicates are found confuses a row's last column with the next one's first.
numbers = rows * (width - 1) + columns - 1
for number, count in collections.Counter(numbers.tolist()).items():
    if count > 1:
        same = np.where(numbers == number)[0]
        depth[rows[same[0]], columns[same[0]]] = seen[same, 2].min()
depth[depth < 0] = 0
sys.stdout.buffer.write(depth.astype("<f4").tobytes())
