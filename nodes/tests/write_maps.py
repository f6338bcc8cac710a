#!/usr/bin/env python3
"""One map of disparities in every form a file may have, by NumPy and OpenCV, as the truth of a scene each.

    write_maps.py FOLDER

Copies FOLDER/scene to FOLDER/<form> and puts the map there as disp0.pfm, whatever it is. The map has 40x30 pixels: at column x and row y
x + 40 y + 0.125, infinite where x is y.
"""
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np

folder = Path(sys.argv[1])
y, x = np.mgrid[:30, :40]
disparities = (x + 40 * y + 0.125).astype(np.float32)
disparities[x == y] = np.inf


def form(name):
    shutil.copytree(folder / "scene", folder / name)
    return folder / name / "disp0.pfm"


for order, scale in (("<", -1.0), (">", 1.0), ("<", -0.00392)):
    with open(form(f"pfm{order}{-scale}"), "wb") as file:
        file.write(f"Pf\n40 30\n{scale}\n".encode())
        np.flipud(disparities).astype(f"{order}f4").tofile(file)
for dtype in ("<f4", ">f4", "<f8", ">f8"):
    with open(form(f"npy{dtype}"), "wb") as file:
        np.save(file, disparities.astype(dtype))
with open(form("npy version 2"), "wb") as file:
    np.lib.format.write_array(file, disparities, version=(2, 0))
written = form("opencv").with_name("opencv.pfm")
cv2.imwrite(str(written), disparities)
written.replace(written.with_name("disp0.pfm"))
