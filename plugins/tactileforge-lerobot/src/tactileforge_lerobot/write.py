"""Touch recordings as a LeRobot data set."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError
from tactileforge.plugins import new_part
from tactileforge_lerobot.episode import device_word, group_takes
from tactileforge_lerobot.options import LeRobotOptions, LeRobotSummary, Vectors
from tactileforge_lerobot.writer import Writer


def write_dataset(
    recordings: Iterable[Recording],
    out: Path,
    options: LeRobotOptions,
    vectors: Vectors | None = None,
) -> LeRobotSummary:
    """Writes a data set beside its final place, then renames it.

    Args:
        recordings: Recordings in any order; those of one take or episode follow one another.
        out: Folder of the data set; it must not exist.
        options: Options of the written data set.
        vectors: Source of the feature ``observation.environment_state``; None to leave it out.

    Raises:
        ConfigError: The folder exists.
        DataError: There are no recordings, or episodes differ in their features.
    """
    if out.exists():
        raise ConfigError(f"{out} exists: give another out=, or remove it")
    with new_part(out) as part:
        with Writer(part, options, vectors) as writer:
            chosen = (
                recording
                for recording in recordings
                if options.devices is None
                or {device_word(recording), recording.sensor} & set(options.devices)
            )
            for group in group_takes(chosen):
                writer.add(group)
            result = writer.finish()
        part.replace(out)
    return result
