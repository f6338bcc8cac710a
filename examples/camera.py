"""A stereo camera whose images are side by side. The argument is a device number or a video file: `python3 camera.py 0`."""

import sys
import time

import cv2

import depthloom

CALIBRATION = depthloom.Calibration(640, 480, focal_px=530.0, cx_px=319.5, cy_px=239.5, baseline_m=0.06, doffs_px=0.0)


@depthloom.stream(outputs={"left": "image", "right": "image", "calibration": "calibration"})
def camera():
    is_device = sys.argv[1].isdigit()
    video = cv2.VideoCapture(int(sys.argv[1]) if is_device else sys.argv[1])
    while (pair := video.read()[1]) is not None:
        # OpenCV has BGR, depthloom RGB.
        yield {"left": pair[:, :640, ::-1], "right": pair[:, 640:, ::-1], "calibration": CALIBRATION}
        time.sleep(0 if is_device else 1 / video.get(cv2.CAP_PROP_FPS))
    if is_device or not video.isOpened():
        raise OSError(f"{sys.argv[1]} sends no image")


depthloom.serve(camera)
