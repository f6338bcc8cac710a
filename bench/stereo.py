"""Times OpenCV's StereoSGBM and StereoBM and ours in turn, in one run, on the same real frames. Called by stereo.sh.

Prints for each matcher and number of threads the median of both, and `ratio MATCHER-THREADSt VALUE`: the median over frames of
(OpenCV's best time / our best time). The best of some repetitions of a frame is the cost of the code on a machine that
does other things as well; the medians include that. OpenCV has nothing like `census-sgm`, which is timed alone and
has no ratio.
"""
import argparse
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import cv2
import numpy as np

MODES = {
    "sgbm": cv2.STEREO_SGBM_MODE_SGBM,
    "hh": cv2.STEREO_SGBM_MODE_HH,
    "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    "hh4": cv2.STEREO_SGBM_MODE_HH4,
}
SGBM = dict(minDisparity=0, numDisparities=64, blockSize=5, P1=200, P2=800, disp12MaxDiff=-1, preFilterCap=63,
            uniquenessRatio=0, speckleWindowSize=0, speckleRange=0)
# OpenCV's defaults, in the order of `bm_raw`.
BM = dict(PreFilterType=1, PreFilterSize=9, PreFilterCap=31, BlockSize=21, MinDisparity=0, NumDisparities=64,
          TextureThreshold=10, UniquenessRatio=15, SpeckleWindowSize=0, SpeckleRange=0, Disp12MaxDiff=-1)
# The defaults of `stereo/census-sgm` (libSGM's): min_disparity disparities p1 p2 uniqueness subpixel lr_max_diff.
CENSUS = dict(min_disparity=0, disparities=64, p1=10, p2=120, uniqueness=5, subpixel=1, lr_max_diff=1)


class Ours:
    """One of the examples, fed a job a line."""

    def __init__(self, binary):
        self.process = subprocess.Popen([binary], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def milliseconds(self, words):
        self.process.stdin.write(" ".join(map(str, words)) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        try:
            return float(answer)
        except ValueError:
            sys.exit(f"{words}: {answer or 'no answer'}")


class Sgbm:
    """OpenCV's StereoSGBM in one mode, and `sgbm_raw`."""

    def __init__(self, mode, args):
        self.mode, self.path = mode, args.path
        self.params = SGBM | dict(numDisparities=args.disparities)
        self.theirs = cv2.StereoSGBM_create(mode=MODES[mode], **self.params)
        self.ours = Ours(args.examples / "sgbm_raw")

    def job(self, paths, out, width, height, threads):
        return [*paths, out, width, height, 1, self.mode, self.path, threads, *self.params.values()]


class Bm:
    """OpenCV's StereoBM, and `bm_raw`."""

    def __init__(self, args):
        self.params = BM | dict(NumDisparities=args.disparities)
        self.theirs = cv2.StereoBM_create()
        for name, value in self.params.items():
            getattr(self.theirs, f"set{name}")(value)
        self.ours = Ours(args.examples / "bm_raw")

    def job(self, paths, out, width, height, threads):
        return ["bm", *paths, out, width, height, threads, *self.params.values()]


class Census:
    """`census_raw`: eight paths over the symmetric census of 9x7."""

    theirs = None

    def __init__(self, args):
        self.params = CENSUS | dict(disparities=args.disparities)
        self.ours = Ours(args.examples / "census_raw")

    def job(self, paths, out, width, height, threads):
        return [*paths, out, width, height, "symmetric", 8, "best", threads, *self.params.values()]


def compare(name, matcher, frames, folder, threads, repeat):
    cv2.setNumThreads(threads)
    all_theirs, all_ours, ratios = [], [], []
    for (left, right), paths in frames:
        height, width = left.shape
        job = matcher.job(paths, f"{folder}/out", width, height, threads)
        theirs_ms, ours_ms = [], []
        for _ in range(repeat):
            if matcher.theirs:
                start = time.perf_counter()
                expected = matcher.theirs.compute(left, right)
                theirs_ms.append((time.perf_counter() - start) * 1e3)
            ours_ms.append(matcher.ours.milliseconds(job))
        all_ours += ours_ms
        if matcher.theirs:
            if not np.array_equal(np.fromfile(f"{folder}/out", np.int16).reshape(height, width), expected):
                sys.exit(f"{name}: disparities of {paths[0]} differ from OpenCV's")
            all_theirs += theirs_ms
            ratios.append(min(theirs_ms) / min(ours_ms))
    ours = f"ours median {statistics.median(all_ours):6.1f} ms, best {min(all_ours):6.1f}"
    if not matcher.theirs:
        print(f"{name:10} {threads} threads: {ours}", flush=True)
        return
    print(f"{name:10} {threads} threads: OpenCV median {statistics.median(all_theirs):6.1f} ms, best {min(all_theirs):6.1f}; {ours}")
    print(f"ratio {name}-{threads}t {statistics.median(ratios):.2f}", flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("examples", type=pathlib.Path, help="the folder of sgbm_raw, bm_raw and census_raw")
    parser.add_argument("frames", type=pathlib.Path, help="a folder with image_2 and image_3, as KITTI's training")
    parser.add_argument("--count", type=int, default=5)
    parser.add_argument("--repeat", type=int, default=6)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    matchers = [*MODES, "bm", "census-sgm"]
    parser.add_argument("--modes", nargs="+", default=matchers, choices=matchers)
    parser.add_argument("--path", default="best", help="of the modes of SGBM: best, avx512, avx2, portable or plain")
    parser.add_argument("--disparities", type=int, default=64)
    args = parser.parse_args()
    names = [path.name for path in sorted((args.frames / "image_2").glob("*_10.png"))]
    names = [name for name in names if (args.frames / "image_3" / name).exists()][:: max(len(names) // args.count, 1)]
    names = names[: args.count]
    if not names:
        sys.exit(f"no stereo frames in {args.frames}")
    with tempfile.TemporaryDirectory() as folder:
        frames = []
        for name in names:
            pair = [cv2.cvtColor(cv2.imread(str(args.frames / side / name)), cv2.COLOR_BGR2GRAY)
                    for side in ("image_2", "image_3")]
            paths = [f"{folder}/{side}-{name}.raw" for side in ("left", "right")]
            for image, path in zip(pair, paths):
                image.tofile(path)
            frames.append((pair, paths))
        print(f"OpenCV {cv2.__version__}, {len(frames)} frames, the first {frames[0][0][0].shape[::-1]}, "
              f"{args.disparities} disparities, {args.repeat} repetitions in turn")
        for name in args.modes:
            matcher = Bm(args) if name == "bm" else Census(args) if name == "census-sgm" else Sgbm(name, args)
            for threads in args.threads:
                compare(name, matcher, frames, folder, threads, args.repeat)


if __name__ == "__main__":
    main()
