"""Provenance of results: the commit of the code."""

from __future__ import annotations

import subprocess
from pathlib import Path


def commit() -> str:
    """The commit of the checkout this package runs from, ``-dirty`` if changed; "" if installed."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists() or not (root / "src" / "tactileforge").is_dir():
        return ""
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        done = subprocess.run([*command, "--exclude=*"], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()
