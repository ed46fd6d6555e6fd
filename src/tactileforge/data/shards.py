"""Shards: plain tar files of recordings, that any tool can read (`docs/shards.md`).

A recording is ``KEY.json`` (all but the pictures), ``KEY.background.0000.jpg`` and on,
``KEY.image.0000.jpg`` and on, and ``KEY.0000.jpg`` and on. Pictures are read where they lie.
"""

from __future__ import annotations

import io
import json
import math
import tarfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data.encoded import Blob, EncodedFrames
from tactileforge.errors import ConfigError, DataError, unknown

#: Version of the layout; a reader refuses what is newer.
VERSION = 1

#: Codecs by the ending of their files, and how OpenCV is told of them.
CODECS: dict[str, list[int]] = {
    "jpg": [cv2.IMWRITE_JPEG_QUALITY, 95],
    "png": [cv2.IMWRITE_PNG_COMPRESSION, 3],
    "webp": [cv2.IMWRITE_WEBP_QUALITY, 101],  # above 100: lossless
}


@dataclass(frozen=True)
class Packed:
    """A recording whose pictures are encoded.

    Attributes:
        head: All else, as plain data.
        codec: One of `CODECS`.
        frames: Encoded frames.
        background: Encoded frames without contact; [] where there are none.
        image: Encoded camera views; [] where there are none.
    """

    head: dict[str, Any]
    codec: str
    frames: Sequence[bytes]
    background: Sequence[bytes]
    image: Sequence[bytes]


def encode(picture: NDArray[np.uint8], codec: str = "jpg", quality: int | None = None) -> bytes:
    """Encodes a picture, uint8 (H, W, 3), RGB.

    Args:
        picture: The picture.
        codec: ``jpg``, or without loss ``png`` or ``webp``.
        quality: Of JPEG, 1 to 100; 95 if not given.

    Raises:
        ConfigError: An unknown codec, or a quality that is none.
    """
    if codec not in CODECS:
        raise ConfigError(unknown("codec", codec, CODECS))
    options = CODECS[codec]
    if quality is not None:
        if codec != "jpg" or not 1 <= quality <= 100:
            raise ConfigError(f"quality={quality}: only jpg has one, from 1 to 100")
        options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    done, out = cv2.imencode(f".{codec}", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise DataError(f"a picture of {picture.shape} could not be encoded as {codec}")
    return out.tobytes()


def head(recording: Recording) -> dict[str, Any]:
    """All of a recording but its pictures, as plain data."""
    force = None
    if recording.force is not None:
        rows = recording.force.astype(float).tolist()
        force = [None if any(map(math.isnan, row)) else row for row in rows]
    return {
        "version": VERSION,
        "key": recording.key,
        "sensor": recording.sensor,
        "times": recording.times.tolist(),
        "force": force,
        "action": None if recording.action is None else recording.action.tolist(),
        "object": recording.object,
        "text": recording.text,
        "labels": dict(recording.labels),
        "source": recording.source,
        "tier": recording.tier,
        "licence": recording.licence,
    }


def write(path: Path, recordings: Iterable[Packed]) -> None:
    """Writes a shard: beside its place, then renamed. The same content gives the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    with tarfile.open(part, "w", format=tarfile.USTAR_FORMAT) as tar:
        for number, packed in enumerate(recordings):
            _add(tar, f"{number:06d}", packed)
    part.replace(path)


def _add(tar: tarfile.TarFile, stem: str, packed: Packed) -> None:
    def member(name: str, content: bytes) -> None:
        info = tarfile.TarInfo(f"{stem}.{name}")
        info.size = len(content)
        tar.addfile(info, io.BytesIO(content))

    member("json", json.dumps(packed.head).encode())
    for group, pictures in (
        ("background.", packed.background),
        ("image.", packed.image),
        ("", packed.frames),
    ):
        for number, picture in enumerate(pictures):
            member(f"{group}{number:04d}.{packed.codec}", picture)


def read(path: Path) -> Iterator[Recording]:
    """The recordings of a shard; no picture is decoded.

    Raises:
        DataError: The file is no shard, is cut off, or is of a newer version; names it.
    """
    heads: dict[str, Any] = {}
    pictures: dict[str, dict[str, list[Blob]]] = {}
    try:
        with tarfile.open(path, "r:") as tar:
            for member in tar:
                stem, _, rest = member.name.partition(".")
                if rest == "json":
                    held = tar.extractfile(member)
                    heads[stem] = json.loads(held.read()) if held else None
                    continue
                group = rest.split(".")[0] if rest.count(".") == 2 else "frames"
                blob = Blob(str(path), member.offset_data, member.size)
                pictures.setdefault(stem, {}).setdefault(group, []).append(blob)
    except (tarfile.TarError, OSError, json.JSONDecodeError) as error:
        raise DataError(f"{path}: not a whole shard ({error}); write it again") from error
    for stem, about in heads.items():
        yield _recording(path, about, pictures.get(stem, {}))


def _recording(path: Path, about: Any, pictures: dict[str, list[Blob]]) -> Recording:
    where = f"{path}:{about.get('key', '?') if isinstance(about, dict) else '?'}"
    try:
        if about["version"] > VERSION:
            raise DataError(
                f"{where}: shard version {about['version']}, but this tactileforge reads up to "
                f"{VERSION}; update it"
            )
        frames, times = pictures.get("frames", []), np.array(about["times"], np.float64)
        if len(frames) != len(times):
            raise DataError(
                f"{where}: {len(frames)} frames and {len(times)} times; write the shard again"
            )
        force, action = about["force"], about["action"]
        none = [math.nan] * 3
        lazy = {
            group: EncodedFrames(f"{where} {group}", blobs) for group, blobs in pictures.items()
        }
        return Recording(
            key=about["key"],
            sensor=about["sensor"],
            frames=lazy["frames"],
            times=times,
            no_contact=lazy.get("background"),
            force=None
            if force is None
            else np.array([row or none for row in force], np.float32).reshape(-1, 3),
            action=None if action is None else np.array(action, np.int64),
            object=about["object"],
            text=about["text"],
            image=lazy.get("image"),
            labels=about["labels"],
            source=about["source"],
            tier=about["tier"],
            licence=about["licence"],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{where}: its description is damaged ({error!r})") from error
