"""Times OpenCV's imread and the source kitti/stereo2015 in turn, in one run, over the same frames on the same number of threads. Called by reading.sh."""
import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import cv2

FOLDERS = {"image_2": cv2.IMREAD_COLOR, "image_3": cv2.IMREAD_COLOR, "disp_noc_0": cv2.IMREAD_UNCHANGED}


def theirs(folder, names, threads):
    """Seconds; imread works without Python's lock, so that threads work at once."""
    def read(name):
        for side, how in FOLDERS.items():
            if cv2.imread(str(folder / side / name), how) is None:
                raise SystemExit(f"imread failed on {folder / side / name}")
    start = time.perf_counter()
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(read, names))
    return time.perf_counter() - start


def ours(process, threads):
    process.stdin.write(f"{threads}\n")
    process.stdin.flush()
    return float(process.stdout.readline())


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("binary")
    parser.add_argument("root", type=pathlib.Path)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    args = parser.parse_args()
    folder = args.root / "training"
    names = sorted(path.name for path in (folder / "image_2").glob("*_10.png") if (folder / "disp_noc_0" / path.name).exists())
    if not names:
        sys.exit(f"no stereo frames with truth in {folder}")
    cv2.setNumThreads(1)
    params = json.dumps({"root": str(args.root)})
    process = subprocess.Popen([args.binary, "kitti/stereo2015", params], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    print(f"OpenCV {cv2.__version__}, {len(names)} frames of {len(FOLDERS)} PNG files, {args.rounds} rounds in turn")
    ratio = None
    for threads in args.threads:
        # Files into memory, threads awake.
        theirs(folder, names, threads), ours(process, threads)
        seconds = [(theirs(folder, names, threads), ours(process, threads)) for _ in range(args.rounds)]
        a, b = (statistics.median(of) for of in zip(*seconds))
        ratio = statistics.median(of[0] / of[1] for of in seconds)
        print(f"{threads} threads: imread {len(names) / a:.1f} frames/s, ours {len(names) / b:.1f}")
        print(f"ratio read-{threads}t {ratio:.2f}")
    print(f"ratio read {ratio:.2f}")


if __name__ == "__main__":
    main()
