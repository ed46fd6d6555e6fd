"""Data module: from a data set to the batches of a run."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from functools import partial
from inspect import signature
from itertools import chain
from typing import Protocol

import lightning as L
import torch

from tactileforge.contracts import Batch, Column, Dataset, Recording
from tactileforge.data.batches.allocate import allocate
from tactileforge.data.batches.clips import Clips, Skipped
from tactileforge.data.batches.columns import CutColumns, measure_columns
from tactileforge.data.batches.leaks import find_leaks, group_by_source, leak_warning
from tactileforge.data.batches.loader import Loader
from tactileforge.data.batches.pairs import Pairs
from tactileforge.data.batches.source_samplers import (
    FullSource,
    WindowedSource,
    WorkerId,
    estimate_clips,
)
from tactileforge.data.batches.sources import Source, sources_of
from tactileforge.data.batches.stream import BatchIndexSampler, Stream
from tactileforge.data.batches.transfer import Transfer
from tactileforge.data.labels.augment import Augment, fill_captions
from tactileforge.data.shards.summary import Summary
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.util.distributed import seed_step

log = logging.getLogger(__name__)

#: Recordings of a large source for checks and for the report.
_SAMPLE = 256
#: Largest number of validation recordings to test for readability beforehand.
_FEW = 20


class Examiner(Protocol):
    """Looks at the recordings of a set before it is trained on, and warns.

    Attributes:
        found: A line for each check that found something, ``CODE what; fix``.
    """

    found: list[str]

    def look(self, data: TouchData, train: Sequence[Recording], val: Sequence[Recording]) -> None:
        """Look at training and validation recordings, or samples of them."""

    def of_labels(self, labels: AbstractSet[str]) -> None:
        """Warn of what makes labels that are learned useless in the set as a whole."""


class TouchData(L.LightningDataModule):
    """Clips of a data set, in batches.

    Args:
        dataset: Data set to read, a plugin of that kind.
        frames: Frames of a clip.
        size: Height and width of the encoder's input.
        batch_size: Clips of a batch, on one process.
        spacing: Seconds between the frames of a clip.
        hop: Seconds between the ends of neighbouring clips.
        match: Share of a batch drawn for matching; 0 without a matching objective.
        shares: Smallest share of the rest from sources with a label, by label.
        window: Recordings of a source held by one reader; a smaller source is sampled as a whole.
        workers: Reading processes.
        cache_mb: Megabytes of frames kept in memory, over all readers.
        max_bad: Tolerated share of unreadable recordings; one is always tolerated.
        seed: Seed of the run.
        augment: Augmentation of clips and labels; None for none.
        limit: Largest number of batches of an epoch (int), or their share (float).
        columns: Extra columns of the batch.

    Attributes:
        columns: The columns with their sizes; None without any, and before `setup`.
        objects: Names of the training objects, sorted: of the whole of small sources, and of a
            sample of large ones; empty before `setup`.
        observers: Functions called with each batch on the host, and whether it is for training.
        examiner: Looks at the recordings in `setup`; None for none.
    """

    def __init__(
        self,
        dataset: Dataset,
        frames: int,
        size: tuple[int, int],
        batch_size: int = 64,
        spacing: float = 0.0667,
        hop: float = 0.2,
        match: float = 0.25,
        shares: Mapping[str, float] | None = None,
        window: int = 1024,
        workers: int = 2,
        cache_mb: float = 1024,
        max_bad: float = 0.01,
        seed: int = 0,
        augment: Augment | None = None,
        limit: float = 1.0,
        columns: Sequence[Column] = (),
    ) -> None:
        super().__init__()
        self._declared = columns
        self.columns: CutColumns | None = None
        self.dataset = dataset
        # some data sets have a share of validation as an option: then messages name it
        self._has_share = "val" in signature(type(dataset)).parameters
        self.hop, self.spacing, self.frames = hop, spacing, frames
        cut: Callable[..., Clips] = getattr(dataset, "cut", Clips)
        self._cut = partial(cut, frames=frames, spacing=spacing, hop=hop, size=size)
        self.batch_size = batch_size
        self.match = match
        self.shares = {label: share for label, share in (shares or {}).items() if share}
        self.window = window
        self.workers = workers
        self.cache_mb = cache_mb / max(1, workers)  # each worker process has a cache of its own
        self.max_bad = max_bad
        self.seed = seed
        self.augment = augment
        self.limit = limit
        self.observers: list[Callable[[Batch, bool], None]] = []
        self.sources: dict[str, list[Source]] = {}
        self.train: Clips | None = None
        self.val: Clips | None = None
        self._whole: dict[int, Clips] = {}
        self._bad: Skipped = {}
        self._transfer = Transfer()
        self.examiner: Examiner | None = None
        self.objects: list[str] = []

    @property
    def skipped(self) -> Skipped:
        """Skipped recordings: unindexed or unreadable ones, with their counts."""
        return {line: (line, 1) for line in self.dataset.skipped} | self._bad

    @property
    def findings(self) -> list[str]:
        """A line for each check with findings, ``CODE what; fix``."""
        return [] if self.examiner is None else self.examiner.found

    @property
    def allowed(self) -> int:
        """Largest number of unreadable recordings before a run stops."""
        total = sum(self.summary(split).recordings for split in self.sources)
        return max(1, int(self.max_bad * total))

    def summary(self, split: str) -> Summary:
        """Counts of a split."""
        total = Summary()
        for source in self.sources.get(split, ()):
            total.merge(source.summary)
        return total

    def setup(self, stage: str = "fit") -> None:
        """Index the recordings; decodes nothing but the ends of a few for validation.

        Raises:
            DataError: No training clip can be cut; see also `contracts.Dataset.recordings`.
            ConfigError: Matching without pairs in the data, a column without its track, or
                augmentation of clips that are not single touches.
        """
        if self.train is not None:
            return
        self.sources = {split: sources_of(self.dataset, split) for split in ("train", "val")}
        if not self.sources["train"]:
            text = "the data set has no recording for training"
            fix = ": all are held out for validation"
            fix += "; give data.val=0" if self._has_share else ""
            raise DataNotFoundError(text + fix if self.sources["val"] else text)
        opened: list[list[Recording]] = []
        whole: list[int] = []
        for number, source in enumerate(self.sources["train"]):
            is_whole = len(source.parts) == 1 or source.summary.recordings <= self.window
            recordings = source.open(_first(source, None if is_whole else _SAMPLE), self._note)
            opened.append(recordings)
            whole += [number] if is_whole else []
        sample = list(chain.from_iterable(opened))
        self.objects = sorted({one.object for one in sample if one.object is not None})
        # columns are measured before any clip is cut: the cut that follows is given their sizes
        if self._declared:
            self.columns = measure_columns(self._declared, sample)
            self._cut = partial(self._cut, columns=self.columns)
        self._whole = {number: self._clips(opened[number]) for number in whole}
        alone = len(self.sources["train"]) == 1 and self._whole
        self.train = self._whole[0] if alone else self._clips(sample)
        if self.augment and not self.train.is_touch:
            raise ConfigError(
                "augment changes clips of one touch, and the data cuts samples of its own: give "
                "augment=null"
            )
        if self.match and not Pairs(*self.train.labels()):
            raise ConfigError(
                "matching needs two objects, one of them touched by two sensors, or two actions, "
                "each shown twice; the data has neither. Leave match out of objective=[...]"
            )
        held_out = [
            source.open(_first(source, self.window), self._note) for source in self.sources["val"]
        ]
        trained, validated = group_by_source(self.sources, opened, held_out)
        if found := find_leaks(trained, validated):
            log.warning(leak_warning(found))
        validation = self._readable(list(chain.from_iterable(held_out)))
        if self.examiner is not None:
            self.examiner.look(self, sample, validation)
        if validation:
            self.val = self._clips(validation)
        else:
            share = " (data.val= is the share of names that is held out)" if self._has_share else ""
            log.warning("no recording is held out: nothing is validated%s", share)

    def check(self, needs: Mapping[str, frozenset[str]]) -> None:
        """Check the training clips for the labels needed by objectives.

        Args:
            needs: Labels by the name of the objective; ``"a|b"`` asks for one of the two.

        Raises:
            ConfigError: A label is missing; the message names the labels of the data and the
                objectives without a missing one.
            DataNotFoundError: The label is missing because the data is.
        """
        provides = self.summary("train").labels if self.sources else self.dataset.provides
        provides |= self.train.provides if self.train is not None else frozenset()
        missing = {
            key: [need for need in sorted(required) if not provides & set(need.split("|"))]
            for key, required in needs.items()
        }
        unmet = {key: labels for key, labels in missing.items() if labels}
        if not unmet:
            labels = {label for need in chain(*needs.values()) for label in need.split("|")}
            if self.examiner is not None:
                self.examiner.of_labels(labels)
            return
        if not self.sources:
            next(iter(self.dataset.recordings("train")), None)  # a wrong folder has no labels
        problems = "; ".join(
            f"objective {key!r} needs {' and '.join(required).replace('|', ' or ')}"
            for key, required in unmet.items()
        )
        left = ",".join(key for key in needs if key not in unmet)
        fix = f"train with 'objective=[{left}]', or use" if left else "use"
        raise ConfigError(
            f"{problems}, which the data does not have (it has: "
            f"{', '.join(sorted(provides)) or 'frames only'}): {fix} data that has it"
        )

    def stream(self, rank: int = 0, world: int = 1, accumulate: int = 1) -> Stream:
        """Training batches of one process.

        Args:
            rank: Rank of the process.
            world: Number of processes.
            accumulate: Batches of an optimizer step; the length of an epoch is a multiple of it.

        Raises:
            ConfigError: The batch cannot be shared out among the sources.
        """
        if self.train is None:
            raise DataError("setup() has not been called")
        sources, hop = self.sources["train"], self.hop
        sizes = [
            len(self._whole[i])
            if i in self._whole
            else sum(estimate_clips(part.recordings, part.seconds, hop) for part in source.parts)
            for i, source in enumerate(sources)
        ]
        n_pairs = round(self.match * self.batch_size / 2)
        weighed = [
            (source.name, size if source.weight is None else source.weight, source.summary.labels)
            for source, size in zip(sources, sizes, strict=True)
        ]
        plain = self.batch_size - 2 * n_pairs
        counts = allocate(plain, weighed, self.shares)
        tracks: list[FullSource | WindowedSource] = []
        for i, (source, count) in enumerate(zip(sources, counts, strict=True)):
            # the only source takes the seed of the run, others have their own; 2 keeps these apart
            # from the seeds of pairs ([seed, number, rank, 1] in `Stream`)
            seed = [self.seed] if len(sources) == 1 else [self.seed, 2, i]
            if i in self._whole:
                tracks.append(FullSource(self._whole[i], count, seed))
            else:
                cut = partial(self._cut, cache_mb=self.cache_mb / len(sources))
                tracks.append(WindowedSource(source, cut, count, seed, self.window, hop))
        workers = max(1, self.workers)
        multiple = accumulate
        if len(self._whole) < len(sources):  # a reader then keeps its worker from epoch to epoch
            multiple *= workers
        length = int(sum(sizes)) // (max(1, plain) * world)
        length = (
            min(length, self.limit) if isinstance(self.limit, int) else int(length * self.limit)
        )
        length = length // multiple * multiple
        reader = WorkerId(rank, world, workers)
        return Stream(tracks, n_pairs, self.seed, reader, max(multiple, length))

    def train_dataloader(self) -> Loader:
        """Batches from the current step of the run to the end of the epoch."""
        trainer = self.trainer
        accumulate = trainer.accumulate_grad_batches if trainer else 1
        stream = self.stream(
            rank=trainer.global_rank if trainer else 0,
            world=trainer.world_size if trainer else 1,
            accumulate=accumulate,
        )
        if trainer is None:
            loader = Loader.of(stream, BatchIndexSampler(len(stream)), self.workers)
            loader.prepare = lambda batch, number: self.prepared(batch, number + 1, True)
            return loader
        # a function: later epochs use the same loader, and begin at other steps
        position = lambda: trainer.global_step * accumulate if trainer else 0  # noqa: E731
        return Loader.of(stream, BatchIndexSampler(len(stream), position), self.workers)

    def val_stream(self) -> Stream:
        """Batches of held-out clips, the same each time."""
        if self.val is None:
            raise DataError("nothing is held out")
        paired = bool(self.match) and bool(Pairs(*self.val.labels()))
        n_pairs = round(self.match * self.batch_size / 2) if paired else 0
        plain = self.batch_size - 2 * n_pairs
        length = max(1, len(self.val) // max(1, plain))
        track = FullSource(self.val, plain, [self.seed])
        return Stream([track], n_pairs, self.seed, WorkerId(), length)

    def val_dataloader(self) -> Loader | list[Loader]:
        """Held-out clips, in the same batches each time; [] without any."""
        if self.val is None:
            return []
        stream = self.val_stream()
        loader = Loader.of(stream, BatchIndexSampler(len(stream)), self.workers)
        if self.trainer is None:
            loader.prepare = lambda batch, number: self.prepared(batch, number + 1, False)
        return loader

    def on_before_batch_transfer(self, batch: Batch, dataloader_idx: int) -> Batch:
        """Draw changes of clips on the host, with their labels; adds ``paired`` (bool)."""
        trainer = self.trainer
        if trainer is None or "paired" in batch:  # a loop of one's own: the loader has done so
            return batch
        number = trainer.fit_loop.total_batch_idx + 1 if trainer.training else 0
        return self.prepared(batch, number, trainer.training, trainer.global_rank)

    def prepared(self, batch: Batch, number: int, training: bool, rank: int = 0) -> Batch:
        """Batch with drawn changes of clips and labels, its captions, and ``paired`` (bool).

        Args:
            batch: Batch on the host, as a reader gives it.
            number: Number of the batch in the run, from 1.
            training: Whether it is for training, where changes are drawn.
            rank: Rank of the process.
        """
        if training:
            # by the number of the batch, not by a running generator: a resumed run draws the same
            # flips as an undisturbed one
            seed_step(self.seed, number, rank + 1)
            if self.augment:
                batch = self.augment.labels(batch, self._declared)
        fill_captions(batch)
        # decided on the host: on a device, the question would make every step wait for the card
        batch["paired"] = bool((batch["group"] >= 0).any())
        for observe in self.observers:
            observe(batch, training)
        return batch

    def transfer_batch_to_device(
        self, batch: Batch, device: torch.device, dataloader_idx: int
    ) -> Batch:
        """Copy a batch to a device; see `Transfer`."""
        return self._transfer(batch, device)

    def _clips(self, recordings: Sequence[Recording]) -> Clips:
        return self._cut(recordings, cache_mb=self.cache_mb)

    def _readable(self, recordings: list[Recording]) -> list[Recording]:
        """Readable ones of a few recordings, tested at both ends; of many, all."""
        if len(recordings) > _FEW:  # a clip of another recording replaces an unreadable one
            return recordings
        readable = []
        for one in recordings:
            try:
                one.frames.read([0, len(one.frames) - 1])
                readable.append(one)
            except DataError as error:
                self._note(f"{one.key}: {error}", 1)
        return readable

    def _note(self, line: str, count: int) -> None:
        self._bad[line] = line, count


def _first(source: Source, limit: int | None) -> list[int]:
    """Numbers of the first parts of a source with so many recordings in all; None for all."""
    chosen: list[int] = []
    total = 0
    for number, part in enumerate(source.parts):
        if limit is not None and total >= limit:
            break
        chosen.append(number)
        total += part.recordings
    return chosen
