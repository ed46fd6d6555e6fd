"""Touch recordings as annotations of TLabel (schema 2.1), a JSON file each.

Facts of the schema from https://pypi.org/project/tlabel (MIT), version 0.23.3: `contact` and
`slip_event` are required of every frame, the centroid of every contact, the normal force (N) from
level L2 on, the force vector from L3 on; a dimension that is not declared is null.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError, DataError
from tactileforge.plugins import new_part

#: Version of the package whose files have these keys, and of their schema.
_VERSION, _SCHEMA = "0.23.3", "2.1"
#: Dimensions that a sensor may declare.
_DIMENSIONS = (
    *("contact", "contact_centroid", "contact_region", "force_magnitude", "force_vector"),
    *("torque_vector", "slip_event", "slip_velocity", "manipulation_phase", "texture_class"),
    *("object_deformation", "temperature", "confidence"),
)
#: Grey levels, as a sum of three channels, up to which a pixel counts as unchanged.
_NOISE = 24


def write_tlabel(
    parts: Mapping[str, Iterable[Recording]], out: Path, contact_n: float
) -> tuple[Counter[str], list[str]]:
    """Writes a file per recording beside their final place, then renames the folder.

    Contact is the track `contact` (above .5), else a normal force above ``contact_n``; slip is the
    track `slip`; the centroid is that of the change from the background, pixels of the frame.
    Frames whose contact is not known, or has no visible place, are left out.

    Args:
        parts: Recordings of each split, ``train`` and ``val``.
        out: Folder of the files; it must not exist.
        contact_n: Normal force from which a frame is in contact, N.

    Returns:
        Numbers of written ``files`` and ``frames``, and of frames ``left out``; and one line for
        each recording that is left out.

    Raises:
        ConfigError: The folder exists.
        DataError: Not one recording has contacts to write.
    """
    if out.exists():
        raise ConfigError(f"{out} exists: give another out=, or remove it")
    counts, skipped = Counter[str](), list[str]()
    with new_part(out) as part:
        for split, recordings in parts.items():
            for recording in recordings:
                contact = _contact(recording, contact_n)
                if contact is None or recording.no_contact is None:
                    lacks = "force and no track contact" if contact is None else "background"
                    skipped.append(f"{recording.key}: left out, as it has no {lacks}")
                    continue
                frames = _frames(recording, contact)
                file = part / split / f"{counts['files']:06d}.json"
                file.parent.mkdir(parents=True, exist_ok=True)
                about = _about(recording, split, frames)
                file.write_text(json.dumps(about, ensure_ascii=False, allow_nan=False), "utf-8")
                counts["files"] += 1
                counts["frames"] += len(frames)
                counts["left out"] += len(recording.frames) - len(frames)
        if not counts["files"]:
            why = f"; {skipped[0]}" if skipped else "; look at data="
            raise DataError(f"there are no recordings to write{why}")
        part.replace(out)
    return counts, skipped


def _contact(recording: Recording, contact_n: float) -> NDArray[np.float64] | None:
    """1 for contact, 0 for none and NaN where it is not known, (T,); None without any label."""
    track = recording.tracks.get("contact")
    if track is not None and track.ndim == 1:
        known, touches = np.isfinite(track), track > 0.5
    elif recording.force is not None:
        normal = recording.force[:, 2]
        known, touches = np.isfinite(normal), normal > contact_n
    else:
        return None
    return np.where(known, touches, np.nan).astype(np.float64)


def _frames(recording: Recording, contact: NDArray[np.float64]) -> list[dict[str, Any]]:
    assert recording.no_contact is not None
    still = recording.no_contact.read([0])[0].astype(np.int16)
    slip = recording.tracks.get("slip")
    out = []
    for row in np.flatnonzero(np.isfinite(contact)).tolist():
        touches = bool(contact[row])
        place = None
        if touches:
            frame = recording.frames.read([row])[0]
            if (place := _centroid(np.abs(frame - still).sum(-1))) is None:
                continue
        out.append(
            {
                "frame_idx": row,
                "timestamp_s": float(recording.times[row]),
                "schema_v2": {
                    **dict.fromkeys(_DIMENSIONS),
                    **_force(recording, row),
                    "contact": touches,
                    "contact_centroid": place,
                    "slip_event": slip is not None and bool(slip[row] > 0.5),
                    "confidence": 1.0,
                },
                "manipulation_phase": None,
                "confidence": 1.0,
            }
        )
    for frame, end in zip(out[:1] + out[-1:], ("is_first", "is_last"), strict=False):
        frame[end] = True
    return out


def _force(recording: Recording, row: int) -> dict[str, Any]:
    """The force of a frame, N, and its level."""
    force = [np.nan] * 3 if recording.force is None else recording.force[row].tolist()
    if not np.isfinite(force[2]):
        return {"compliance_level": "L1"}
    if not np.isfinite(force).all():
        return {"force_magnitude": force[2], "compliance_level": "L2"}
    return {"force_magnitude": force[2], "force_vector": force, "compliance_level": "L3"}


def _centroid(change: NDArray[np.int16]) -> list[float] | None:
    """Place of a change, right and down, pixels; None where nothing changed."""
    weights = np.where(change > _NOISE, change, 0).astype(np.float64)
    total = float(weights.sum())
    if not total:
        return None
    rows, columns = weights.sum(1), weights.sum(0)
    return [
        float(columns @ np.arange(len(columns))) / total,
        float(rows @ np.arange(len(rows))) / total,
    ]


def _about(recording: Recording, split: str, frames: list[dict[str, Any]]) -> dict[str, Any]:
    height, width = recording.frames.shape
    told = {
        name
        for frame in frames
        for name, value in frame["schema_v2"].items()
        if value is not None and name in _DIMENSIONS
    }
    if "slip" not in recording.tracks:
        told.discard("slip_event")
    return {
        "schema_version": _VERSION,
        "format": "tlabel_schema_v2",
        "schema_version_v2": _SCHEMA,
        "sensor": {"type": recording.sensor, "resolution": f"{width}x{height}"},
        "episode": {
            "id": recording.key,
            "split": split,
            "task": recording.text,
            "object": recording.object,
            "licence": recording.licence or None,
            "num_frames": len(frames),
        },
        "capabilities": {name: name == "contact" or name in told for name in _DIMENSIONS},
        "frames": frames,
    }
