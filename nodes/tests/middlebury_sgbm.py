#!/usr/bin/env python3
"""OpenCV's StereoSGBM on a scene of Middlebury's 2003 sets, quarter size: JSON of the pixels whose truth is known, the share of them that is
answered, and the share that is off by more than 2 px, of all and of those answered.

    middlebury_sgbm.py SCENE
"""
import json
import sys
from pathlib import Path

import cv2
import numpy as np

scene = Path(sys.argv[1])
left, right = (cv2.cvtColor(cv2.imread(str(scene / name)), cv2.COLOR_BGR2GRAY) for name in ("im2.png", "im6.png"))
truth = cv2.imread(str(scene / "disp2.png"), cv2.IMREAD_UNCHANGED)
truth = truth[..., 0] if truth.ndim == 3 else truth
matcher = cv2.StereoSGBM_create(minDisparity=0, numDisparities=64, blockSize=5, P1=200, P2=800, disp12MaxDiff=-1, preFilterCap=63,
                                uniquenessRatio=0, speckleWindowSize=0, mode=cv2.STEREO_SGBM_MODE_SGBM)
found = matcher.compute(left, right)
known = truth > 0
answered = known & (found > 0)
# A grey level is a quarter of a pixel.
wrong = np.abs(found / 16.0 - truth / 4.0) > 2.0
told = {
    "pixels": int(known.sum()),
    "density": float(answered.sum() / known.sum()),
    "all": float((known & (wrong | ~answered)).sum() / known.sum()),
    "answered": float((answered & wrong).sum() / answered.sum()),
}
print(json.dumps(told))
