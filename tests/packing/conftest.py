import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


@pytest.fixture
def packable(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module of that name beside this file; other processes find it too."""
    monkeypatch.syspath_prepend(Path(__file__).parent)
    import packable

    return packable


@pytest.fixture
def command(packable: ModuleType) -> Callable[..., subprocess.Popen[str]]:
    """Starts packing in a process of its own."""

    def start(out: Path, options: dict[str, Any], **given: Any) -> subprocess.Popen[str]:
        words = [sys.executable, str(packable.__file__), str(out)]
        return subprocess.Popen(
            [*words, json.dumps({**given, "options": options})],
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(Path(__file__).parent)},
        )

    return start
