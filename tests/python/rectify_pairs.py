#!/usr/bin/env python3
"""Pairs of random cameras, calibrations of these as OpenCV's `FileStorage`, and the pairs rectified by OpenCV.

    rectify_pairs.py FOLDER COUNT

A folder a case: left.png, right.png; intrinsics.yml (M1 D1 M2 D2) and extrinsics.yml (R T R1 R2 P1 P2) as its sample `stereo_calib` writes them;
left.rectified.png and right.rectified.png by `initUndistortRectifyMap` (`CV_32FC1`) and `remap` (`INTER_LINEAR`). Every second case has no R1, ..., P2.
"""
import pathlib
import sys

import cv2
import numpy as np


def write(path, matrices):
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, matrix in matrices.items():
        file.write(name, np.atleast_2d(matrix))
    file.release()


def main():
    out, count = pathlib.Path(sys.argv[1]), int(sys.argv[2])
    rng = np.random.default_rng(2026)
    for case in range(count):
        folder = out / str(case)
        folder.mkdir(parents=True)
        size = (1242, 375) if case == 0 else tuple(int(of) for of in rng.integers(60, 500, 2))
        width, height = size
        images, cameras = [], []
        for side in ("left", "right"):
            image = rng.integers(0, 256, (height // 4 + 1, width // 4 + 1, 3), dtype=np.uint8)
            images.append(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC))
            cv2.imwrite(str(folder / f"{side}.png"), images[-1])
            focal = width * rng.uniform(0.7, 1.3) if side == "left" else focal * rng.uniform(0.98, 1.02)
            k = np.array([[focal, 0, width * rng.uniform(0.45, 0.55)], [0, focal * rng.uniform(0.99, 1.01), height * rng.uniform(0.45, 0.55)], [0, 0, 1]])
            scale = np.array([0.2, 0.1, 0.002, 0.002, 0.02, 0.1, 0.05, 0.01])
            cameras.append((k, rng.uniform(-1, 1, 8)[: (5, 8, 4)[case % 3]] * scale[: (5, 8, 4)[case % 3]]))
        (k1, d1), (k2, d2) = cameras
        r = cv2.Rodrigues(rng.uniform(-0.03, 0.03, 3))[0]
        t = np.array([[-rng.uniform(0.05, 0.5)], [rng.uniform(-0.01, 0.01)], [rng.uniform(-0.01, 0.01)]])
        r1, r2, p1, p2 = cv2.stereoRectify(k1, d1, k2, d2, size, r, t, flags=cv2.CALIB_ZERO_DISPARITY, alpha=-1)[:4]
        write(folder / "intrinsics.yml", dict(M1=k1, D1=d1, M2=k2, D2=d2))
        write(folder / "extrinsics.yml", dict(R=r, T=t) if case % 2 else dict(R=r, T=t, R1=r1, R2=r2, P1=p1, P2=p2))
        for side, image, k, d, rotation, projection in (("left", images[0], k1, d1, r1, p1), ("right", images[1], k2, d2, r2, p2)):
            maps = cv2.initUndistortRectifyMap(k, d, rotation, projection, size, cv2.CV_32FC1)
            cv2.imwrite(str(folder / f"{side}.rectified.png"), cv2.remap(image, *maps, cv2.INTER_LINEAR))


if __name__ == "__main__":
    main()
