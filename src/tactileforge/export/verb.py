"""``tactileforge export``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omegaconf import ListConfig

from tactileforge import settings

_SUFFIXES = {"onnx": ".onnx", "torch_export": ".pt2"}


def main(argv: Sequence[str]) -> int:
    """Runs the verb.

    Args:
        argv: The words after ``tactileforge export``.

    Returns:
        The exit code.

    Raises:
        TactileForgeError: See `write.export`.
    """
    if argv in (["--help"], ["-h"]):
        print(settings.text("export"))
        return 0
    config = settings.load("export", argv)
    from tactileforge.export.write import export

    model = str(config.model)
    stem = Path(model.removeprefix("file:")).stem if model.startswith("file:") else model
    size = [*config.size] if isinstance(config.size, ListConfig) else [config.size]
    done = export(
        model,
        config.out or f"{stem}{_SUFFIXES.get(config.format, '')}",
        format=config.format,
        size=None if size == [None] else size,
        int8=config.int8,
        tolerance=config.tolerance,
    )
    megabytes = Path(done.path).stat().st_size / 1e6
    print(f"{done.path}: {megabytes:.1f} MB, differs from the module by {done.error:.2g} at most")
    if done.int8:
        print(
            f"int8: cls differs by {done.int8['relative']:.2%} of its length, cosine at least "
            f"{done.int8['cosine']:.5f}"
        )
    return 0
