"""Times OpenCV's StereoSGBM and ours in turn, in one run, on the same real frames. Called by stereo.sh.

Prints for each mode and number of threads the median of both, and `ratio MODE-THREADSt VALUE`: the median over frames of
(OpenCV's best time / our best time). The best of some repetitions of a frame says what the code costs on a machine that
does other things as well; the medians say what was seen.
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
PARAMS = dict(minDisparity=0, numDisparities=64, blockSize=5, P1=200, P2=800, disp12MaxDiff=-1, preFilterCap=63,
              uniquenessRatio=0, speckleWindowSize=0, speckleRange=0)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("binary", type=pathlib.Path)
    parser.add_argument("frames", type=pathlib.Path, help="a folder with image_2 and image_3, as KITTI's training")
    parser.add_argument("--count", type=int, default=5)
    parser.add_argument("--repeat", type=int, default=6)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--modes", nargs="+", default=list(MODES), choices=list(MODES))
    parser.add_argument("--path", default="best", help="best, Avx512, Avx2, Portable or Plain")
    parser.add_argument("--disparities", type=int, default=64)
    args = parser.parse_args()
    params = PARAMS | dict(numDisparities=args.disparities)
    names = [path.name for path in sorted((args.frames / "image_2").glob("*_10.png"))]
    names = [name for name in names if (args.frames / "image_3" / name).exists()][:: max(len(names) // args.count, 1)]
    names = names[: args.count]
    if not names:
        sys.exit(f"no stereo frames in {args.frames}")
    ours = subprocess.Popen([args.binary], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
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
        for mode in args.modes:
            matcher = cv2.StereoSGBM_create(mode=MODES[mode], **params)
            for threads in args.threads:
                cv2.setNumThreads(threads)
                all_theirs, all_ours, ratios = [], [], []
                for (left, right), paths in frames:
                    height, width = left.shape
                    words = [*paths, f"{folder}/out", width, height, 1, mode, args.path, threads, *params.values()]
                    line = " ".join(map(str, words)) + "\n"
                    theirs_ms, ours_ms = [], []
                    for _ in range(args.repeat):
                        start = time.perf_counter()
                        expected = matcher.compute(left, right)
                        theirs_ms.append((time.perf_counter() - start) * 1e3)
                        ours.stdin.write(line)
                        ours.stdin.flush()
                        ours_ms.append(float(ours.stdout.readline()))
                    if not np.array_equal(np.fromfile(f"{folder}/out", np.int16).reshape(height, width), expected):
                        sys.exit(f"{mode}: disparities of {paths[0]} differ from OpenCV's")
                    all_theirs += theirs_ms
                    all_ours += ours_ms
                    ratios.append(min(theirs_ms) / min(ours_ms))
                print(f"{mode:5} {threads} threads: OpenCV median {statistics.median(all_theirs):6.1f} ms, best "
                      f"{min(all_theirs):6.1f}; ours median {statistics.median(all_ours):6.1f} ms, best {min(all_ours):6.1f}")
                print(f"ratio {mode}-{threads}t {statistics.median(ratios):.2f}", flush=True)


if __name__ == "__main__":
    main()
