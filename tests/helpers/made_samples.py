"""Small tars of samples, as other programs write them with webdataset."""

import io
import json
import tarfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.image_codecs import encode_image

#: Height and width of the pictures.
SHAPE = (32, 24)


def picture(level: int, shape: tuple[int, int] = SHAPE) -> NDArray[np.uint8]:
    """A picture of one grey level, with a red mark at the left of its upper side."""
    out = np.full((*shape, 3), level, np.uint8)
    out[: shape[0] // 4, : shape[1] // 4] = (250, 20, 20)
    return out


def part(name: str, value: Any) -> bytes:
    """Content of a part, by its ending."""
    kind = name.rpartition(".")[2]
    if isinstance(value, bytes):
        return value
    if kind in ("jpg", "png", "webp"):
        return encode_image(value, kind)
    if kind == "json":
        return json.dumps(value).encode()
    if kind == "npy":
        out = io.BytesIO()
        np.save(out, value)
        return out.getvalue()
    return str(value).encode()


def write_tar(path: Path, samples: Iterable[tuple[str, Mapping[str, Any]]]) -> Path:
    """Writes samples, each a key and its parts by ending."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tarfile.open(path, "w") as tar:
        for key, parts in samples:
            for name, value in parts.items():
                add(tar, f"{key}.{name}", part(name, value))
    return path


def add(tar: tarfile.TarFile, name: str, content: bytes) -> None:
    """Adds a member to an open tar."""
    info = tarfile.TarInfo(name)
    info.size = len(content)
    tar.addfile(info, io.BytesIO(content))


def video(path: Path, levels: Iterable[int], fps: float = 20) -> bytes:
    """An mp4 of pictures of grey levels."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, SHAPE[::-1])
    for level in levels:
        writer.write(np.full((*SHAPE, 3), level, np.uint8))
    writer.release()
    return path.read_bytes()


def frame_samples(tar: int, clips: int = 4, frames: int = 12) -> list[tuple[str, dict[str, Any]]]:
    """Samples with a frame of a clip each, ``mug/ep03_007``, with force and time."""
    return [
        (
            f"{('mug', 'pen')[clip % 2]}/ep{tar * clips + clip:02d}_{frame:03d}",
            {
                "jpg": picture(10 * frame + 40),
                "json": {"force": [0.1, -0.2, frame / 2], "t": 40 * frame, "note": "x"},
            },
        )
        for clip in range(clips)
        for frame in range(frames)
    ]


#: Layout of `frame_samples`.
FRAMES = {
    "touch": "jpg",
    "sensor": "digit",
    "background": {"first": 2},
    "samples": "{object}/{clip}_{frame}",
    "times": {"values": "json:t", "unit": "ms"},
    "force": {"values": "json:force"},
    "object": "{object}",
    "text": "touching a {object}",
    "licence": "CC0-1.0",
}


def made_set(root: Path, tars: int = 3, **given: int) -> Path:
    """A folder of tars of `frame_samples`."""
    for number in range(tars):
        write_tar(root / f"part-{number:03d}.tar", frame_samples(number, **given))
    return root
