"""The data set ``visgel``: a robot pokes objects with a GelSight, filmed by a camera."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from tactileforge.contracts import FrameSubset, Recording
from tactileforge.reading import (
    NumberedImages,
    PublishedDataset,
    RecordingItem,
    frame_times,
    matches,
)


class VisGel(PublishedDataset):
    """VisGel: each sequence is a recording, its first frame without contact.

    Args:
        root: Folder with ``images``, or with ``touch`` and ``vision``.
        split: One of ``splits``.
        val: Share of the sequences held out for validation.
        fps: Frames per second; the true rate is not published.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "visgel"
    sensors = ("gelsight",)
    tier = 5
    citation = "Li et al., Connecting Touch and Vision via Cross-Modal Prediction, CVPR 2019"
    url = "https://github.com/YunzhuLi/VisGel"
    tree = """ROOT/images/
  touch/SEQUENCE/frame0000.jpg ...
  vision/SEQUENCE/frame0000.jpg ..."""
    provides = frozenset({"image"})
    marks = ("images/touch/*/frame*.jpg", "images/touch/*/*/frame*.jpg")
    beside = ("images/vision",)
    doubts = ("the first frame of a sequence is taken to be without contact",)

    def __init__(self, root: str, split: str = "all", val: float = 0.1, fps: float = 30.0) -> None:
        super().__init__(root, split, val)
        self.fps = fps

    def _items(self) -> Iterator[RecordingItem]:
        touch = self._folder("images/touch", "touch")
        for folder in sorted(path for path in matches(touch, "**/*") if path.is_dir()):
            files = NumberedImages(folder, r"frame\d+")
            if files.files:
                key = folder.relative_to(touch).as_posix()
                vision = NumberedImages(touch.parent / "vision" / key, r"frame\d+")
                yield RecordingItem(key, partial(self._open, key, files, vision))

    def _open(self, key: str, touch: NumberedImages, vision: NumberedImages) -> Recording:
        frames, numbers = touch.frames(self._index), list(touch.files)
        return self._recording(
            key,
            sensor="gelsight",
            frames=frames,
            times=frame_times(numbers, self.fps),
            no_contact=FrameSubset(frames, [0]),
            image=vision.nearest(numbers),
        )
