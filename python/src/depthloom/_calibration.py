"""The calibration of a rectified pair, or of a single camera."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Calibration:
    """The cameras of a rectified pair. All values are pixels, except the baseline, which is in metres."""

    width: int
    height: int
    focal_px: float
    cx_px: float
    cy_px: float
    #: The distance between the two cameras' centres, metres; 0 for a single camera.
    baseline_m: float
    #: The right camera's principal point minus the left one's, in x: depth is `focal_px * baseline_m / (disparity + doffs_px)`.
    doffs_px: float
