"""The data set ``tacquad``: the same objects touched by four sensors, three of them optical."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data import stated
from tactileforge.errors import DataError
from tactileforge.reading import (
    NumberedImages,
    PublishedDataset,
    RecordingItem,
    frame_rate,
    frame_times,
    is_there,
    read_rows,
)

#: Sensor by folder, in the order of the columns of the index.
_SENSORS = {"gelsight": "gelsight_mini", "digit": "digit", "duragel": "duragel"}
#: Other names of items in the index or in folders, and the names used here.
_ALIASES = {"yumaoqiu": "shuttlecock"}


class TacQuad(PublishedDataset):
    """TacQuad: a contact of one item with one optical sensor is a recording.

    The contacts are those of the index, both ends included. Camera and touch have different numbers
    of frames: touch frame ``t`` of ``n`` is paired with view ``int(t / n * m)`` of ``m``. Up to
    three frames before the contact are the background; a contact from the first frame has none.

    Args:
        root: Folder of the data.
        split: One of ``splits``.
        val: Share of the items held out for validation.
        fps: Frames per second; None for those of the sensor. The true rate is not published.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "tacquad"
    sensors = ("gelsight_mini", "digit", "duragel")
    tier = 4
    citation = "Feng et al., AnyTouch, ICLR 2025"
    url = "https://huggingface.co/datasets/xxuan01/TacQuad"
    tree = """ROOT/
  contact_indoor.csv, contact_outdoor.csv   (item, then first and last frame of each sensor)
  data_indoor/ITEM/                         (data_outdoor alike)
    gelsight/0.png ...     img_gelsight/0.png ...
    digit/0.png ...        img_digit/0.png ...
    duragel/0.png ...      img_duragel/0.png ..."""
    provides = frozenset({"object", "text", "image"})
    marks = ("contact_indoor.csv", "contact_outdoor.csv", "tacquad/contact_indoor.csv")
    certainty = 1.0

    def __init__(
        self, root: str, split: str = "all", val: float = 0.1, fps: float | None = None
    ) -> None:
        super().__init__(root, split, val)
        self.fps = fps

    def _items(self) -> Iterator[RecordingItem]:
        root = self.root / "tacquad" if (self.root / "tacquad").is_dir() else self.root
        any_found = False
        for area in ("indoor", "outdoor"):
            index = root / f"contact_{area}.csv"
            if not is_there(index):
                continue
            any_found = True
            for i, (name, ranges) in enumerate(_read(index)):
                item = f"{area}/{i}_{name}"
                for folder, contact in zip(_SENSORS, ranges, strict=True):
                    key = f"{item}/{folder}"
                    place = root / f"data_{area}"
                    yield RecordingItem(
                        key, partial(self._open, key, place, name, contact), group=item
                    )
        if not any_found:
            raise self._missing(f"no index {root / 'contact_indoor.csv'}")

    def _open(self, key: str, place: Path, name: str, contact: tuple[int, int]) -> Recording:
        folder = key.rpartition("/")[2]
        names = [name, *(other for other, kept in _ALIASES.items() if kept == name)]
        item = next((place / one for one in names if (place / one).is_dir()), None)
        if item is None:
            raise DataError(
                f"{place / name}: no such folder, although the index names it; download it"
            )
        touch, sensor = NumberedImages(item / folder, r"\d+"), _SENSORS[folder]
        first, last = contact
        numbers = [number for number in touch.files if first <= number <= last]
        if not numbers:
            raise DataError(
                f"{touch.folder}: no image from {first} to {last}, as the index says; download it "
                "again"
            )
        views = NumberedImages(item / f"img_{folder}", r"\d+").files
        # camera and touch have different numbers of frames, and no times
        rows = [
            min(int(number / len(touch.files) * len(views)), len(views) - 1) for number in numbers
        ]
        before = [path for number, path in touch.files.items() if number < first][:3]
        return self._recording(
            key,
            sensor=sensor,
            frames=self._pictures([touch.files[number] for number in numbers]),
            times=frame_times(numbers, frame_rate(sensor, self.fps)),
            no_contact=self._pictures(before) if before else None,
            object=key.rpartition("/")[0],
            text=f"{{action}} {name}".replace("_", " ") if stated(name) else None,
            image=FrameSubset(self._pictures(list(views.values())), rows) if views else None,
        )


def _read(index: Path) -> Iterator[tuple[str, list[tuple[int, int]]]]:
    """Item, and first and last frame of the contact for each sensor, of each row."""
    rows = read_rows(index)
    if not rows:
        raise DataError(f"{index}: empty; download it again")
    for i, row in enumerate(rows, start=1):
        if len(row) < 7 or not all(cell.strip().isdecimal() for cell in row[1:7]):
            raise DataError(
                f"{index}, line {i}: {row} is not an item and six numbers; download it again"
            )
        name, numbers = row[0].strip(), [int(cell) for cell in row[1:7]]
        yield _ALIASES.get(name, name), list(zip(numbers[::2], numbers[1::2], strict=True))
