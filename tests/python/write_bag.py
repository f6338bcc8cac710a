"""Writes a bag from the messages in a JSON file, with software that is not depthloom's: rosbags serialises and stores, mcap stores what rosbags' writer cannot.

    write_bag.py SPEC.json OUT

SPEC: {"writer": "rosbags", "storage": "mcap" | "sqlite3", "compression": "none" | "message" | "storage", "files": 1, "messages": [...]}
   or {"writer": "mcap", "options": {"compression": "lz4", "chunk_size": 100000, "use_chunking": true}, "messages": [...]}
   or {"writer": "foxglove", "options": {...}, "messages": [...]}
A message has "topic", "log_ns", "stamp_ns", "frame_id" and one of
    "image": FILE, "encoding": "bgr8"                  the pixels of an image
    "image": FILE, "compressed": "png" | "jpeg"        the image encoded by OpenCV; of a file with that ending its own bytes
    "depth": VALUES, "encoding": "16UC1" | "32FC1"     one list per row
    "camera": {"size": [w, h], "p": [12 numbers], "d": [5 numbers]}
    "points": [[x, y, z], ...]
    "transforms": [{"parent": ..., "child": ..., "translation": [3 numbers], "rotation": [x, y, z, w]}, ...]
"""

import json
import pathlib
import sys

import cv2
import numpy as np
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import CompressionType, Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

store = get_typestore(Stores.ROS2_HUMBLE)
types = store.types


def pixels(file, encoding):
    image = cv2.imread(file, cv2.IMREAD_UNCHANGED)
    if encoding.startswith("mono"):
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return grey if encoding == "mono8" else grey.astype(np.uint16) * 256 + 17
    if image.ndim == 2:
        image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    order = {"bgr8": None, "rgb8": cv2.COLOR_BGR2RGB, "bgra8": cv2.COLOR_BGR2BGRA, "rgba8": cv2.COLOR_BGR2RGBA}[encoding]
    return image if order is None else cv2.cvtColor(image, order)


def compressed(of):
    file = pathlib.Path(of["image"])
    if file.suffix[1:] == of["compressed"]:
        return np.frombuffer(file.read_bytes(), np.uint8)
    return cv2.imencode("." + of["compressed"], cv2.imread(str(file), cv2.IMREAD_UNCHANGED))[1].ravel()


def ros(of):
    """Type and message."""
    time = types["builtin_interfaces/msg/Time"](sec=of["stamp_ns"] // 10**9, nanosec=of["stamp_ns"] % 10**9)
    header = types["std_msgs/msg/Header"](stamp=time, frame_id=of["frame_id"])
    kind = lambda name: (name, types[name])
    if "compressed" in of:
        name, make = kind("sensor_msgs/msg/CompressedImage")
        return name, make(header=header, format=of["compressed"], data=compressed(of))
    if "image" in of or "depth" in of:
        dtype = {"16UC1": np.uint16, "32FC1": np.float32}
        rows = pixels(of["image"], of["encoding"]) if "image" in of else np.array(of["depth"], dtype[of["encoding"]])
        name, make = kind("sensor_msgs/msg/Image")
        height, width = rows.shape[:2]
        data = np.ascontiguousarray(rows).view(np.uint8).ravel()
        step = len(data) // height
        return name, make(header=header, height=height, width=width, encoding=of["encoding"], is_bigendian=0, step=step, data=data)
    if "camera" in of:
        camera = of["camera"]
        p = np.array(camera["p"], np.float64)
        name, make = kind("sensor_msgs/msg/CameraInfo")
        roi = types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        d, r, k = np.array(camera.get("d", [0.0] * 5)), np.eye(3).ravel(), p.reshape(3, 4)[:, :3].ravel()
        width, height = camera["size"]
        return name, make(
            header=header, height=height, width=width, distortion_model="plumb_bob", d=d, k=k, r=r, p=p, binning_x=0, binning_y=0, roi=roi
        )
    if "points" in of:
        name, make = kind("sensor_msgs/msg/PointCloud2")
        field = types["sensor_msgs/msg/PointField"]
        # As scanners' drivers have it: a number between the coordinates and the next point.
        fields = [field(name=axis, offset=4 * at, datatype=7, count=1) for at, axis in enumerate("xyz")]
        points = np.zeros((len(of["points"]), 5), np.float32)
        points[:, :3] = of["points"]
        data = points.view(np.uint8).ravel()
        return name, make(
            header=header, height=1, width=len(points), fields=fields, is_bigendian=False, point_step=20, row_step=len(data), data=data, is_dense=True
        )
    name, make = kind("tf2_msgs/msg/TFMessage")
    geometry = lambda name: types["geometry_msgs/msg/" + name]

    def transform(of):
        x, y, z = of["translation"]
        qx, qy, qz, qw = of["rotation"]
        motion = geometry("Transform")(
            translation=geometry("Vector3")(x=x, y=y, z=z), rotation=geometry("Quaternion")(x=qx, y=qy, z=qz, w=qw)
        )
        parent = types["std_msgs/msg/Header"](stamp=time, frame_id=of["parent"])
        return geometry("TransformStamped")(header=parent, child_frame_id=of["child"], transform=motion)

    return name, make(transforms=[transform(each) for each in of["transforms"]])


def with_rosbags(spec, out):
    files = spec.get("files", 1)
    per_file = -(-len(spec["messages"]) // files)
    for number in range(files):
        part = out if files == 1 else out.with_name(f"{out.name}_{number}")
        writer = Writer(part, version=9, storage_plugin=StoragePlugin[spec["storage"].upper()])
        writer.set_compression(CompressionMode[spec["compression"].upper()], CompressionFormat.ZSTD)
        with writer:
            connections = {}
            for of in spec["messages"][number * per_file : (number + 1) * per_file]:
                name, message = ros(of)
                if of["topic"] not in connections:
                    connections[of["topic"]] = writer.add_connection(of["topic"], name, typestore=store)
                writer.write(connections[of["topic"]], of["log_ns"], store.serialize_cdr(message, name))
    if files == 1:
        return
    # As `ros2 bag record --max-bag-size` leaves them: one folder, one metadata.yaml.
    out.mkdir()
    named = []
    for number in range(files):
        part = out.with_name(f"{out.name}_{number}")
        metadata = YAML(typ="safe").load(part / "metadata.yaml")
        for name in metadata["rosbag2_bagfile_information"]["relative_file_paths"]:
            (part / name).rename(out / name)
            named.append(name)
    metadata["rosbag2_bagfile_information"]["relative_file_paths"] = named
    YAML(typ="safe").dump(metadata, out / "metadata.yaml")


def options(spec):
    given = dict(spec.get("options", {}))
    given["compression"] = CompressionType[given.get("compression", "zstd").upper()]
    return given


def with_mcap(spec, out):
    with open(out, "wb") as file:
        writer = McapWriter(file, **options(spec))
        writer.start("ros2", "write_bag.py")
        channels = {}
        for of in spec["messages"]:
            name, message = ros(of)
            if of["topic"] not in channels:
                schema = writer.register_schema(name, "ros2msg", store.generate_msgdef(name, ros_version=2)[0].encode())
                channels[of["topic"]] = writer.register_channel(of["topic"], "cdr", schema)
            data = bytes(store.serialize_cdr(message, name))
            writer.add_message(channels[of["topic"]], log_time=of["log_ns"], publish_time=of["log_ns"], data=data)
        writer.finish()


def with_foxglove(spec, out):
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
    from mcap_protobuf.writer import Writer as ProtobufWriter

    def message(of):
        stamp = Timestamp(seconds=of["stamp_ns"] // 10**9, nanos=of["stamp_ns"] % 10**9)
        if "camera" in of:
            camera, p = of["camera"], of["camera"]["p"]
            k = [p[at] for at in (0, 1, 2, 4, 5, 6, 8, 9, 10)]
            width, height = camera["size"]
            return CameraCalibration(
                timestamp=stamp, frame_id=of["frame_id"], width=width, height=height, distortion_model="plumb_bob", D=[0.0] * 5, K=k,
                R=np.eye(3).ravel(), P=p,
            )
        if "compressed" in of:
            data = compressed(of).tobytes()
            return CompressedImage(timestamp=stamp, frame_id=of["frame_id"], data=data, format=of["compressed"])
        rows = pixels(of["image"], of["encoding"])
        height, width = rows.shape[:2]
        data = np.ascontiguousarray(rows).tobytes()
        return RawImage(
            timestamp=stamp, frame_id=of["frame_id"], width=width, height=height, encoding=of["encoding"], step=len(data) // height, data=data
        )

    with open(out, "wb") as file, ProtobufWriter(file, **options(spec)) as writer:
        for of in spec["messages"]:
            writer.write_message(topic=of["topic"], message=message(of), log_time=of["log_ns"], publish_time=of["log_ns"])


spec = json.loads(pathlib.Path(sys.argv[1]).read_text())
{"rosbags": with_rosbags, "mcap": with_mcap, "foxglove": with_foxglove}[spec["writer"]](spec, pathlib.Path(sys.argv[2]))
