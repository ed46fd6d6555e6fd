"""Reader of Sparsh's force and slip tasks: batches of pickles, with trajectories in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Guess, Recording
from tactileforge.data import EncodedFrames
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.reading import (
    OfficialSplit,
    PublishedDataset,
    RecordingItem,
    add_once,
    frame_times,
    load_pickle,
)

_LABELS = "dataset_slip_forces.pkl"
#: Name of a sensor in files and folders.
_FILES = {"digit": "digit", "gelsight_mini": "gelsight"}


@dataclass(frozen=True)
class PickleFolder:
    """One batch: a folder of pickles.

    Attributes:
        folder: Path of the folder.
        sensor: Name of the sensor.
    """

    folder: Path
    sensor: str

    @property
    def name(self) -> str:
        """Name of the batch, ``PROBE/batch_N``."""
        return f"{self.folder.parent.name}/{self.folder.name}"

    @cached_property
    def labels(self) -> tuple[NDArray[np.bool_], Mapping[Any, Any]]:
        """Contact of each image, and the trajectories by number."""
        path = self.folder / _LABELS
        content = load_pickle(path)
        try:
            contact = np.asarray(content["in_contact"]).astype(bool).ravel()
            trajectories = dict(content["trajectories"])
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(
                f"{path}: no in_contact and trajectories ({error!r}); download it again"
            ) from error
        return contact, trajectories

    @cached_property
    def images(self) -> list[Any]:
        """All images of the batch, without their duplicates in ``org_dataset_*``."""
        files = sorted(self.folder.glob(f"dataset_{_FILES[self.sensor]}_*.pkl"))
        return [image for path in files for image in _images(path)]

    @cached_property
    def sign(self) -> float:
        """Sign of Fz in our convention, positive when pressing: a probe cannot pull."""
        force = np.concatenate(
            [np.zeros((0, 3), np.float32), *map(_force, self.labels[1].values())]
        )
        normal = force[np.isfinite(force).all(1), 2]
        return -1.0 if len(normal) and normal.mean() < 0 else 1.0

    def frames(self, rows: NDArray[np.int64]) -> EncodedFrames:
        """Some images of the batch, upright and in RGB."""
        if not len(self.images) or rows.max(initial=0) >= len(self.images) or rows.min() < 0:
            raise DataError(
                f"{self.folder}: {len(self.images)} images of {self.sensor}, but {_LABELS} names "
                f"image {rows.max(initial=0)}; download the missing files, or correct data.sensor"
            )
        images = [self.images[row] for row in rows]
        # channels are BGR in DIGIT's sphere2, and in all batches but one of GelSight
        is_bgr = self.name.startswith("sphere2/")
        if self.sensor != "digit":
            is_bgr = self.name != "sharp/batch_2"
        return EncodedFrames(str(self.folder), images, is_bgr, int(self.sensor == "digit"))


def _force(trajectory: Mapping[str, Any]) -> NDArray[np.float32]:
    try:
        return np.asarray(trajectory["forces"], np.float32).reshape(-1, 3)
    except (KeyError, TypeError, ValueError):
        return np.zeros((0, 3), np.float32)


class SparshTrajectories(PublishedDataset):
    """Base class of the data sets ``sparsh_force`` and ``sparsh_slip``."""

    sensors = tuple(_FILES)
    tier = 1
    licence = "CC-BY-NC-4.0"
    citation = "Higuera et al., Sparsh, CoRL 2024"
    url = "https://huggingface.co/collections/facebook/sparsh"
    tree = """ROOT/                          (digit-force-estimation or gelsight-force-estimation)
  sphere/batch_1/              (sharp, flat, sphere2 alike)
    dataset_digit_00.pkl ...   (dataset_gelsight_00.pkl ...)
    dataset_slip_forces.pkl"""
    provides = frozenset({"force", "object"})
    marks = (f"*/*/{_LABELS}",)
    certainty = 1.0
    doubts = (
        "the same files are read by sparsh_force and sparsh_slip",
        "directions of x and y in the picture are not published",
    )
    by_sensor: ClassVar[Mapping[str, tuple[OfficialSplit, ...]]]

    def __init__(
        self,
        root: str,
        sensor: str = "digit",
        split: str = "sparsh-official",
        val: float = 0.1,
        fps: float = 30.0,
    ) -> None:
        if sensor not in _FILES:
            raise ConfigError(f"{self.name}: {unknown('sensor', sensor, _FILES)}")
        self.splits = self.by_sensor[sensor]
        super().__init__(root, split, val)
        self.sensor = sensor
        self.fps = fps

    @classmethod
    def recognise(cls, root: Path) -> Guess | None:
        """See `PublishedDataset.recognise`; names of the files tell the sensor."""
        guess = super().recognise(root)
        if guess is None:
            return None
        has = {name: any(root.glob(f"*/*/dataset_{file}_*.pkl")) for name, file in _FILES.items()}
        sensor = next((name for name, found in has.items() if found), "digit")
        return replace(guess, options={**guess.options, "sensor": sensor})

    def _items(self) -> Iterator[RecordingItem]:
        files = sorted(self._folder(".").glob(f"*/*/{_LABELS}"))
        if not files:
            raise self._missing(f"no file PROBE/batch_1/{_LABELS} in {self.root}")
        for path in files:
            batch = PickleFolder(path.parent, self.sensor)
            facts = {"batch": batch.name}
            # before its pickles are read, which take long
            if self.chosen.side(facts) is None:
                continue
            try:
                trajectories = batch.labels[1]
            except DataError as error:
                add_once(self.skipped, error)
                continue
            for number, trajectory in trajectories.items():
                key = f"{batch.name}/{number}"
                yield RecordingItem(key, partial(self._open, key, batch, trajectory), facts)

    def _open(self, key: str, batch: PickleFolder, trajectory: Mapping[str, Any]) -> Recording:
        """Pairs images and forces one by one, and drops those at the end without a partner."""
        force = _force(trajectory) * np.array([1, 1, batch.sign], np.float32)
        try:
            rows = np.asarray(trajectory["indexes"]).astype(np.int64).ravel()
            slip = np.asarray(trajectory["slip_label"]).astype(np.int8).ravel()
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(
                f"{batch.folder / _LABELS}: trajectory {key} has no indexes and slip_label "
                f"({error!r}); download it again"
            ) from error
        # most trajectories have five images more than forces
        count = min(len(rows), len(force), len(slip))
        rows = rows[:count]
        if not count or (np.diff(rows) <= 0).any() or not np.isfinite(force[:count]).all():
            raise DataError(
                f"{batch.folder / _LABELS}: trajectory {key} is empty, not in order, or has forces "
                "that are not numbers; download it again"
            )
        contact = batch.labels[0]
        free = np.flatnonzero(~contact[: len(batch.images)])[:1]
        return self._recording(
            key,
            sensor=self.sensor,
            frames=batch.frames(rows),
            times=frame_times(rows.tolist(), self.fps),
            no_contact=batch.frames(free) if len(free) else None,
            force=force[:count],
            object=f"sparsh_{batch.folder.parent.name}",
            tracks={"slip": slip[:count], "image": rows},
        )


def _images(path: Path) -> list[Any]:
    """Images of a pickle.

    Raises:
        DataError: It holds no list.
    """
    if not isinstance(found := load_pickle(path), list):
        raise DataError(f"{path}: no list of images; download it again")
    return found
