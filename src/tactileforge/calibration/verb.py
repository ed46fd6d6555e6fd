"""``tactileforge calibrate``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from tactileforge import registry
from tactileforge.atomic import write_text
from tactileforge.calibration.calibrate import Found, Options, calibrate
from tactileforge.calibration.file import load
from tactileforge.contracts import Dataset, Recording
from tactileforge.errors import ConfigError


def main(argv: Sequence[str]) -> int:
    """Runs the verb.

    Args:
        argv: The words after ``tactileforge calibrate``.

    Returns:
        The exit code.

    Raises:
        TactileForgeError: Something is wrong; says the fix.
    """
    if argv in (["--help"], ["-h"]):
        print((files("tactileforge.conf") / "calibrate.yaml").read_text())
        return 0
    from tactileforge.compose import settings

    config = settings("calibrate", argv)
    if missing := sorted(map(str, OmegaConf.missing_keys(config))):
        raise ConfigError(f"give {' '.join(f'{key}=...' for key in missing)}")
    plain: dict[str, Any] = OmegaConf.to_container(config, resolve=True)  # type: ignore[assignment]
    out = Path(plain["out"])
    if out.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"out={out}: give the name of a file, for example digit.yaml")
    options = Options(**{one.name: plain[one.name] for one in fields(Options)})
    reference = load(plain["reference"]) if plain["reference"] else None
    dataset = registry.build("datasets", plain["data"])
    found = calibrate(_recordings(dataset), options, reference)

    from tactileforge.calibration.page import render

    found.calibration.save(out)
    write_text(out.with_suffix(".html"), render(found))
    print(_told(found))
    for line in [*found.notes, *dataset.skipped]:
        print(f"note: {line}")
    print(f"calibration: {out}\npage: {out.with_suffix('.html')}")
    return 0


def _recordings(dataset: Dataset) -> Iterator[Recording]:
    for split in ("train", "val"):
        yield from dataset.recordings(split)


def _told(found: Found) -> str:
    one = found.calibration
    lines = [f"{one.sensor} {one.unit}".strip()]
    if one.light is not None:
        lines.append(f"balance of red, green, blue: {one.light.balance}")
    if one.mm_per_pixel is not None:
        lines.append(f"mm per pixel: {one.mm_per_pixel:.4g} ({found.scale})")
    if one.force is not None:
        lines += [
            f"force {name}: error {axis.rmse:.3g} N, R2 {axis.r2:.3f}, on presses not seen"
            for name, axis in one.force.axes.items()
        ]
    return "\n".join(lines)
