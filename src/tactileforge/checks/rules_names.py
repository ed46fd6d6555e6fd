"""Checks of names and words: TF401 to TF499."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from tactileforge.checks.check import Check, Examples, Finding
from tactileforge.checks.codes import CODES
from tactileforge.checks.made import made_touch
from tactileforge.checks.names import is_blank, plain_name
from tactileforge.checks.seen import Seen
from tactileforge.checks.sides import side_of
from tactileforge.contracts import ACTIONS

_LABELS = frozenset({"labels"})
#: Objects whose spelling is compared, and keys that are kept; the first of a set, so that memory
#: does not grow with it.
_SPELLED, _KEPT = 300, 100_000


class SpelledAlike(Check):
    """Two objects with names of different spelling only."""

    code, level, needs = CODES["spelled_alike"], "warning", _LABELS
    title = "Names differ only in their spelling"
    why = (
        "red cup, Red_Cup and red  cup, or 1, 1.0 and 01, count as several objects: a classifier "
        "is taught to tell one from itself."
    )
    fix = "spell them alike, if they are one"

    def __init__(self) -> None:
        self._spellings: dict[str, set[str]] = {}

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        name = seen.recording.object
        if name is not None:
            plain = plain_name(name)
            if plain in self._spellings or len(self._spellings) < _SPELLED:
                self._spellings.setdefault(plain, set()).add(name)
        return ()

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        for names in self._spellings.values():
            if len(names) > 1:
                listed = ", ".join(map(repr, sorted(names)))
                yield self.found("", f"objects {listed} differ only in their spelling")

    @staticmethod
    def examples() -> Examples:
        """A number as text, and as a number."""
        return Examples(
            [made_touch(0, object="1"), made_touch(1, object="10")],
            [made_touch(0, object="1"), made_touch(1, object="1.0")],
        )


class OneClass(Check):
    """A label with one value alone."""

    code, level, needs = CODES["one_class"], "note", _LABELS
    title = "Only one class"
    why = "Nothing that tells one object, or action, from another can be learned."
    fix = "add others, or leave the label out"

    def __init__(self) -> None:
        self._names: dict[str, set[str]] = {"object": set(), "action": set()}
        self._count = Counter[str]()

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        one = seen.recording
        shown: dict[str, set[str]] = {"object": set(), "action": set()}
        if one.object is not None:
            shown["object"] = {one.object}
        if one.action is not None:
            numbers = np.unique(one.action[one.action >= 0]).tolist()
            shown["action"] = {ACTIONS[i] for i in numbers if i < len(ACTIONS)}
        for label, names in shown.items():
            self._count[label] += bool(names)
            if len(self._names[label]) < 2:  # one from several is all that is told
                self._names[label] |= names
        return ()

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        for label, names in self._names.items():
            if len(names) == 1 and self._count[label] > 1:
                name = next(iter(names))
                words = f"only one {label} ({name}) in {self._count[label]} recordings"
                yield self.found("", words)

    @staticmethod
    def examples() -> Examples:
        """Every touch is of one cup."""
        return Examples([made_touch(0), made_touch(1)], [made_touch(0), made_touch(2)])


class BlankNames(Check):
    """An object without a name to read."""

    code, level, needs = CODES["blank_names"], "warning", _LABELS
    title = "Names are blank"
    why = "A blank cell, nan or None became an object of its own: unknown things count as one."
    fix = "leave the cell empty where the object is unknown, or give it a name"

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        name = seen.recording.object
        if name is not None and is_blank(name):
            yield self.found(seen.key, f"its object is {name!r}")

    @staticmethod
    def examples() -> Examples:
        """An empty cell, read as nan."""
        return Examples([made_touch(object=None)], [made_touch(object="nan")])


class RepeatedKeys(Check):
    """Two recordings with one key."""

    code, level, needs = CODES["repeated_keys"], "error", _LABELS
    title = "Keys that several recordings have"
    why = "A key has to be unique: labels and files are found by it."
    fix = "give each a key of its own"

    def __init__(self) -> None:
        self._seen: set[str] = set()

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        if seen.key in self._seen:
            yield self.found(seen.key, "another recording has the same key")
        if len(self._seen) < _KEPT:
            self._seen.add(seen.key)

    @staticmethod
    def examples() -> Examples:
        """One key for two touches."""
        return Examples(
            [made_touch(0), made_touch(1)], [made_touch(0), made_touch(1, key="made/0")]
        )


class CaptionsOfSides(Check):
    """Captions with words for sides or turns, which a mirrored clip makes wrong.

    Args:
        mirrors: Ways in which clips are mirrored or turned in training: ``horizontal``,
            ``vertical``, ``turn``.
    """

    code, level, needs = CODES["captions_of_sides"], "warning", frozenset({"captions"})
    title = "Captions tell left from right, and clips are mirrored"
    why = (
        "A mirror changes {action} in a caption, but no other word: 'the ball slides left' stays, "
        "and is wrong in half of the clips."
    )
    fix = (
        "write {action} in its place, give these recordings upright: true in labels, or turn the "
        "mirrors off (augment.horizontal=0 augment.vertical=0)"
    )

    def __init__(self, mirrors: Iterable[str] = ("horizontal", "vertical")) -> None:
        self._mirrors = frozenset(mirrors)
        self._first, self._count, self._all = ("", ""), 0, 0

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        text = seen.recording.text
        if text:
            self._all += 1
            is_upright = bool(seen.recording.labels.get("upright"))
            if not is_upright and (word := side_of(text, self._mirrors)):
                self._count += 1
                self._first = self._first if self._first[0] else (seen.key, word)
        return ()

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        if self._count:
            key, word = self._first
            words = (
                f"{self._count} of {self._all} captions hold words such as {word!r} ({key}), and "
                "clips are mirrored"
            )
            yield self.found("", words, self._count / self._all)

    @staticmethod
    def examples() -> Examples:
        """A slide to the left in words, and as an action."""
        good = [
            made_touch(text="the ball is {action}"),
            made_touch(1, text="what is left of a cup"),
        ]
        kept = made_touch(2, text="press the left button", labels={"upright": "true"})
        return Examples([*good, kept], [made_touch(text="the ball slides left")])
