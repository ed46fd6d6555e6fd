"""The data set ``sparsh_pose``: an object turned under three DIGIT fingers (T3 of Sparsh)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.data import EncodedFrames
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.reading import (
    ALL_FOR_TRAINING,
    PublishedDataset,
    RecordingItem,
    load_pickle,
    still_background,
)
from tactileforge_datasets.official_splits import POSE_OFFICIAL

_FINGERS = ("index", "middle", "ring")


class SparshPose(PublishedDataset):
    """T3 of Sparsh, pose estimation: the images of one finger in a bag are a recording.

    ``tracks["relative_pose"]`` is float32 (T, 4, 4), the object's motion over the last five frames
    in the frame of the finger, unchanged from the source. Images without a pose are left out.
    Pickles are read without executing anything; their channels are in OpenCV's order (BGR), those
    of the background images are not.

    Args:
        root: Folder with ``train``, ``test`` and ``bgs``.
        finger: ``index``, ``middle`` or ``ring``; the task is defined on the ring finger.
        split: One of ``splits``.
        val: Share of the bags held out for validation.
        fps: Frames per second; the true rate is not published.

    Raises:
        ConfigError: An unknown finger or split, or a share outside 0..1.
    """

    name = "sparsh_pose"
    sensors = ("digit",)
    tier = 4
    licence = "CC-BY-NC-4.0"
    citation = "Higuera et al., Sparsh, CoRL 2024"
    url = "https://huggingface.co/datasets/facebook/digit-pose-estimation"
    tree = """ROOT/
  train/sugar/bag_00.pkl ...   (pringles alike; test alike)
  bgs/digit_ring.png ..."""
    splits = (POSE_OFFICIAL, ALL_FOR_TRAINING)
    provides = frozenset({"object"})
    marks = ("t*/*/bag_*.pkl",)
    certainty = 1.0
    doubts = ("finger=ring unless another is given",)

    def __init__(
        self,
        root: str,
        finger: str = "ring",
        split: str = "sparsh-official",
        val: float = 0.1,
        fps: float = 30.0,
    ) -> None:
        super().__init__(root, split, val)
        if finger not in _FINGERS:
            raise ConfigError(f"{self.name}: {unknown('finger', finger, _FINGERS)}")
        self.finger = finger
        self.fps = fps

    def _items(self) -> Iterator[RecordingItem]:
        files = sorted(self._folder(".").glob("t*/*/bag_*.pkl"))
        if not files:
            raise self._missing(f"no file train/sugar/bag_00.pkl in {self.root}")
        for path in files:
            folder, name = path.parts[-3:-1]
            key = f"{folder}/{name}/{path.stem}"
            yield RecordingItem(key, partial(self._open, key, path), {"folder": folder})

    def _open(self, key: str, path: Path) -> Recording:
        bag = load_pickle(path)
        names = f"digit_{self.finger}", f"object_{self.finger}_rel_pose_n5"
        try:
            images, poses = (list(bag[name]) for name in names)
            count = min(len(images), len(poses))
            relative = np.asarray(poses[:count], np.float32).reshape(count, 4, 4)
        except (LookupError, TypeError, ValueError) as error:
            raise DataError(
                f"{path}: no images and 4x4 poses under {' and '.join(names)} ({error!r}); "
                "download it again"
            ) from error
        frames = EncodedFrames(str(path), images[:count], bgr=True)
        return self._recording(
            key,
            sensor="digit",
            frames=frames,
            times=np.arange(count) / self.fps,
            no_contact=still_background(self.root / "bgs" / f"digit_{self.finger}.png", frames),
            object=path.parent.name,
            tracks={"relative_pose": relative},
        )
