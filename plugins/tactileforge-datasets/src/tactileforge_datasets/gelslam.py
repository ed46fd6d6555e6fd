"""The data set ``gelslam``: films of a GelSight Mini rolled over objects, and ball presses."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data import VideoFrames
from tactileforge.errors import DataError
from tactileforge.plugins import load_yaml
from tactileforge.reading import (
    PublishedDataset,
    RecordingItem,
    add_once,
    is_there,
    kind_of,
    read_cells,
    regular_text,
    still_background,
)
from tactileforge_datasets.checks import inside

#: First frames of a film, which are without contact.
_FREE = 10
_DIAMETER = "diameter(mm)"


class GelSlam(PublishedDataset):
    """GelSLAM: films over objects, and the ball presses of its calibration.

    A film is a recording; its first 10 frames are the background. Times are those of the video.
    The scale of its `config.yaml`, mm a pixel, is the label ``mm_per_pixel``. No pose is published:
    the results of the source are meshes. A press of the calibration, from ``catalog.csv``, is a
    recording of one frame with the label ``ball_diameter_mm``; its background is
    ``background.png`` beside the table, or one folder below.

    Args:
        root: Folder of the data set, or of a part of it.
        split: One of ``splits``.
        val: Share of the objects held out for validation.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "gelslam"
    sensors = ("gelsight_mini",)
    tier = 4
    licence = "MIT"
    citation = "Huang et al., GelSLAM, 2025"
    url = "https://huggingface.co/datasets/joehjhuang/GelSLAM_dataset"
    tree = """ROOT/
  reconstruction_dataset/OBJECT/{gelsight.avi,config.yaml}
  calibration/catalog.csv, background.png     (optional)
  calibration/6.310mm/0/gelsight.png ..."""
    provides = frozenset({"object"})
    marks = ("*/*/gelsight.avi", "*/gelsight.avi", "catalog.csv", "*/catalog.csv")
    doubts = ("no poses are published", "the first 10 frames of a film are the background")

    @classmethod
    def recognise(cls, root: Path) -> Any:
        """See `PublishedDataset.recognise`; films have a scale, and no poses."""
        guess = super().recognise(root)
        films = [path for path in (*root.glob("*/gelsight.avi"), *root.glob("*/*/gelsight.avi"))]
        # films with poses are of ``tactile_tracking``
        if guess is None or any(
            (path.parent / "true_start_T_currs.npy").exists() for path in films
        ):
            return None
        return guess if any(map(_has_scale, films)) or _tables(root) else None

    def _items(self) -> Iterator[RecordingItem]:
        root = self._folder(".")
        films = sorted({*root.glob("*/gelsight.avi"), *root.glob("*/*/gelsight.avi")})
        tables = _tables(root)
        for path in _catalogs(root):
            if path not in tables:
                kind = "a file" if path.is_file() else kind_of(path)
                add_once(self.notes, f"{path}: {kind}, and no table of presses; download it again")
        if not films and not tables:
            raise self._missing(f"no film OBJECT/gelsight.avi in {root}")
        for path in films:
            key = path.parent.relative_to(root).as_posix()
            yield RecordingItem(key, partial(self._film, key, path), group=path.parent.name)
        for table in tables:
            for where, cells in read_cells(table, ["experiment_reldir", _DIAMETER]):
                key = f"calibration/{cells['experiment_reldir']}"
                opened = partial(self._press, key, table.parent, where, cells)
                yield RecordingItem(key, opened, group=f"ball {cells[_DIAMETER]}")

    def _film(self, key: str, path: Path) -> Recording:
        frames = VideoFrames(path)
        scale = _scale(path.parent / "config.yaml")
        if not scale and is_there(path.parent / "config.yaml"):
            add_once(self.notes, f"{path.parent / 'config.yaml'}: no ppmm, so no scale of the film")
        return self._recording(
            key,
            sensor="gelsight_mini",
            frames=frames,
            times=frames.times,
            no_contact=FrameSubset(frames, list(range(min(_FREE, len(frames))))),
            object=path.parent.name,
            labels={"mm_per_pixel": scale} if scale else {},
        )

    def _press(self, key: str, folder: Path, where: str, cells: dict[str, str]) -> Recording:
        name = cells["experiment_reldir"]
        near = (inside(folder, name, where), inside(folder / "calibration", name, where))
        stills = [
            still
            for place in near
            for still in (place / "gelsight.png", place.with_name(f"{place.name}.png"))
        ]
        frames = self._pictures([next((path for path in stills if path.is_file()), stills[0])])
        try:
            diameter = float(cells[_DIAMETER])
        except ValueError:
            raise DataError(
                f"{where}: {cells[_DIAMETER]!r} is not a diameter in mm; correct it"
            ) from None
        backgrounds = (folder / "background.png", *sorted(folder.glob("*/background.png")))
        chosen = next((path for path in backgrounds if is_there(path)), backgrounds[0])
        return self._recording(
            key,
            sensor="gelsight_mini",
            frames=frames,
            times=np.zeros(1),
            no_contact=still_background(chosen, frames),
            object=f"ball_{cells[_DIAMETER]}_mm",
            labels={"ball_diameter_mm": diameter},
        )


def _tables(root: Path) -> list[Path]:
    """Tables of ball presses, by their columns."""
    found = []
    for path in _catalogs(root):
        if not path.is_file():
            continue
        with path.open("rb") as file:
            if file.readline(256).removeprefix(b"\xef\xbb\xbf").startswith(b"experiment_reldir,"):
                found.append(path)
    return found


def _catalogs(root: Path) -> list[Path]:
    return sorted((*root.glob("catalog.csv"), *root.glob("*/catalog.csv")))


def _has_scale(film: Path) -> bool:
    try:
        return _scale(film.parent / "config.yaml") > 0
    except DataError:
        return False


def _scale(path: Path) -> float:
    """Millimetres a pixel of a film's description; 0 without one."""
    if not is_there(path):
        return 0.0
    try:
        said = load_yaml(regular_text(path))
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: not YAML ({error}); correct it, or remove it") from error
    scale = said.get("ppmm") if isinstance(said, dict) else None
    if scale is None:
        scale = next(
            (
                one["ppmm"]
                for one in (said or {}).values()
                if isinstance(one, dict) and "ppmm" in one
            ),
            0.0,
        )
    if not isinstance(scale, int | float) or scale < 0:
        raise DataError(f"{path}: ppmm is {scale!r}; expected mm per pixel")
    return float(scale)
