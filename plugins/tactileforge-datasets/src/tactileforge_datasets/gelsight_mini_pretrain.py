"""The data set ``gelsight_mini_pretrain``: frames of twelve sources in one table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Guess, Recording
from tactileforge.data import EncodedFrames, LazyImages
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.reading import OfficialSplit, PublishedDataset, RecordingItem, add_once
from tactileforge_datasets import parquet
from tactileforge_datasets.checks import POSE, numbers, pose_track, pressing_sign

#: Licence by source, from the table's card.
LICENCES = {
    "fota_labeled": "MIT",
    "fota_unlabeled": "MIT",
    "threedcal": "CC-BY-4.0",
    "feats": "MIT",
    "gelslam": "MIT",
    "tactile_tracking": "MIT",
    "real_tactile_mnist": "CC-BY-2.0",
    "feelanyforce": "CC-BY-4.0",
    "unit": "BSD-3-Clause style",
    "tacquad": "CC-BY-4.0",
    "sim_tactile_mnist": "CC-BY-4.0",
    "sim_starstruck": "CC-BY-4.0",
}
_FORCE = ("f_x", "f_y", "f_z")
_WORDS = ("source", "domain", "gel_variant", "capture", "episode", "side", "indenter_param")
_NUMBERS = ("digit_class", "frame_idx", "init_pose", "markered")
_ROW = (*_FORCE, *POSE, *_WORDS, *_NUMBERS, "obj_name", "indenter")
_OFFICIAL = OfficialSplit(
    "published",
    "splits of the table: train, recon and the areas of TacQuad; val; test and its variants",
    "side",
    frozenset({"train"}),
    frozenset({"test"}),
    frozenset({"val"}),
)


class GelSightMiniPretrain(PublishedDataset):
    """GelSight Mini Pretrain: a row is a recording of one frame, with the licence of its source.

    Forces are those of FEATS and others, in N, with z turned for each source so that its mean is
    positive; x and y are as they are there. Poses are the track ``pose``, float32 (1, 7): x, y, z
    in m and the quaternion x, y, z, w; NaN where the source has none. No frame is known to be
    without contact: nothing is subtracted.

    Args:
        root: Folder of the sources.
        split: One of ``splits``.
        val: Share of the objects held out for validation, where a source has no such part.
        sources: Names of the sources to read, such as ``feats``; None for all.
        bgr: Names of sources with red and blue exchanged. The release of 2026 has none; older
            copies have ``fota_unlabeled`` and ``unit``.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "gelsight_mini_pretrain"
    sensors = ("gelsight_mini",)
    tier = 5
    licence = "CC-BY-4.0, and that of each source"
    citation = "Ma et al., GelSight Mini Pretrain, 2026"
    url = "https://huggingface.co/datasets/yxma/gelsight-mini-pretrain"
    tree = """ROOT/
  feats/train-00000-of-00001.parquet ...   (each source in its folder)
  gelslam/train-*.parquet ..."""
    splits = (_OFFICIAL, *PublishedDataset.splits)
    provides = frozenset({"force", "object"})
    marks = ("*/train-*.parquet", "*/data_*-*.parquet")
    certainty = 1.0
    doubts = ("an older copy may hold red and blue exchanged: set bgr=[SOURCE] after a look",)

    def __init__(
        self,
        root: str,
        split: str = "published",
        val: float = 0.1,
        sources: Sequence[str] | None = None,
        bgr: Sequence[str] = (),
    ) -> None:
        super().__init__(root, split, val)
        self.sources = None if sources is None else list(sources)
        self.bgr = list(bgr)

    @classmethod
    def recognise(cls, root: Path) -> Guess | None:
        """See `PublishedDataset.recognise`; the columns of a file decide."""
        guess = super().recognise(root)
        try:
            known = parquet.column_names(next(root.glob("*/*.parquet"))) if guess else []
        except (DataError, StopIteration):
            return None
        return guess if {"image", "source", "obj_name", "markered"} <= {*known} else None

    @cached_property
    def _files(self) -> list[Path]:
        """Files of the chosen sources."""
        files = sorted(self._folder(".").glob("*/*.parquet"))
        if not files:
            raise self._missing(f"no file SOURCE/train-*.parquet in {self.root}")
        known = {path.parent.name for path in files}
        for name in (*(self.sources or ()), *self.bgr):
            if name not in known:
                raise ConfigError(f"{self.name}: {unknown('source', name, known)}")
        return [path for path in files if self.sources is None or path.parent.name in self.sources]

    def _items(self) -> Iterator[RecordingItem]:
        signs: dict[str, float] = {}
        for path in self._files:
            source = path.parent.name
            try:
                parquet.check_columns(path, ["image", "source"])
                if source not in signs:
                    signs[source] = self._sign(source)
                yield from self._of_file(path, source, signs[source])
            except DataError as error:
                add_once(self.skipped, error)

    def _sign(self, source: str) -> float:
        """Sign of the normal force of a source, over its readable files."""
        files = [path for path in self._files if path.parent.name == source]
        rows = chain.from_iterable(parquet.read_rows(path, ["f_z"]) for path in files)
        return pressing_sign(row["f_z"] for row in rows if row.get("f_z") is not None)

    def _of_file(self, path: Path, source: str, sign: float) -> Iterator[RecordingItem]:
        part = path.stem.split("-")[0]
        side = part if part in ("train", "val") else "test" if part.startswith("test") else "train"
        for number, row in enumerate(parquet.read_rows(path, _ROW)):
            key = f"{source}/{path.stem}/{number}"
            name = _object(row)
            opened = partial(self._open, key, path, number, row, sign)
            yield RecordingItem(key, opened, {"side": side}, group=f"{source}/{name or key}")

    def _open(
        self, key: str, path: Path, number: int, row: dict[str, Any], sign: float
    ) -> Recording:
        where, source = f"{path}, row {number}", path.parent.name
        pictures = LazyImages(1, partial(_picture, str(path), number))
        force = _values(row, _FORCE, where) * [1, 1, sign]
        name = _object(row)
        labels: dict[str, str | float] = {
            key: str(row[key]) for key in _WORDS if row.get(key) is not None
        }
        labels |= {key: float(row[key]) for key in _NUMBERS if row.get(key) is not None}
        recording = self._recording(
            key,
            sensor="gelsight_mini",
            frames=EncodedFrames(where, pictures, bgr=source in self.bgr),
            times=np.zeros(1),
            no_contact=None,
            force=force[None].astype(np.float32) if np.isfinite(force).any() else None,
            object=f"{source}_{name}" if name else None,
            labels=labels,
            tracks=pose_track(_values(row, POSE, where)),
        )
        return replace(recording, licence=LICENCES.get(source, self.licence))


def _object(row: dict[str, Any]) -> str:
    """Name of the touched object; "" for none."""
    digit = row.get("digit_class")
    named = row.get("obj_name") or row.get("indenter")
    return str(named or ("" if digit is None else f"digit_{digit}"))


def _values(row: dict[str, Any], names: Sequence[str], where: str) -> NDArray[np.float64]:
    """Numbers of a row; NaN for an empty cell or a column that is not there."""
    cells = [np.nan if row.get(name) is None else row[name] for name in names]
    return numbers(cells, (len(names),), ", ".join(names), where, empty=True)


def _picture(path: str, row: int, _: int) -> bytes:
    return parquet.image_bytes(parquet.read_cell(path, "image", row), f"{path}, row {row}")
