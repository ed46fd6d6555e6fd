"""Every code block on every page runs.

Python blocks of a page share one namespace; bash blocks run with ``bash -e``. Both run in one
temporary folder a page, from top to bottom. A block after ``<!-- no-run: reason -->`` is left out.
The README's ``tactileforge`` is the installed one, that of other pages is forked (`warm`).
"""

import contextlib
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from warm import Warm

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"(<!-- no-run: [^>]+-->\s*)?^```(python|bash)\n(.*?)^```$", re.M | re.S)


def run_bash(code: str, folder: Path, *commands: Path) -> None:
    places = [*commands, Path(sys.executable).parent, os.environ["PATH"]]
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", code],
        cwd=folder,
        env=os.environ | {"PATH": os.pathsep.join(map(str, places))},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, f"{code}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_code_blocks_run(page: Path, tmp_path: Path, warm: Warm) -> None:
    blocks = BLOCK.findall(page.read_text())
    if not any(not skipped for skipped, _, _ in blocks):
        pytest.skip("no code to run on this page")
    namespace: dict[str, object] = {"__name__": "__main__"}
    for skipped, language, code in blocks:
        if skipped:
            continue
        if language == "bash":
            run_bash(code, tmp_path, *([] if page.name == "README.md" else [warm.bin]))
        else:
            with contextlib.chdir(tmp_path), warnings.catch_warnings():
                warnings.simplefilter("default")
                exec(compile(code, str(page), "exec"), namespace)
