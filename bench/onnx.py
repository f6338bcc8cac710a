"""Times a network in Python's onnxruntime and in ours in turn, on the same images. Called by onnx.sh.

Both load the library of this Python environment. For each number of threads: both are warmed up, then every round runs one image
here and there, the first of the two by turns; what both give is compared once for every image. Theirs has onnxruntime's own
defaults, except for the number of threads, and these stop spinning when a run ends.
"""
import argparse
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
import onnxruntime


def library():
    capi = pathlib.Path(onnxruntime.__file__).parent / "capi"
    found = sorted(capi.glob("libonnxruntime.so*")) + sorted(capi.glob("libonnxruntime*.dylib"))
    return str(found[0])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("binary", type=pathlib.Path)
    parser.add_argument("model", type=pathlib.Path)
    parser.add_argument("--count", type=int, default=4, help="different images")
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    args = parser.parse_args()
    environment = os.environ | {"ORT_DYLIB_PATH": library(), "DEPTHLOOM_ONNX_ENGINE": "onnxruntime"}
    for threads in args.threads:
        ours = subprocess.Popen([args.binary, args.model, str(threads)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                text=True, env=environment)
        title = ours.stdout.readline().strip()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        # Their threads would spin on into our turn.
        options.add_session_config_entry("session.force_spinning_stop", "1")
        session = onnxruntime.InferenceSession(args.model, options, providers=["CPUExecutionProvider"])
        network_input = session.get_inputs()[0]
        _, channels, height, width = network_input.shape
        if channels != 3:
            sys.exit(f"the network takes {channels} channels; a network of 3 is expected")
        random = np.random.default_rng(1)
        images = [random.integers(0, 256, (height, width, 3), np.uint8) for _ in range(args.count)]
        with tempfile.TemporaryDirectory() as folder:
            for number, image in enumerate(images):
                image.tofile(f"{folder}/{number}")

            def run_theirs(number):
                start = time.perf_counter()
                tensor = np.ascontiguousarray(images[number].transpose(2, 0, 1)[None], np.float32) / np.float32(255)
                output = session.run(None, {network_input.name: tensor})[0]
                return (time.perf_counter() - start) * 1e3, output

            def run_ours(number):
                ours.stdin.write(f"{folder}/{number} {folder}/out {width} {height}\n")
                ours.stdin.flush()
                return float(ours.stdout.readline())

            worst = 0.0
            for number in range(args.count):
                _, expected = run_theirs(number)
                run_ours(number)
                found = np.fromfile(f"{folder}/out", np.float32).reshape(expected.shape) / 1000
                worst = max(worst, float(np.max(np.abs(found - expected)) / np.max(np.abs(expected))))
            if worst > 1e-5:
                sys.exit(f"outputs differ by {worst:.1e} of the largest value")
            theirs_ms, ours_ms = [], []
            for index in range(args.rounds):
                number = index % args.count
                if index % 2:
                    ours_ms.append(run_ours(number))
                theirs_ms.append(run_theirs(number)[0])
                if not index % 2:
                    ours_ms.append(run_ours(number))
        ours.stdin.close()
        ours.wait()
        theirs, mine = statistics.median(theirs_ms), statistics.median(ours_ms)
        print(f"{threads} threads: onnxruntime {onnxruntime.__version__} median {theirs:.2f} ms, best {min(theirs_ms):.2f}; "
              f"ours ({title}) median {mine:.2f} ms, best {min(ours_ms):.2f}; outputs differ by {worst:.1e}")
        print(f"ratio onnx-{threads}t {theirs / mine:.2f}", flush=True)


if __name__ == "__main__":
    main()
