"""The data set ``touchd_sim``: simulated motions of a thousand objects on five sensors."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from tactileforge.contracts import ACTIONS, Guess, Recording
from tactileforge.errors import DataError, unknown
from tactileforge.reading import (
    NumberedImages,
    PublishedDataset,
    RecordingItem,
    frame_times,
    still_background,
)

_FPS = 30.0
#: Pictures that a guess looks at.
_LOOKED = 20


class TouchdSim(PublishedDataset):
    """ToucHD (Sim), in a neutral layout: the release's own is not public.

    Convert your copy to this form: ``OBJECT/ACTION/SENSOR/NUMBER.png``. An action is one of
    `contracts.ACTIONS`; a sensor is one of ``sensors``, with a number after it for several units of
    a type (``digit_2``). ``background.png`` is beside the frames; without it nothing is subtracted.
    Further touches of an object are ``OBJECT/ACTION-2/...``. The paper also turns left and right
    slides by 90 degrees for slides up and down; this reader does not.

    Args:
        root: Folder of the objects.
        split: One of ``splits``.
        val: Share of the objects held out for validation.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "touchd_sim"
    sensors = ("gelsight", "digit", "gelsight_mini", "gelslim", "duragel")
    tier = 3
    licence = "that of the form on its page"
    citation = "Feng et al., AnyTouch 2, ICLR 2026"
    url = "https://huggingface.co/collections/BAAI/touchd"
    tree = """ROOT/OBJECT/slide_left/digit_1/    (a neutral layout, see the class)
  0.png ...
  background.png"""
    provides = frozenset({"action", "object", "text"})
    marks = tuple(f"*/{action}*/*/[0-9]*.png" for action in ACTIONS)
    doubts = ("a neutral layout: that of the release is not public",)

    @classmethod
    def recognise(cls, root: Path) -> Guess | None:
        """See `PublishedDataset.recognise`; whole names of folders decide, and pictures only."""
        guess = super().recognise(root)
        found = (path.parent for mark in cls.marks for path in root.glob(mark)) if guess else ()
        return guess if any(map(_is_of_form, islice(found, _LOOKED))) else None

    def _items(self) -> Iterator[RecordingItem]:
        folders = sorted(path for path in self._folder(".").glob("*/*/*") if path.is_dir())
        if not folders:
            raise self._missing(f"no folder OBJECT/ACTION/SENSOR in {self.root}")
        for folder in folders:
            key = folder.relative_to(self.root).as_posix()
            yield RecordingItem(key, partial(self._open, key, folder), group=key.split("/")[0])

    def _open(self, key: str, folder: Path) -> Recording:
        name = key.split("/")[0]
        action, sensor = _action_and_sensor(folder)
        for what, value, known in (("action", action, ACTIONS), ("sensor", sensor, self.sensors)):
            if value not in known:
                raise DataError(f"{folder}: {unknown(what, value, known, 'Rename the folder')}")
        touch = NumberedImages(folder, r"\d+")
        frames = touch.frames(self._index)
        return self._recording(
            key,
            sensor=sensor,
            frames=frames,
            times=frame_times(list(touch.files), _FPS),
            no_contact=still_background(folder / "background.png", frames),
            action=np.full(len(frames), ACTIONS.index(action), np.int64),
            object=name,
            text=f"{{action}} {name}".replace("_", " "),
        )


def _action_and_sensor(folder: Path) -> tuple[str, str]:
    return re.sub(r"-\d+$", "", folder.parent.name), re.sub(r"_\d+$", "", folder.name)


def _is_of_form(folder: Path) -> bool:
    action, sensor = _action_and_sensor(folder)
    are_pictures = all(path.suffix.lower() == ".png" for path in folder.iterdir())
    return action in ACTIONS and sensor in TouchdSim.sensors and are_pictures
