"""Official splits of data sets: one known property of a recording tells its part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

_NONE: frozenset[str] = frozenset()


@dataclass(frozen=True)
class OfficialSplit:
    """Split into training, validation and test by one known property of each recording.

    Attributes:
        name: Name in options.
        about: Origin, in words.
        fact: Name of the deciding property.
        train: Its values for training; None for every value outside the other two sets.
        test: Its values for test.
        val: Its values for validation; if empty, a share of the training is held out.

    Example:
        >>> split = OfficialSplit("mine", "", "object", train=None, test=frozenset({"cup"}))
        >>> split.side({"object": "cup"}), split.side({"object": "mug"})
        ('test', 'train')
    """

    name: str
    about: str
    fact: str = ""
    train: frozenset[str] | None = None
    test: frozenset[str] = _NONE
    val: frozenset[str] = _NONE

    def side(self, facts: Mapping[str, str]) -> str | None:
        """``train``, ``val`` or ``test`` for a recording's properties; None outside the split."""
        value = facts.get(self.fact, "")
        for side, values in (("test", self.test), ("val", self.val)):
            if value in values:
                return side
        return "train" if self.train is None or value in self.train else None


ALL_FOR_TRAINING = OfficialSplit("all", "everything is for training")
