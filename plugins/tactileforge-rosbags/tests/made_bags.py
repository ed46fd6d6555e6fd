"""Bags written by rosbags: rosbag2 in sqlite3 and mcap, and ROS 1."""

from pathlib import Path

import cv2
import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

KINDS = ("sqlite3", "mcap", "ros1")
#: Time of the first message, ns; stamps are 4 ms earlier.
BEGIN = 1_700_000_000_000_000_000
DELAY = 4_000_000
HZ = 25


def store_of(kind):
    return get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.LATEST)


def picture(i, height=32, width=24, top=40):
    """A picture with its number as red, and blue growing to the right."""
    out = np.zeros((height, width, 3), np.uint8)
    out[..., 0] = top + i
    out[..., 2] = np.linspace(0, 200, width).astype(np.uint8)
    return out


class Messages:
    """Makes messages of a store."""

    def __init__(self, kind):
        self.kind, self.store = kind, store_of(kind)

    def make(self, kind, /, **fields):
        return self.store.types[kind](**fields)

    def header(self, time, frame="sensor"):
        stamp = self.make("builtin_interfaces/msg/Time", sec=time // 10**9, nanosec=time % 10**9)
        more = {"seq": 0} if self.kind == "ros1" else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def compressed(self, time, pixels, form="png", data=None):
        raw = cv2.imencode(f".{form}", pixels[..., ::-1])[1].tobytes() if data is None else data
        return self.make(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(time),
            format=form,
            data=np.frombuffer(raw, np.uint8),
        )

    def raw(self, time, pixels, encoding="rgb8", pad=0):
        """A raw picture; ``pad`` further bytes end each row."""
        height, width = pixels.shape[:2]
        if encoding == "bgr8":
            pixels = pixels[..., ::-1]
        elif encoding in ("mono8", "8UC1"):
            pixels = pixels[..., :1]
        elif encoding in ("rgba8", "bgra8", "8UC4"):
            colours = pixels if encoding == "rgba8" else pixels[..., ::-1]
            pixels = np.dstack([colours, np.full((height, width), 9, np.uint8)])
        elif encoding == "8UC3":
            pixels = pixels[..., ::-1]
        rows = np.ascontiguousarray(pixels).reshape(height, -1)
        rows = np.pad(rows, ((0, 0), (0, pad)), constant_values=7)
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(time),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=rows.shape[1],
            data=rows.reshape(-1),
        )

    def wrench(self, time, force, torque=(0.1, 0.2, 0.3), stamped=True):
        three = [
            self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z) for x, y, z in (force, torque)
        ]
        bare = self.make("geometry_msgs/msg/Wrench", force=three[0], torque=three[1])
        if not stamped:
            return bare
        return self.make("geometry_msgs/msg/WrenchStamped", header=self.header(time), wrench=bare)

    def joints(self, time, names, position, velocity=(), effort=()):
        return self.make(
            "sensor_msgs/msg/JointState",
            header=self.header(time),
            name=list(names),
            position=np.asarray(position, np.float64),
            velocity=np.asarray(velocity, np.float64),
            effort=np.asarray(effort, np.float64),
        )

    def text(self, words):
        return self.make("std_msgs/msg/String", data=words)


def write(path, kind, rows, compress=None):
    """Writes a bag of (topic, time of recording, message); returns the path of it."""
    store, path = store_of(kind), Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "ros1":
        path = path.with_suffix(".bag")
        writer = rosbag1.Writer(path)
        if compress:
            writer.set_compression(compress)
        encode = store.serialize_ros1
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        if compress:
            writer.set_compression(compress, rosbag2.CompressionFormat.ZSTD)
        encode = store.serialize_cdr
    with writer:
        connections = {}
        for topic, time, message in rows:
            name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            writer.write(connections[topic], time, bytes(encode(message, name)))
    return path


def frame_rows(kind, topic="/left/image/compressed", count=20, raw="", stamped=True, **how):
    """Pictures at 25 Hz, stamped 4 ms before they are recorded."""
    make = Messages(kind)
    for i in range(count):
        time = BEGIN + i * 10**9 // HZ
        stamp = time - DELAY if stamped else 0
        pixels = picture(i)
        message = make.raw(stamp, pixels, raw, **how) if raw else make.compressed(stamp, pixels)
        yield topic, time, message


def rig_rows(kind, count=20):
    """Two touches, a camera, a wrench at 100 Hz and joints at 50 Hz, in order of time."""
    make = Messages(kind)
    rows = [*frame_rows(kind, "/left/image/compressed", count)]
    rows += frame_rows(kind, "/right/image_raw", count, raw="bgr8", pad=5)
    for i in range(count // 2):
        time = BEGIN + i * 2 * 10**9 // HZ
        rows.append(("/wrist/image_raw", time, make.raw(time - DELAY, picture(i, 16, 20), "mono8")))
    for i in range(count * 4):
        time = BEGIN - 10**7 + i * 10**7
        rows.append(("/ft/wrench", time, make.wrench(time, (1.0 * i, 2.0, -0.5 * i))))
    for i in range(count * 2):
        time = BEGIN + i * 2 * 10**7
        rows.append(
            ("/joint_states", time, make.joints(time, ("elbow", "wrist"), (i, -i), (0.5, 0.25)))
        )
    rows.append(("/notes", BEGIN, make.text("begin")))
    return sorted(rows, key=lambda row: row[1])


def write_rig(path, kind, count=20, compress=None):
    return write(path, kind, rig_rows(kind, count), compress)


RIG_MAP = """
licence: CC0-1.0
object: mug
text: touching a mug
labels: {task: lift}
touch:
  - topic: /left/image/compressed
    sensor: digit
    finger: left
    force: {topic: /ft/wrench, unit: mN, sign: [1, -1, -1], lag_s: -0.012}
  - {topic: /right/image_raw, sensor: gelsight_mini, finger: right, rotate: 270}
camera: {topic: /wrist/image_raw}
background: first
"""
