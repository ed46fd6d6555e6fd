"""Publishers of readings: newline JSON here, others as plugins."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TextIO

from tactileforge.pages import to_json
from tactileforge.plugins import registry


class Publisher(Protocol):
    """Sink of readings and events, called in the thread of the computation.

    A plugin is a class in the entry-point group ``tactileforge.publishers``; its constructor takes
    plain options and does no I/O. ``send`` must not block: a slow one costs frames.
    """

    def open(self) -> None:
        """Claims the address.

        Raises:
            ConfigError: The address cannot be used, or a package is missing; says which.
        """
        ...

    def send(self, message: dict[str, Any]) -> None:
        """Sends a message of plain data; see ``docs/live.md`` for its keys."""
        ...

    def close(self) -> None:
        """Releases the address; a second call does nothing."""
        ...


class JsonLines:
    """Writes one JSON object per line.

    Args:
        to: Text stream; None for standard output.
    """

    def __init__(self, to: TextIO | None = None) -> None:
        self._to = to

    def open(self) -> None:
        """Does nothing: standard output is open."""

    def send(self, message: dict[str, Any]) -> None:
        """Writes and flushes a line."""
        to = self._to or sys.stdout
        to.write(to_json(message) + "\n")
        to.flush()

    def close(self) -> None:
        """Does nothing: standard output stays open."""


def build_publishers(publishers: Sequence[str] | Mapping[str, Any]) -> list[Publisher]:
    """Builds publishers from names, or from names with options.

    Raises:
        PluginError: A publisher is not installed.
        ConfigError: An option is unknown.
    """
    nodes = publishers if isinstance(publishers, Mapping) else dict.fromkeys(publishers)
    return [
        registry.build("publishers", {"name": name, **(node or {})}, f"publish.{name}")
        for name, node in nodes.items()
    ]
