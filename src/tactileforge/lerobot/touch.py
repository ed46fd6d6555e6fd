"""Touch metadata that LeRobot's format has no place for: backgrounds, labels, licence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactileforge.contracts import Recording
from tactileforge.data.frames.image_codecs import encode_image
from tactileforge.data.shards.shards import describe_recording

#: What stands in columns of the tables.
_COLUMNS = ("version", "times", "force", "action", "tracks", "image_times")
#: Frames without contact that are kept.
_STILLS = 9


def describe_touch(root: Path, number: int, name: str, part: Recording) -> dict[str, Any]:
    """Describes what the tables of a recording leave out, and writes its background.

    Args:
        root: The data set.
        number: Of the episode.
        name: Of the device.
        part: The recording.
    """
    about = {key: value for key, value in describe_recording(part).items() if key not in _COLUMNS}
    return about | {
        "background": _write_stills(root, f"meta/tactileforge/{number:06d}.{name}", part),
        "shape": list(part.frames.shape),
        "tracks": {track: list(values.shape[1:]) for track, values in part.tracks.items()},
        "image": part.image is not None,
    }


def _write_stills(root: Path, prefix: str, part: Recording) -> list[str]:
    if part.no_contact is None:
        return []
    (root / prefix).parent.mkdir(exist_ok=True)
    files = []
    for i in range(min(len(part.no_contact), _STILLS)):
        files.append(f"{prefix}.{i}.png")
        (root / files[-1]).write_bytes(encode_image(part.no_contact.read([i])[0], "png"))
    return files
