"""Everything between a data set and the batches of a run."""

from __future__ import annotations

import signal
from typing import Any

import cv2
import lightning as L
import torch
from torch.utils.data import DataLoader

from tactileforge.contracts import Dataset
from tactileforge.data.clips import Clips, collate
from tactileforge.data.sampler import Batches, Pairs
from tactileforge.errors import ConfigError, DataError

#: Labels of a batch that objectives may need.
LABELS = ("force", "action", "object", "text", "image")


class Loader(DataLoader[dict[str, Any]]):
    """A loader that a run can resume from at any step.

    Its place is that of the run (see `Batches`); what it keeps is what may not change in between.
    """

    def state_dict(self) -> dict[str, int]:
        """What the order of batches depends on."""
        batches = self.batch_sampler
        assert isinstance(batches, Batches)
        return {
            "clips": batches.clips,
            "batch size": batches.size,
            "seed": batches.seed,
            "processes": batches.world,
        }

    def load_state_dict(self, state: dict[str, int]) -> None:
        """Checks that nothing has changed.

        Raises:
            ConfigError: Names what has, and both values.
        """
        for key, now in self.state_dict().items():
            if state[key] != now:
                raise ConfigError(
                    f"resume: {key} was {state[key]} and is {now}; a resumed run goes on with the "
                    "same data, batches and processes (init= starts a new run from its weights)"
                )


class TouchData(L.LightningDataModule):
    """Clips of one data set, in batches.

    Args:
        dataset: A data set plugin.
        frames: Frames of a clip.
        size: Height and width of the encoder's input.
        batch_size: Clips of a batch, on one process.
        spacing: Seconds between the frames of a clip.
        hop: Seconds between the ends of neighbouring clips.
        match: Share of a batch that is drawn in pairs for matching; 0 if no objective matches.
        workers: Processes that read.
        cache_mb: Megabytes of frames kept in memory, over all readers.
        seed: Seed of the run.
    """

    def __init__(
        self,
        dataset: Dataset,
        frames: int,
        size: tuple[int, int],
        batch_size: int = 64,
        spacing: float = 1 / 15,
        hop: float = 0.2,
        match: float = 0.25,
        workers: int = 2,
        cache_mb: float = 1024,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.dataset = dataset
        self.cut = {
            "frames": frames,
            "spacing": spacing,
            "hop": hop,
            "size": size,
            "cache_mb": cache_mb / max(1, workers),
        }
        self.batch_size = batch_size
        self.match = match
        self.workers = workers
        self.seed = seed
        self.train: Clips | None = None
        self.val: Clips | None = None
        self.pairs: Pairs | None = None

    @property
    def skipped(self) -> list[str]:
        """Recordings that could not be indexed, one line each."""
        return list(dict.fromkeys(self.dataset.skipped))

    def setup(self, stage: str = "fit") -> None:
        """Indexes the recordings; decodes nothing.

        Raises:
            DataError: No training clip can be cut; see also `contracts.Dataset.recordings`.
            ConfigError: Pairs are asked for, and the data has none.
        """
        if self.train is not None:
            return
        self.train = Clips(self.dataset.recordings("train"), **self.cut)  # type: ignore[arg-type]
        if self.match:
            self.pairs = Pairs(*self.train.labels())
            if not self.pairs:
                raise ConfigError(
                    "matching needs two objects, one of them touched by two sensors, or two "
                    "actions, each shown twice; the data has neither. Leave match out of "
                    "objective=[...]"
                )
        if held_out := list(self.dataset.recordings("val")):
            self.val = Clips(held_out, **self.cut)  # type: ignore[arg-type]

    def check(self, key: str, needs: frozenset[str]) -> None:
        """Whether the training clips carry what an objective needs.

        Args:
            key: Name of the objective.
            needs: Labels; ``"a|b"`` asks for one of the two.

        Raises:
            ConfigError: Names what is missing and what there is.
        """
        provides = self.train.has() if self.train else self.dataset.provides
        for need in sorted(needs):
            if not provides & set(need.split("|")):
                raise ConfigError(
                    f"objective {key!r} needs {need.replace('|', ' or ')}, which the data does not "
                    f"have (it has: {', '.join(sorted(provides)) or 'frames only'}). Leave the "
                    f"objective out (objective=[...] without {key}), or use data that has it"
                )

    def train_dataloader(self) -> Loader:
        """Batches from the run's present place to the end of the epoch."""
        if self.train is None:
            raise DataError("setup() has not been called")
        trainer = self.trainer
        accumulate = trainer.accumulate_grad_batches if trainer else 1
        batches = Batches(
            len(self.train),
            self.batch_size,
            self.seed,
            self.pairs,
            self.match,
            rank=trainer.global_rank if trainer else 0,
            world=trainer.world_size if trainer else 1,
            multiple=accumulate,
            position=lambda: trainer.global_step * accumulate if trainer else 0,
        )
        return self._loader(self.train, batches)

    def val_dataloader(self) -> Loader | list[Loader]:
        """The held-out clips, in the same batches each time; [] where the data holds none out."""
        if self.val is None:
            return []
        pairs = Pairs(*self.val.labels()) if self.match else None
        return self._loader(
            self.val, Batches(len(self.val), self.batch_size, self.seed, pairs, self.match)
        )

    def _loader(self, clips: Clips, batches: Batches) -> Loader:
        return Loader(
            clips,
            batch_sampler=batches,
            collate_fn=collate,
            num_workers=self.workers,
            persistent_workers=self.workers > 0,
            pin_memory=torch.cuda.is_available(),
            worker_init_fn=_start_worker,
        )


def _start_worker(_: int) -> None:
    """Ctrl-C reaches every process of a terminal; the run, not its readers, answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(0)
