"""Packs runs and published files into one-file checkpoints."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tactileforge.hub import files
from tactileforge.hub.runs import read_run
from tactileforge.runs.folder import split_best
from tactileforge.util.licences import NO_LICENCE, check_licence


def pack_run(
    run: str | Path,
    out: str | Path | None = None,
    *,
    dtype: Literal["float32", "float16"] = "float32",
    name: str = "",
    licence: str = NO_LICENCE,
    encoder: Literal["trained", "slow"] | None = None,
) -> Path:
    """Makes a one-file checkpoint of a run's encoder, with the heads of use alone.

    `runs.read_run` says which encoder and which heads.

    Args:
        run: Folder of the run: its ``config.yaml`` and last checkpoint are read, or with
            ``@best`` behind it the best one.
        out: The file; None for ``model.safetensors`` in the run.
        dtype: Type in which numbers are kept.
        name: Name of the model.
        licence: SPDX identifier of the weights, or ``LicenseRef-NAME``.
        encoder: ``trained``, the encoder that the optimiser changed, or ``slow``, its slow copy;
            None takes the slow copy where the run has one. The header says which it is.

    Returns:
        The file.

    Raises:
        DataNotFoundError: The folder is not that of a run.
        DataError: Checkpoint and configuration do not fit.
        ConfigError: The licence is none; see also `files.save_checkpoint` and `runs.read_run`.
    """
    check_licence("licence", licence)
    run = Path(str(run).removeprefix("run:"))
    path = Path(out) if out is not None else split_best(run)[0] / "model.safetensors"
    built, heads, header = read_run(run, name=name, licence=licence, encoder=encoder)
    files.save_checkpoint(path, built, header, dtype, heads)
    return path
