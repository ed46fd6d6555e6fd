"""The data set ``webdataset``: tars of samples of other programs, described by a layout."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from tactileforge.contracts import Guess, Recording
from tactileforge.data import Bad, ShardFolder, Source, Summary
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, command
from tactileforge.plugins import cache_folder
from tactileforge.reading import (
    Drawn,
    Lines,
    add_once,
    as_texts,
    check_share,
    check_split,
    is_held_out,
    one_of_few,
)
from tactileforge_datasets.samples.layout import SampleLayout, parse_samples
from tactileforge_datasets.samples.opened import SampleOpener
from tactileforge_datasets.samples.tars import Tar, find_tars
from tactileforge_datasets.samples.units import SampleTar, Unit, read_samples

#: Recordings that are opened to count frames and labels; those of more are estimated from them.
_COUNTED = 20_000


class WebDataset(Drawn):
    """Tars of samples of other programs, as webdataset has them (`docs/data.md`).

    Frames and videos are read where they lie. Tars of this machine are indexed by the headers of
    their members; a tar behind a URL is fetched whole when it is needed, and kept in the cache.

    Args:
        root: Folder of the tars, or its URL.
        layout: Parts of a sample and their meanings, see `samples.layout.SampleLayout`.
        tars: Names of tars with ranges, ``train-{000..099}.tar``, or patterns; several in a list.
        val_tars: Tars of validation; [] holds out a share of the others.
        val: Share held out for validation, without ``val_tars``.
        cache: Folder of the cache for tars behind a URL; None for the user's cache folder.
        cache_gb: Size limit of the cache, GB; None for no limit. It must hold the tars read by all
            workers at a time.

    Raises:
        ConfigError: A share outside 0..1, no layout, or an invalid one; names the key.
    """

    def __init__(
        self,
        root: str,
        layout: Mapping[str, Any] | None = None,
        tars: str | Sequence[str] = "*.tar",
        val_tars: str | Sequence[str] = (),
        val: float = 0.1,
        cache: str | None = None,
        cache_gb: float | None = None,
    ) -> None:
        check_share(val)
        if not layout:
            raise ConfigError(
                "data.layout is missing: it says which part of a sample is what "
                f"(docs/data.md); {command('data', 'inspect', root)} guesses one"
            )
        plain = OmegaConf.to_container(layout) if OmegaConf.is_config(layout) else layout
        self.layout = parse_samples(plain)
        self.root, self.val = root, val
        self.cache, self.cache_gb = cache, cache_gb
        self.tars, self.val_tars = as_texts(tars), as_texts(val_tars)
        self.skipped: list[str] = Lines()
        self._notes: list[str] = []
        self._unread: Counter[str] = Counter()

    @staticmethod
    def recognise(root: Path) -> Guess | None:
        """Guess the layout of a folder of tars, or of a single tar."""
        from tactileforge_datasets.samples.guess import guess_samples

        return guess_samples(root)

    @property
    def provides(self) -> frozenset[str]:
        """Labels of the layout."""
        return self.layout.provides

    @property
    def notes(self) -> list[str]:
        """Doubts about the recordings, and the limits of a source without an index."""
        unread = [f"{n} members .{ending}" for ending, n in sorted(self._unread.items())]
        left = [f"{self.root}: the layout has no place for {', '.join(unread)}"] if unread else []
        return [*dict.fromkeys(self._notes), *left]

    @cached_property
    def folder(self) -> ShardFolder:
        """Folder of the tars."""
        return ShardFolder(self.root, cache_folder(self.cache) / "webdataset", self.cache_gb)

    def sources(self, split: str) -> list[Source]:
        """One source with a part per tar; see `data.batches.sources.Sharded`.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: There is no tar.
            DataError: Not one recording can be opened.
            ConfigError: An unknown split, or a pattern of tars is invalid.
        """
        parts = self._parts(split)
        if self.folder.remote:
            return self._estimated(parts)
        indexed, seconds, summary = list[_TarPart](), list[float](), Summary()
        for part in self._indexed(parts):
            indexed += [part] if part.recordings else []
            # opened while its index is at hand
            if part.recordings and summary.recordings < _COUNTED:
                own = Summary.of(part.open(self._note))
                seconds.append(own.seconds)
                summary.merge(own)
        self._check(summary.recordings, split)
        rest = sum(part.recordings for part in indexed[len(seconds) :])
        if rest:
            self._notes.append(
                f"{self.root}: frames and labels of {rest:,} recordings are estimated from those "
                f"of the first {len(seconds)} tars; recordings are counted"
            )
        each = summary.seconds / max(1, summary.recordings)
        seconds += [each * part.recordings for part in indexed[len(seconds) :]]
        timed = [replace(part, seconds=one) for part, one in zip(indexed, seconds, strict=True)]
        whole = 1 + rest / max(1, summary.recordings)
        return _source(timed, summary.times(whole))

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, tar after tar.

        A recording that cannot be opened is left out and listed in ``skipped``.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: There is no tar.
            DataError: Not one recording can be opened.
            ConfigError: An unknown split, or a pattern of tars is invalid.
        """
        opened = 0
        for part in self._indexed(self._parts(split)):
            for recording in part.open(self._note):
                opened += 1
                yield recording
        self._check(opened, split)

    @property
    def held_out(self) -> list[str]:
        """The held-out unit."""
        if self.val_tars:
            return [f"the tars {', '.join(self.val_tars)}"]
        unit = self.layout.unit or "trial, with all sensors, cameras and repetitions in its name"
        return [f"by {unit}"] if self.val else []

    def _parts(self, split: str) -> list[_TarPart]:
        """Tars of a split, not indexed yet."""
        check_split(split)
        if split == "val" and not self.val_tars and not self.val:
            return []
        # a pattern of all tars may take in those of validation
        val = find_tars(self.folder, self.val_tars, self._odd)
        held_out = {tar.file for tar in val}
        tars = [
            tar for tar in find_tars(self.folder, self.tars, self._odd) if tar.file not in held_out
        ]
        if split == "val" and self.val_tars:
            tars = val
        if not tars:
            names = self.val_tars if split == "val" and self.val_tars else self.tars
            raise DataNotFoundError(
                f"{self.root}: no tar like {', '.join(names)}; set data.root to the folder of the "
                "tars, and data.tars to their names"
            )
        if self.val_tars:
            return [_TarPart(tar, self.layout, "", self.val) for tar in tars]
        # tars behind a URL are not fetched to know whether there are few
        whole = [] if self.folder.remote else [_TarPart(tar, self.layout, "", 0.0) for tar in tars]
        few = one_of_few((name for part in whole for name in part.names()), self.val)
        return [_TarPart(tar, self.layout, split, self.val, few) for tar in tars]

    def _indexed(self, parts: Sequence[_TarPart]) -> Iterator[_TarPart]:
        """Yields the readable tars with their numbers of recordings; notes their oddities."""
        last = None
        for part in parts:
            try:
                samples = part.samples
            except DataError as error:
                self._note(str(error), 1)
                continue
            for ending, count in samples.unread.items():
                self._unread[ending] += count
            units = samples.units
            if self.layout.by_frame and units and last == units[0].name:
                self._notes.append(
                    f"{part.tar.file}: {last} goes on from the tar before; its frames are two "
                    "recordings"
                )
            last = units[-1].name if units else None
            yield replace(part, recordings=len(part.units(samples)))

    def _estimated(self, parts: list[_TarPart]) -> list[Source]:
        """Source of tars behind a URL, by the first readable one."""
        own = Summary()
        for part in self._indexed(parts):
            own = Summary.of(part.open(self._note))
            if own.recordings:
                break
        if not own.recordings:
            self._check(0, parts[0].side if parts else "val")
            return []
        self._notes.append(
            f"{self.root}: {len(parts)} tars without an index are taken to be as long as "
            f"{part.tar.file}, and their bytes are not checked. A resumed run has the same batches "
            "only while the tars stay the same, and a pass may miss or repeat some clips; download "
            "them, or make shards with data pack, for exact passes"
        )

        alike = [replace(part, tar=one.tar, seconds=own.seconds) for one in parts]
        return _source(alike, own.times(len(parts)))

    def _check(self, opened: int, split: str) -> None:
        """Raises a `DataError` for training data without one readable recording."""
        if not opened and self.skipped and split != "val":
            raise DataError(
                f"{self.root}: not one recording can be opened; the first of {len(self.skipped)} "
                f"problems: {self.skipped[0]}"
            )

    def _odd(self, line: str) -> None:
        add_once(self.skipped, line)

    def _note(self, line: str, count: int) -> None:
        add_once(self.skipped, line)


@dataclass(frozen=True)
class _TarPart:
    """A tar as a part of its source.

    ``side`` is the split of its recordings, "" for all; ``few`` is held out, see `one_of_few`.
    """

    tar: Tar
    layout: SampleLayout
    side: str
    val: float
    few: frozenset[str] = frozenset()
    recordings: int = 0
    seconds: float = 0.0

    @property
    def samples(self) -> SampleTar:
        """Samples of the tar; fetches it if needed.

        Raises:
            DataError: It cannot be fetched or read.
        """
        return read_samples(self.tar.get(), self.tar.name, self.layout)

    @property
    def opener(self) -> SampleOpener:
        """Opener of the recordings."""
        return SampleOpener(self.layout, str(self.tar.folder.path / self.tar.file), self.tar.name)

    def units(self, samples: SampleTar) -> list[Unit]:
        """Recordings of the side."""
        if not self.side:
            return samples.units
        opener, on_val = self.opener, self.side == "val"
        return [
            unit
            for unit in samples.units
            if is_held_out(opener.held_out_with(unit), self.val, self.few) == on_val
        ]

    def names(self) -> Iterator[str]:
        """Yields the names of the units held out together; none of an unreadable tar."""
        with suppress(DataError):  # `open` names it
            yield from map(self.opener.held_out_with, self.samples.units)

    def open(self, bad: Bad) -> Iterator[Recording]:
        """Yields the recordings; see `data.batches.sources.Part`."""
        try:
            samples = self.samples
        except DataError as error:
            bad(str(error), max(1, self.recordings))
            return
        for line, count in samples.skipped:
            bad(line, count)
        for unit in self.units(samples):
            try:
                yield self.opener.open(unit)
            except DataError as error:
                bad(str(error), 1)


def _source(parts: Sequence[_TarPart], summary: Summary) -> list[Source]:
    return [Source("", parts, summary)] if summary.recordings else []
