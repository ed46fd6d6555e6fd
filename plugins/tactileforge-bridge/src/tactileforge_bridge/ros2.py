"""Readings as ROS 2 topics."""

from __future__ import annotations

import re
import sys
from array import array
from collections.abc import Sequence
from math import nan
from typing import Any

from tactileforge.errors import ConfigError

#: Values of ``/tactile/NAME/reading``, in order; NaN for an unknown one.
READING = ("contact", "slip", "difference", "depth_mm", "latency_ms")


class Ros2:
    """Publishes readings as ROS 2 messages with a stamp, the time of the frame.

    For each sensor: ``/tactile/NAME/wrench``, the force in newtons, or ``relative_force``, an array
    of shares of the force scale, as a wrench is in newtons by its definition;
    ``/tactile/NAME/embedding``, the vector; ``/tactile/NAME/reading``, the values of `READING`;
    ``/tactile/NAME/event``, a word. An array is sent as an image of one row, 32FC1, as this is the
    common message with a stamp and an array.

    Args:
        node: Name of the node.
        prefix: Prefix of all topics.
        depth: Length of the queue for a slow subscriber, in messages.
    """

    def __init__(
        self, node: str = "tactileforge", prefix: str = "/tactile", depth: int = 1
    ) -> None:
        self.node, self.prefix, self.depth = node, prefix, depth
        self._node: Any = None
        self._topics: dict[tuple[str, str], Any] = {}

    def open(self) -> None:
        """Starts the node.

        Raises:
            ConfigError: ROS 2 is not installed, or not sourced.
        """
        try:
            import geometry_msgs.msg
            import rclpy
            import sensor_msgs.msg
            import std_msgs.msg
        except ImportError as error:
            fix = "source /opt/ros/DISTRO/setup.bash, with the Python that it is built for"
            raise ConfigError(f"publish=[ros2] needs ROS 2 ({error}): {fix}") from error
        self.close()
        self._types = {
            "wrench": geometry_msgs.msg.WrenchStamped,
            "relative_force": sensor_msgs.msg.Image,
            "embedding": sensor_msgs.msg.Image,
            "reading": sensor_msgs.msg.Image,
            "event": std_msgs.msg.String,
        }
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node(self.node, context=self._context)

    def _topic(self, sensor: str, what: str) -> Any:
        if (sensor, what) not in self._topics:
            name = f"{self.prefix}/{re.sub(r'[^A-Za-z0-9_]', '_', sensor)}/{what}"
            made = self._node.create_publisher(self._types[what], name, self.depth)
            self._topics[sensor, what] = made
        return self._topics[sensor, what]

    def send(self, message: dict[str, Any]) -> None:
        """Publishes a message."""
        sensor = str(message["sensor"])
        if "event" in message:
            word = self._types["event"]()
            word.data = str(message["event"])
            self._topic(sensor, "event").publish(word)
            return
        known = [message.get(name) for name in READING]
        self._publish_array("reading", message, [nan if x is None else float(x) for x in known])
        if message.get("force") is not None:
            x, y, z = (nan if axis is None else float(axis) for axis in message["force"])
            if message.get("force_unit") == "relative":
                self._publish_array("relative_force", message, [x, y, z])
            else:
                wrench = self._stamped("wrench", message)
                force = wrench.wrench.force
                force.x, force.y, force.z = x, y, z
                self._topic(sensor, "wrench").publish(wrench)
        if message.get("embedding") is not None:
            self._publish_array("embedding", message, message["embedding"])

    def _publish_array(self, what: str, message: dict[str, Any], values: Sequence[float]) -> None:
        """Publishes an array with a stamp, as an image of one row."""
        numbers = array("f", values)
        image = self._stamped(what, message)
        image.height, image.width, image.encoding = 1, len(numbers), "32FC1"
        image.is_bigendian, image.step = int(sys.byteorder == "big"), 4 * len(numbers)
        image.data = numbers.tobytes()
        self._topic(str(message["sensor"]), what).publish(image)

    def _stamped(self, what: str, message: dict[str, Any]) -> Any:
        """Builds an empty message of a type, with the time and the name of the sensor."""
        made = self._types[what]()
        made.header.frame_id = str(message["sensor"])
        seconds, nano = divmod(round(message["unix"] * 1e9), 10**9)
        made.header.stamp.sec, made.header.stamp.nanosec = seconds, nano
        return made

    def close(self) -> None:
        """Ends the node; a second call does nothing."""
        node, self._node = self._node, None
        self._topics.clear()
        if node is not None:
            node.destroy_node()
            self._context.shutdown()
