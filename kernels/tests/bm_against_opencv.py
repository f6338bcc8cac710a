#!/usr/bin/env python3
"""Draws random images and parameters and compares `bm` with OpenCV's own StereoBM, pixel by pixel.

    bm_against_opencv.py [--cases 400] [--seed 1] [--threads 1 2 5]

Makes a private virtual environment under the target folder with opencv-python-headless and numpy in it and builds the
example `bm_raw`. OpenCV runs with one thread: with several, what it writes beyond the right border at a positive
minDisparity depends on which stripe ends last. Its output is filled with "no answer" first: where no block lies inside
both images it writes nothing. Not drawn is what OpenCV answers from memory it never wrote or does not own (`undefined`).
What OpenCV refuses must be refused. Prints what differs and exits 1, or says that nothing does.
"""
import argparse
import os
import pathlib
import subprocess
import sys
import tempfile
import venv

WORKSPACE = pathlib.Path(__file__).resolve().parents[3]
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", WORKSPACE / "target"))
PACKAGES = ["opencv-python-headless==5.0.*", "numpy"]


def into_private_environment():
    """Runs this script again with the private environment's Python, which is made if it is not there."""
    place = TARGET / "venv-opencv"
    python = place / "bin" / "python"
    if pathlib.Path(sys.prefix) == place:
        return
    if not (place / "ready").exists():
        venv.create(place, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
        (place / "ready").touch()
    os.execv(python, [str(python), *sys.argv])


def texture(rng, height, width):
    """One of several kinds of image: noise, blurred noise, steps, saturated noise, nearly flat."""
    kind = rng.integers(5)
    image = rng.integers(0, 256, (height, width)).astype(np.float32)
    if kind == 1:
        image = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.5, 3)))
        image = (image - image.min()) * (255 / max(np.ptp(image), 1))
    elif kind == 2:
        image = np.repeat(np.repeat(image[::5, ::7], 5, 0), 7, 1)[:height, :width]
    elif kind == 3:
        image = np.where(image > 128, 255, 0)
    elif kind == 4:
        image = 100 + image / 64
    return np.clip(image, 0, 255).astype(np.uint8)


def pair(rng, height, width, reach):
    """A left image, and a right image that shows it shifted by a disparity that changes along and across."""
    left = texture(rng, height, width)
    if rng.random() < 0.1:
        return left, texture(rng, height, width)
    rows, columns = np.mgrid[0:height, 0:width]
    shift = reach * (0.5 + 0.4 * np.sin(rows / rng.uniform(3, 40) + columns / rng.uniform(10, 80)))
    right = np.take_along_axis(left, np.clip(columns + shift.astype(int), 0, width - 1), 1)
    return left, np.clip(right + rng.normal(0, rng.uniform(0, 8), right.shape), 0, 255).astype(np.uint8)


def draw(rng):
    """A size and parameters, under OpenCV's names."""
    odd = lambda low, high: int(rng.integers(low // 2, high // 2)) * 2 + 1
    block = int(rng.choice([5, 7, 9, 11, 15, 21, 21, 23, 31, odd(5, 63)]))
    count = 16 * int(rng.choice([1, 2, 3, 4, 4, 5, 6, 8, 9, 12, 16]))
    smallest = int(rng.choice([0, 0, rng.integers(-40, 40), rng.integers(1, 20), rng.integers(-300, 0)]))
    border = max(smallest + count - 1, 0) + 2 * (block // 2)
    roomy = [border + rng.integers(10, 200)] * 3
    width = int(rng.choice([rng.integers(1, 90), border + rng.integers(0, 12), *roomy]))
    roomy = [block + rng.integers(1, 120)] * 4
    height = int(rng.choice([rng.integers(1, 40), block + rng.integers(0, 5), *roomy]))
    params = dict(
        PreFilterType=int(rng.choice([0, 1, 1])), PreFilterSize=int(rng.choice([5, 7, 9, 9, 21, odd(5, 255)])),
        PreFilterCap=int(rng.choice([1, 10, 31, 31, 31, 32, 63, rng.integers(1, 64)])), BlockSize=block,
        MinDisparity=smallest, NumDisparities=count, TextureThreshold=int(rng.choice([0, 10, 10, 10, 500, 5000])),
        UniquenessRatio=int(rng.choice([0, 0, 5, 5, 15, 15, 40, 100, 1000])),
        SpeckleWindowSize=int(rng.choice([0, 0, 1, 20, 100])), SpeckleRange=int(rng.choice([-1, 0, 1, 2, 16, 32])),
        Disp12MaxDiff=int(rng.choice([-1, -1, 0, 1, 2, 5, 1000])))
    if rng.random() < 0.08:  # something that OpenCV refuses
        wrong = dict(PreFilterSize=[4, 6, 257], PreFilterCap=[0, 64], BlockSize=[1, 3, 8, 257], NumDisparities=[0, 24, -16],
                     TextureThreshold=[-1], UniquenessRatio=[-5])
        name = str(rng.choice(list(wrong)))
        params[name] = int(rng.choice(wrong[name]))
    return width, height, params


def undefined(width, height, params):
    """Why OpenCV's answer is not determined by the images and parameters, or None."""
    size = params["PreFilterSize"]
    if params["PreFilterType"] == 0 and size // 2 > height:
        return "the prefilter's window reads behind the image"
    if params["PreFilterType"] == 0 and (size in (51, 53) or 73 <= size <= 89):
        return "the prefilter's response leaves its table"
    if params["Disp12MaxDiff"] >= 0 and (params["PreFilterCap"] > 31 or params["BlockSize"] > 21):
        return "32-bit costs are checked as if they were 16-bit, in part without having been written"
    return None


def opencv(left, right, params):
    matcher = cv2.StereoBM_create()
    for name, value in params.items():
        getattr(matcher, "set" + name)(value)
    disparity = np.full(left.shape, (params["MinDisparity"] - 1) * 16, np.int16)
    try:
        return matcher.compute(left, right, disparity)
    except cv2.error:
        return None


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2, 5])
    args = parser.parse_args()
    build = ["cargo", "build", "--release", "--quiet", "-p", "depthloom-kernels", "--example", "bm_raw"]
    subprocess.run(build, cwd=WORKSPACE, check=True)
    cv2.setNumThreads(1)
    rng = np.random.default_rng(args.seed)
    binary = TARGET / "release" / "examples" / "bm_raw"
    ours = subprocess.Popen([binary], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    differing = answered = refused = left_out = done = 0
    with tempfile.TemporaryDirectory() as folder:
        files = [f"{folder}/{name}" for name in ("left", "right", "out")]
        while done < args.cases:
            width, height, params = draw(rng)
            left, right = pair(rng, height, width, params["MinDisparity"] + params["NumDisparities"] / 2)
            if undefined(width, height, params):
                left_out += 1
                continue
            done += 1
            left.tofile(files[0])
            right.tofile(files[1])
            expected = opencv(left, right, params)
            words = ["bm", *files, width, height, args.threads[done % len(args.threads)], *params.values()]
            ours.stdin.write(" ".join(map(str, words)) + "\n")
            ours.stdin.flush()
            answer = ours.stdout.readline()
            if not answer:
                sys.exit(f"case {done}: no answer to {words}")
            if expected is None or answer.startswith("refused"):
                refused += 1
                if expected is not None or not answer.startswith("refused"):
                    differing += 1
                    print(f"case {done}: {width}x{height} {params}: OpenCV "
                          f"{'refuses' if expected is None else 'accepts'}, ours: {answer}")
                continue
            got = np.fromfile(files[2], np.int16).reshape(height, width)
            answered += int((expected != (params["MinDisparity"] - 1) * 16).sum())
            if not np.array_equal(got, expected):
                differing += 1
                wrong = np.argwhere(got != expected)
                y, x = wrong[0]
                print(f"case {done}: {width}x{height} {params}: {len(wrong)} of {got.size} pixels differ, first at row {y} "
                      f"column {x}: ours {got[y, x]}, OpenCV's {expected[y, x]}")
    ours.stdin.close()
    ours.wait()
    print(f"{done} cases with OpenCV {cv2.__version__}, {refused} refused by both, {left_out} more undefined in OpenCV, "
          f"{answered} answered pixels: {differing} cases differ")
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    into_private_environment()
    import cv2
    import numpy as np

    main()
