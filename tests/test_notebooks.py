"""The notebooks of docs/notebooks are made from the tutorials: ``python tests/test_notebooks.py``.

The code of the tutorials runs in ``test_docs``, as that of every other page.
"""

import json
import re
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).parents[1] / "docs"
#: Packages of ours that the commands of a page need.
NEEDED = {
    "embeddings": ("depth", "markers", "sim"),
    "train": ("inspect",),
    "publish-a-sensor": ("arrays", "depth", "markers", "live"),
    "policy": ("depth", "markers", "sim", "bench", "policies"),
}
PAGES = [DOCS / "tutorials" / f"{name}.md" for name in NEEDED]
#: Code of a page; the comment before it is for tests.
BLOCK = re.compile(r"(?:<!-- ([^>]+) -->\s*)?^```(python|bash)\n(.*?)^```$\n?", re.M | re.S)
#: Words of each notebook before its first step; none of our packages is on an index.
INSTALL = """# of the clone that this notebook lies in
%pip install --quiet ../..{}
%matplotlib inline
"""


def _cell(kind: str, text: str, number: int) -> dict[str, Any]:
    cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}}
    if kind == "code":
        cell |= {"execution_count": None, "outputs": []}
    return cell | {"source": text.strip("\n").splitlines(keepends=True)}


def notebook(page: Path) -> str:
    """A tutorial as a notebook of format 4.5, without outputs."""
    text = re.sub(r"\[As a notebook\].*\n\n", "", page.read_text("utf-8"))
    needed = "".join(f" ../../plugins/tactileforge-{name}" for name in NEEDED[page.stem])
    cells: list[tuple[str, str]] = [("code", INSTALL.format(needed))]
    done = 0
    for block in BLOCK.finditer(text):
        cells.append(("markdown", text[done : block.start()]))
        comment, language, code = block.groups()
        if comment and comment.startswith("no-run"):
            cells.append(("markdown", f"```{language}\n{code}```"))
        else:
            cells.append(("code", code if language == "python" else f"%%bash\n{code}"))
        done = block.end()
    cells.append(("markdown", text[done:]))
    kept = [(kind, _absolute(source)) for kind, source in cells if source.strip()]
    plain = {
        "cells": [_cell(kind, source, number) for number, (kind, source) in enumerate(kept)],
        "metadata": {"language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(plain, indent=1) + "\n"


def _absolute(text: str) -> str:
    """Links to other pages from the folder of the notebooks: both folders lie side by side."""
    return re.sub(r"\]\((?!http|#|\.\./)([\w-]+\.md)", r"](../tutorials/\1", text)


def _place(page: Path) -> Path:
    return DOCS / "notebooks" / f"{page.stem}.ipynb"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_notebook_is_its_page(page: Path) -> None:
    assert _place(page).read_text("utf-8") == notebook(page)
    made = json.loads(notebook(page))
    code = ["".join(cell["source"]) for cell in made["cells"] if cell["cell_type"] == "code"]
    for source in code:
        if "%pip" not in source and not source.startswith("%"):
            compile(source, str(page), "exec")
    assert len(code) > 3


if __name__ == "__main__":
    for tutorial in PAGES:
        _place(tutorial).parent.mkdir(exist_ok=True)
        _place(tutorial).write_text(notebook(tutorial), "utf-8")
