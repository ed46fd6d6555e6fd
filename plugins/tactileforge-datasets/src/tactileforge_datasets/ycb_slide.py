"""The data set ``ycb_slide``: a DIGIT slides over ten objects of the YCB set."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from tactileforge.contracts import Recording
from tactileforge.reading import (
    NumberedImages,
    PublishedDataset,
    RecordingItem,
    frame_times,
    median_frames,
    still_background,
)

#: Number of Sparsh's background for each object (``bgs/bg_N.jpg`` in its data).
BACKGROUNDS = {
    "004_sugar_box": 0,
    "005_tomato_soup_can": 1,
    "006_mustard_bottle": 2,
    "021_bleach_cleanser": 3,
    "025_mug": 4,
    "035_power_drill": 0,
    "037_scissors": 5,
    "042_adjustable_wrench": 6,
    "048_hammer": 8,
    "055_baseball": 8,
}


class YcbSlide(PublishedDataset):
    """YCB-Slide, the real part: a minute of sliding is a recording.

    No frame is known to be without contact. The background is Sparsh's, if it lies beside the
    objects (``bgs/bg_N.jpg``), or the median over the recording.

    Args:
        root: Folder with ``real``, or that folder itself.
        split: One of ``splits``.
        val: Share of the recordings held out for validation.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "ycb_slide"
    sensors = ("digit",)
    tier = 4
    licence = "CC-BY-SA-4.0"
    citation = "Suresh et al., MidasTouch, CoRL 2022"
    url = "https://github.com/rpl-cmu/YCB-Slide"
    tree = """ROOT/real/
  035_power_drill/dataset_0/
    frames/frame_0000000.jpg ...
    webcam_frames/frame_0000000.jpg ..."""
    provides = frozenset({"object", "image"})
    marks = (
        "real/*/dataset_0/frames",
        "dataset/real/*/dataset_0/frames",
        "[0-9][0-9][0-9]_*/dataset_0/frames",
    )
    certainty = 1.0
    doubts = ("no frame without contact is known: the median is the background",)

    def _items(self) -> Iterator[RecordingItem]:
        real = self._folder("real", "dataset/real", ".")
        folders = sorted(path for path in real.glob("*/dataset_*") if path.is_dir())
        if not folders:
            raise self._missing(f"no folder OBJECT/dataset_0 in {real}")
        for folder in folders:
            key = f"{folder.parent.name}/{folder.name}"
            yield RecordingItem(key, partial(self._open, key, folder))

    def _open(self, key: str, folder: Path) -> Recording:
        numbered, name = NumberedImages(folder / "frames"), folder.parent.name
        frames = numbered.frames(self._index)
        chosen = BACKGROUNDS.get(name, "")
        background = still_background(folder.parents[1] / "bgs" / f"bg_{chosen}.jpg", frames)
        views = NumberedImages(folder / "webcam_frames")
        return self._recording(
            key,
            sensor="digit",
            frames=frames,
            times=frame_times(list(numbered.files), 30.0),
            no_contact=background or median_frames(frames),
            object=name,
            image=views.frames(self._index) if views.files else None,
        )
