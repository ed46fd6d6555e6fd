"""The data set ``touchd_mani``: filmed manipulation with two tactile fingers."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from tactileforge.contracts import Guess, Recording
from tactileforge.errors import DataError
from tactileforge.plugins import load_json
from tactileforge.reading import (
    NumberedImages,
    PublishedDataset,
    RecordingItem,
    add_once,
    check_sensor,
    frame_rate,
    frame_times,
    matches,
    read_text,
    still_background,
)

#: Episodes that a guess opens: the first ones may be damaged.
_LOOKED = 5


class TouchdMani(PublishedDataset):
    """ToucHD (Mani), in a neutral layout: the release's own is not public.

    Convert your copy to this form. Each folder with `episode.json` is an episode, and each of its
    fingers a recording::

        {"task": "insert a usb plug", "object": "usb_plug", "fps": 30,
         "fingers": {"left": "digit", "right": "gelsight_mini"}}

    ``fingers`` is required. The numbered images of a finger are in a folder of its name, optional
    camera views in ``camera``, in any number. The background is ``FINGER_background.png`` beside
    these folders; without it nothing is subtracted.

    Args:
        root: Folder of the episodes.
        split: One of ``splits``.
        val: Share of the episodes held out for validation.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "touchd_mani"
    sensors = ("digit", "gelsight_mini", "duragel")
    tier = 2
    licence = "that of the form on its page"
    citation = "Feng et al., AnyTouch 2, ICLR 2026"
    url = "https://huggingface.co/datasets/BAAI/ToucHD-Mani"
    tree = """ROOT/EPISODE/                  (a neutral layout, see the class)
  episode.json
  left/0.png ...       left_background.png
  right/0.png ...      right_background.png
  camera/0.png ..."""
    provides = frozenset({"object", "text", "image"})
    marks = ("*/episode.json", "*/*/episode.json", "episode.json")
    doubts = ("a neutral layout: that of the release is not public",)

    @classmethod
    def recognise(cls, root: Path) -> Guess | None:
        """See `PublishedDataset.recognise`; the fingers of an episode decide."""
        guess = super().recognise(root)
        found = (path for mark in cls.marks for path in root.glob(mark)) if guess else iter(())
        return guess if any(map(_has_fingers, islice(found, _LOOKED))) else None

    def _items(self) -> Iterator[RecordingItem]:
        files = sorted(matches(self._folder("."), "**/episode.json"))
        if not files:
            raise self._missing(f"no folder with episode.json in {self.root}")
        for path in files:
            place = path.parent.relative_to(self.root).as_posix()
            try:
                episode = _read(path)
            except DataError as error:
                add_once(self.skipped, error)
                continue
            for finger, sensor in episode["fingers"].items():
                key = f"{place}/{finger}"
                opened = partial(self._open, key, path.parent, finger, sensor, episode)
                yield RecordingItem(key, opened, group=place)

    def _open(
        self, key: str, place: Path, finger: str, sensor: str, episode: dict[str, Any]
    ) -> Recording:
        touch, views = NumberedImages(place / finger), NumberedImages(place / "camera")
        frames = touch.frames(self._index)
        return self._recording(
            key,
            sensor=sensor,
            frames=frames,
            times=frame_times(list(touch.files), frame_rate(sensor, episode.get("fps"))),
            no_contact=still_background(place / f"{finger}_background.png", frames),
            object=episode.get("object"),
            text=episode.get("task"),
            image=views.frames(self._index) if views.files else None,
        )


def _has_fingers(path: Path) -> bool:
    try:
        episode = load_json(read_text(path))
    except (DataError, ValueError):
        return False
    return isinstance(episode, dict) and "fingers" in episode


def _read(path: Path) -> dict[str, Any]:
    """A validated episode: fields of the right types, and known sensors."""
    try:
        episode = load_json(read_text(path))
    except ValueError as error:
        raise DataError(f"{path}: not JSON: {error}; correct it") from error
    kinds: dict[str, Any] = {"fingers": dict, "task": str, "object": str, "fps": int | float}
    for key, kind in kinds.items():
        value: Any = episode.get(key) if isinstance(episode, dict) else None
        if value is None and key != "fingers":
            continue
        if not isinstance(value, kind) or (key == "fps" and not value > 0):
            raise DataError(f"{path}: {key} is {value!r}; see the layout of touchd_mani")
    for sensor in episode["fingers"].values():
        check_sensor(str(sensor), str(path))
    return dict(episode)
