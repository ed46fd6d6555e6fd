"""Sources of pages have short lines; ``python tests/test_line_lengths.py`` fills them anew."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: Written by commands: the keys and cards of others decide their lines.
MADE = {"contracts.md", "keys.md", "zoo.md", "gallery.md"}
PAGES = [
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if page.name not in MADE),
    *sorted((ROOT / "zoo" / "recipe").glob("*.md")),
    ROOT / "CONTRIBUTING.md",
]
MOST = 110
#: Code, links and words, none of which is broken.
TOKEN = re.compile(r"(?:`[^`]*`|!?\[[^\]\s]*\]\([^)\s]*\)|[^\s`])+")
#: Lines that stay as they are: tables, headings, HTML, directives, pictures, references.
WHOLE = re.compile(r"\s*(\||#|<|:::|!\[|!!!|\[[^\]]+\]:)")
FENCE = re.compile(r"\s*(```|~~~)")
ITEM = re.compile(r"^(\s*)((?:[-*+]|\d+[.)])\s+)?")
#: A word that would start a list, quote or heading, were it the first of a line.
STARTS = re.compile(r"^(?:[-+*]|\d+[.)]|#+|>.*|\|.*|=+|:::.*|!!!.*)$")


def _blocks(text: str) -> Iterator[tuple[bool, list[str]]]:
    """Whether lines are a paragraph or item to fill, and the lines."""
    lines = text.split("\n")
    fenced, front, listed, paragraph = False, lines[0] == "---", False, []
    for number, line in enumerate(lines):
        if line and not line[0].isspace():
            listed = bool((ITEM.match(line) or [""])[2])  # what is indented below is its text
        code = line.startswith("    ") and not listed and not paragraph
        whole = front or fenced or code or bool(FENCE.match(line)) or not line.strip()
        whole = whole or bool(WHOLE.match(line))
        if paragraph and (whole or (ITEM.match(line) or [""])[2]):
            yield True, paragraph
            paragraph = []
        if whole:
            yield False, [line]
        else:
            paragraph = [*paragraph, line]
        fenced ^= bool(FENCE.match(line)) and not front
        front &= not (number and line == "---")
    if paragraph:
        yield True, paragraph


def _filled(lines: list[str]) -> list[str]:
    """A paragraph or item in lines of at most `MOST` characters, if words allow it."""
    found = ITEM.match(lines[0])
    assert found is not None
    indent, mark = found[1], found[2] or ""
    rest = indent + " " * len(mark)
    if len(lines) > 1 and not mark:
        rest = lines[1][: len(lines[1]) - len(lines[1].lstrip())]
    words = TOKEN.findall(" ".join([lines[0][len(indent + mark) :], *map(str.strip, lines[1:])]))
    out = [indent + mark + words[0]]
    for word in words[1:]:
        if len(out[-1]) + 1 + len(word) > MOST and not STARTS.match(word):
            out.append(rest + word)
        else:
            out[-1] += f" {word}"
    return out


def filled(text: str) -> str:
    """The text with new line breaks in paragraphs with a long line."""
    out: list[str] = []
    for is_text, lines in _blocks(text):
        long = is_text and any(len(line) > MOST for line in lines)
        out += _filled(lines) if long and not any(line.endswith("  ") for line in lines) else lines
    return "\n".join(out)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_line_is_long(page: Path) -> None:
    text = page.read_text("utf-8")
    long = _long(text)
    assert not long, f"fill them: python tests/test_line_lengths.py\n{long}"


def _long(text: str) -> list[str]:
    """Lines of paragraphs over the limit, with a place to break them."""
    return [
        line
        for is_text, lines in _blocks(text)
        if is_text
        for line in lines
        if len(line) > MOST and len(TOKEN.findall(line)) > 1 and filled(line) != line
    ]


def test_filling_changes_line_breaks_alone() -> None:
    text = "# Title\n\n- " + "a word and `code with spaces` " * 9 + "\n\n```bash\n" + "x" * 200
    done = filled(text)
    assert done.split() == text.split()
    assert max(map(len, done.split("\n")[2:-3])) <= MOST
    assert done.split("\n")[3].startswith("  ")
    assert "code with spaces" in done.replace("\n", "|")
    assert filled(done) == done
    code = "Commands:\n\n    one --with=" + "words " * 30 + "\\\n        and=more\n    two"
    assert filled(code) == code
    assert filled("-   " + code) != "-   " + code  # text of an item


if __name__ == "__main__":
    for path in PAGES:
        path.write_text(filled(path.read_text("utf-8")), "utf-8")
