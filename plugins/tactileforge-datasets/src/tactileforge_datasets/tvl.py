"""The data set ``tvl``: a hand-held DIGIT and a camera in the wild, with captions (HCT of TVL)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from tactileforge.contracts import Recording
from tactileforge.errors import DataError
from tactileforge.plugins import load_json
from tactileforge.reading import (
    ALL_FOR_TRAINING,
    PublishedDataset,
    RecordingItem,
    frame_times,
    is_there,
    label_runs,
    read_rows,
    read_text,
    still_background,
)
from tactileforge_datasets.official_splits import TVL_OFFICIAL


class _Row(NamedTuple):
    """A pair of frames: paths from the folder of the part, a caption, and the side of the split."""

    touch: str
    vision: str
    background: str
    caption: str
    side: str

    @property
    def number(self) -> int:
        """The number of the frame, from a name ``NUMBER-SECONDS.jpg``."""
        match = re.match(r"\d+", Path(self.touch).name)
        if not match:
            raise DataError(f"{self.touch}: its name begins with no number; download it again")
        return int(match[0])


class Tvl(PublishedDataset):
    """TVL without SSVTP (see ``ssvtp``): runs of frames in contact with one caption.

    A run has one caption, and lies in one of `train.csv` and `test.csv`; without these files,
    `contact.json` lists the frames in contact. The first release swapped the folders ``tactile``
    and ``vision``: of the two images, the smaller counts as the touch. A missing background is
    replaced by ``digit_background.png`` of the part, or left out.

    Args:
        root: Folder with ``hct`` or ``data1`` to ``data3``.
        split: One of ``splits``.
        val: Share of the touches held out for validation.
        fps: Frames per second; the true rate is not published.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "tvl"
    sensors = ("digit",)
    tier = 5
    licence = "none stated"
    citation = "Fu et al., A Touch Vision and Language Dataset for Multimodal Alignment, ICML 2024"
    url = "https://huggingface.co/datasets/mlfu7/Touch-Vision-Language-Dataset"
    tree = """ROOT/hct/data1/              (data2, data3 alike)
  train.csv, test.csv          (vision, tactile, background, caption)
  contact.json
  digit_background.png
  RECORDING/tactile/12-0.034.jpg ...
  RECORDING/vision/12-0.034.jpg ..."""
    splits = (TVL_OFFICIAL, ALL_FOR_TRAINING)
    provides = frozenset({"text", "image"})
    marks = ("hct/data1", "tvl_dataset/hct/data1", "data1/contact.json")
    certainty = 1.0

    def __init__(
        self, root: str, split: str = "tvl-official", val: float = 0.1, fps: float = 30.0
    ) -> None:
        super().__init__(root, split, val)
        self.fps = fps

    def _items(self) -> Iterator[RecordingItem]:
        parts = sorted(self._folder("hct", "tvl_dataset/hct", ".").glob("data[0-9]*"))
        if not parts:
            raise self._missing(f"no folder data1 in {self.root}")
        for part in parts:
            # RECORDING/tactile/12-0.034.jpg: frames of one recording and side stand together
            rows = {
                (row.side, Path(row.touch).parent.parent.as_posix(), row.number): row
                for row in self._rows(part)
            }
            for (side, folder), group in groupby(sorted(rows), lambda place: place[:2]):
                group_rows = [rows[place] for place in group]
                for run in label_runs(
                    [row.number for row in group_rows], [row.caption for row in group_rows]
                ):
                    key = f"{part.name}/{folder}/{side}_{group_rows[run][0].number}"
                    opened = partial(self._open, key, part, group_rows[run])
                    yield RecordingItem(key, opened, {"list": side}, group=f"{part.name}/{folder}")

    def _rows(self, part: Path) -> list[_Row]:
        rows = []
        for side in ("train", "test"):
            path = part / f"{side}.csv"
            if is_there(path):
                lines = read_rows(path)
                if not lines:
                    raise DataError(f"{path}: empty; download it again")
                for i, cells in enumerate(lines[1:], start=2):
                    if len(cells) != 4:
                        raise DataError(
                            f"{path}, line {i}: {len(cells)} cells, where vision, tactile, "
                            "background and caption belong; download it again"
                        )
                    vision, touch, background, caption = map(str.strip, cells)
                    rows.append(_Row(touch, vision, background, caption, side))
        return rows or self._in_contact(part / "contact.json")

    def _in_contact(self, path: Path) -> list[_Row]:
        if not path.is_file():
            raise self._missing(f"neither {path.with_name('train.csv')} nor {path}")
        try:
            lists = load_json(read_text(path))
            touches = lists["tactile"]
            nothing = [""] * len(touches)
            backgrounds = lists.get("background") or nothing
            rows = zip(touches, lists["vision"], backgrounds, nothing, strict=True)
            return [_Row(str(t), str(v), str(b), c, "train") for t, v, b, c in rows]
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise DataError(
                f"{path}: not lists of equal length under tactile and vision ({error!r}); "
                "download it again"
            ) from error

    def _open(self, key: str, part: Path, rows: list[_Row]) -> Recording:
        numbers = [row.number for row in rows]
        frames = self._pictures([part / row.touch for row in rows])
        views = [part / row.vision for row in rows]
        image = self._pictures(views) if all(is_there(path) for path in views) else None
        # The first release swapped the folders: the smaller image is the touch.
        if image and image.shape[0] * image.shape[1] < frames.shape[0] * frames.shape[1]:
            frames, image = image, frames
        still = part / rows[0].background
        background = still if still.is_file() else part / "digit_background.png"
        return self._recording(
            key,
            sensor="digit",
            frames=frames,
            times=frame_times(numbers, self.fps),
            no_contact=still_background(background, frames),
            text=rows[0].caption or None,
            image=image,
        )
