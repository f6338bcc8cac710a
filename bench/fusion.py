"""The measuring half of fusion.sh: times the oracle's chain and ours in turn on the same frames."""
import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import cv2
import numpy as np

VARIANTS = ("full", "no_weighting", "no_scaling", "average_scaling")


def inputs(oracle, shared, number):
    """Grey, fixed-point disparity and mono depth of a frame: what both sides start from."""
    frames = shared / "data/kitti_stereo_2015/training"
    name = f"{number:06d}_10.png"
    left, right = (cv2.cvtColor(cv2.imread(str(frames / side / name)), cv2.COLOR_BGR2GRAY) for side in ("image_2", "image_3"))
    focal = oracle.FOCAL_BY_WIDTH[left.shape[1]]
    return left, oracle.sgbm(left, right), oracle.ground_plane(left.shape, focal), focal


def theirs(oracle, grey, fixed, mono, focal):
    """The oracle's chain, with its own functions."""
    stereo = np.minimum(oracle.depth_from_disparity(fixed, focal, oracle.BASELINE), np.float32(oracle.CAP))
    w_c = oracle.confidence(grey)
    fused = {}
    for variant in VARIANTS:
        how, weighting = oracle.VARIANTS[variant]
        fused[variant] = oracle.fuse(stereo, oracle.scale(mono, stereo, how), w_c, weighting)
    return fused


class Ours:
    """The example binary holding one frame, run on demand."""

    def __init__(self, binary, folder, grey, fixed, mono, focal):
        self.shape = grey.shape
        self.out = folder
        for name, array in (("grey", grey), ("disparity", fixed), ("mono", mono)):
            array.tofile(folder / name)
        files = [str(folder / name) for name in ("grey", "disparity", "mono")]
        self.command = [str(binary), str(grey.shape[1]), str(grey.shape[0]), str(focal), *files, str(folder)]
        self.process = subprocess.Popen(self.command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def run(self, command):
        """Milliseconds of the chain once, and of its steps."""
        self.process.stdin.write(f"{command}\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def fused(self, variant):
        return np.fromfile(self.out / f"{variant}.raw", np.float32).reshape(self.shape)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--shared", type=pathlib.Path, required=True)
    parser.add_argument("--ours", type=pathlib.Path, required=True)
    parser.add_argument("--frames", default="150,151,152")
    parser.add_argument("--rounds", type=int, default=30)
    args = parser.parse_args()
    sys.path.insert(0, str(args.shared / "oracle"))
    import oracle

    spent = {1: ([], []), 2: ([], [])}
    steps = {}
    for number in map(int, args.frames.split(",")):
        frame = inputs(oracle, args.shared, number)
        with tempfile.TemporaryDirectory() as folder:
            ours = Ours(args.ours, pathlib.Path(folder), *frame)
            for threads, (their_ms, our_ms) in spent.items():
                cv2.setNumThreads(threads)
                theirs(oracle, *frame), ours.run(threads)   # warm both
                for _ in range(args.rounds):
                    began = time.perf_counter()
                    fused = theirs(oracle, *frame)
                    their_ms.append((time.perf_counter() - began) * 1e3)
                    lap = ours.run(threads)
                    our_ms.append(lap.pop("total"))
                    for step, ms in lap.items():
                        steps.setdefault((threads, step), []).append(ms)
            ours.run("write")
            for variant in VARIANTS:
                difference = np.abs(ours.fused(variant) - fused[variant])
                share = (difference <= 1 / 256).mean()
                print(f"frame {number} {variant:16} {share:.6f} of pixels within 1/256 m, at most {difference.max():.2g} m apart")
                if share < 0.999:
                    raise SystemExit("the two chains disagree: the times mean nothing")
    print(f"OpenCV {cv2.__version__}, NumPy {np.__version__}, frames {args.frames}, {args.rounds} rounds each, milliseconds a frame")
    for threads, (their_ms, our_ms) in spent.items():
        ours_by_step = ", ".join(f"{step} {statistics.median(ms):.2f}" for (t, step), ms in steps.items() if t == threads)
        print(f"{threads} thread(s): theirs {statistics.median(their_ms):.2f} (best {min(their_ms):.2f}), "
              f"ours {statistics.median(our_ms):.2f} (best {min(our_ms):.2f}: {ours_by_step})")
    for threads, (their_ms, our_ms) in spent.items():
        print(f"ratio fusion-{threads}t {statistics.median(their_ms) / statistics.median(our_ms):.2f}")


if __name__ == "__main__":
    main()
