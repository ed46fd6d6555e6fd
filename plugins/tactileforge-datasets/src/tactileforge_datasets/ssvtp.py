"""The data set ``ssvtp``: textiles pressed with a DIGIT and photographed by a robot."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.reading import (
    ALL_FOR_TRAINING,
    NumberedImages,
    PublishedDataset,
    RecordingItem,
    add_once,
    is_there,
    read_rows,
    read_text,
)
from tactileforge_datasets.official_splits import TVL_OFFICIAL


class Ssvtp(PublishedDataset):
    """SSVTP with the captions of TVL: each press is one frame, without a background.

    Args:
        root: Folder with ``images_tac``, or the folder above it.
        split: One of ``splits``.
        val: Share of the presses held out for validation.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "ssvtp"
    sensors = ("digit",)
    tier = 5
    licence = "none stated"
    citation = "Kerr et al., Self-Supervised Visuo-Tactile Pretraining to Locate Garments, RSS 2023"
    url = "https://huggingface.co/datasets/mlfu7/Touch-Vision-Language-Dataset"
    tree = """ROOT/ssvtp/
  train.csv, test.csv          (images_rgb/image_12_rgb.jpg, caption)
  images_tac/image_12_tac.jpg ...
  images_rgb/image_12_rgb.jpg ...
  text/labels_12.txt ..."""
    splits = (TVL_OFFICIAL, ALL_FOR_TRAINING)
    provides = frozenset({"text", "image"})
    marks = ("images_tac/image_*_tac.jpg", "ssvtp/images_tac", "tvl_dataset/ssvtp/images_tac")
    beside = ("train.csv", "test.csv", "text/labels_*.txt", "ssvtp", "tvl_dataset")
    certainty = 1.0

    def __init__(self, root: str, split: str = "tvl-official", val: float = 0.1) -> None:
        super().__init__(root, split, val)

    def _items(self) -> Iterator[RecordingItem]:
        touch = self._folder("images_tac", "ssvtp/images_tac", "tvl_dataset/ssvtp/images_tac")
        index = touch.parent / "test.csv"
        listed = read_rows(index) if is_there(index) else []
        # by number: the list names the photographs, which have names of their own
        names = [re.search(r"image_(\d+)_rgb", row[0]) for row in listed if row]
        tests = {int(match[1]) for match in names if match}
        views = NumberedImages(touch.parent / "images_rgb", r"image_\d+_rgb")
        for number, path in NumberedImages(touch, r"image_\d+_tac").files.items():
            opened = partial(self._open, str(number), path, views.files.get(number))
            side = "test" if number in tests else "train"
            yield RecordingItem(str(number), opened, {"list": side})

    def _open(self, key: str, path: Path, view: Path | None) -> Recording:
        caption = path.parents[1] / "text" / f"labels_{key}.txt"
        text = read_text(caption).strip() if is_there(caption) else ""
        if not text and is_there(caption):
            add_once(self.notes, f"{caption}: no caption is in it")
        return self._recording(
            key,
            sensor="digit",
            frames=self._pictures([path]),
            times=np.zeros(1),
            no_contact=None,
            text=text.partition("\n")[0].strip() or None,
            image=self._pictures([view]) if view else None,
        )
