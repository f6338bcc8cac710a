"""A process that does what no process should: the first argument says what, the second where the replies lie that the test has made."""

import mmap
import os
import re
import signal
import struct
import subprocess
import sys
import time

mode, folder = sys.argv[1], sys.argv[2]
calls, answers = sys.stdin.buffer, sys.stdout.buffer


def say(*names):
    for name in names:
        with open(os.path.join(folder, name), "rb") as file:
            answers.write(file.read())
    answers.flush()


def answer(number):
    """Answers a call with values."""
    with open(os.path.join(folder, "values-any"), "rb") as file:
        answers.write(file.read().replace(struct.pack("<q", 0x1122334455667788), struct.pack("<q", number)))
    answers.flush()


def message():
    """The next message of the stream of calls; `None` at its end."""
    head = calls.read(8)
    if len(head) < 8 or head[4:] == bytes(4):
        return None
    described = calls.read(struct.unpack("<I", head[4:])[0])
    table = struct.unpack_from("<I", described)[0]
    fields = table - struct.unpack_from("<i", described, table)[0]
    return described + calls.read(struct.unpack_from("<q", described, table + struct.unpack_from("<H", described, fields + 10)[0])[0])


def file():
    """Opens the file in memory that the next message names last."""
    return os.open(re.findall(rb"/proc/\d+/fd/\d+", message())[-1], os.O_RDWR)


def lay(name=None, noise=b""):
    """Lays a reply, or something else, into the memory for the answer to the next call."""
    there = file()
    os.pwrite(there, noise or open(os.path.join(folder, name), "rb").read(), 0)
    return there


def scribble():
    """Answers for ever, and changes the answer while it is read."""
    size = os.fstat(there := lay("shared-values-2")).st_size
    view = mmap.mmap(there, size)
    say("shared-lies")
    while True:
        view[:4096] = os.urandom(4096)


def shrink():
    """What is sealed stays as large as it is."""
    there = lay("shared-values-2")
    for change in (lambda: os.ftruncate(there, 4096), lambda: os.ftruncate(there, 1 << 30)):
        try:
            change()
        except PermissionError:
            continue
        os._exit(1)
    os._exit(9)


def forever():
    while True:
        time.sleep(60)


def child():
    """Another process of the group, which does not end when it is told."""
    subprocess.Popen(["/bin/sh", "-c", "trap '' TERM; while :; do sleep 60; done"])


AT_START = {
    "exits-at-once": lambda: sys.exit(3),
    "exits-silently": lambda: sys.exit(0),
    "kills-itself-at-start": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "prints-text": lambda: (print("loading the model ...", flush=True), forever()),
    "prints-zeros": lambda: (answers.write(bytes(4096)), answers.flush(), forever()),
    "prints-three-bytes": lambda: (answers.write(b"\xff\xff\xff"), answers.flush(), sys.exit(0)),
    "hangs-at-start": forever,
    "closes-stdout-at-start": lambda: (answers.close(), os.close(1), forever()),
    "cut-schema": lambda: (say("cut-schema"), sys.exit(0)),
    "batch-before-schema": lambda: (say("ready"), forever()),
    "ready-never": lambda: (say("schema"), forever()),
    "floods-stderr-and-exits": lambda: (sys.stderr.write("no weights\n" * 4_000_000), sys.exit(1)),
    "raises": lambda: {}["weights"],
    "floods-stdout": lambda: [answers.write(b"x" * 65536) for _ in iter(int, 1)],
}
# What is said at the start, and then nothing more.
SAYS = {"no-protocol", "other-protocol", "no-says", "huge-head", "huge-body", "negative-body", "random-head"}

if mode in AT_START:
    AT_START[mode]()
if mode in SAYS:
    say(mode)
    forever()

if mode in ("values-before-ready", "fails-at-start", "ready-of-another-call"):
    say("schema", {"values-before-ready": "values-0", "fails-at-start": "failure-0", "ready-of-another-call": "ready-5"}[mode])
    forever()

# In shared memory the first call is answered as ever, with a large value, so that the second one has a place for its answer.
LATER = {
    "shared-nowhere": lambda: (message(), say("shared-lies-nowhere")),
    "shared-beyond": lambda: (message(), say("shared-lies-beyond")),
    "shared-before": lambda: (message(), say("shared-lies-before")),
    "shared-nothing-there": lambda: (message(), say("shared-lies")),
    "shared-cut": lambda: (lay("shared-values-2"), say("shared-lies-cut")),
    "shared-noise": lambda: (lay(noise=b"loading the model ..."), say("shared-lies")),
    "shared-another-number": lambda: (lay("shared-values-5"), say("shared-lies")),
    "shared-leads-on": lambda: (lay("shared-leads-on"), say("shared-lies")),
    "shared-a-schema": lambda: (lay("shared-schema"), say("shared-lies")),
    "shared-holds-others": lambda: (message(), say("shared-holds")),
    "shared-shrinks": shrink,
    "shared-scribbles": scribble,
    "shared-works": lambda: (lay("shared-values-2"), say("shared-lies")),
}
if mode.startswith("shared"):
    offered = file()
    word = b"f" * 32 if mode == "shared-wrong-word" else os.read(offered, 32)
    with open(os.path.join(folder, "schema" if mode == "shared-not-agreed" else "shared-schema"), "rb") as schema:
        answers.write(schema.read().replace(b"f" * 32, word))
    if mode == "shared-not-agreed":
        say("ready")
    else:
        say("shared-ready")
    message()
    if mode in LATER:
        say("shared-values-1")
        LATER[mode]()
    elif mode == "shared-not-agreed":
        say("shared-not-agreed")
    else:
        say("shared-first")
    message() if mode == "shared-works" else forever()
    sys.exit(0)

if mode == "wrong-type":
    say("float64-schema", "ready")
else:
    say("schema", "ready")
if mode == "reads-nothing":
    forever()
if mode == "closes-stdin":
    os.close(0)
    forever()

message()
if mode == "exits-within-a-call":
    calls.read(20)
    os._exit(4)
if mode == "ends-between-calls":
    sys.exit(0)

number = 0
while message() is not None:
    number += 1
    if mode == "exits":
        sys.stderr.write("the model is gone\n")
        sys.stderr.flush()
        os._exit(7)
    elif mode == "segfaults":
        os.kill(os.getpid(), signal.SIGSEGV)
    elif mode == "hangs":
        forever()
    elif mode == "ignores-sigterm":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        forever()
    elif mode == "forks-and-hangs":
        child()
        forever()
    elif mode == "forks-and-exits":
        child()
        os._exit(1)
    elif mode == "stops-itself":
        os.kill(os.getpid(), signal.SIGSTOP)
    elif mode == "stops-its-group":
        os.kill(0, signal.SIGSTOP)
    elif mode == "kills-its-group":
        os.kill(0, signal.SIGKILL)
    elif mode == "closes-stdout":
        answers.close()
        os.close(1)
        forever()
    elif mode == "ends-the-stream":
        say("end")
        forever()
    elif mode == "half-a-batch-and-exits":
        say("half")
        os._exit(0)
    elif mode == "half-a-batch-and-hangs":
        say("half")
        forever()
    elif mode == "answers-twice":
        say(f"values-{number}", f"values-{number}")
    elif mode == "answers-and-floods":
        while True:
            say("values-9")
    elif mode == "floods-stderr-and-hangs":
        sys.stderr.write("still here\n" * 2_000_000)
        sys.stderr.flush()
        forever()
    elif mode == "works":
        answer(number)
    elif mode == "works-with-noise":
        sys.stderr.write("noise\n" * 200_000)
        answer(number)
    else:
        # Every other fault is a reply of that name.
        say(mode)
