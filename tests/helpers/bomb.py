"""A pickle with code in it."""

import os
from pathlib import Path


class Bomb:
    """Makes a folder when it is unpickled.

    Args:
        path: The folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.path),)
