"""Recordings of one unit of a sensor."""

from __future__ import annotations

from collections.abc import Iterable

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError, DataError, unknown


def recordings_of_unit(
    recordings: Iterable[Recording],
    device: str | None = None,
    unit: str | None = None,
    frames: int | None = None,
) -> list[Recording]:
    """Chooses the recordings of one unit.

    Args:
        recordings: Recordings of any sensors.
        device: Sensor, by the label ``device`` or the type; None for any.
        unit: Unit, by the label ``unit``; None for any.
        frames: Number of frames after which no more recordings are read; None for all.

    Raises:
        ConfigError: There is no such device or unit, or the recordings are of several units.
        DataError: There are no recordings.
    """
    chosen: list[Recording] = []
    others: set[str] = set()
    for recording in recordings:
        names = {recording.sensor, str(recording.labels.get("device", recording.sensor))}
        own = str(recording.labels.get("unit", ""))
        if device not in (None, *names) or unit not in (None, own):
            others |= {*names, own} - {""}
            continue
        chosen.append(recording)
        # enough: further recordings are not even opened
        if frames is not None and sum(len(each.frames) for each in chosen) >= frames:
            break
    if not chosen:
        if wanted := unit or device or "":
            raise ConfigError(unknown("device or unit", wanted, others))
        raise DataError("there are no recordings: record a series of presses first")
    units = {
        f"{item.labels.get('device', item.sensor)} {item.labels.get('unit', '')}".strip()
        for item in chosen
    }
    if len(units) > 1:
        raise ConfigError(
            f"recordings of {', '.join(sorted(units))}: a calibration belongs to a single unit; "
            "choose it with device=NAME or unit=NAME"
        )
    return chosen
