import subprocess
import sys
from collections.abc import Callable

import pytest


@pytest.fixture
def lightly() -> Callable[..., str]:
    """Runs a command in a process of its own, without some modules; gives what it prints."""

    def run(words: list[str], without: str) -> str:
        code = (
            "import sys; from tactileforge.cli import run; status = run(sys.argv[2:]); "
            "heavy = set(sys.argv[1].split()) & set(sys.modules); "
            "sys.exit(f'imports {heavy}' if heavy else status)"
        )
        command = [sys.executable, "-c", code, without, *words]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run
