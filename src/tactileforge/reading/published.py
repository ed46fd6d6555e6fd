"""Base of the readers of published data sets."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames, FrameSubset, Guess, Recording
from tactileforge.data.frames.companions import is_companion
from tactileforge.data.frames.crop import check_background_size
from tactileforge.data.frames.cut import spread_rows
from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.data.frames.picture_files import IMAGE_SUFFIXES
from tactileforge.data.frames.picture_index import PictureIndex
from tactileforge.data.labels.missing import stated
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, home_path, unknown
from tactileforge.reading.drawn import Drawn
from tactileforge.reading.layout_keys import MEDIAN_FRAMES
from tactileforge.reading.notes import Lines, add_once
from tactileforge.reading.official import ALL_FOR_TRAINING, OfficialSplit
from tactileforge.reading.splits import is_held_out, one_of_few
from tactileforge.specs.published import spec
from tactileforge.util.regular import is_there


@dataclass(frozen=True)
class RecordingItem:
    """A recording before it is opened.

    Attributes:
        key: Key, unique within the data set.
        open: Function that opens the recording; raises a `DataError` if it cannot.
        facts: Properties for the splits, see `OfficialSplit.fact`.
        group: Name of the group held out together; "" for the key.
    """

    key: str
    open: Callable[[], Recording]
    facts: Mapping[str, str] = field(default_factory=dict)
    group: str = ""


class PublishedDataset(Drawn, ABC):
    """Base class of readers of published data sets; subclasses describe one and list its items.

    Args:
        root: Folder of the data.
        split: One of ``splits``.
        val: Share of the training held out for validation; unused by a split with its own.

    Attributes:
        name: Name of the data set in options.
        sensors: Names of its sensors.
        tier: Tier of the tactile dynamic pyramid (AnyTouch 2, appendix), 1 to 5.
        licence: SPDX identifier, or plain words.
        citation: Authors, title and venue to cite.
        url: Address of the download.
        tree: Expected tree of folders.
        splits: Available splits.
        chosen: Selected split.
        provides: Labels of its recordings.
        marks: Glob patterns below the root by which a download is recognised; any of them is
            enough, and () recognises nothing.
        beside: Glob patterns of which one has to be there too; () where the marks are enough.
        certainty: Score of such a guess: .5 for names that other data may have, 1 for its own.
        doubts: What a user of it has to check, one line each.
        skipped: One line for each unreadable recording.
        notes: One line for each table or scale that is there and says nothing.

    Raises:
        ConfigError: An unknown split, or a share outside 0..1.
    """

    name: ClassVar[str]
    sensors: ClassVar[tuple[str, ...]]
    tier: ClassVar[int]
    licence: ClassVar[str] = "see its page"
    citation: ClassVar[str]
    url: ClassVar[str]
    tree: ClassVar[str]
    splits: tuple[OfficialSplit, ...] = (ALL_FOR_TRAINING,)
    provides: frozenset[str] = frozenset()
    marks: ClassVar[tuple[str, ...]] = ()
    beside: ClassVar[tuple[str, ...]] = ()
    certainty: ClassVar[float] = 0.5
    doubts: ClassVar[tuple[str, ...]] = ()

    def __init__(self, root: str, split: str = "all", val: float = 0.1) -> None:
        named = {one.name: one for one in self.splits}
        if split not in named:
            raise ConfigError(f"{self.name}: {unknown('split', split, named)}")
        if not 0 <= val < 1:
            raise ConfigError(f"{self.name}: val is {val}, but must be 0 or more, and below 1")
        self.root = home_path(root)
        self.split = split
        self.chosen = named[split]
        self.val = val
        self.skipped: list[str] = Lines()
        self.notes: list[str] = []

    @abstractmethod
    def _items(self) -> Iterator[RecordingItem]:
        """Lists the recordings in a fixed order; decodes nothing."""

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of one side of the split; frames are decoded on reading.

        A recording that cannot be opened is left out and listed in ``skipped``.

        Args:
            split: ``train``, ``val`` or ``test``.

        Raises:
            DataNotFoundError: Data is missing; names the download and its folder.
            DataError: No recording can be opened, or an index file is damaged.
            ConfigError: An unknown side.
        """
        if split not in ("train", "val", "test"):
            raise ConfigError(unknown("side of a split", split, ("train", "val", "test")))
        opened = False
        try:
            for item in self._items():
                if self._side(item) != split:
                    continue
                try:
                    recording = item.open()
                except DataError as error:
                    add_once(self.skipped, error)
                    continue
                opened = True
                yield recording
        finally:
            self._index.save()
        # Validation may be empty; training and test may not.
        if opened or split == "val":
            return
        if self.skipped:
            raise DataError(
                f"{self.root}: no recording of {self.name} for {split} can be opened; the first of "
                f"{len(self.skipped)} problems: {self.skipped[0]}"
            )
        about = f"split {self.split}: {self.chosen.about}"
        raise self._missing(f"nothing for {split} in {self.root} ({about})")

    @property
    def held_out(self) -> list[str]:
        """The held-out unit."""
        split = f"split {self.split}: {self.chosen.about}"
        if self.chosen.val:
            return [split]
        return [f"by object, film or session of {split}"] if self.val else []

    def _side(self, item: RecordingItem) -> str | None:
        side = self.chosen.side(item.facts)
        if side != "train" or self.chosen.val:
            return side
        # by name and group: but for a few, a share is the same one whatever files are there
        return "val" if is_held_out(self._unit(item), self.val, self._held) else side

    def _unit(self, item: RecordingItem) -> str:
        return f"{self.name}/{item.group or item.key}"

    @cached_property
    def _held(self) -> frozenset[str]:
        """The unit held out of few; see `splits.one_of_few`."""
        own = (item for item in self._items() if self.chosen.side(item.facts) == "train")
        return one_of_few(map(self._unit, own), self.val)

    @cached_property
    def _index(self) -> PictureIndex:
        """Headers of the images, of this start and of earlier ones."""
        return PictureIndex(self.root)

    def _pictures(self, paths: Sequence[Path]) -> ImageFrames:
        """Images as frames; their headers are read once for all starts.

        Raises:
            DataError: One is damaged, or they differ in size.
        """
        return ImageFrames(paths, index=self._index)

    def _missing(self, what: str) -> DataNotFoundError:
        return DataNotFoundError(
            f"{self.name}: {what}. Download it from {self.url}, and give its folder as data.root; "
            f"it has to look like this:\n{self.tree}"
        )

    def _folder(self, *names: str) -> Path:
        """The first existing folder of some below the root; "." is the root itself."""
        for name in names:
            if (self.root / name).is_dir():
                return self.root / name
        raise self._missing(f"no folder {self.root / names[0]}")

    def _recording(self, key: str, **fields: Any) -> Recording:
        """A recording with its source; a word for "no value" counts as no text and no object."""
        for name in ("object", "text"):
            fields[name] = stated(fields.get(name)) or None
        return Recording(
            key=f"{self.name}/{key}",
            source=f"{self.citation} {self.url}",
            tier=self.tier,
            licence=self.licence,
            **fields,
        )

    @classmethod
    def recognise(cls, root: Path) -> Guess | None:
        """Guesses from names of files and folders whether this reader reads a folder.

        Args:
            root: A folder, or anything else.

        Returns:
            The options of the reader; None for a folder of something else.
        """
        for patterns in (cls.marks, cls.beside or cls.marks):
            if not any(_has(root, pattern) for pattern in patterns):
                return None
        first = cls.citation.split(",")[0]
        return Guess(
            options={"root": str(root)},
            format=f"{cls.name} ({first})",
            score=cls.certainty,
            doubts=cls.doubts,
        )

    @classmethod
    def row(cls) -> str:
        """The data set as a row of the table in ``docs/datasets.md``."""
        cells = (
            f"`{cls.name}`",
            ", ".join(cls.sensors),
            str(cls.tier),
            ", ".join(sorted(cls.provides)),
            cls.licence,
            f"[{cls.citation.split(',')[0]}]({cls.url})",
            ", ".join(f"`{split.name}`" for split in cls.splits),
        )
        return f"| {' | '.join(cells)} |"


def _has(root: Path, pattern: str) -> bool:
    """Whether a folder has a match of a glob pattern, other than a companion file."""
    try:
        found = (path for path in root.glob(pattern) if not is_companion(path.relative_to(root)))
        return next(found, None) is not None
    except OSError:
        return False


class NumberedImages:
    r"""The images of a folder, by the last number in their names.

    Args:
        folder: Folder of the images; it need not exist.
        named: Regular expression of the names without the ending, e.g. ``image_\d+``.
    """

    def __init__(self, folder: Path, named: str = r".*\d") -> None:
        self.folder = folder
        self.named = re.compile(named)

    @cached_property
    def files(self) -> dict[int, Path]:
        """File by number, ascending; hidden files and other kinds are left out."""
        paths = {}
        for path in sorted(self.folder.iterdir()) if self.folder.is_dir() else ():
            wanted = path.suffix.lower() in IMAGE_SUFFIXES and not is_companion(Path(path.name))
            if wanted and self.named.fullmatch(path.stem):
                paths[int(re.findall(r"\d+", path.stem)[-1])] = path
        return dict(sorted(paths.items()))

    def frames(self, index: PictureIndex | None = None) -> ImageFrames:
        """Frames of all images, by ascending number.

        Args:
            index: Headers of earlier starts; None reads them.

        Raises:
            DataError: There are no images, or one is damaged.
        """
        if not self.files:
            raise DataError(f"{self.folder}: no image; download it again")
        return ImageFrames(list(self.files.values()), index=index)

    def nearest(self, numbers: Sequence[int]) -> Frames | None:
        """The images nearest to some numbers; None without any image."""
        if not self.files:
            return None
        known = np.array(list(self.files))
        right = np.searchsorted(known, numbers).clip(1, max(1, len(known) - 1))
        # of two equally near, argmin takes the first: the earlier image
        pair = np.stack([known[right - 1], known[np.minimum(right, len(known) - 1)]])
        closest = np.abs(pair - np.asarray(numbers)).argmin(axis=0)
        chosen = pair[closest, np.arange(len(numbers))]
        return ImageFrames([self.files[int(number)] for number in chosen])


def frame_times(numbers: Sequence[int], fps: float) -> NDArray[np.float64]:
    """Times of frames by their numbers, from 0; a gap in the numbers is a gap in time."""
    times: NDArray[np.float64] = (np.asarray(numbers, np.float64) - numbers[0]) / fps
    return times


def frame_rate(sensor: str, fps: float | None) -> float:
    """Frames per second: ``fps``, or those of the sensor for None."""
    return fps or spec(sensor).fps


def median_frames(frames: Frames) -> FrameSubset:
    """Frames spread over a recording. Their median leaves out a moving contact."""
    return FrameSubset(frames, spread_rows(len(frames), MEDIAN_FRAMES))


def label_runs(numbers: Sequence[int], labels: Sequence[Any]) -> Iterator[slice]:
    """Yields the stretches of consecutive numbers with one label."""
    start = 0
    for i in range(1, len(numbers) + 1):
        if i < len(numbers) and numbers[i] == numbers[i - 1] + 1 and labels[i] == labels[i - 1]:
            continue
        yield slice(start, i)
        start = i


def still_background(path: Path, frames: Frames) -> ImageFrames | None:
    """An image as background; None without the file.

    Raises:
        DataError: The image is damaged, or its size differs from that of the frames.

    Example:
        >>> import numpy as np
        >>> from tactileforge.data import ArrayFrames
        >>> still_background(Path("no.png"), ArrayFrames(np.zeros((1, 8, 8, 3), np.uint8))) is None
        True
    """
    if not is_there(path):
        return None
    background = ImageFrames([path])
    fix = "give a background of the same size, or remove it"
    check_background_size(background.shape, frames.shape, str(path), fix=fix)
    return background
