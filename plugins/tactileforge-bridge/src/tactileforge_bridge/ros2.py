"""Readings as ROS 2 topics."""

from __future__ import annotations

import json
import re
from typing import Any

from tactileforge.errors import ConfigError


class Ros2:
    """Publishes ``/tactile/NAME/wrench`` and ``/tactile/NAME/json``.

    Args:
        node: Name of the node.
        prefix: Of the topics.
        depth: Messages that are kept for a slow subscriber.
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
            ConfigError: ROS 2 is not there.
        """
        try:
            import geometry_msgs.msg
            import rclpy
            import std_msgs.msg
        except ImportError as error:
            fix = "source /opt/ros/DISTRO/setup.bash, with the Python that it is built for"
            raise ConfigError(f"publish=[ros2] needs ROS 2 ({error}): {fix}") from error
        self.close()
        self._types = {
            "wrench": geometry_msgs.msg.WrenchStamped,
            "json": std_msgs.msg.String,
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
        text = self._types["json"]()
        text.data = json.dumps(message)
        self._topic(sensor, "json").publish(text)
        if message.get("force") is None:
            return
        wrench = self._types["wrench"]()
        wrench.header.frame_id = sensor
        seconds, nano = divmod(round(message["unix"] * 1e9), 10**9)
        wrench.header.stamp.sec, wrench.header.stamp.nanosec = seconds, nano
        force = wrench.wrench.force
        force.x, force.y, force.z = map(float, message["force"])
        self._topic(sensor, "wrench").publish(wrench)

    def close(self) -> None:
        """Ends the node; a second call does nothing."""
        node, self._node = self._node, None
        self._topics.clear()
        if node is not None:
            node.destroy_node()
            self._context.shutdown()
