"""The path of a folder of unknown format, in place of the options of its reader."""

from __future__ import annotations

import re
from collections.abc import Iterable

from tactileforge.cli import hydra_value, unquoted
from tactileforge.contracts import Guess
from tactileforge.errors import ConfigError, home_path

#: Doubts about forces and tables that are left out, though there are some.
_LOST = re.compile(r"(^|: )(force|labels): .*left out(?!, since no force)")


def lost_labels(doubts: Iterable[str]) -> list[str]:
    """Doubts of a guess about omitted forces or tables.

    Example:
        >>> lost_labels(["fps: 30 is assumed", "labels: a.xls is left out: a spreadsheet"])
        ['labels: a.xls is left out: a spreadsheet']
    """
    return [line for line in doubts if _LOST.search(line)]


def guess_words(words: list[str], doubts: list[str] | None = None) -> list[str]:
    """Replaces the word of a path by the options of the best guess; later words change these.

    Args:
        words: Words of the command.
        doubts: Gets the doubts about the guess.
    """
    from tactileforge.datasets import recognise

    path = next((word.partition("=")[2] for word in words if word.startswith("path=")), None)
    if path is None or path in ("null", "None"):
        return words
    if named := next((word for word in words if word.startswith("data=")), None):
        raise ConfigError(f"{named} and a path: leave the path out, or {named}")
    if "data.guess=false" in words:
        raise ConfigError(
            f"data.guess=false, and a path, which is guessed: give data=NAME data.root="
            f"{unquoted(path)} with a layout or a map (docs/data.md)"
        )
    found = recognise(home_path(unquoted(path)))
    name, guess = found[0]
    others = ", ".join(f"{other} ({one.format})" for other, one in found[1:3])
    print(f"{unquoted(path)}: {guess.format}, read by data={name}" + (others and f"; or: {others}"))
    words = [word for word in words if word != "data.guess=true"]
    for doubt in guess.doubts:
        print(f"  to be checked: {doubt}")
    if guess.doubts:
        print(f"  {_correction(guess)}")
    if doubts is not None:
        doubts += guess.doubts
    options = [f"++data.{key}={hydra_value(value)}" for key, value in guess.options.items()]
    return [f"data={name}", *options, *words]


def _correction(guess: Guess) -> str:
    """How a guess is corrected: by words of the command, or in a file."""
    from tactileforge.datasets import LAYOUT_FILE

    if layouts := guess.options.get("layouts"):
        key = f"data.layouts.{next(iter(layouts))}.sensor"
        return f"correct one by its key ({key}=NAME), or in {LAYOUT_FILE}, written by data inspect"
    if "root" in guess.options and len(guess.options) > 1:
        keys = ", ".join(f"data.{key}" for key in guess.options if key != "root")
        return f"correct one by its key, of {keys}, or in the options that data inspect writes"
    return "correct one by a key behind the path, data.KEY=VALUE (docs/keys.md)"
