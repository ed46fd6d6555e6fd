"""Files that are whole or not there."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactileforge.untrusted import load_json


def write_text(path: Path, text: str) -> None:
    """Writes a text file beside its place, then renames it; makes its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def sealed(plain: Mapping[str, Any]) -> str:
    """Plain data as JSON with its checksum, ``sha256``; see `unsealed`."""
    return json.dumps({**plain, "sha256": _checksum(plain)}, indent=1)


def unsealed(text: str | bytes) -> dict[str, Any]:
    """The data of a text that `sealed` made.

    Raises:
        ValueError: It is another text, or one byte that counts has changed.
    """
    plain = load_json(text)
    if not isinstance(plain, dict) or "sha256" not in plain:
        raise ValueError("it has no checksum")
    stated = plain.pop("sha256")
    if stated != _checksum(plain):
        raise ValueError("its checksum is another: bytes of it have changed")
    return plain


def _checksum(plain: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()
