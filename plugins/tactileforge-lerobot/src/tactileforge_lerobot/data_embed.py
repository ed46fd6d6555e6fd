"""Writes a LeRobot data set with an encoder's vectors, for LeRobot's policies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tactileforge.cli import Command
from tactileforge_lerobot.data_lerobot import write
from tactileforge_lerobot.embed import EmbedOptions, TouchVectors
from tactileforge_lerobot.options import LeRobotOptions


@dataclass(frozen=True, kw_only=True)
class _Tables(LeRobotOptions):
    __doc__ = LeRobotOptions.__doc__
    images: str = "camera"


@dataclass(frozen=True, kw_only=True)
class Embed:
    """Keys of ``data embed``.

    Attributes:
        model: NAME.TAG of the zoo, file:PATH or run:FOLDER; its weights stay frozen.
        out: Folder of the data set; it must not exist.
        embed: Options of the vectors.
        device: Device of the model, for example cpu or cuda.
        threads: Number of CPU threads for the model; None for torch's choice.
        lerobot: Options of the written data set.
    """

    model: str
    out: str
    embed: EmbedOptions = field(default_factory=EmbedOptions)
    device: str = "cpu"
    threads: int | None = None
    lerobot: _Tables = field(default_factory=_Tables)


def embed(keys: Embed, config: dict[str, Any]) -> None:
    """Writes a LeRobot data set with an encoder's vectors, for LeRobot's policies.

    The vectors are the feature observation.environment_state (docs/lerobot.md#policies).
    """
    from tactileforge import load  # imports torch, which is slow: late, so that --help is fast
    from tactileforge.plugins import use_threads

    use_threads(keys.threads)
    vectors = TouchVectors(load(keys.model, device=keys.device), keys.model, keys.embed)
    written = write(keys.out, keys.lerobot, config, vectors)
    print(
        f"observation.environment_state: {written.vectors} numbers a row "
        f"({' + '.join(vectors.devices)}), {written.vectors * written.rows * 4 / 1e6:.2f} MB"
    )


COMMANDS = {"": Command(run=embed, keys=Embed, groups={"data": "???"}, into=True)}
