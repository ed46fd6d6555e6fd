"""Readings over ZeroMQ."""

from __future__ import annotations

from typing import Any

from tactileforge.errors import ConfigError
from tactileforge.pages import to_json
from tactileforge.plugins import install_command


class ZeroMq:
    """A PUB socket: the name of the sensor, then the message as JSON.

    Args:
        address: Address to bind; ``tcp://127.0.0.1:*`` takes any free port.
        queue: Length of the queue for a slow subscriber, in messages; more are lost.

    Attributes:
        endpoint: Bound address; "" while the socket is closed.
    """

    def __init__(self, address: str = "tcp://127.0.0.1:5556", queue: int = 2) -> None:
        self.address, self.queue = address, queue
        self.endpoint = ""
        self._socket: Any = None

    def open(self) -> None:
        """Binds the address.

        Raises:
            ConfigError: pyzmq is not installed, or the address cannot be bound.
        """
        try:
            import zmq
        except ImportError as error:
            fix = install_command("tactileforge-bridge[zmq]")
            raise ConfigError(f"publish=[zmq] needs pyzmq: {fix}") from error
        self.close()
        socket: Any = zmq.Context.instance().socket(zmq.PUB)
        socket.setsockopt(zmq.SNDHWM, self.queue)
        socket.setsockopt(zmq.LINGER, 0)
        try:
            socket.bind(self.address)
        except zmq.ZMQError as error:
            socket.close()
            raise ConfigError(f"zmq: {self.address}: {error}; give another address") from error
        self._socket = socket
        self.endpoint = socket.getsockopt_string(zmq.LAST_ENDPOINT)

    def send(self, message: dict[str, Any]) -> None:
        """Sends a message; does not wait."""
        parts = [str(message["sensor"]).encode(), to_json(message).encode()]
        self._socket.send_multipart(parts)  # never blocks: a PUB socket drops what it cannot send

    def close(self) -> None:
        """Unbinds; a second call does nothing."""
        socket, self._socket, self.endpoint = self._socket, None, ""
        if socket is not None:
            socket.close()
