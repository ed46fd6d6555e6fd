"""``tactileforge calibrate``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from tactileforge import registry, settings
from tactileforge.calibration.calibrate import CalibrateOptions, CalibrationResult, calibrate
from tactileforge.calibration.file import load_calibration
from tactileforge.contracts import Dataset, Recording
from tactileforge.errors import ConfigError
from tactileforge.files import write_text

if TYPE_CHECKING:
    from tactileforge.hub.model import Model


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
        print(settings.text("calibrate"))
        return 0
    from tactileforge.compose import plain

    config = plain("calibrate", argv)
    out = Path(config["out"])
    if out.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"out={out}: give the name of a file, for example digit.yaml")
    options = CalibrateOptions(
        **{field.name: config[field.name] for field in fields(CalibrateOptions)}
    )
    reference = load_calibration(config["reference"]) if config["reference"] else None
    dataset = registry.build("datasets", config["data"])
    model = load_model(config["model"]) if config["model"] else None
    result = calibrate(_recordings(dataset), options, reference, model)

    from tactileforge.calibration.page import calibration_page

    result.calibration.save(out)
    write_text(out.with_suffix(".html"), calibration_page(result))
    print(_told(result))
    for line in [*result.notes, *dataset.skipped]:
        print(f"note: {line}")
    print(f"calibration: {out}\npage: {out.with_suffix('.html')}")
    return 0


def load_model(name: str) -> Model:
    """The model of a name; see `tactileforge.load`."""
    import tactileforge

    return tactileforge.load(name)


def _recordings(dataset: Dataset) -> Iterator[Recording]:
    for split in ("train", "val"):
        yield from dataset.recordings(split)


def _told(result: CalibrationResult) -> str:
    calibration = result.calibration
    lines = [f"{calibration.sensor} {calibration.unit}".strip()]
    if calibration.light is not None:
        lines.append(f"balance of red, green, blue: {calibration.light.balance}")
    if calibration.mm_per_pixel is not None:
        lines.append(f"mm per pixel: {calibration.mm_per_pixel:.4g} ({result.scale})")
    if calibration.force is not None:
        lines += [
            f"force {name}: error {axis.rmse:.3g} N, R2 {axis.r2:.3f}, on presses not seen"
            + ("" if axis.before is None else f" (before: {axis.before:.3g} N)")
            for name, axis in calibration.force.axes.items()
        ]
    return "\n".join(lines)
