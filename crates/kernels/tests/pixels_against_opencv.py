#!/usr/bin/env python3
"""Compares the pixel kernels with OpenCV on random images of random sizes.

  pixels_against_opencv.py [--cases N] [--seed S]

Makes a private virtual environment under the target folder with opencv-python-headless and numpy in it, builds the example
`pixels_raw`, and prints for each kernel the cases, the pixels and the largest difference; exit 1 if one exceeds its bound.
"""
import argparse
import pathlib
import subprocess
import sys
import tempfile

from cases import TARGET, WORKSPACE, into_private_environment


class Kernels:
    """The example binary, fed one job at a time."""

    def __init__(self, folder):
        build = ["cargo", "build", "--release", "--quiet", "-p", "depthloom-kernels", "--example", "pixels_raw"]
        subprocess.run(build, cwd=WORKSPACE, check=True)
        self.folder = pathlib.Path(folder)
        binary = TARGET / "release" / "examples" / "pixels_raw"
        self.process = subprocess.Popen([binary], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def run(self, kernel, image, dtype, out_size=None, parameter=0):
        height, width = image.shape[:2]
        out_width, out_height = out_size or (width, height)
        source, result = self.folder / "in.raw", self.folder / "out.raw"
        image.tofile(source)
        job = f"{kernel} {width} {height} {out_width} {out_height} {parameter} {source} {result}\n"
        self.process.stdin.write(job)
        self.process.stdin.flush()
        if self.process.stdout.readline() != "done\n":
            raise SystemExit(f"the kernel failed on: {job}")
        channels = (3,) if kernel == "area" else ()
        return np.fromfile(result, dtype).reshape(out_height, out_width, *channels)


def sizes(rng):
    """A width and a height: mostly small, sometimes a single row or column."""
    return [1 if rng.random() < 0.05 else int(rng.integers(2, 300)) for _ in range(2)]


def depth_map(rng, width, height):
    """Floats with many equal neighbours, as depth maps have."""
    depth = rng.uniform(0.5, 80, (height, width)).astype(np.float32)
    return np.where(rng.random((height, width)) < 0.5, np.round(depth / 8) * 8, depth)


def photo(rng, width, height):
    return rng.integers(0, 256, (height, width, 3), np.uint8)


def case_grey(kernels, rng):
    image = photo(rng, *sizes(rng))
    return kernels.run("grey", image, np.uint8), cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)


def case_edges(kernels, rng):
    width, height = sizes(rng)
    grey = rng.integers(0, 256, (height, width), np.uint8)
    threshold = float(rng.uniform(0, 600))
    theirs = np.abs(cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3)) > np.float32(threshold)
    return kernels.run("edges", grey, np.uint8, parameter=threshold), theirs.astype(np.uint8) * 255


def case_confidence(kernels, rng):
    width, height = sizes(rng)
    mask = (rng.random((height, width)) < rng.choice([0, 0.01, 0.1, 0.9])).astype(np.float32)
    sigma = float(rng.choice([10, rng.uniform(0.5, 12)]))
    theirs = cv2.GaussianBlur(mask, (0, 0), sigma, borderType=cv2.BORDER_REFLECT_101)
    theirs = theirs / theirs.max() if theirs.max() > 0 else theirs
    return kernels.run("confidence", mask.astype(np.uint8) * 255, np.float32, parameter=sigma), theirs


def case_median3(kernels, rng):
    image = depth_map(rng, *sizes(rng))
    return kernels.run("median3", image, np.float32), cv2.medianBlur(image, 3)


def case_median5(kernels, rng):
    image = depth_map(rng, *sizes(rng))
    return kernels.run("median5", image, np.float32), cv2.medianBlur(image, 5)


def case_area_shrink(kernels, rng):
    width, height = sizes(rng)
    small = [int(rng.integers(1, size + 1)) for size in (width, height)]
    if rng.random() < 0.3:   # whole scales take another path in OpenCV
        factors = rng.integers(1, 6, 2)
        width, height = (int(size * factor) for size, factor in zip(small, factors))
    image = photo(rng, width, height)
    return kernels.run("area", image, np.uint8, small), cv2.resize(image, small, interpolation=cv2.INTER_AREA)


def case_area_grow(kernels, rng):
    width, height = sizes(rng)
    size = [int(rng.integers(1, 2 * width + 2)), int(rng.integers(height, 3 * height + 1))]
    image = photo(rng, width, height)
    return kernels.run("area", image, np.uint8, size), cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def case_bilinear(kernels, rng):
    # OpenCV's packages leave maps of floats to Intel's IPP, but single rows and columns to code that rounds positions
    # to 32 bits (7e-6 apart on values up to 1).
    width, height = (max(size, 2) for size in sizes(rng))
    size = [int(rng.integers(1, 600)) for _ in range(2)]
    image = rng.random((height, width)).astype(np.float32)
    return kernels.run("bilinear", image, np.float32, size), cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)


# The largest difference that passes. Sums of floats are added in another order.
CASES = {
    case_grey: 0,
    case_edges: 0,
    case_median3: 0,
    case_median5: 0,
    case_area_shrink: 0,
    case_area_grow: 0,
    case_confidence: 1e-6,
    case_bilinear: 5e-7,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    rng, failed = np.random.default_rng(args.seed), False
    print(f"OpenCV {cv2.__version__}, NumPy {np.__version__}, {args.cases} cases a kernel, seed {args.seed}")
    with tempfile.TemporaryDirectory() as folder:
        kernels = Kernels(folder)
        for case, bound in CASES.items():
            largest, pixels, differing, worst = 0.0, 0, 0, ""
            for _ in range(args.cases):
                ours, theirs = case(kernels, rng)
                theirs = theirs.reshape(ours.shape)
                difference = np.abs(ours.astype(np.float64) - theirs.astype(np.float64))
                pixels += difference.size
                differing += np.count_nonzero(difference)
                if not difference.max() <= largest:
                    largest, worst = difference.max(), f" (at {ours.shape[1]} x {ours.shape[0]})"
            verdict = "ok" if largest <= bound else "FAILED"
            failed |= verdict == "FAILED"
            print(f"{case.__name__[5:]:12} {pixels:9} samples, {differing:8} differ, at most by {largest:.3g}{worst}: {verdict}")
    sys.exit(failed)


if __name__ == "__main__":
    into_private_environment()
    import cv2
    import numpy as np

    main()
