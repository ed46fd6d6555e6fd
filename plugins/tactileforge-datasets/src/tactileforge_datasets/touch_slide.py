"""The data set ``touch_slide``: a DIGIT slides over toy food."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.data import EncodedFrames
from tactileforge.errors import DataError
from tactileforge.reading import (
    PublishedDataset,
    RecordingItem,
    load_pickle,
    median_frames,
    still_background,
)
from tactileforge_datasets.ycb_slide import BACKGROUNDS

#: Number of Sparsh's background for each toy (``bgs/bg_N.jpg``).
_TOYS = {
    "banana": 15,
    "bread": 11,
    "cheese": 16,
    "cookie": 17,
    "corn": 18,
    "lettuce": 17,
    "plum": 11,
    "strawberry": 17,
    "tomato": 16,
}


class TouchSlide(PublishedDataset):
    """Touch-Slide: pickled lists of encoded images, read without executing anything.

    The layout is that of Sparsh's pre-training data, also used there for YCB-Slide: objects of both
    are read. A missing background is replaced by the median over the recording.

    Args:
        root: Folder of the objects.
        split: One of ``splits``.
        val: Share of the recordings held out for validation.
        fps: Frames per second.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "touch_slide"
    sensors = ("digit",)
    tier = 4
    licence = "CC-BY-NC-4.0"
    citation = "Higuera et al., Sparsh, CoRL 2024"
    url = "https://huggingface.co/datasets/facebook/touch-slide"
    tree = """ROOT/
  bread/dataset_0.pkl ...
  bgs/bg_11.jpg ..."""
    provides = frozenset({"object"})
    marks = ("*/dataset_[0-9]*.pkl",)
    certainty = 0.9
    doubts = ("no frame without contact is known: the median is the background",)

    def __init__(self, root: str, split: str = "all", val: float = 0.1, fps: float = 30.0) -> None:
        super().__init__(root, split, val)
        self.fps = fps

    def _items(self) -> Iterator[RecordingItem]:
        files = sorted(self._folder(".").glob("*/dataset_*.pkl"))
        if not files:
            raise self._missing(f"no file OBJECT/dataset_0.pkl in {self.root}")
        for path in files:
            key = f"{path.parent.name}/{path.stem}"
            yield RecordingItem(key, partial(self._open, key, path))

    def _open(self, key: str, path: Path) -> Recording:
        images, name = load_pickle(path), path.parent.name
        if not isinstance(images, list):
            raise DataError(f"{path}: a {type(images).__name__}, where a list of images belongs")
        frames = EncodedFrames(str(path), images)
        chosen = _TOYS.get(name, BACKGROUNDS.get(name))
        return self._recording(
            key,
            sensor="digit",
            frames=frames,
            times=np.arange(len(frames)) / self.fps,
            no_contact=still_background(self.root / "bgs" / f"bg_{chosen}.jpg", frames)
            or median_frames(frames),
            object=name,
        )
