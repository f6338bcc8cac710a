"""What is known of a pair's cameras."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Calibration:
    """A rectified pair's cameras: pixels, except the baseline, which is in metres."""

    width: int
    height: int
    focal_px: float
    cx_px: float
    cy_px: float
    #: The distance between the two cameras' centres, metres.
    baseline_m: float
    #: How much farther right the right camera's principal point lies: depth is `focal_px * baseline_m / (disparity + doffs_px)`.
    doffs_px: float
