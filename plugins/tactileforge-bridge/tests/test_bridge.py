"""Messages arrive: over a real ZeroMQ socket, and at stand-ins for the packages of ROS 2."""

import json
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from tactileforge_bridge.ros2 import READING, Ros2
from tactileforge_bridge.zeromq import ZeroMq

from tactileforge.errors import ConfigError

MESSAGE = {"sensor": "digit 1", "unix": 12.25, "force": [1.0, -2.0, 3.0], "contact": True}
MESSAGE |= {"force_unit": "N"}


def test_messages_arrive_over_zeromq():
    zmq = pytest.importorskip("zmq")
    sender = ZeroMq("tcp://127.0.0.1:*")
    sender.open()
    socket = zmq.Context.instance().socket(zmq.SUB)
    try:
        socket.setsockopt(zmq.RCVTIMEO, 10_000)
        socket.connect(sender.endpoint)
        socket.subscribe(b"digit")
        while not socket.poll(50):  # a subscription takes a moment to arrive
            sender.send(MESSAGE)
        topic, body = socket.recv_multipart()
        assert (topic, json.loads(body)) == (b"digit 1", MESSAGE)
        with pytest.raises(ConfigError, match="give another address"):
            ZeroMq(sender.endpoint).open()
    finally:
        socket.close()
        sender.close()
        sender.close()


def test_nobody_listens_and_nothing_waits():
    pytest.importorskip("zmq")
    sender = ZeroMq("tcp://127.0.0.1:*", queue=1)
    sender.open()
    for _ in range(1000):
        sender.send(MESSAGE)
    sender.close()
    assert sender.endpoint == ""


@pytest.mark.parametrize(("kind", "package"), [(ZeroMq, "zmq"), (Ros2, "rclpy")])
def test_a_missing_package_is_named(monkeypatch, kind, package):
    for name in (package, "geometry_msgs.msg"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ConfigError, match=r"needs (pyzmq|ROS 2)"):
        kind().open()


class Wrench:
    def __init__(self):
        self.header = SimpleNamespace(frame_id="", stamp=SimpleNamespace(sec=0, nanosec=0))
        self.wrench = SimpleNamespace(force=SimpleNamespace(x=0.0, y=0.0, z=0.0))


class Image:
    def __init__(self):
        self.header = SimpleNamespace(frame_id="", stamp=SimpleNamespace(sec=0, nanosec=0))


@pytest.fixture
def sent(monkeypatch):
    """Stand-ins for ROS 2, and a list of the published topics and messages."""
    sent = []

    def create_publisher(kind, name, depth):
        return SimpleNamespace(publish=lambda message: sent.append((name, message)))

    node = SimpleNamespace(create_publisher=create_publisher, destroy_node=lambda: None)
    packages = {
        "rclpy": {
            "Context": lambda: SimpleNamespace(shutdown=lambda: None),
            "init": lambda context: None,
            "create_node": lambda name, context: node,
        },
        "geometry_msgs": {},
        "geometry_msgs.msg": {"WrenchStamped": Wrench},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Image": Image},
        "std_msgs": {},
        "std_msgs.msg": {"String": SimpleNamespace},
    }
    for name, content in packages.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    for name in ("geometry_msgs", "sensor_msgs", "std_msgs"):
        sys.modules[name].msg = sys.modules[f"{name}.msg"]
    return sent


def test_forces_are_wrenches_in_ros(sent):
    bridge = Ros2()
    bridge.open()
    bridge.send(MESSAGE)
    bridge.send({"sensor": "digit 1", "event": "lost"})
    bridge.close()
    bridge.close()
    topics = [topic.removeprefix("/tactile/digit_1/") for topic, _ in sent]
    assert topics == ["reading", "wrench", "event"]
    wrench = sent[1][1]
    assert (wrench.header.stamp.sec, wrench.header.stamp.nanosec) == (12, 250_000_000)
    force = wrench.wrench.force
    assert (wrench.header.frame_id, force.x, force.y, force.z) == ("digit 1", 1.0, -2.0, 3.0)
    assert sent[2][1].data == "lost"


def test_vectors_are_stamped_arrays_in_ros(sent):
    bridge = Ros2()
    bridge.open()
    bridge.send(MESSAGE | {"force": None, "embedding": [0.5, -1.25, 3.0]})
    bridge.close()
    assert len(sent) == 2  # no force, no wrench
    topic, image = sent[1]
    assert topic == "/tactile/digit_1/embedding"
    assert (image.header.stamp.sec, image.header.stamp.nanosec) == (12, 250_000_000)
    assert (image.header.frame_id, image.encoding, image.step) == ("digit 1", "32FC1", 12)
    assert np.frombuffer(image.data, np.float32).tolist() == [0.5, -1.25, 3.0]
    assert (image.height, image.width) == (1, 3)


def test_readings_are_stamped_arrays_and_nothing_is_json_in_ros(sent):
    bridge = Ros2()
    bridge.open()
    known = {"slip": None, "difference": 7.5, "depth_mm": 0.25, "latency_ms": 12.0}
    bridge.send(MESSAGE | known)
    bridge.close()
    topic, image = sent[0]
    assert topic == "/tactile/digit_1/reading"
    assert (image.header.frame_id, image.header.stamp.sec) == ("digit 1", 12)
    values = np.frombuffer(image.data, np.float32)
    assert len(values) == len(READING) == image.width
    np.testing.assert_array_equal(values, np.array([1, np.nan, 7.5, 0.25, 12], np.float32))
    assert not any(
        hasattr(message, "data") and isinstance(message.data, str) for _, message in sent
    )


def test_shares_of_a_scale_are_no_wrench(sent):
    bridge = Ros2()
    bridge.open()
    bridge.send(MESSAGE | {"force_unit": "relative", "force": [0.5, -0.25, None]})
    bridge.send(MESSAGE | {"force_unit": "uncalibrated"})
    bridge.close()
    topics = [topic.removeprefix("/tactile/digit_1/") for topic, _ in sent]
    assert topics == ["reading", "relative_force", "reading", "wrench"]
    shares = np.frombuffer(sent[1][1].data, np.float32)
    np.testing.assert_array_equal(shares, np.float32([0.5, -0.25, np.nan]))
