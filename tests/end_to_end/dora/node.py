"""A node of dora's that knows nothing of depthloom: what comes, goes."""

import os
import sys
import time

from dora import Node

node = Node()
for count, event in enumerate(event for event in node if event["type"] == "INPUT"):
    if "silent" in sys.argv and count == 2:
        time.sleep(4)
    if "ends" in sys.argv and count == 2:
        os._exit(7)
    metadata = {} if "forgets" in sys.argv else event["metadata"]
    node.send_output("depth", event["value"], metadata)
