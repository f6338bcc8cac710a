"""The ablation of experiments/sgbm-ablation-kitti.yaml as people write it: a loop over OpenCV and NumPy. Called by ablation.sh.

Block sizes, uniqueness, modes, and holes kept or filled, on the frames 150 to 155 of KITTI stereo 2015: 32 settings. A matcher runs once a
setting of its own, not once for kept and once for filled holes. The left-right check is that of `disparity/left-right`, the filling the
development kit's, both in NumPy; what is scored is what the experiment scores. Prints one JSON object: seconds, without imports, and the scores.
"""
import argparse
import itertools
import json
import pathlib
import time

import cv2
import numpy as np

MODES = {"sgbm": cv2.STEREO_SGBM_MODE_SGBM, "hh": cv2.STEREO_SGBM_MODE_HH}
DISPARITIES = 64
MIN_M, MAX_M, MISSING_M = 1e-3, 80.0, 1e-4
# Where there is no calibration file: focal length (px) by the image's width, and the baseline (m).
FOCAL = {1242: 721.5377, 1241: 718.856, 1224: 707.0493, 1238: 718.3351, 1226: 707.0912}
BASELINE = 0.532725


def sgbm(left, right, block, uniqueness, mode, min_disparity):
    matcher = cv2.StereoSGBM_create(
        minDisparity=min_disparity, numDisparities=DISPARITIES, blockSize=block, P1=8 * block**2, P2=32 * block**2, disp12MaxDiff=-1,
        preFilterCap=63, uniquenessRatio=uniqueness, speckleWindowSize=0, speckleRange=0, mode=MODES[mode])
    return matcher.compute(left, right)


def confirmed(left, right, max_difference=16):
    """The left disparities (1/16 px) that one of the two pixels they point between confirms."""
    height, width = left.shape
    x = np.arange(width)[None, :]
    y = np.arange(height)[:, None]
    answered = left >= 0
    partners = []
    for rounding in (0, 15):
        at = x - ((left + rounding) >> 4)
        inside = (at >= 0) & (at < width)
        partner = right[y, np.clip(at, 0, width - 1)]
        partners.append(inside & (partner > -DISPARITIES * 16) & (np.abs(left + partner) <= max_difference))
    return np.where(answered & (partners[0] | partners[1]), left, -16)


def filled(disparity):
    """The development kit's interpolation: a gap takes the smaller of its ends, borders the nearest answer of row, then column."""
    out = disparity.copy()
    for row in out:
        answered = np.flatnonzero(row >= 0)
        if answered.size == 0:
            continue
        ends = row[answered]
        gaps = np.searchsorted(answered, np.arange(row.size))
        before, after = np.clip(gaps - 1, 0, None), np.clip(gaps, None, answered.size - 1)
        hole = row < 0
        row[hole] = np.minimum(ends[before], ends[after])[hole]
    for column in out.T:
        answered = np.flatnonzero(column >= 0)
        if answered.size:
            column[: answered[0]], column[answered[-1] + 1 :] = column[answered[0]], column[answered[-1]]
    return out


def depth_scores(depth, truth):
    pixels = (truth > MIN_M) & (truth < MAX_M)
    t, y = truth[pixels].astype(np.float64), depth[pixels].astype(np.float64)
    y = np.where(np.isfinite(y), np.clip(y, MIN_M, MAX_M), MISSING_M)
    ratio, log = np.maximum(y / t, t / y), np.log(y) - np.log(t)
    return {
        "a1": (ratio < 1.25).mean(), "a2": (ratio < 1.25**2).mean(), "a3": (ratio < 1.25**3).mean(), "abs_rel": (abs(y - t) / t).mean(),
        "sq_rel": ((y - t) ** 2 / t).mean(), "rmse": np.sqrt(((y - t) ** 2).mean()), "rmse_log": np.sqrt((log**2).mean()),
        "silog": 0.5 * log.var(),
    }


def disparity_scores(disparity, truth):
    pixels = truth > 0
    d, t = disparity[pixels].astype(np.float64) / 16, truth[pixels].astype(np.float64)
    answered = d > 0
    error = np.abs(d - t)
    scores = {"epe": error[answered].mean(), "density": answered.mean()}
    for x in (0.5, 1, 2, 3, 4):
        scores[f"bad_{x}"] = (~answered | (error > x)).mean()
    scores["d1"] = (~answered | ((error > 3) & (error > 0.05 * t))).mean()
    return scores


def calibration(path, width):
    """Focal length in pixels and baseline in metres."""
    if not path.exists():
        return FOCAL[width], BASELINE
    rows = dict(line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
    left, right = (np.array(rows[name].split(), dtype=float).reshape(3, 4) for name in ("P_rect_02", "P_rect_03"))
    return left[0, 0], (left[0, 3] - right[0, 3]) / left[0, 0]


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("frames", type=pathlib.Path, help="the data set's `training` folder")
    arguments.add_argument("--threads", type=int, default=2)
    arguments.add_argument("--count", type=int, default=6, help="how many frames from 150 on")
    arguments = arguments.parse_args()
    cv2.setNumThreads(arguments.threads)
    started = time.perf_counter()
    rows = {}
    for index in range(150, 150 + arguments.count):
        name = f"{index:06d}_10.png"
        left, right = (
            cv2.cvtColor(cv2.imread(str(arguments.frames / side / name)), cv2.COLOR_BGR2GRAY) for side in ("image_2", "image_3"))
        truth = cv2.imread(str(arguments.frames / "disp_noc_0" / name), cv2.IMREAD_UNCHANGED).astype(np.float32) / 256
        focal, baseline = calibration(arguments.frames / "calib_cam_to_cam" / f"{index:06d}.txt", left.shape[1])
        with np.errstate(divide="ignore"):
            true_m = np.where(truth > 0, focal * baseline / truth, np.nan)
        for block, uniqueness, mode in itertools.product((3, 5, 7, 9), (0, 10), MODES):
            forward = sgbm(left, right, block, uniqueness, mode, 0)
            backward = sgbm(right, left, block, uniqueness, mode, 1 - DISPARITIES)
            kept = confirmed(forward, backward)
            for holes, disparity in (("kept", kept), ("filled", filled(kept))):
                with np.errstate(divide="ignore", invalid="ignore"):
                    depth = np.where(disparity > 0, 16 * focal * baseline / disparity, np.nan)
                    scores = depth_scores(depth, true_m) | disparity_scores(disparity, truth)
                rows.setdefault(f"{block} {uniqueness} {mode} {holes}", []).append(scores)
    means = {key: {name: float(np.mean([row[name] for row in of])) for name in of[0]} for key, of in rows.items()}
    print(json.dumps({"total_s": time.perf_counter() - started, "means": means}))


if __name__ == "__main__":
    main()
