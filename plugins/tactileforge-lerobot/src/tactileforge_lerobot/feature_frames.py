"""Frames of the features of a LeRobot data set, whatever they are stored as."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames, FrameSubset
from tactileforge.data import VIDEO_SUFFIXES, EncodedFrames, LazyImages, VideoFrames
from tactileforge.errors import DataError
from tactileforge.sensors import TaxelLayout
from tactileforge_lerobot.deep import DeepPart, DeepVideo, form_of
from tactileforge_lerobot.drawn import ColumnValues, Drawing, DrawnFrames, Values
from tactileforge_lerobot.folder import inside
from tactileforge_lerobot.images import read_image
from tactileforge_lerobot.info import Info
from tactileforge_lerobot.rows import EpisodeRows

#: Most numbers of a frame that are kept as a track beside their picture.
_TRACK = 4096


@dataclass(frozen=True)
class Touch:
    """Frames of a touch feature in one episode.

    Attributes:
        frames: All frames, one per row.
        still: Frame without contact; None where there is none.
        values: Numbers of the frames, (T, taxels, values of each); None for pictures, and where
            there are more than 4096 a frame.
        lost: Rows without values, bool (T,).
    """

    frames: Frames
    still: Frames | None
    values: NDArray[np.floating] | None
    lost: NDArray[np.bool_]


def split_part(feature: str) -> tuple[str, int | None]:
    """Splits ``NAME/2`` into a feature and an index along its first axis, None for all."""
    name, _, part = feature.rpartition("/")
    return (name, int(part)) if name and part.isdecimal() and len(part) < 6 else (feature, None)


class Pictures:
    """Opener of frames, with a memory for facts of the videos.

    Args:
        root: Folder of the data set.
        info: Metadata of the data set.
        drawing: How numbers become pictures.
    """

    def __init__(self, root: Path, info: Info, drawing: Drawing) -> None:
        self.root, self.info, self.drawing = root, info, drawing
        self._videos: dict[tuple[Path, tuple[int, int, int, int] | None], VideoFrames] = {}
        self._deep: dict[Path, DeepVideo] = {}

    def frames(self, rows: EpisodeRows, feature: str, shape: Sequence[int] | None) -> Frames:
        """Frames of a picture feature, one per row.

        Args:
            rows: Rows of the episode.
            feature: Name of the feature, of dtype video or image.
            shape: Height and width that are shown of a video; None for all.

        Raises:
            DataError: A file is damaged, or has too few frames.
        """
        if self.info.features[feature]["dtype"] == "image":
            path, start = rows.place
            read = partial(read_image, self.root, path, feature, start)
            return EncodedFrames(f"{path}, {feature}", LazyImages(len(rows), read))
        if self.info.features[feature]["dtype"] != "video":
            raise DataError(f"{self.root}: {feature} holds no pictures; give another feature")
        path = self._present(rows.video(feature)[0])
        crop = None if shape is None else (0, 0, int(shape[1]), int(shape[0]))
        video = self._videos.get((path, crop)) or VideoFrames(path, crop)
        self._videos[path, crop] = video
        start = self._first(rows, feature, path, video.times)
        return FrameSubset(video, range(start, start + len(rows)))

    def touch(
        self,
        rows: EpisodeRows,
        feature: str,
        shape: Sequence[int] | None,
        home: EpisodeRows | None,
    ) -> Touch:
        """Frames of a touch feature: pictures, or drawn numbers.

        Args:
            rows: Rows of the episode.
            feature: Name of the feature, ``/i`` behind it for one part of its first axis.
            shape: Height and width that are shown of a video; None for all.
            home: Episode whose first frame is without contact; None for no such frame.

        Raises:
            DataError: A file is damaged, or its first frame has no values.
            ConfigError: Options of drawing do not fit the feature.
        """
        known = np.zeros(len(rows), np.bool_)
        if not self.is_drawn(rows, feature):
            still = None
            if home is not None:
                still = FrameSubset(self.frames(home, feature, shape), [0])
            return Touch(self.frames(rows, feature, shape), still, None, known)
        values, drawn = self._drawn(rows, feature, home)
        still = None
        if home is not None:
            still = FrameSubset(self._drawn(home, feature, home)[1], [0])
        if not isinstance(values, ColumnValues) or drawn.rest.size > _TRACK:
            return Touch(drawn, still, None, known)
        numbers = values.all()
        lost = (~np.isfinite(numbers) & ~drawn.outside).any((1, 2))
        return Touch(drawn, still, numbers, lost)

    def is_drawn(self, rows: EpisodeRows, feature: str) -> bool:
        """Whether a touch feature holds numbers, in its rows or in a video of 16 bits."""
        dtype = self.info.features[split_part(feature)[0]]["dtype"]
        if dtype == "video":
            return form_of(self._present(rows.video(feature)[0])) is not None
        return bool(dtype != "image")

    def _drawn(
        self, rows: EpisodeRows, feature: str, home: EpisodeRows | None
    ) -> tuple[Values, DrawnFrames]:
        """Numbers of a feature, and the pictures drawn from them."""
        name, _ = split_part(feature)
        is_video = self.info.features[name]["dtype"] == "video"
        opened = self._deep_values if is_video else self._column_values
        values, layout = opened(rows, feature)
        at = values if home is None or home is rows else opened(home, feature)[0]
        first = at.read([0])[0]
        if not np.isfinite(first).any():
            raise DataError(f"{at.name}: its first frame has no values; leave the episode out")
        rest = first if home is not None else np.where(np.isfinite(first), self.drawing.rest, first)
        return values, DrawnFrames(values, layout, rest)

    def _column_values(self, rows: EpisodeRows, feature: str) -> tuple[Values, TaxelLayout]:
        name, part = split_part(feature)
        shape = rows.shape(name)
        if part is not None and (len(shape) < 2 or part >= shape[0]):
            raise DataError(
                f"{self.root}: data.touch={feature}: {name} has the shape {shape}; correct the "
                "number behind /"
            )
        layout, size = self.drawing.arranged(shape if part is None else shape[1:], feature)
        return ColumnValues(rows, name, part, size), layout

    def _deep_values(self, rows: EpisodeRows, feature: str) -> tuple[Values, TaxelLayout]:
        path = self._present(rows.video(feature)[0])
        form = form_of(path)
        assert form is not None
        video = self._deep.get(path) or DeepVideo(path, form)
        self._deep[path] = video
        start = self._first(rows, feature, path, video.times)
        drawing, shape = replace(self.drawing, columns=()), [*video.shape]
        if video.channels == 3:
            drawing = replace(drawing, columns=self.drawing.columns or (0, 1, 2))
            shape.append(3)
        return DeepPart(video, start, len(rows)), drawing.arranged(shape, feature)[0]

    def _first(
        self, rows: EpisodeRows, feature: str, path: Path, times: NDArray[np.float64]
    ) -> int:
        """First frame of an episode in a video."""
        rows.check_rate(f"{path}: its video", times)
        # Half a frame earlier, so that rounding of the time cannot skip the first frame.
        first = rows.video(feature)[1] - 0.5 / self.info.fps
        start = int(np.searchsorted(times, first))
        if start + len(rows) > len(times):
            raise DataError(
                f"{path}: {len(times)} frames, but episode {rows.number} needs "
                f"{start + len(rows)}; download the data set again"
            )
        return start

    def _present(self, path: Path) -> Path:
        """The video, by its real suffix: Daimon's are named .mp4 and are .mov."""
        if path.is_file():
            return path
        for suffix in sorted(VIDEO_SUFFIXES):
            other = path.with_suffix(suffix)
            if other.is_file():
                return inside(self.root, str(other.relative_to(self.root)), str(path))
        return path
