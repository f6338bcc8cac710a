#!/usr/bin/env python3
"""Compares the weighted-least-squares filter of disparity maps with OpenCV's, pixel by pixel.

    wls_against_opencv.py [--cases 300] [--seed 1] [--threads 1 2 5] [--frames ../shared/data/kitti_stereo_2015/training] [--count 4]

On random images and maps, and on KITTI frames matched by OpenCV's StereoSGBM:

- plain: `DisparityWLSFilter` without confidence, of maps answered in every pixel of its region of interest;
- right: `DisparityWLSFilter` with the confidence that the right view gives, of such maps;
- gappy: the quotient of two `FastGlobalSmootherFilter`s over disparity times answered and answered, which is what the
  filter makes of confidences, for maps with gaps, and for every attenuation and number of iterations.

OpenCV runs with one thread: with several it cuts its vectors elsewhere and its own sixteenths change. Makes a private
virtual environment under the target folder with opencv-contrib-python-headless and numpy in it and builds the example
`wls_raw`. Prints how many pixels differ and by how much, and exits 1 if one does. (On machines other than x86-64,
OpenCV may round elsewhere: there, differences of a sixteenth are to be expected.)
"""
import argparse
import os
import pathlib
import subprocess
import sys
import tempfile
import time

from cases import TARGET, WORKSPACE, into_private_environment

SHARED = pathlib.Path(os.environ.get("DEPTHLOOM_SHARED", WORKSPACE.parent / "shared"))
PACKAGES = ["opencv-contrib-python-headless==5.0.*", "numpy"]
LEAST_CONFIDENCE = 1e-30


class Ours:
    """The example `wls_raw`, fed through files."""

    def __init__(self, folder):
        self.process = subprocess.Popen([TARGET / "release" / "examples" / "wls_raw"], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True)
        self.files = [f"{folder}/{name}" for name in ("guide", "left", "right", "out")]
        self.milliseconds = None

    def smooth(self, guide, left, invalid, params, threads, right=None, invalid_right=0):
        guide.tofile(self.files[0])
        left.tofile(self.files[1])
        if right is not None:
            right.tofile(self.files[2])
        channels = guide.shape[2] if guide.ndim == 3 else 1
        words = [*self.files[:2], "-" if right is None else self.files[2], self.files[3], left.shape[1], left.shape[0],
                 channels, threads, invalid, invalid_right, params["difference"], params["radius"], 1,
                 params["iterations"], params["lambda"], params["sigma"], params["attenuation"]]
        self.process.stdin.write(" ".join(map(str, words)) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            sys.exit(f"no answer to {words}")
        self.milliseconds = float(answer)
        return np.fromfile(self.files[3], np.int16).reshape(left.shape)


class Tally:
    """Differences of one kind of case."""

    def __init__(self, name):
        self.name, self.cases, self.pixels, self.unreached, self.differing, self.largest = name, 0, 0, 0, 0, 0

    def compare(self, got, expected, invalid, reached, what):
        """`reached`: where OpenCV's own smoothed confidence is more than nothing; elsewhere we give no answer."""
        self.cases += 1
        self.pixels += expected.size
        expected = np.where(reached, expected, invalid)
        self.unreached += int((~reached).sum())
        wrong = got != expected
        if wrong.any():
            y, x = np.argwhere(wrong)[0]
            difference = np.abs(got.astype(int) - expected)
            self.differing += int(wrong.sum())
            self.largest = max(self.largest, int(difference.max()))
            print(f"{self.name}: {what}: {wrong.sum()} of {wrong.size} pixels differ by up to {difference.max()}, the first at "
                  f"row {y} column {x}: ours {got[y, x]}, OpenCV's {expected[y, x]}")

    def __str__(self):
        return (f"{self.name}: {self.cases} maps, {self.pixels} pixels, {self.unreached} out of confidence's reach: "
                f"{self.differing} differ, by at most {self.largest} sixteenths")


def opencv(guide, left, region, params, right=None):
    """OpenCV's filter over `region` (x, y, width, height), and where confidence reaches."""
    wls = cv2.ximgproc.createDisparityWLSFilterGeneric(right is not None)
    wls.setLambda(params["lambda"])
    wls.setSigmaColor(params["sigma"])
    wls.setLRCthresh(params["difference"])
    wls.setDepthDiscontinuityRadius(params["radius"])
    start = time.perf_counter()
    out = wls.filter(left, guide, disparity_map_right=right, ROI=region)
    milliseconds = (time.perf_counter() - start) * 1e3
    reached = np.ones(left.shape, bool)
    if right is not None:
        x, y, width, height = region
        inside = np.ascontiguousarray(guide[y:y + height, x:x + width])
        confidence = wls.getConfidenceMap()[y:y + height, x:x + width].copy()
        smoothed = cv2.ximgproc.fastGlobalSmootherFilter(inside, confidence, params["lambda"], params["sigma"])
        reached[y:y + height, x:x + width] = smoothed >= LEAST_CONFIDENCE
    return out, reached, milliseconds


def quotient(guide, left, invalid, params):
    """Two smoothers and a division, over the rectangle of the answered pixels."""
    rows, columns = [np.flatnonzero((left != invalid).any(axis)) for axis in (1, 0)]
    expected, reached = np.full_like(left, invalid), np.ones(left.shape, bool)
    if not rows.size:
        return expected, reached
    place = np.s_[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1]
    if rows[-1] == rows[0]:  # OpenCV reads a second row that is not there.
        return None, None
    inside = left[place]
    answered = (inside != invalid).astype(np.float32)
    smoother = cv2.ximgproc.createFastGlobalSmootherFilter(np.ascontiguousarray(guide[place]), params["lambda"], params["sigma"],
                                                           params["attenuation"], params["iterations"])
    weighted, confidence = smoother.filter(answered * inside), smoother.filter(answered)
    reached[place] = confidence >= LEAST_CONFIDENCE
    with np.errstate(all="ignore"):
        result = weighted * (1 / confidence) if (answered == 0).any() else weighted
        expected[place] = np.where(reached[place], np.rint(result), 0).astype(np.int16)
    return expected, reached


def draw(rng):
    """A guide of flat patches and noise, and a map whose steps are mostly at the edges of the patches."""
    height, width = (int(side) for side in rng.integers(2, 120, 2))
    patch = rng.integers(1, 30, 2)
    labels = (np.arange(height)[:, None] // patch[0]) * 31 + (np.arange(width)[None, :] // patch[1]) * 17
    channels = int(rng.choice([1, 3]))
    colours = rng.integers(0, 256, (int(labels.max()) + 1, channels))
    noise = rng.integers(0, int(rng.choice([1, 3, 9, 60])), (height, width, channels))
    guide = np.clip(colours[labels] + noise, 0, 255).astype(np.uint8)
    depths = 16 * rng.integers(0, 64, int(labels.max()) + 1)
    left = (depths[labels] + rng.integers(0, int(rng.choice([1, 8, 64])), (height, width))).astype(np.int16)
    params = {"lambda": float(rng.choice([0, 1, 100, 8000, 20000])), "sigma": float(rng.choice([0.5, 0.8, 1.0, 1.5, 2.0, 30.0])),
              "attenuation": 0.25, "iterations": 3, "radius": int(rng.integers(0, 9)), "difference": int(rng.integers(1, 60))}
    return np.ascontiguousarray(guide[:, :, 0] if channels == 1 else guide), left, params


def inside_of(rng, height, width):
    x, y = int(rng.integers(0, max(width // 2, 1))), int(rng.integers(0, max(height // 3, 1)))
    return x, y, int(rng.integers(1, width - x + 1)), int(rng.integers(min(2, height - y), height - y + 1))


def only(disparity, region, invalid):
    x, y, width, height = region
    result = np.full_like(disparity, invalid)
    result[y:y + height, x:x + width] = disparity[y:y + height, x:x + width]
    return result


def random_case(rng, ours, tallies, threads):
    guide, left, params = draw(rng)
    height, width = left.shape
    region = inside_of(rng, height, width)
    if region[3] < 2:
        return
    invalid = -16
    what = f"{width}x{height} region {region} {params} {threads} threads"
    expected, reached, _ = opencv(guide, left, region, params)
    tallies[0].compare(ours.smooth(guide, only(left, region, invalid), invalid, params, threads), expected, invalid, reached, what)

    columns = np.clip(np.arange(width)[None, :] + rng.integers(-2, 3, left.shape) + 10, 0, width - 1)
    right = (-np.take_along_axis(left, columns, 1) + rng.integers(-30, 31, left.shape)).astype(np.int16)
    expected, reached, _ = opencv(guide, left, region, params, right)
    mirrored = (width - region[0] - region[2], *region[1:])
    got = ours.smooth(guide, only(left, region, invalid), invalid, params, threads, only(right, mirrored, 32767), 32767)
    tallies[1].compare(got, expected, invalid, reached, what)

    gappy = left.copy()
    gappy[rng.random(left.shape) < rng.choice([0.05, 0.5, 0.95, 0.995])] = invalid
    params |= {"attenuation": float(rng.choice([0.1, 0.25, 1.0])), "iterations": int(rng.integers(1, 6))}
    expected, reached = quotient(guide, gappy, invalid, params)
    if expected is not None:
        tallies[2].compare(ours.smooth(guide, gappy, invalid, params, threads), expected, invalid, reached, what)


def frame_case(frames, name, ours, tallies):
    images = [cv2.imread(str(frames / side / name)) for side in ("image_2", "image_3")]
    guide = images[0]
    matcher = cv2.StereoSGBM_create(0, 64, 5, P1=200, P2=800, disp12MaxDiff=1000000, preFilterCap=63)
    left, right = matcher.compute(*images), cv2.ximgproc.createRightMatcher(matcher).compute(*reversed(images))
    height, width = left.shape
    # The right matcher never searches its first column, whose partner is the left image's last one.
    region = (64, 0, width - 65, height)
    params = {"lambda": 8000.0, "sigma": 1.0, "attenuation": 0.25, "iterations": 3, "radius": 3, "difference": 24}
    cropped = only(left, region, -16)
    times = []
    for threads in (1, 2):
        for tally, other in zip(tallies, (None, right)):
            expected, reached, theirs = opencv(guide, left, region, params, other)
            got = ours.smooth(guide, cropped, -16, params, threads, other, -64 * 16)
            tally.compare(got, expected, -16, reached, f"{name} {threads} threads")
            times.append(f"{tally.name} {ours.milliseconds:.1f} ms with {threads} threads, OpenCV {theirs:.1f} with 1")
    print(f"{name}: " + "; ".join(times))
    checked = cv2.StereoSGBM_create(0, 64, 5, P1=200, P2=800, disp12MaxDiff=1, uniquenessRatio=5, preFilterCap=63,
                                    speckleWindowSize=100, speckleRange=2).compute(*images)
    expected, reached = quotient(guide, checked, -16, params)
    tallies[2].compare(ours.smooth(guide, checked, -16, params, 2), expected, -16, reached, name)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2, 5])
    parser.add_argument("--frames", type=pathlib.Path, default=SHARED / "data/kitti_stereo_2015/training")
    parser.add_argument("--count", type=int, default=4)
    args = parser.parse_args()
    build = ["cargo", "build", "--release", "--quiet", "-p", "depthloom-kernels", "--example", "wls_raw"]
    subprocess.run(build, cwd=WORKSPACE, check=True)
    cv2.setNumThreads(1)
    rng = np.random.default_rng(args.seed)
    tallies = [Tally(name) for name in ("plain", "right", "gappy")]
    with tempfile.TemporaryDirectory() as folder:
        ours = Ours(folder)
        for case in range(args.cases):
            random_case(rng, ours, tallies, args.threads[case % len(args.threads)])
        names = [path.name for path in sorted((args.frames / "image_2").glob("*_10.png"))]
        names = [name for name in names if (args.frames / "image_3" / name).exists()]
        for name in names[:: max(len(names) // max(args.count, 1), 1)][: args.count]:
            frame_case(args.frames, name, ours, tallies)
        if not names:
            print(f"SKIPPED the KITTI frames: none in {args.frames}")
        ours.process.stdin.close()
        ours.process.wait()
    print(f"OpenCV {cv2.__version__}, {args.cases} random cases, {min(len(names), args.count)} frames")
    print(*tallies, sep="\n")
    sys.exit(1 if any(tally.differing for tally in tallies) else 0)


if __name__ == "__main__":
    into_private_environment("venv-opencv-contrib", PACKAGES)
    import cv2
    import numpy as np

    main()
