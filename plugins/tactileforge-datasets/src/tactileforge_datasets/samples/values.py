"""Values of the samples of a recording, as numbers and as text."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data import Blob, stated
from tactileforge.errors import DataError, unknown
from tactileforge_datasets.samples.layout import SampleLayout, words_of
from tactileforge_datasets.samples.places import (
    Place,
    as_numbers,
    fill,
    parse_place,
    read_value,
)
from tactileforge_datasets.samples.units import Sample, Unit


class UnitValues:
    """Values of a recording, each read once.

    Args:
        layout: The layout.
        unit: Its samples.
        where: Name of the recording, for messages.
    """

    def __init__(self, layout: SampleLayout, unit: Unit, where: str) -> None:
        self.layout, self.unit, self.where = layout, unit, where
        self._read: dict[tuple[int, str], Any] = {}

    def rows(self, text: str, count: int) -> NDArray[np.float64]:
        """Numbers of a place, one row per frame: float64 (T, ...); NaN for missing ones."""
        place, samples = parse_place(text), self.unit.samples
        read = [self._value(place, i) for i in range(len(samples))]
        known = [as_numbers(one, f"{self.where}: {place}") for one in read if one is not None]
        if not known:
            return np.full(count, np.nan)
        if not self.layout.by_frame:
            whole = known[0][None] if count == 1 and known[0].shape[:1] != (1,) else known[0]
            if whole.shape[:1] != (count,):
                raise DataError(
                    f"{self.where}: {place} has shape {whole.shape}, where the recording has "
                    f"{count} frames; correct it"
                )
            return whole
        # samples are frames: each gives one row, and rows of a track have one shape
        odd = next((one for one in known if one.shape != known[0].shape), None)
        if odd is not None:
            raise DataError(
                f"{self.where}: {place} has shape {known[0].shape} in one frame and {odd.shape} in "
                "another; correct it"
            )
        out = np.full((count, *known[0].shape), np.nan)
        out[[one is not None for one in read]] = known
        return out

    def _value(self, place: Place, number: int) -> Any:
        """Value of a sample, read once; None for a missing optional one."""
        sample = self.unit.samples[number]
        if (number, str(place)) not in self._read:
            is_there = place.part in sample.parts
            if not is_there and not place.optional:
                raise self.missing(sample, place.part)
            blob = sample.parts.get(place.part)
            where = f"{self.where}, {sample.key}" if self.layout.by_frame else self.where
            value = read_value(place, blob, where) if blob else None
            self._read[number, str(place)] = value
        return self._read[number, str(place)]

    def text(self, template: str) -> str:
        """A template filled in; "" with a missing value.

        Raises:
            DataError: Frames of the recording differ in it, or a value has no word.
        """
        if not template:
            return ""
        texts = {self.filled(template, i) for i in self.numbers(template)}
        if len(texts) > 1:
            one, other = sorted(texts)[:2]
            raise DataError(
                f"{self.where}: frames with {one!r} and with {other!r} for {template}; a recording "
                "has one value: correct it, or part them by layout.samples"
            )
        return texts.pop()

    def numbers(self, template: str) -> range:
        """Numbers of the samples behind a template."""
        read = any(True for _ in self.layout.places(template))
        return range(len(self.unit.samples) if read else 1)

    def filled(self, template: str, number: int) -> str:
        """A template filled in from one sample; "" with a missing value.

        Raises:
            DataError: A part or name is missing, or a value is no text or has no word.
        """
        words, empty = words_of(self.layout), False

        def value(name: str) -> str:
            nonlocal empty
            if name in self.unit.values:
                said = self.unit.values[name]
            else:
                found = self._value(parse_place(name), number)
                if isinstance(found, list | dict):
                    raise DataError(f"{self.where}: {name} is no text and no number; correct it")
                said = stated(found)
            empty = empty or not said
            meanings = words.get(name.removesuffix("?"))
            if said and meanings is not None:
                if said not in meanings:
                    fault = unknown(f"value of {name}", said, meanings)
                    raise DataError(f"{self.where}: {fault}; add it to layout.words")
                return meanings[said]
            return said

        filled = fill(template, value)
        return "" if empty else filled

    def part(self, sample: Sample, name: str) -> Blob:
        """Content of a part.

        Raises:
            DataError: The sample lacks it; names the nearest.
        """
        if name.lower() not in sample.parts:
            raise self.missing(sample, name)
        return sample.parts[name.lower()]

    def missing(self, sample: Sample, name: str) -> DataError:
        """Error of a missing part."""
        return DataError(f"{self.where}, {sample.key}: {unknown('part', name, sample.parts)}")
