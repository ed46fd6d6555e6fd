"""Finds light, scale and force of one sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactileforge.cli import Command
from tactileforge.contracts import Dataset, Recording
from tactileforge.errors import ConfigError
from tactileforge.plugins import registry, write_text
from tactileforge.sensors import load_calibration
from tactileforge_live.calibrate.calibrate import CalibrateOptions, CalibrationResult, calibrate
from tactileforge_live.calibrate.depth_options import DepthOptions
from tactileforge_live.calibrate.scale import SCALED

if TYPE_CHECKING:
    from tactileforge.hub import Model


@dataclass(frozen=True, kw_only=True)
class _Calibrate(CalibrateOptions):
    """A calibration of one unit.

    Attributes:
        out: The calibration, FILE.yaml; its page is beside it.
        model: A model with a force head, NAME.TAG, file:PATH or run:FOLDER, whose forces are fitted
            to this unit.
        reference: Calibration of another unit, to whose colours this one is balanced.
    """

    out: str
    model: str | None = None
    reference: str | None = None


def _calibrate(keys: _Calibrate, config: dict[str, Any]) -> None:
    """Finds light, scale and force of one unit; a page shows how well forces fit."""
    out = Path(keys.out)
    if out.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"out={out}: give the name of a file, for example digit.yaml")
    reference = load_calibration(keys.reference) if keys.reference else None
    dataset = registry.build("datasets", config["data"], "data")
    model = load_model(keys.model) if keys.model else None
    result = calibrate(_recordings(dataset), keys, reference, model)

    from tactileforge_live.calibrate.page import calibration_page

    result.calibration.save(out)
    write_text(out.with_suffix(".html"), calibration_page(result))
    print(_told(result))
    for line in [*result.notes, *dataset.skipped]:
        print(f"note: {line}")
    print(f"calibration: {out}\npage: {out.with_suffix('.html')}")


def load_model(name: str) -> Model:
    """Loads a model by name; see `tactileforge.load`."""
    import tactileforge

    return tactileforge.load(name)


def _recordings(dataset: Dataset) -> Iterator[Recording]:
    for split in ("train", "val"):
        yield from dataset.recordings(split)


def _told(result: CalibrationResult) -> str:
    calibration = result.calibration
    lines = [calibration.title]
    if calibration.light is not None:
        lines.append(f"balance of red, green, blue: {calibration.light.balance}")
    if calibration.mm_per_pixel is not None:
        lines.append(f"mm per pixel: {calibration.mm_per_pixel:.4g} ({result.scale})")
    if calibration.force is not None:
        for name, axis in calibration.force.axes.items():
            rest = sorted(
                (other, error) for other, error in axis.errors.items() if other != axis.chosen
            )
            others = ", ".join(f"{other}: {error:.3g} N" for other, error in rest)
            if axis.chosen == SCALED:
                # judged by forces that are hardly there, so R2 says nothing
                lines.append(f"force {name}: error {axis.rmse:.3g} N, {axis.chosen} ({others})")
                continue
            lines.append(
                f"force {name}: error {axis.rmse:.3g} N, R2 {axis.r2:.3f}, on blocks not seen; "
                f"fitted to {axis.chosen} ({others})"
            )
    return "\n".join(lines)


@dataclass(frozen=True, kw_only=True)
class _Depth(DepthOptions):
    """An optical calibration of one unit.

    Attributes:
        out: The calibration, FILE.json, for ``depth=``; its page is beside it.
    """

    out: str


def _depth(keys: _Depth, config: dict[str, Any]) -> None:
    """Fits the optics of one unit to presses of a ball; a page shows how well depths fit."""
    out = Path(keys.out)
    if out.suffix != ".json":
        raise ConfigError(f"out={out}: give the name of a file, for example digit.json")
    dataset = registry.build("datasets", config["data"])

    from tactileforge_live.calibrate.depth import calibrate_depth
    from tactileforge_live.calibrate.depth_page import depth_page, depth_table

    result = calibrate_depth(_recordings(dataset), keys)
    result.save(out)
    write_text(out.with_suffix(".html"), depth_page(result))
    for name, correlation, error, deepest in depth_table(result):
        fits = f"correlation {correlation}, error {error} mm, " if error else ""
        print(f"{name}: {fits}deepest place {deepest} mm")
    for line in [*result.notes, *dataset.skipped]:
        print(f"note: {line}")
    print(f"calibration: {out}\npage: {out.with_suffix('.html')}")


_DATA = {"data": "???"}
COMMANDS = {
    "": Command(run=_calibrate, keys=_Calibrate, groups=_DATA),
    "depth": Command(run=_depth, keys=_Depth, groups=_DATA),
}
