"""Forces of touch features: offset, signs and units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge_lerobot.rows import EpisodeRows
from tactileforge_lerobot.touch_features import ReadOptions, TouchFeature


class Forces:
    """Forces of a data set.

    Args:
        reading: Options of the forces.
    """

    def __init__(self, reading: ReadOptions) -> None:
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
        newton = self._newton(rows, touch)
        x, y, z = self.reading.force.sign
        sign = (x, y, self._turn(touch, episodes) if z == "mean" else z)
        forces = self._zeroed(rows, touch, episodes) * (np.asarray(sign, np.float64) * newton)
        with np.errstate(over="ignore"):
            return forces.astype(np.float32)

    def _newton(self, rows: EpisodeRows, touch: TouchFeature) -> float:
        """Newton of the unit; a `ConfigError` where names say another, and no option does."""
        named = rows.info.features[touch.force].get("names")
        if isinstance(named, Mapping):
            named = next(iter(named.values()), None)
        names = [*named] if isinstance(named, list) else []
        said = [str(names[column]) if column < len(names) else "" for column in touch.columns]
        return self.reading.force.newtons(said, f"{rows.root}: {touch.force}", "data.force_unit")

    def _zeroed(
        self, rows: EpisodeRows, touch: TouchFeature, episodes: Sequence[EpisodeRows]
    ) -> NDArray[np.float64]:
        forces = rows.numbers(touch.force, touch.columns).astype(np.float64)
        if not self.reading.tare:
            return forces
        home = episodes[0] if self.reading.objects else rows
        first = home.numbers(touch.force, touch.columns)[: self.reading.tare]
        first = first[np.isfinite(first).all(1)]
        where = f"{home.place[0]}: the first {self.reading.tare} rows of {touch.force}"
        if not len(first):
            raise DataError(f"{where} have no numbers; leave them out, or give data.force_tare=0")
        most, allowed = float(np.abs(first[:, 2]).max()), self.reading.tare_most
        if allowed is not None and most >= allowed:
            raise DataError(
                f"{where} reach {most:.4g} along z, where data.force_tare_most={allowed:g}: they "
                "may be of a contact, so their median is not an offset; leave them out"
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
            self._turned[key] = -1.0 if total < 0 else 1.0
        return self._turned[key]
