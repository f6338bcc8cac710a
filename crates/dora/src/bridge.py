"""Stands between depthloom and the Python library of dora: messages pass through as they come. Started by `depthloom dora-node`, which writes to its standard input and reads its standard
output. A message is two lengths (little endian, 4 and 8 bytes), a head in JSON, and a body: an Arrow IPC stream of one column and one row, bytes of a larger one, or nothing."""

import json
import os
import struct
import sys
import threading
import time

calls = os.fdopen(os.dup(0), "rb", 1 << 16)
answers = os.fdopen(os.dup(1), "wb", 1 << 16)
os.dup2(2, 1)  # prints of the program must not mix with messages
lock = threading.Lock()


def note(way, head, body):
    if "DEPTHLOOM_DORA_LOG" in os.environ:
        print(way, json.dumps(head, default=str), len(body), file=sys.stderr, flush=True)


def tell(head, body=b""):
    note("got", head, body)
    text = json.dumps(head, default=str).encode()
    with lock:
        answers.write(struct.pack("<IQ", len(text), len(body)))
        answers.write(text)
        answers.write(body)
        answers.flush()


try:
    import pyarrow as pa
    from dora import Node
except ImportError as error:
    tell({"lacks": f"{sys.executable}: {error}"})
    sys.exit(0)

try:
    node = Node()
except BaseException as error:
    why = " ".join(str(error).split("\n\nLocation:")[0].split())  # what follows are places in dora's own code
    tell({"lacks": f"it does not know this node: {why}", "outside": True})
    os._exit(0)


def hand_over(event):
    value, metadata = event["value"], event.get("metadata") or {}
    head = {"input": event["id"], "metadata": metadata}
    if "nothing" in metadata or value is None:
        return tell(head)
    if "chunk" in metadata:
        return tell(head, value.buffers()[1].slice(value.offset, len(value)))
    if pa.types.is_primitive(value.type) and not (pa.types.is_boolean(value.type) or pa.types.is_null(value.type)):
        items = pa.ListArray.from_arrays(pa.array([0, len(value)], pa.int32()), value)
        value = pa.StructArray.from_arrays([items], ["data"])
    batch = pa.record_batch([value], names=["value"])
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    tell(head, sink.getvalue())


def listen():
    try:
        for event in node:
            match event["type"]:
                case "INPUT":
                    hand_over(event)
                case "INPUT_CLOSED":
                    tell({"closed": event["id"]})
                case "STOP":
                    tell({"stop": True})
                case "ERROR":
                    tell({"trouble": str(event.get("error"))})
        tell({"over": True})
    except BrokenPipeError:
        pass
    except BaseException as error:
        tell({"trouble": f"{type(error).__name__}: {error}"})


def exactly(count):
    data = calls.read(count)
    if len(data) < count:
        raise EOFError
    return data


def send(head, body):
    note("sends", head, body)
    metadata = head["metadata"]
    if not body:
        array = pa.nulls(1)
    elif "chunk" in metadata:
        array = pa.Array.from_buffers(pa.uint8(), len(body), [None, pa.py_buffer(body)])
    else:
        array = pa.ipc.open_stream(body).read_next_batch().column(0)
        if head.get("flat"):
            array = array.field("data").flatten()
    node.send_output(head["output"], array, metadata)


tell({"ready": True})
threading.Thread(target=listen, daemon=True).start()
try:
    while True:
        of_head, of_body = struct.unpack("<IQ", exactly(12))
        head = json.loads(exactly(of_head))
        send(head, exactly(of_body))
except EOFError:
    pass
except BaseException as error:
    tell({"trouble": f"{type(error).__name__}: {error}"})
    sys.stdin.read()
# What was sent last is on its way.
time.sleep(0.2)
os._exit(0)
