"""Every code block on every page runs.

Python blocks of a page share one namespace; bash blocks run with ``bash -e``. Both run in one
temporary folder a page, from top to bottom. A block after ``<!-- no-run: reason -->`` is left out;
one after ``<!-- made: NAME, NAME; also: WORDS -->`` runs on small files that are made first
(`made_files`), with the words added to its last command.
The README's ``tactileforge`` is the installed one, that of other pages is forked (`warm`).
Trainings of few steps and simulated touches are made smaller than on the page, and torchrun starts
forked commands (`smaller`).
"""

import contextlib
import os
import re
import subprocess
import sys
import warnings
from functools import cache
from pathlib import Path

import pytest
from made_files import make_files
from warm import Warm

from tactileforge.plugins import metadata
from tactileforge.training.run_length import MACHINE
from tactileforge.util.untrusted import load_yaml

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(
    r"(?:<!-- (no-run|made): ([^>]+?)(?:; also: ([^>]+?))? -->\s*)?^```(python|bash)\n(.*?)^```$",
    re.M | re.S,
)
#: Reasons to leave out a block: none of them is a file that a reader has and a test can make.
REASONS = (
    "takes", "trains", "installs", "compiles", "needs GPUs", "needs a GPU", "needs SLURM",
    "needs Ray", "needs a sensor", "needs the sensors", "needs a camera", "needs the arm",
    "needs LeRobot", "needs a policy", "needs demonstrations", "needs presses",
    "needs the pictures",
    "needs a network", "needs a published", "needs published", "needs imported weights",
    "needs a public set",
    "needs a LeRobot set", "needs recordings and sensors",
)  # fmt: skip


#: Trainings that begin with weights of a certain size.
SIZED = re.compile(r"init=(?!runs/)|recipe=touch|image_encoder=")


def smaller(code: str) -> str:
    """Shrink trainings of a few steps, and simulated touch, to the sizes of other pages.

    Trainings of free size take 32 pixels. Touches are stored in the folder of all tests.
    """
    code = re.sub(r"export TACTILEFORGE_CACHE=\S+\n| TACTILEFORGE_CACHE=\S+", "", code)
    return "\n".join(_smaller(command) for command in re.split(r"(?<!\\)\n", code))


def with_few_touches(code: str) -> str:
    """Simulated touches of Python code as few and as small as those of commands."""

    def few(found: re.Match[str]) -> str:
        return f"Sim(scenes={min(int(found[1]), 3)}, val={min(int(found[2]), 1)}, size=32)"

    return re.sub(r"\bSim\(scenes=(\d+), val=(\d+)(?:, size=\d+)?\)", few, code)


def _smaller(command: str) -> str:
    # the page's command has the same words, and each process of its own would import all again
    command = re.sub(r"(torchrun .*)-m tactileforge\b", r"\1--no-python tactileforge", command)
    trained = bool(re.search(r"\btrain .*(debug=steps|max_steps=)", command, re.S))
    if " data=" in command.replace(" data=sim ", " ") or "resume=" in command:
        return command
    if not trained and " data=sim " not in command:
        return command
    words = {"data.scenes": 3, "data.val": 1, "data.size": 32}
    words |= {"batch.size": 4} if trained else {}
    if trained and "encoder.image_size=" not in command and not SIZED.search(command):
        words["encoder.image_size"] = 32
    # other touches than those of the tests beside it: one type of sensor is enough
    command = re.sub(r"(?<= )data.seed=[1-9]\d*", r"\g<0> 'data.sensors=[digit]'", command)
    for key, value in words.items():
        command, found = re.subn(rf"(?<= ){key}=\d+", f"{key}={value}", command)
        if not found:
            command = re.sub(r"\b(train|data=sim)\b", rf"\1 {key}={value}", command, count=1)
    return command


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
def test_code_blocks_run(
    page: Path, tmp_path: Path, warm: Warm, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a reader runs the code in the folder of the files, as a notebook does
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setattr(metadata, "entries", cache(metadata.entries.__wrapped__))  # a new reader
    blocks = BLOCK.findall(page.read_text())
    if all(mark == "no-run" for mark, *_ in blocks):
        pytest.skip("no code to run on this page")
    namespace: dict[str, object] = {"__name__": "__main__"}
    for mark, names, also, language, code in blocks:
        if mark == "no-run":
            continue
        if mark == "made":
            make_files(names, tmp_path)
        code = f"{code.rstrip()} {also}\n" if also else code
        if language == "bash":
            run_bash(smaller(code), tmp_path, *([] if page.name == "README.md" else [warm.bin]))
        else:
            with contextlib.chdir(tmp_path), warnings.catch_warnings():
                warnings.simplefilter("default")
                exec(compile(with_few_touches(code), str(page), "exec"), namespace)


def test_trainings_are_made_smaller() -> None:
    small = "data.scenes=3 data.val=1"
    before = "tactileforge train debug=steps data.scenes=6 data.val=2 \\\n  optim.lr=1\n"
    assert smaller(f"export TACTILEFORGE_CACHE=c\n{before}") == (
        "tactileforge train encoder.image_size=32 batch.size=4 data.size=32 debug=steps "
        f"{small} \\\n  optim.lr=1\n"
    )
    assert smaller("torchrun --nproc-per-node=2 -m tactileforge train scale=demo") == (
        "torchrun --nproc-per-node=2 --no-python tactileforge train scale=demo"
    )
    pack = "tactileforge data pack data=sim"
    assert smaller(f"{pack} out=a") == f"{pack} data.size=32 data.val=1 data.scenes=3 out=a"
    another = smaller(f"{pack} data.seed=1 out=b")
    assert another.endswith(" data.seed=1 'data.sensors=[digit]' out=b")
    assert "image_size" not in smaller("tactileforge train init=imagenet debug=steps")
    for kept in (
        "tactileforge train data=shards debug=steps",
        "tactileforge train resume=run trainer.max_steps=4",
        "tactileforge train scale=demo",
        "echo debug=steps",
    ):
        assert smaller(kept) == kept
    assert with_few_touches("Sim(scenes=6, val=2)") == "Sim(scenes=3, val=1, size=32)"
    assert with_few_touches("Sim(scenes=2, val=0, size=64)") == "Sim(scenes=2, val=0, size=32)"
    assert with_few_touches("TouchdSim('sim', val=0)") == "TouchdSim('sim', val=0)"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_does_not_run_has_a_reason(page: Path) -> None:
    for mark, reason, *_ in BLOCK.findall(page.read_text()):
        assert mark != "no-run" or reason.startswith(REASONS), reason


def _pages(nav: object) -> list[str]:
    if isinstance(nav, str):
        return [nav]
    items = nav.values() if isinstance(nav, dict) else nav
    return [page for item in items for page in _pages(item)]  # type: ignore[attr-defined]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_end_before_text(page: Path) -> None:
    """Text in the line below a table would be drawn as one more row."""
    prose = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.M | re.S)
    assert re.findall(r"^[|].*\n(?![|]|\n|<!--)(.+)", prose, re.M) == []


def test_the_page_names_what_a_resumed_run_may_change() -> None:
    page = " ".join((ROOT / "docs/configuration.md").read_text("utf-8").split())
    _, _, after = page.partition("with an unchanged configuration;")
    named = after.partition("another machine.")[0]
    assert [key for key in MACHINE if f".{key}=`" not in named] == []


def test_the_menu_has_every_page_once() -> None:
    menu = _pages(load_yaml((ROOT / "mkdocs.yml").read_text("utf-8"))["nav"])
    pages = [path.relative_to(ROOT / "docs").as_posix() for path in PAGES[1:]]
    assert sorted(menu) == sorted(pages)


@pytest.mark.parametrize(
    ("page", "begin"),
    [
        ("local-code", "cat > my_module.py"),
        ("lightning", "mkdir -p own/recipe"),
        ("lightning", "import lightning as L"),
        ("lightning", "import torch\n\noptimizer"),
        ("python", "import tactileforge\n\ntask = {"),
    ],
)
def test_doors_are_opened_by_few_lines(page: str, begin: str) -> None:
    """An objective, callbacks, the module, the data, a suite; timm's is in its package."""
    blocks = [match[5] for match in BLOCK.finditer((ROOT / f"docs/{page}.md").read_text("utf-8"))]
    (code,) = [block for block in blocks if block.startswith(begin)]
    assert sum(bool(line.strip()) for line in code.splitlines()) <= 20
