"""Status line, overwritten on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TextIO


class Status:
    """Writer of a status line, over the last one on a terminal.

    Args:
        to: Stream to write to; None for standard error.
    """

    def __init__(self, to: TextIO | None = None) -> None:
        self.to = to or sys.stderr
        self._is_terminal = self.to.isatty()
        self._next = 0.0
        self._length = 0

    def _write(self, line: str) -> None:
        if self._is_terminal:
            self.to.write("\r" + line.ljust(self._length))
            self._length = len(line)
        else:
            self.to.write(line + "\n")
        self.to.flush()

    def end(self) -> None:
        """End the line."""
        if self._length:
            self.to.write("\n")
            self._length = 0


def of_drops(reasons: Mapping[str, Mapping[str, int]]) -> str:
    """Format dropped frames of each device by reason; ``none`` for none."""
    devices = [
        f"{name} {sum(counts.values())} ({', '.join(f'{k} {n}' for k, n in counts.items() if n)})"
        for name, counts in reasons.items()
        if any(counts.values())
    ]
    return "; ".join(devices) or "none"
