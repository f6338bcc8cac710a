"""A dora node without depthloom's library: it sends its input on."""

import os
import sys
import time

import pyarrow as pa
from dora import Node

node = Node()
for count, event in enumerate(event for event in node if event["type"] == "INPUT"):
    value, metadata = event["value"], event["metadata"]
    # Names and times of the test's frames.
    assert metadata["frame_id"] == f"{count:06}_10" and metadata["time_ns"] == 100_000_000 * count, metadata
    if "silent" in sys.argv and count == 2:
        time.sleep(60)
    if "ends" in sys.argv and count == 2:
        os._exit(7)
    if "forgets" in sys.argv and count == 2:
        metadata = {}
    if "negative" in sys.argv and count == 2:
        value = pa.array([-5.0] * len(value), pa.float32())
    node.send_output("depth", value, metadata)
