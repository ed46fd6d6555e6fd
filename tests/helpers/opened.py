"""Opening and closing, shared by tests of sensors."""

from typing import Any, Self


class Opened:
    """Opens a sensor for a ``with`` block, and closes it after it."""

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def open(self) -> Any:
        """Opens it."""

    def close(self) -> Any:
        """Closes it."""
