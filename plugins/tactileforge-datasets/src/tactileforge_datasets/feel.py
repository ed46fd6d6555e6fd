"""The data set ``feel``: attempts of a gripper with two GelSights to lift objects."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from tactileforge.contracts import FrameSubset, Recording
from tactileforge.errors import DataError
from tactileforge.reading import PublishedDataset, RecordingItem, is_there, read_rows

#: The first is before the gripper closes, and so without contact.
_MOMENTS = ("before", "during", "after")
_FINGERS = ("A", "B")


class Feel(PublishedDataset):
    """The Feeling of Success, unpacked: a grasp and a finger are a recording of three frames.

    Frames are those before, during and after the grasp, one second apart (their times are not
    published); the first is without contact. The layout is the one written by AnyTouch's
    `feel_data.py` from ``calandra_corl2017_*.h5``; ``is_gripping`` is 1 for a lifted object.

    Args:
        root: Folder with `feel.csv`.
        split: One of ``splits``.
        val: Share of the objects held out for validation.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "feel"
    sensors = ("gelsight",)
    tier = 5
    citation = "Calandra et al., The Feeling of Success, CoRL 2017"
    url = "https://sites.google.com/view/the-feeling-of-success"
    tree = """ROOT/
  feel.csv                     (object, number of the grasp, is_gripping)
  OBJECT/touch_before/0_A.png, 0_B.png ...    (touch_during, touch_after alike)
  OBJECT/vision_before/0.png ...              (vision_during, vision_after alike)"""
    provides = frozenset({"object", "image"})
    marks = ("feel.csv",)
    beside = ("*/touch_before/*.png",)
    certainty = 1.0
    doubts = ("times are not published: a second a moment",)

    def _items(self) -> Iterator[RecordingItem]:
        index = self.root / "feel.csv"
        if not index.is_file():
            raise self._missing(f"no index {index}")
        for i, row in enumerate(read_rows(index), start=1):
            if not row:
                continue
            if len(row) != 3 or not row[1].strip().isdigit() or row[2].strip() not in ("0", "1"):
                raise DataError(
                    f"{index}, line {i}: {row} is not an object, a number, and 0 or 1; unpack the "
                    "data again"
                )
            name, grasp, success = map(str.strip, row)
            for finger in _FINGERS:
                key = f"{name}/{grasp}_{finger}"
                yield RecordingItem(key, partial(self._open, key, float(success)), group=name)

    def _open(self, key: str, success: float) -> Recording:
        name, place = key.split("/")
        folder = self.root / name
        frames = self._pictures(
            [folder / f"touch_{moment}" / f"{place}.png" for moment in _MOMENTS]
        )
        views = [folder / f"vision_{moment}" / f"{place[:-2]}.png" for moment in _MOMENTS]
        return self._recording(
            key,
            sensor="gelsight",
            frames=frames,
            times=np.arange(3.0),
            no_contact=FrameSubset(frames, [0]),
            object=name,
            image=self._pictures(views) if all(is_there(view) for view in views) else None,
            labels={"is_gripping": success, "finger": place[-1]},
        )
