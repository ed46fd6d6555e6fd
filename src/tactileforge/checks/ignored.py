"""Checks left out for a recording by its own description."""

from __future__ import annotations

from tactileforge.checks.codes import CODES
from tactileforge.contracts import Recording


def is_ignored(recording: Recording, name: str, code: str = "") -> bool:
    """Whether the label ``ignore`` of a recording names a check.

    Layouts write it (``ignore: [TF307]``); it may hold codes, their beginnings and names, with
    blanks between.

    Args:
        recording: The recording.
        name: Name of the check.
        code: Its code; "" for that of a check that comes with the package.
    """
    words = str(recording.labels.get("ignore", "")).split()
    code = code or CODES.get(name, "")
    return any(word == name or (code and code.startswith(word)) for word in words)
