"""The info file of a LeRobot data set, versions 2.0, 2.1 and 3."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.plugins import load_json
from tactileforge.reading import regular_text
from tactileforge_lerobot.folder import (
    CHUNK,
    DATA,
    DATA_2,
    INFO,
    NUMBERS,
    VIDEO,
    VIDEO_2,
    inside,
)

#: Field in braces of a path: ``{file_index}`` or ``{file_index:03d}``.
_PLACE = re.compile(r"\{([a-z_]{1,40})(?::0?([1-9])d)?\}")
#: Largest accepted size of a feature, and rows a second; more is a damaged file.
_LARGEST, _FASTEST = 1 << 24, 1e5


@dataclass(frozen=True)
class Info:
    """``meta/info.json``.

    Attributes:
        fps: Rows per second.
        features: Description of each feature (dtype, shape, names), by its name.
        data_path: Pattern of the parquet files.
        video_path: Pattern of the videos.
        version: 3, or 2 for versions 2.0 and 2.1.
        chunks: Number of episodes of a chunk, in version 2.
    """

    fps: float
    features: dict[str, dict[str, Any]]
    data_path: str
    video_path: str
    version: int = 3
    chunks: int = CHUNK

    @classmethod
    def read(cls, root: Path) -> Info:
        """Reads the file.

        Raises:
            DataNotFoundError: There is no such file.
            DataError: Its version is not supported, or its content is invalid.
        """
        path = root / INFO
        if not path.is_file():
            raise DataNotFoundError(
                f"{path}: not there; set data.root to the folder of a LeRobot data set"
            )
        try:
            info_json = load_json(regular_text(path))
            said = str(info_json["codebase_version"])
            version = _version(path, said)
            info = cls(
                _rate(info_json["fps"]),
                {str(key): _feature(key, value) for key, value in info_json["features"].items()},
                _pattern(info_json.get("data_path"), DATA if version == 3 else DATA_2),
                _pattern(info_json.get("video_path"), VIDEO if version == 3 else VIDEO_2),
                version,
                CHUNK if version == 3 else _chunk(info_json.get("chunks_size", CHUNK)),
            )
        except (ValueError, KeyError, TypeError, AttributeError, OSError, OverflowError) as error:
            raise DataError(f"{path}: not a LeRobot info file ({error!r})") from error
        if not 0 < info.fps <= _FASTEST or not info.features:
            raise DataError(f"{path}: fps={info.fps:g} and {len(info.features)} features")
        return info

    def data_file(self, root: Path, place: Mapping[str, int]) -> Path:
        """Path of a parquet file, by the fields of its pattern.

        Raises:
            DataError: The pattern has an unknown field, or leads out of the data set.
        """
        return _filled(root, "data_path", self.data_path, place)

    def video_file(self, root: Path, feature: str, place: Mapping[str, int]) -> Path:
        """Path of the video of a feature, by the further fields of its pattern.

        Raises:
            DataError: The pattern has an unknown field, or leads out of the data set.
        """
        return _filled(root, "video_path", self.video_path, {"video_key": feature, **place})

    def pictures(self) -> list[str]:
        """Names of the features of dtype video or image."""
        return [
            key for key, feature in self.features.items() if feature["dtype"] in ("video", "image")
        ]


def _version(path: Path, said: str) -> int:
    """Main number of a version.

    Raises:
        DataError: The version is not supported.
    """
    if said in ("v2.0", "v2.1"):
        return 2
    if re.fullmatch(r"v3(\.[0-9]{1,4})*", said):
        return 3
    raise DataError(
        f"{path}: format {said[:60]}, but only v2.0, v2.1 and v3 can be read; convert it with "
        "LeRobot's own script"
    )


def _chunk(value: Any) -> int:
    if type(value) is not int or not 1 <= value < 1 << 40:
        raise ValueError(f"chunks_size is {str(value)[:60]}, no number of episodes")
    return value


def _rate(value: Any) -> float:
    if type(value) not in (int, float):
        raise ValueError(f"fps is {value!r}, not a number")
    return float(value)


def _feature(name: str, value: Any) -> dict[str, Any]:
    """Checks a feature: its dtype is a plain word, its shape has sizes of a possible array."""
    feature = dict(value)
    dtype, shape = feature["dtype"], feature["shape"]
    if not isinstance(dtype, str) or not re.fullmatch(r"[a-z][a-z_]{0,30}[0-9]{0,3}", dtype):
        raise ValueError(f"{name} is of dtype {str(dtype)[:60]!r}; give {', '.join(NUMBERS)}, ...")
    if not isinstance(shape, list) or not all(
        type(size) is int and 0 <= size <= _LARGEST for size in shape
    ):
        raise ValueError(f"{name} has the shape {str(shape)[:60]}")
    return feature


def _pattern(value: Any, default: str) -> str:
    if not isinstance(value or default, str):
        raise ValueError(f"a path is {str(value)[:60]}, no text")
    return str(value or default)


def _filled(root: Path, key: str, pattern: str, fields: Mapping[str, str | int]) -> Path:
    """Fills in a path pattern; only names with a number of digits are allowed in braces.

    Unlike `str.format`, this gives the pattern of a foreign file no access to attributes.
    """
    where = f"{root / INFO}, {key}"
    try:
        name = _PLACE.sub(lambda found: _written(fields[found[1]], found[2]), pattern)
    except KeyError as error:
        raise DataError(
            f"{where}: {pattern!r} cannot be filled in ({error!r}); it may name {', '.join(fields)}"
        ) from error
    if "{" in _PLACE.sub("", pattern) or "}" in _PLACE.sub("", pattern) or len(name) > 1000:
        raise DataError(
            f"{where}: {pattern[:200]!r} cannot be filled in; it may have {', '.join(fields)} in "
            "braces, with digits as in {file_index:03d}"
        )
    return inside(root, name, where)


def _written(value: str | int, digits: str | None) -> str:
    return str(value) if digits is None or isinstance(value, str) else f"{value:0{int(digits)}d}"
