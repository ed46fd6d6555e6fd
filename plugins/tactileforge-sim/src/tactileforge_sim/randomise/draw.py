"""Choices of randomised rows, and draws from the table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from tactileforge.errors import ConfigError, unknown
from tactileforge_sim.randomise.table import TABLE, rng

#: ``none``, ``unit``, ``all``, or names of rows.
Choice: TypeAlias = str | Sequence[str]

CHOICES: dict[str, frozenset[str]] = {
    "none": frozenset(),
    "unit": frozenset(name for name, row in TABLE.items() if row.scope == "unit"),
    "all": frozenset(TABLE),
}


def randomised_rows(choice: Choice) -> frozenset[str]:
    """Names of the randomised rows.

    Args:
        choice: ``none``, ``unit``, ``all``, or names of rows.

    Raises:
        ConfigError: A name is unknown; the message gives the nearest.
    """
    if isinstance(choice, str) and choice in CHOICES:
        return CHOICES[choice]
    names = (choice,) if isinstance(choice, str) else tuple(choice)
    for name in names:
        if name not in TABLE:
            raise ConfigError(unknown("randomise", name, {*TABLE, *CHOICES}))
    return frozenset(names)


class RandomDraw:
    """Values of the rows for one unit or scene.

    Args:
        choice: Randomised rows; see `randomised_rows`.
        seed: Seed of the values.
        sensor: Type of the sensor, for rows of units.

    Example:
        >>> RandomDraw("none", seed=3)["contrast"]
        1.0
    """

    def __init__(self, choice: Choice, seed: int, sensor: str = "") -> None:
        self.chosen = randomised_rows(choice)
        self.seed, self.sensor = seed, sensor

    def __getitem__(self, name: str) -> float:
        row = TABLE[name]
        return row.draw(self.seed, self.sensor) if name in self.chosen else row.neutral

    def rng(self, name: str) -> np.random.Generator:
        """A generator for further random numbers of a row."""
        return rng(self.seed, f"{name} detail", self.sensor)
