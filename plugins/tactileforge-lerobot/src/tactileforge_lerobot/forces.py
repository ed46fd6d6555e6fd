"""Forces of touch features: offset, signs and units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.data import NEWTONS, named_unit
from tactileforge.errors import ConfigError, DataError
from tactileforge_lerobot.reading import Reading, TouchFeature
from tactileforge_lerobot.rows import EpisodeRows


class Forces:
    """Forces of a data set.

    Args:
        reading: Options of the forces.
    """

    def __init__(self, reading: Reading) -> None:
        self.reading = reading
        self._turned: dict[tuple[str, tuple[int, ...]], float] = {}

    def read(
        self, rows: EpisodeRows, touch: TouchFeature, episodes: Sequence[EpisodeRows]
    ) -> NDArray[np.float32]:
        """Reads the forces of an episode, (N, 3).

        Args:
            rows: Rows of the episode.
            touch: The touch feature.
            episodes: Rows of all episodes of the data set, in order.

        Raises:
            DataError: A table is damaged, or the first rows may be of a contact.
        """
        self._check_unit(rows, touch)
        forces = self._zeroed(rows, touch, episodes) * np.asarray(self.reading.sign, np.float64)
        if self.reading.turn_z:
            forces[:, 2] *= self._turn(touch, episodes)
        with np.errstate(over="ignore"):
            return forces.astype(np.float32)

    def _check_unit(self, rows: EpisodeRows, touch: TouchFeature) -> None:
        """Raises a `ConfigError` for another unit than newton by the names, without a factor."""
        named = rows.info.features[touch.force].get("names")
        if isinstance(named, Mapping):
            named = next(iter(named.values()), None)
        names = [*named] if isinstance(named, list) else []
        for column, factor in zip(touch.columns, self.reading.sign, strict=True):
            name = str(names[column]) if column < len(names) else ""
            unit = named_unit(name)
            if unit in ("", "N") or abs(factor) != 1:
                continue
            newton = NEWTONS.get(unit)
            signs = [f"{one * (newton or 1):.6g}" for one in self.reading.sign]
            factors = f"data.force_sign=[{','.join(signs)}]" if newton else "factors to newton"
            raise ConfigError(
                f"{rows.root}: {touch.force} is in {unit} by its name {name!r}: give {factors}, or "
                "correct the name in meta/info.json"
            )

    def _zeroed(
        self, rows: EpisodeRows, touch: TouchFeature, episodes: Sequence[EpisodeRows]
    ) -> NDArray[np.float64]:
        forces = rows.numbers(touch.force, touch.columns).astype(np.float64)
        if not self.reading.zero_rows:
            return forces
        home = episodes[0] if self.reading.objects else rows
        first = home.numbers(touch.force, touch.columns)[: self.reading.zero_rows]
        first = first[np.isfinite(first).all(1)]
        where = f"{home.place[0]}: the first {self.reading.zero_rows} rows of {touch.force}"
        if not len(first):
            raise DataError(f"{where} have no numbers; leave them out, or give data.zero_rows=0")
        most, allowed = float(np.abs(first[:, 2]).max()), self.reading.zero_most
        if allowed is not None and most >= allowed:
            raise DataError(
                f"{where} reach {most:.4g} along z, where data.zero_most={allowed:g}: they may be "
                "of a contact, so their median is no offset; leave them out"
            )
        zeroed: NDArray[np.float64] = forces - np.median(first, axis=0)
        return zeroed

    def _turn(self, touch: TouchFeature, episodes: Sequence[EpisodeRows]) -> float:
        """Factor of z for a positive mean over all readable episodes."""
        key = (touch.force, tuple(touch.columns))
        if key not in self._turned:
            total = 0.0
            for rows in episodes:
                try:
                    total += float(np.nansum(self._zeroed(rows, touch, episodes)[:, 2]))
                except DataError:
                    continue
            self._turned[key] = -1.0 if total * self.reading.sign[2] < 0 else 1.0
        return self._turned[key]
