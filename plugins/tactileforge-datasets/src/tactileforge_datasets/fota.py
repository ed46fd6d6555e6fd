"""The data set ``fota``: single frames of many sensors in tars, with their labels."""

from __future__ import annotations

import re
import tarfile
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Guess, Recording
from tactileforge.data import Blob, EncodedFrames
from tactileforge.errors import DataError
from tactileforge.plugins import check_pointer, load_json
from tactileforge.reading import (
    BoundedTarInfo,
    OfficialSplit,
    PublishedDataset,
    RecordingItem,
    add_once,
    check_regular,
    matches,
)
from tactileforge_datasets.checks import POSE, numbers, pose_track

_OFFICIAL = OfficialSplit(
    "fota-official",
    "folders train and val of FoTa, whose frames were shuffled before: sides may share objects",
    "folder",
    frozenset({"train"}),
    val=frozenset({"val"}),
)
_NAMED = re.compile(
    r"(?P<object>.+)_(?P<left>[A-Za-z]+)_(?P<right>[A-Za-z]+)_init_pose_(?P<pose>\d+)"
    r"(_(?:un)?labeled)?_(?P<side>left|right)"
)
#: Most bytes of a description.
_LARGEST = 1 << 20


class FoTa(PublishedDataset):
    """FoTa, the data of T3: a frame is a recording.

    The folder of a set names the object, both sensors and the side, as in
    ``pen_Mini_Wedge_init_pose_0_labeled_left``. Sets of sensors without a type here are left out
    and counted; ``sensors`` gives them one. Poses are the track ``pose``, float32 (1, 7): x, y, z
    in m and the quaternion x, y, z, w. FoTa shuffled its frames, and holds copies of other sets:
    read those at their source. No frame is known to be without contact: nothing is subtracted.

    Args:
        root: Folder of the sets.
        split: One of ``splits``.
        val: Share of the objects held out for validation, of the split ``all``.
        types: Type of sensor by its name in folders, such as ``{Wedge: gelsight}``; added to
            ``{Mini: gelsight_mini, Digit: digit}``.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "fota"
    sensors = ("gelsight_mini", "digit")
    tier = 5
    licence = "MIT"
    citation = "Zhao et al., Transferable Tactile Transformers, CoRL 2024"
    url = "https://huggingface.co/datasets/alanz-mit/FoundationTactile"
    tree = """ROOT/SET/                      (pen_Mini_Wedge_init_pose_0_labeled_left ...)
  train/count.txt, data-000000.tar ...      (val alike)"""
    splits = (_OFFICIAL, *PublishedDataset.splits)
    provides = frozenset({"object", "text"})
    marks = ("*/train/data[-_]*.tar", "*/*/train/data[-_]*.tar", "train/data[-_]*.tar")
    doubts = ("frames were shuffled: train and val may share objects",)

    def __init__(
        self,
        root: str,
        split: str = "fota-official",
        val: float = 0.1,
        types: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(root, split, val)
        self.types = {"Mini": "gelsight_mini", "Digit": "digit", **(types or {})}

    @classmethod
    def recognise(cls, root: Path) -> Guess | None:
        """See `PublishedDataset.recognise`; the count beside the tars decides."""
        guess = super().recognise(root)
        counts = ("train/count.txt", "*/train/count.txt", "*/*/train/count.txt")
        return guess if guess and any(any(root.glob(count)) for count in counts) else None

    def _items(self) -> Iterator[RecordingItem]:
        root = self._folder(".")
        tars = sorted(
            path for side in ("train", "val") for path in matches(root, f"**/{side}/data*.tar")
        )
        if not tars:
            raise self._missing(f"no file SET/train/data-000000.tar in {root}")
        for path in tars:
            side, folder = path.parent.name, path.parents[1]
            if self.chosen.side({"folder": side}) is None:
                continue
            named = _NAMED.fullmatch(folder.name)
            sensor = self._type(named[named["side"]] if named else "", folder)
            if sensor:
                found = named["object"] if named else folder.name
                yield from self._of_tar(path, sensor, found)

    def _type(self, named: str, folder: Path) -> str:
        """Type of the sensor of a set; "" for none, which is counted."""
        typed = self.types.get(named) or self.types.get(folder.name)
        if not typed:
            what = f"the sensor {named!r}" if named else f"the set {folder.name!r}"
            add_once(
                self.skipped,
                f"{folder}: {what} has no type here; give data.types.{named or folder.name}=TYPE",
            )
        return typed or ""

    def _of_tar(self, path: Path, sensor: str, named: str) -> Iterator[RecordingItem]:
        place = path.parents[1].relative_to(self.root).as_posix()
        side = path.parent.name
        for name, parts in self._members(path):
            where = f"{path}, {name}"
            key = f"{place}/{side}/{path.stem}/{name}"
            opened = partial(self._open, key, where, parts, sensor, named)
            yield RecordingItem(key, opened, {"folder": side}, group=named)

    def _members(self, path: Path) -> Iterator[tuple[str, dict[str, Blob]]]:
        """Name and parts, by ending, of each sample of a tar; those before a damage are given."""
        found: dict[str, dict[str, Blob]] = {}
        try:
            check_regular(path)
            with tarfile.open(path, "r:", tarinfo=BoundedTarInfo) as tar:
                end = 0
                for member in tar:
                    end = member.offset_data + member.size
                    if not member.isfile():
                        continue
                    name, _, ending = member.name.removeprefix("./").partition(".")
                    blob = Blob(str(path), member.offset_data, member.size)
                    found.setdefault(name, {})[ending.lower()] = blob
            if end + tarfile.BLOCKSIZE > path.stat().st_size:
                raise tarfile.ReadError("it ends before its end mark")
        except (tarfile.TarError, OSError, ValueError) as error:
            try:
                check_pointer(path)
                add_once(self.skipped, f"{path}: damaged ({error}); download it again")
            except DataError as pointer:
                add_once(self.skipped, pointer)
            if found:  # the last sample may lack a part
                found.popitem()
        yield from found.items()

    def _open(
        self, key: str, where: str, parts: dict[str, Blob], sensor: str, named: str
    ) -> Recording:
        image = next((parts[end] for end in ("jpg", "jpeg", "png") if end in parts), None)
        if image is None:
            raise DataError(f"{where}: no picture beside {', '.join(parts)}; download it again")
        said = _description(parts.get("json"), where)
        labels: dict[str, str | float] = {
            name: float(said[name])
            for name in ("has_contact", "contact_class", "is_gripping")
            if isinstance(said.get(name), int | float)
        }
        found = said.get("object_name") or said.get("contact_name") or named
        text = said.get("desc")
        return self._recording(
            key,
            sensor=sensor,
            frames=EncodedFrames(where, [image]),
            times=np.zeros(1),
            no_contact=None,
            object=str(found),
            text=text if isinstance(text, str) else None,
            labels=labels,
            tracks=_pose(said, where),
        )


def _description(blob: Blob | None, where: str) -> dict[str, Any]:
    """Values of a frame's json; {} without one."""
    if blob is None:
        return {}
    if blob.size > _LARGEST:
        raise DataError(f"{where}: a json of {blob.size} bytes; download it again")
    try:
        said = load_json(blob.read())
    except ValueError as error:
        raise DataError(f"{where}: not JSON ({error}); download it again") from error
    if not isinstance(said, dict):
        raise DataError(f"{where}: a json of {type(said).__name__}, where an object belongs")
    return said


def _pose(said: dict[str, Any], where: str) -> dict[str, NDArray[np.float32]]:
    """The track of the pose; none where the frame has none."""
    if not any(name in said for name in POSE):
        return {}
    if missing := [name for name in POSE if name not in said]:
        raise DataError(f"{where}: a pose without {', '.join(missing)}; download it again")
    return pose_track(numbers([said[name] for name in POSE], (7,), "the pose", where))
