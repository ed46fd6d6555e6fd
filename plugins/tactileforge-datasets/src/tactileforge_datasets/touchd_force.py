"""The data set ``touchd_force``: 71 indenters press and slide on five sensors, with forces."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.data import label_actions
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.plugins import load_json
from tactileforge.reading import (
    ALL_FOR_TRAINING,
    PublishedDataset,
    RecordingItem,
    add_once,
    frame_rate,
    frame_times,
    read_text,
    still_background,
)
from tactileforge_datasets.official_splits import TOUCHD_BENCH, TOUCHD_PRETRAIN

#: Sensor by folder. ``biotip`` sees markers in space, and ``dm`` has no labels: both are left out.
_SENSORS = {"digit": "digit", "gelsight": "gelsight_mini", "duragel": "duragel"}

#: Columns and signs for converting the source's Fx, Fy, Fz to x right, y down, z into the gel.
#: Those of DIGIT and GelSight Mini were measured on the public demonstration videos, from the
#: motion of the imprint; those of DuraGel are unknown. The source's Fz is negative when pressing.
_AXES = {
    "digit": ((0, 1, 2), (-1, 1, -1)),
    "gelsight_mini": ((1, 0, 2), (1, 1, -1)),
    "duragel": ((0, 1, 2), (1, 1, -1)),
}
_SOURCE_AXES = ((0, 1, 2), (1, 1, -1))


class TouchdForce(PublishedDataset):
    """ToucHD (Force): the labelled frames of one session and sensor are a recording.

    Args:
        root: Folder with `all_data_direction.json` and the unzipped sessions.
        split: One of ``splits``. AnyTouch 2 pre-trains on `anytouch2-pretrain`, and probes on
            `anytouch2-official`.
        val: Share of the indenters held out for validation.
        axes: ``image`` for forces in image axes (see `tactileforge.contracts`), ``source`` for
            (Fx, Fy, -Fz) as in ToucHD Bench.
        fps: Frames per second; None for those of the sensor.

    Raises:
        ConfigError: Unknown axes; see also `PublishedDataset`.
    """

    name = "touchd_force"
    sensors = tuple(_SENSORS.values())
    tier = 1
    licence = "that of the form on its page"
    citation = "Feng et al., AnyTouch 2, ICLR 2026"
    url = "https://huggingface.co/datasets/BAAI/ToucHD-Force"
    tree = """ROOT/
  all_data_direction.json
  obj006_speed1/               (every obj*_speed*.zip unzipped in place)
    digit/image_1.png ...      (image_1 is the background)
    gelsight/, duragel/"""
    splits = (TOUCHD_PRETRAIN, TOUCHD_BENCH, ALL_FOR_TRAINING)
    provides = frozenset({"force", "action", "object"})
    marks = ("all_data_direction.json",)
    certainty = 1.0
    doubts = ("axes of DuraGel are not known",)

    def __init__(
        self,
        root: str,
        split: str = "anytouch2-pretrain",
        val: float = 0.1,
        axes: str = "image",
        fps: float | None = None,
    ) -> None:
        super().__init__(root, split, val)
        if axes not in ("image", "source"):
            raise ConfigError(f"{self.name}: {unknown('axes', axes, ('image', 'source'))}")
        self.axes = axes
        self.fps = fps
        if axes == "source":  # actions are directions in the image
            self.provides = frozenset({"force", "object"})

    def _items(self) -> Iterator[RecordingItem]:
        index = self.root / "all_data_direction.json"
        if not index.is_file():
            raise self._missing(f"no index {index}")
        try:
            sessions = load_json(read_text(index)).items()
        except (AttributeError, ValueError) as error:
            raise DataError(f"{index}: not an index of sessions: {error}; download it") from error
        for session, tables in sorted(sessions):
            named = re.fullmatch(r"obj0*(\d+)_speed\d+", session)
            if not named or not isinstance(tables, dict):
                add_once(
                    self.skipped,
                    f"{index}: {session!r} is not objID_speedS with tables of forces",
                )
                continue
            for folder in _SENSORS:
                if folder in tables:
                    key = f"{session}/{folder}"
                    opened = partial(self._open, key, int(named[1]), tables[folder])
                    yield RecordingItem(key, opened, {"indenter": named[1]}, group=named[1])

    def _open(self, key: str, indenter: int, table: Any) -> Recording:
        session, folder = key.split("/")
        numbers, force = self._forces(key, table, _SENSORS[folder])
        # An archive may unpack into a folder of its own name.
        nested = self.root / session / session / folder
        place = nested if nested.is_dir() else self.root / session / folder
        frames = self._pictures([place / f"image_{number}.png" for number in numbers])
        times = frame_times(numbers, frame_rate(_SENSORS[folder], self.fps))
        return self._recording(
            key,
            sensor=_SENSORS[folder],
            frames=frames,
            times=times,
            no_contact=still_background(place / "image_1.png", frames),
            force=force,
            action=label_actions(times, force) if self.axes == "image" else None,
            object=f"touchd_indenter_{indenter}",
            labels={"indenter": float(indenter), "speed": float(session.rpartition("speed")[2])},
        )

    def _forces(self, key: str, table: Any, sensor: str) -> tuple[list[int], Any]:
        """Frame numbers, ascending, and their forces, float32 (T, 3), N."""
        try:
            rows = {int(row[0]): [float(value) for value in row[1:4]] for row in table}
            force = np.array([rows[number] for number in sorted(rows)], np.float32).reshape(-1, 3)
        except (IndexError, TypeError, ValueError) as error:
            raise DataError(
                f"{self.root / 'all_data_direction.json'}, {key}: not rows of a frame number and "
                f"three forces ({error}); download it again"
            ) from error
        if not len(force) or not np.isfinite(force).all():
            raise DataError(f"{self.root}, {key}: no forces, or forces that are not numbers")
        columns, signs = _AXES[sensor] if self.axes == "image" else _SOURCE_AXES
        return sorted(rows), force[:, columns] * np.array(signs, np.float32)
