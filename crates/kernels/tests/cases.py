"""Shared by the scripts that draw stereo cases and compare disparities with another implementation."""
import os
import pathlib
import subprocess
import sys
import tempfile
import venv

WORKSPACE = pathlib.Path(__file__).resolve().parents[2]
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", WORKSPACE / "target"))
PACKAGES = ["opencv-python-headless==5.0.*", "numpy"]


def into_private_environment(name="venv-opencv", packages=PACKAGES):
    """Runs the script again with the Python of a private environment under the target folder, which is made if it is not there."""
    place = TARGET / name
    python = place / "bin" / "python"
    if pathlib.Path(sys.prefix) == place:
        return
    if not (place / "ready").exists():
        venv.create(place, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *packages], check=True)
        (place / "ready").touch()
    os.execv(python, [str(python), *sys.argv])


def built(example):
    """An example of the crate, built now."""
    subprocess.run(["cargo", "build", "--release", "--quiet", "-p", "depthloom-kernels", "--example", example], cwd=WORKSPACE, check=True)
    return TARGET / "release" / "examples" / example


def texture(rng, height, width, channels):
    """One of several kinds of image: noise, blurred noise, steps, saturated noise, nearly flat."""
    import cv2
    import numpy as np
    kind = rng.integers(5)
    image = rng.integers(0, 256, (height, width, channels)).astype(np.float32)
    if kind == 1:
        image = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.5, 3))).reshape(height, width, channels)
        image = (image - image.min()) * (255 / max(np.ptp(image), 1))
    elif kind == 2:
        image = np.repeat(np.repeat(image[::5, ::7], 5, 0), 7, 1)[:height, :width]
    elif kind == 3:
        image = np.where(image > 128, 255, 0)
    elif kind == 4:
        image = 100 + image / 64
    return np.clip(image, 0, 255).astype(np.uint8)


def pair(rng, height, width, channels, reach):
    """A left image, and a right image that shows it shifted by a disparity that changes along and across."""
    import numpy as np
    left = texture(rng, height, width, channels)
    if rng.random() < 0.1:
        right = texture(rng, height, width, channels)
    else:
        rows, columns = np.mgrid[0:height, 0:width]
        shift = reach * (0.5 + 0.4 * np.sin(rows / rng.uniform(3, 40) + columns / rng.uniform(10, 80)))
        right = np.take_along_axis(left, np.clip(columns + shift.astype(int), 0, width - 1)[..., None], 1)
        right = np.clip(right + rng.normal(0, rng.uniform(0, 8), right.shape), 0, 255).astype(np.uint8)
    return [image[..., 0].copy() if channels == 1 else image for image in (left, right)]


class Comparison:
    """An example fed a job a line, and what came of its answers."""

    def __init__(self, binary):
        self.ours = subprocess.Popen([binary], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.folder = tempfile.TemporaryDirectory()
        self.files = [f"{self.folder.name}/{name}" for name in ("left", "right", "out")]
        self.done = self.refused = self.answered = self.differing = 0

    def compare(self, name, left, right, words, expected, unanswered):
        """Runs a job (`words` gets the names of three files) and holds its disparities, or that it was refused, against `expected`."""
        import numpy as np
        self.done += 1
        left.tofile(self.files[0])
        right.tofile(self.files[1])
        words = words(self.files)
        self.ours.stdin.write(" ".join(map(str, words)) + "\n")
        self.ours.stdin.flush()
        answer = self.ours.stdout.readline()
        if not answer:
            sys.exit(f"case {self.done}: no answer to {words}")
        if expected is None or answer.startswith("refused"):
            self.refused += 1
            if expected is not None or not answer.startswith("refused"):
                self.differing += 1
                print(f"case {self.done}: {name}: OpenCV {'accepts' if expected is not None else 'refuses'}; depthloom: {answer}")
            return
        got = np.fromfile(self.files[2], np.int16).reshape(expected.shape)
        self.answered += int((expected != unanswered).sum())
        if not np.array_equal(got, expected):
            self.differing += 1
            wrong = np.argwhere(got != expected)
            y, x = wrong[0]
            print(f"case {self.done}: {name}: {len(wrong)} of {got.size} pixels differ, first at row {y} column {x}: "
                  f"ours {got[y, x]}, OpenCV's {expected[y, x]}")

    def end(self, what):
        """Says how it went, and exits."""
        self.ours.stdin.close()
        self.ours.wait()
        self.folder.cleanup()
        print(f"{self.done} cases {what}, {self.refused} refused by both, {self.answered} answered pixels: {self.differing} cases differ")
        sys.exit(1 if self.differing else 0)
