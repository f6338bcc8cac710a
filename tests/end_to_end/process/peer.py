"""A faulty process for tests. Arguments: the mode, and the folder with the replies that the test has written."""

import mmap
import os
import re
import signal
import struct
import subprocess
import sys
import time

mode, folder = sys.argv[1], sys.argv[2]
calls, replies = sys.stdin.buffer, sys.stdout.buffer


def send(*names):
    for name in names:
        with open(os.path.join(folder, name), "rb") as file:
            replies.write(file.read())
    replies.flush()


def reply(number):
    """Reply to a call with values."""
    with open(os.path.join(folder, "values-any"), "rb") as file:
        replies.write(file.read().replace(struct.pack("<q", 0x1122334455667788), struct.pack("<q", number)))
    replies.flush()


def message():
    """Return the next message of the stream of calls; `None` at its end."""
    head = calls.read(8)
    if len(head) < 8 or head[4:] == bytes(4):
        return None
    described = calls.read(struct.unpack("<I", head[4:])[0])
    table = struct.unpack_from("<I", described)[0]
    fields = table - struct.unpack_from("<i", described, table)[0]
    return described + calls.read(struct.unpack_from("<q", described, table + struct.unpack_from("<H", described, fields + 10)[0])[0])


def file():
    """Open the last memory file that the next message names."""
    return os.open(re.findall(rb"/proc/\d+/fd/\d+", message())[-1], os.O_RDWR)


def store(name=None, noise=b""):
    """Write a reply, or noise, into the shared memory for the next call's reply."""
    descriptor = file()
    os.pwrite(descriptor, noise or open(os.path.join(folder, name), "rb").read(), 0)
    return descriptor


def scribble():
    """Reply, and keep changing the reply while it is read."""
    size = os.fstat(descriptor := store("shared-values-2")).st_size
    view = mmap.mmap(descriptor, size)
    send("shared-memory")
    while True:
        view[:4096] = os.urandom(4096)


def shrink():
    """Try to resize a sealed file, which must fail."""
    descriptor = store("shared-values-2")
    for change in (lambda: os.ftruncate(descriptor, 4096), lambda: os.ftruncate(descriptor, 1 << 30)):
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
    """Start another process of the group, which ignores SIGTERM."""
    subprocess.Popen(["/bin/sh", "-c", "trap '' TERM; while :; do sleep 60; done"])


AT_START = {
    "exits-at-once": lambda: sys.exit(3),
    "exits-silently": lambda: sys.exit(0),
    "kills-itself-at-start": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "prints-text": lambda: (print("loading the model ...", flush=True), forever()),
    "prints-zeros": lambda: (replies.write(bytes(4096)), replies.flush(), forever()),
    "prints-three-bytes": lambda: (replies.write(b"\xff\xff\xff"), replies.flush(), sys.exit(0)),
    "hangs-at-start": forever,
    "closes-stdout-at-start": lambda: (replies.close(), os.close(1), forever()),
    "cut-schema": lambda: (send("cut-schema"), sys.exit(0)),
    "batch-before-schema": lambda: (send("ready"), forever()),
    "ready-never": lambda: (send("schema"), forever()),
    "floods-stderr-and-exits": lambda: (sys.stderr.write("no weights\n" * 4_000_000), sys.exit(1)),
    "raises": lambda: {}["weights"],
    "floods-stdout": lambda: [replies.write(b"x" * 65536) for _ in iter(int, 1)],
}
# Modes that send one reply at the start, and then nothing more.
ONE_REPLY = {"no-protocol", "other-protocol", "no-says", "huge-head", "huge-body", "negative-body", "random-head"}

if mode in AT_START:
    AT_START[mode]()
if mode in ONE_REPLY:
    send(mode)
    forever()

if mode in ("values-before-ready", "fails-at-start", "ready-of-another-call"):
    send("schema", {"values-before-ready": "values-0", "fails-at-start": "failure-0", "ready-of-another-call": "ready-5"}[mode])
    forever()

# The reply to the first call uses the pipe and is large, so that the second call offers shared memory for its reply.
LATER = {
    "shared-nowhere": lambda: (message(), send("shared-memory-nowhere")),
    "shared-beyond": lambda: (message(), send("shared-memory-beyond")),
    "shared-before": lambda: (message(), send("shared-memory-before")),
    "shared-nothing-there": lambda: (message(), send("shared-memory")),
    "shared-cut": lambda: (store("shared-values-2"), send("shared-memory-cut")),
    "shared-noise": lambda: (store(noise=b"loading the model ..."), send("shared-memory")),
    "shared-another-number": lambda: (store("shared-values-5"), send("shared-memory")),
    "shared-leads-on": lambda: (store("shared-leads-on"), send("shared-memory")),
    "shared-a-schema": lambda: (store("shared-schema"), send("shared-memory")),
    "shared-holds-others": lambda: (message(), send("shared-holds")),
    "shared-shrinks": shrink,
    "shared-scribbles": scribble,
    "shared-works": lambda: (store("shared-values-2"), send("shared-memory")),
}
if mode.startswith("shared"):
    descriptor = file()
    word = b"f" * 32 if mode == "shared-wrong-word" else os.read(descriptor, 32)
    with open(os.path.join(folder, "schema" if mode == "shared-not-agreed" else "shared-schema"), "rb") as schema:
        replies.write(schema.read().replace(b"f" * 32, word))
    if mode == "shared-not-agreed":
        send("ready")
    else:
        send("shared-ready")
    message()
    if mode in LATER:
        send("shared-values-1")
        LATER[mode]()
    elif mode == "shared-not-agreed":
        send("shared-not-agreed")
    else:
        send("shared-first")
    message() if mode == "shared-works" else forever()
    sys.exit(0)

if mode == "wrong-type":
    send("float64-schema", "ready")
else:
    send("schema", "ready")
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
        replies.close()
        os.close(1)
        forever()
    elif mode == "ends-the-stream":
        send("end")
        forever()
    elif mode == "half-a-batch-and-exits":
        send("half")
        os._exit(0)
    elif mode == "half-a-batch-and-hangs":
        send("half")
        forever()
    elif mode == "answers-twice":
        send(f"values-{number}", f"values-{number}")
    elif mode == "answers-and-floods":
        while True:
            send("values-9")
    elif mode == "floods-stderr-and-hangs":
        sys.stderr.write("still here\n" * 2_000_000)
        sys.stderr.flush()
        forever()
    elif mode == "works":
        reply(number)
    elif mode == "works-with-noise":
        sys.stderr.write("noise\n" * 200_000)
        reply(number)
    else:
        # All other modes are names of replies.
        send(mode)
