"""The data set ``tactile_tracking``: films of a GelSight Mini with the pose of each frame."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.data import VideoFrames
from tactileforge.errors import DataError
from tactileforge.reading import PublishedDataset, RecordingItem, check_regular, is_there
from tactileforge_datasets.checks import numbers, same_length, word_before_number

_POSES = "true_start_T_currs.npy"


class TactileTracking(PublishedDataset):
    """TactileTracking, the data of NormalFlow: a trial is a recording, and has a pose a frame.

    Poses are the track ``pose``, float32 (T, 4, 4): from the sensor's frame now to that of the
    first frame, lengths in m. Times are those of the video. The webcam's frames are spread evenly
    over the trial. No frame is known to be without contact: nothing is subtracted. Masks and
    gradients of the source are made from its pictures, and not read.

    Args:
        root: Folder of the trials.
        split: One of ``splits``.
        val: Share of the objects held out for validation.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "tactile_tracking"
    sensors = ("gelsight_mini",)
    tier = 4
    licence = "MIT"
    citation = "Huang et al., NormalFlow, RA-L 2024"
    url = "https://huggingface.co/datasets/joehjhuang/TactileTracking"
    tree = """ROOT/avocado1/                 (object and number of the trial)
  gelsight.avi
  true_start_T_currs.npy
  webcam.avi"""
    provides = frozenset({"object", "image"})
    marks = (f"*/{_POSES}",)
    certainty = 1.0
    doubts = ("times are those of the video's header", "no frame without contact is known")

    def _items(self) -> Iterator[RecordingItem]:
        folders = sorted(path.parent for path in self._folder(".").glob("*/gelsight.avi"))
        if not folders:
            raise self._missing(f"no file TRIAL/gelsight.avi in {self.root}")
        for folder in folders:
            name = word_before_number(folder.name)
            yield RecordingItem(folder.name, partial(self._open, folder, name), group=name)

    def _open(self, folder: Path, name: str) -> Recording:
        frames = VideoFrames(folder / "gelsight.avi")
        poses = _poses(folder / _POSES)
        same_length(
            {"frames of gelsight.avi": len(frames), f"poses of {_POSES}": len(poses)}, str(folder)
        )
        webcam = folder / "webcam.avi"
        return self._recording(
            folder.name,
            sensor="gelsight_mini",
            frames=frames,
            times=frames.times,
            no_contact=None,
            object=name,
            image=VideoFrames(webcam) if is_there(webcam) else None,
            tracks={"pose": poses.astype(np.float32)},
        )


def _poses(path: Path) -> np.ndarray:
    try:
        check_regular(path)
        poses = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise DataError(f"{path}: no array of poses ({error}); download it again") from error
    return numbers(poses, (None, 4, 4), "the array of poses", str(path))
