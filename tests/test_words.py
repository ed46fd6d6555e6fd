"""Plain docstrings: short first lines, and descriptions of arguments."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PLACES = ("src", "plugins", "benchmarks", "tests")
#: Packages of others, kept as they were published.
FROZEN = "tests/third_party/"
#: Share of first lines that may have a relative clause, of code and of tests each.
MOST = 0.03

RELATIVE = re.compile(r"\b(that|which|who|whose|whom|where|what)\b", re.I)
OF = re.compile(r"^\s+\*{0,2}[\w.]+(?:, \*{0,2}\w+)*: [Oo]f ")
SEE = re.compile(r"^\s+\*{0,2}[\w.]+: (?:See|As|Alike|Likewise)\b[^.;,]*\.?$", re.I)
NONE = re.compile(r"\b(?:that|it|which) is none\b|\bis another\.$")


@cache
def docstrings() -> list[tuple[str, str]]:
    """Place and text of each docstring."""
    found = []
    for path in sorted(path for place in PLACES for path in (ROOT / place).rglob("*.py")):
        place = path.relative_to(ROOT).as_posix()
        if place.startswith(FROZEN):
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
            if isinstance(node, kinds) and (text := ast.get_docstring(node)):
                found.append((f"{place}:{getattr(node, 'lineno', 1)}", text))
    return found


def lines_like(pattern: re.Pattern[str]) -> Iterator[str]:
    """Places and lines of docstrings matching a pattern."""
    for place, text in docstrings():
        for line in text.splitlines():
            if pattern.search(line):
                yield f"{place}: {line.strip()}"


def first_sentence(text: str) -> str:
    return re.split(r"[.;] ", text.split("\n\n")[0].replace("\n", " "))[0]


def is_test(place: str) -> bool:
    return place.startswith("tests/") or "/tests/" in place


@pytest.mark.slow
@pytest.mark.parametrize(("of_tests", "least"), [(False, 3500), (True, 700)])
def test_first_lines_have_no_relative_clause(of_tests: bool, least: int) -> None:
    found = [
        (place, first_sentence(text)) for place, text in docstrings() if is_test(place) == of_tests
    ]
    odd = [f"{place}: {line}" for place, line in found if RELATIVE.search(line)]
    assert len(found) > least
    assert len(odd) <= MOST * len(found), "\n".join(odd)


def test_arguments_are_described() -> None:
    """Neither by ``x: Of y`` nor by ``x: See y``."""
    assert not [*lines_like(OF), *lines_like(SEE)]


def test_invalid_things_are_called_so() -> None:
    """Not none, and not another."""
    assert not list(lines_like(NONE))


def test_the_rules_find_what_they_are_for() -> None:
    assert RELATIVE.search(first_sentence("Turns what goes wrong into an error."))
    assert OF.match("    weight_decay: Of matrices.")
    assert SEE.match("    config: See `parse`.")
    assert not SEE.match("    config: Options, see `parse`.")
    assert NONE.search("ConfigError: A share that is none.")


#: American spellings; names of other libraries stand in code.
AMERICAN = re.compile(
    r"\b(?:neighbor\w*|behavior\w*|colors?|colored|center(?:s|ed)?|gray(?:s|ish)?"
    r"|(?:normal|initial|recogn|summar|quant|general)iz(?:es?|ed|ing|ation))\b"
)
CODE = re.compile(r"`[^`]*`|\]\([^)]*\)|https?://\S+|\w+[=.(]\S+|\w*_\w+|^\s*\w+:|\"[^\"]*\"", re.M)
FENCE = re.compile(r"^```.*?^```", re.M | re.S)


def prose() -> Iterator[tuple[str, str]]:
    """Place and prose of each docstring, page, card and comment of a YAML."""
    yield from (
        (place, re.sub(r"^ *(>>>|\.\.\.).*", "", text, flags=re.M)) for place, text in docstrings()
    )
    for path in sorted(
        path for place in ("conf", "zoo") for path in (ROOT / place).rglob("*.yaml")
    ):
        comments = re.findall(r"# .*", path.read_text("utf-8"))
        yield path.relative_to(ROOT).as_posix(), "\n".join(comments)
    cards = [*(ROOT / "zoo").rglob("*.md"), *ROOT.glob("plugins/*/README.md")]
    for path in sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *cards]):
        if path.name not in ("reference.md", "zoo.md"):  # titles of papers; lines of docstrings
            yield path.relative_to(ROOT).as_posix(), FENCE.sub("", path.read_text("utf-8"))


def prose_like(pattern: re.Pattern[str]) -> list[str]:
    """Places and words of prose matching a pattern, beside code."""
    return [
        f"{place}: {match[0]}"
        for place, text in prose()
        for match in pattern.finditer(CODE.sub(" ", text))
    ]


#: Words that no engineer would write: ``one a clip``, ``is told``, ``a value that is none``.
ODD = re.compile(
    r"\b(?:one|two) an? (?:clip|frame|step|sensor|run|recording|process|worker|row|line|image)\b"
    r"|\b(?:is|are|was|were) (?:then )?told\b|\bthat (?:is|are) none\b|\bis no (?:error|matter)\b"
)


def test_pages_and_comments_use_plain_words() -> None:
    odd = prose_like(ODD)
    assert ODD.search("two a clip")
    assert not odd, "\n".join(odd)


def test_one_spelling_of_english() -> None:
    odd = prose_like(AMERICAN)
    assert AMERICAN.search("a Color of its neighbors".lower())
    assert not odd, "\n".join(odd)
