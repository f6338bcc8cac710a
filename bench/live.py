"""Runs the on-board experiment live, and a Python loop that does the same work. Called by live.sh.

The loop captures frames in a thread of its own into a slot for one frame, so that the newest wins, as ours does. It records the same
maps: both images, disparity, depth, confidence, monocular depth, merged and fused depth.
"""
import argparse
import json
import pathlib
import subprocess
import tempfile
import threading
import time

import cv2
import numpy as np
import onnxruntime
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.writer import CompressionType
from mcap_protobuf.writer import Writer

CAP = np.float32(10)
FASTEST = 1000  # frames per second that neither can process


def run(*command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if done.returncode not in (0, 3):
        raise SystemExit(f"{' '.join(map(str, command))} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.stdout


class Loop:
    """The experiment's nodes in OpenCV, ONNX Runtime and NumPy."""

    def __init__(self, model, focal, baseline, record):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 2
        self.session = onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])
        self.input = self.session.get_inputs()[0]
        self.focal_baseline = np.float32(focal * baseline)
        self.matcher = cv2.StereoSGBM_create(minDisparity=0, numDisparities=64, blockSize=5, P1=200, P2=800, disp12MaxDiff=1,
                                             preFilterCap=63, uniquenessRatio=10, speckleWindowSize=0, speckleRange=0,
                                             mode=cv2.STEREO_SGBM_MODE_SGBM)
        self.writer = Writer(record, chunk_size=4 << 20, compression=CompressionType.ZSTD)

    def process(self, left, right):
        grey_left, grey_right = (cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (left, right))
        disparity = self.matcher.compute(grey_left, grey_right)
        with np.errstate(divide="ignore"):
            depth = np.where(disparity > 0, self.focal_baseline / (disparity.astype(np.float32) / np.float32(16)), np.nan)
        depth = np.minimum(depth, CAP)
        edges = (np.abs(cv2.Sobel(grey_left, cv2.CV_32F, 1, 0, ksize=3)) > 100).astype(np.float32)
        blurred = cv2.GaussianBlur(edges, (0, 0), 10, borderType=cv2.BORDER_REFLECT_101)
        confidence = blurred / blurred.max() if blurred.max() > 0 else blurred
        _, _, height, width = self.input.shape
        small = cv2.resize(left, (width, height), interpolation=cv2.INTER_AREA)[:, :, ::-1].astype(np.float32) / np.float32(255)
        output = self.session.run(None, {self.input.name: np.ascontiguousarray(small.transpose(2, 0, 1)[None])})[0][0, 0]
        mono = np.minimum(cv2.resize(output, left.shape[1::-1], interpolation=cv2.INTER_LINEAR), CAP)
        share, mono_share = depth / np.nanmax(depth), mono / mono.max()
        weight = np.minimum(share, mono_share) / np.maximum(share, mono_share)
        merged = confidence * depth + (1 - confidence) * (weight * depth + (1 - weight) * mono)
        merged = np.where(np.isnan(depth), mono, merged).astype(np.float32)
        fused = cv2.medianBlur(merged, 5)
        maps = {"disparity": (disparity.view(np.uint16), "16UC1"), "left": (left, "bgr8"), "right": (right, "bgr8")}
        floats = {"depth": depth, "confidence": confidence, "mono": mono, "merged": merged, "fused": fused}
        return maps | {name: (value.astype(np.float32), "32FC1") for name, value in floats.items()}

    def record(self, maps, stamp):
        for name, (array, encoding) in maps.items():
            message = RawImage(width=array.shape[1], height=array.shape[0], encoding=encoding, step=array.strides[0],
                               data=np.ascontiguousarray(array).tobytes(), frame_id="left")
            message.timestamp.FromNanoseconds(stamp)
            self.writer.write_message(topic=f"/{name}", message=message, log_time=stamp, publish_time=stamp)

    def play(self, frames, rate, seconds):
        """Plays frames at a rate; returns the rate processed, the number dropped, and the latencies in ms."""
        slot, ready, over = [None], threading.Condition(), [False]
        dropped = [0]

        def capture():
            start = time.perf_counter()
            for number in range(max(1, int(rate * seconds))):
                time.sleep(max(0.0, start + number / rate - time.perf_counter()))
                with ready:
                    dropped[0] += slot[0] is not None
                    slot[0] = (time.perf_counter(), frames[number % len(frames)])
                    ready.notify()
            with ready:
                over[0] = True
                ready.notify()

        self.record(self.process(*frames[0]), time.time_ns())  # starts the network
        thread = threading.Thread(target=capture)
        began = time.perf_counter()
        thread.start()
        latencies = []
        while True:
            with ready:
                ready.wait_for(lambda: slot[0] is not None or over[0])
                taken, slot[0] = slot[0], None
            if taken is None:
                break
            captured, pair = taken
            maps = self.process(*pair)
            latencies.append((time.perf_counter() - captured) * 1e3)
            self.record(maps, time.time_ns())
        thread.join()
        elapsed = time.perf_counter() - began
        return len(latencies) / elapsed, dropped[0], np.array(latencies)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("depthloom", type=pathlib.Path)
    parser.add_argument("experiment", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement")
    parser.add_argument("--steps", type=int, default=500, help="of the training")
    parser.add_argument("--frames", type=int, default=40, help="that are repeated")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        measure(args, pathlib.Path(work))


def measure(args, work):
    runs = work / "runs"
    changes = ["--set", f"learn.coarse.with.steps={args.steps}", "--set", f"sources.flight.with.frames=0..{args.frames}", "--runs", runs]
    print("trains the network ...", flush=True)
    run(args.depthloom, "run", args.experiment, *changes, "--no-page", "--quiet", "--out", runs / "batch")
    model = next((runs / "batch" / "models").glob("*.onnx"))
    run(args.depthloom, "synth", work / "street", "--frames", args.frames, "--seed", 2, "--width", 640, "--height", 480, "--quiet")
    read = lambda side: [cv2.imread(str(path)) for path in sorted((work / "street" / "training" / side).glob("*_10.png"))]
    frames = list(zip(read("image_2"), read("image_3")))
    calibration = calibration_of(work / "street")

    def ours(rate, *options):
        options = ["--rate", rate, "--for", f"{args.seconds}s", "--preload", args.frames, "--repeat", "--allow-drops", "--json",
                   "--overwrite", "--out", runs / "live", *options]
        return json.loads(run(args.depthloom, "live", args.experiment, *changes, *options))

    def theirs(rate):
        cv2.setNumThreads(2)
        with open(work / "peer.mcap", "wb") as record:
            loop = Loop(model, *calibration, record)
            result = loop.play(frames, rate, args.seconds)
            loop.writer.finish()
        return result

    def shown(side, rate, processed, dropped, p50, p99, note=""):
        print(f"{side:7} offered {rate:6.1f}/s  processed {processed:5.1f}/s  dropped {dropped:5}  p50 {p50:6.1f} ms  p99 {p99:6.1f} ms{note}", flush=True)

    def show_ours(rate, result, note=""):
        per_second = result["processed"] / result["elapsed_s"]
        shown("ours", rate, per_second, sum(result["dropped"].values()), result["frames"]["p50_ms"], result["frames"]["p99_ms"], note)
        return per_second, result["frames"]["p99_ms"]

    def show_theirs(rate, result):
        processed, dropped, latencies = result
        p50, p99 = np.percentile(latencies, [50, 99])
        shown("theirs", rate, processed, dropped, p50, p99)
        return processed, p99

    show_ours(30, ours(30))
    show_theirs(30, theirs(30))
    _, our_p99 = show_ours(25, ours(25, "--deadline", "60ms"))
    _, their_p99 = show_theirs(25, theirs(25))
    highest, _ = show_ours(FASTEST, ours(FASTEST), "  (highest rate)")
    their_highest, _ = show_theirs(FASTEST, theirs(FASTEST))
    unloaded = ours(max(1.0, highest / 2))
    _, unloaded_p99 = show_ours(highest / 2, unloaded, "  (half the highest rate)")
    twice = ours(2 * highest)
    _, twice_p99 = show_ours(2 * highest, twice, "  (twice the highest rate)")
    if twice["offered"] != twice["processed"] + sum(twice["dropped"].values()):
        raise SystemExit(f"frames are missing: {twice}")
    print(f"live p99 at twice the rate / at half the rate: {twice_p99 / unloaded_p99:.2f}")
    print(f"ratio live-rate {highest / their_highest:.2f}")
    print(f"ratio live-p99 {their_p99 / our_p99:.2f}")


def calibration_of(street):
    """Focal length in pixels and baseline in metres, of the first frame."""
    text = next((street / "training" / "calib_cam_to_cam").glob("*.txt")).read_text()
    rows = {line.split(":")[0]: line.split(":")[1].split() for line in text.splitlines() if ":" in line}
    left, right = ([float(number) for number in rows[f"P_rect_0{camera}"]] for camera in (2, 3))
    return left[0], (left[3] - right[3]) / left[0]


if __name__ == "__main__":
    main()
