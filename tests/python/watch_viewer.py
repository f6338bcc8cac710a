"""A client of Foxglove's WebSocket protocol: subscribes to topics and prints what it receives, as JSON.

    watch_viewer.py ws://HOST:PORT COUNT TOPIC...        prints COUNT messages of each topic, decoded
    watch_viewer.py ws://HOST:PORT stall TOPIC...        subscribes and never reads again
"""

import base64
import json
import struct
import sys
import time
import zlib

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from websockets.asyncio.client import connect
import asyncio
import numpy as np

SUBPROTOCOL = "foxglove.sdk.v1"
MESSAGE_DATA = 1
HEADER = struct.Struct("<BIQ")


def decoded(schema: str, payload: bytes) -> dict:
    if schema == "foxglove.RawImage":
        image = RawImage.FromString(payload)
        kind, channels = {"rgb8": (np.uint8, 3), "mono8": (np.uint8, 1), "16UC1": (np.uint16, 1)}[image.encoding]
        pixels = np.frombuffer(image.data, kind).reshape(image.height, image.width, channels)
        assert image.step == image.width * channels * pixels.itemsize
        return {"size": [image.width, image.height], "encoding": image.encoding, "frame_id": image.frame_id,
                "pixels_crc32": zlib.crc32(pixels.tobytes()), "sum": int(pixels.sum(dtype=np.int64))}
    if schema == "foxglove.CompressedImage":
        image = CompressedImage.FromString(payload)
        return {"format": image.format, "frame_id": image.frame_id, "data_crc32": zlib.crc32(image.data)}
    if schema == "foxglove.CameraCalibration":
        calibration = CameraCalibration.FromString(payload)
        return {"size": [calibration.width, calibration.height], "focal_px": calibration.K[0]}
    return {}


def check_schema(channel: dict) -> None:
    """The schema of a channel is complete and has its message."""
    assert channel["encoding"] == "protobuf" and channel["schemaEncoding"] == "protobuf"
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file:
        pool.Add(file)
    pool.FindMessageTypeByName(channel["schemaName"])


async def subscribe(socket, topics: list[str]) -> dict[int, dict]:
    """Waits until the topics are offered, and subscribes to them."""
    offered = {}
    while not all(topic in offered for topic in topics):
        text = await socket.recv()
        if isinstance(text, str):
            message = json.loads(text)
            if message["op"] == "advertise":
                offered |= {channel["topic"]: channel for channel in message["channels"]}
    chosen = {number: offered[topic] for number, topic in enumerate(topics, 1)}
    subscriptions = [{"id": number, "channelId": channel["id"]} for number, channel in chosen.items()]
    await socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
    print(json.dumps({"offered": sorted(offered)}), flush=True)
    return chosen


async def watch(address: str, count: str, topics: list[str]) -> None:
    async with connect(address, subprotocols=[SUBPROTOCOL], max_size=None, max_queue=1) as socket:
        assert socket.subprotocol == SUBPROTOCOL
        chosen = await subscribe(socket, topics)
        if count == "stall":
            # Not `asyncio.sleep`, in which the library would read.
            time.sleep(600)
        for channel in chosen.values():
            check_schema(channel)
        missing = {number: int(count) for number in chosen}
        while any(missing.values()):
            data = await socket.recv()
            if isinstance(data, str) or data[0] != MESSAGE_DATA:
                continue
            _, number, time_ns = HEADER.unpack_from(data)
            if missing[number] == 0:
                continue
            missing[number] -= 1
            channel, payload = chosen[number], data[HEADER.size:]
            message = {"topic": channel["topic"], "schema": channel["schemaName"], "time_ns": time_ns,
                       "crc32": zlib.crc32(payload)}
            print(json.dumps(message | decoded(channel["schemaName"], payload)), flush=True)


if __name__ == "__main__":
    asyncio.run(watch(sys.argv[1], sys.argv[2], sys.argv[3:]))
