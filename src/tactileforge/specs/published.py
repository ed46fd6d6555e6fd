"""The published optical sensors, as data.

Sizes, rates and areas are those of the frames in public data sets; None for unpublished ones.
Force scales of ``digit``, ``gelsight_mini`` and ``duragel`` are those of ToucHD's benchmark
(AnyTouch 2, its ``max_abs``); for the others none is published, and they take the Mini's.

`simulation.PUBLISHED` has their simulations, and `encoders.tactile_vit.PUBLISHED_SENSORS` their
rows in published weights.
"""

from __future__ import annotations

from inspect import signature

from tactileforge.contracts import SensorSpec, Simulation
from tactileforge.errors import ConfigError, PluginError, unknown
from tactileforge.plugins import local, registry
from tactileforge.specs.simulated import PUBLISHED

#: Largest force of a GelSight Mini in ToucHD's benchmark, N (AnyTouch 2, its ``max_abs``).
_MINI_FORCE = (6.84, 9.87, 8.52)

SPECS: dict[str, SensorSpec] = {
    spec.name: spec
    for spec in (
        SensorSpec(
            name="gelsight",
            height=480,
            width=640,
            fps=30.0,
            area_mm=(14.2, 18.9),
            force_scale=_MINI_FORCE,
            simulation=PUBLISHED["gelsight"],
        ),
        SensorSpec(
            name="digit",
            height=320,
            width=240,
            fps=30.0,
            area_mm=(16.3, 12.3),
            force_scale=(5.25, 10.61, 14.14),
            simulation=PUBLISHED["digit"],
        ),
        SensorSpec(
            name="gelslim",
            height=320,
            width=427,
            fps=90.0,
            area_mm=None,
            force_scale=_MINI_FORCE,
            simulation=PUBLISHED["gelslim"],
        ),
        SensorSpec(
            name="gelsight_mini",
            height=240,
            width=320,
            fps=18.0,
            area_mm=(15.2, 20.3),
            force_scale=_MINI_FORCE,
            dome=True,
            simulation=PUBLISHED["gelsight_mini"],
        ),
        SensorSpec(
            name="duragel",
            height=240,
            width=320,
            fps=30.0,
            area_mm=None,
            force_scale=(3.92, 3.64, 7.89),
            markers=True,
            simulation=PUBLISHED["duragel"],
        ),
        SensorSpec(
            name="dm",
            height=288,
            width=384,
            fps=30.0,
            area_mm=None,
            force_scale=_MINI_FORCE,
            markers=True,
            simulation=PUBLISHED["dm"],
        ),
    )
}


def spec(name: str, *also: str) -> SensorSpec:
    """Spec of a sensor type: published, of an installed plugin, or of a typed class.

    Args:
        name: Name of the type.
        also: Further types of the caller, listed in the message.

    Raises:
        ConfigError: Unknown name; the message lists the known ones.

    Example:
        >>> spec("digit").height, spec("digit").fps
        (320, 30.0)
    """
    if name in SPECS:
        return SPECS[name]
    if name in registry.names("sensors"):
        known = getattr(registry.get("sensors", name), "spec", None)
        if isinstance(known, SensorSpec):
            return known
    for own in local.given():  # typed as my_module:Finger
        known = getattr(own, "spec", None)
        if isinstance(known, SensorSpec) and known.name == name:
            return known
    fix = (
        "Correct the name, install the sensor's plugin, or describe yours: "
        "tactileforge plugins new sensor NAME"
    )
    types = filter(is_type, registry.names("sensors"))
    raise ConfigError(unknown("sensor", name, {*SPECS, *types, *also}, fix))


def is_type(name: str) -> bool:
    """Whether a plugin is a type of sensor, not a way to open one of any type, as ``replay`` is."""
    try:
        plugin = registry.get("sensors", name)
        known = getattr(plugin, "spec", None)
        is_seen = isinstance(known, SensorSpec) and known.kind in ("image", "array")
        return is_seen and "type" not in signature(plugin).parameters
    except PluginError:  # a broken package is no concern of this name
        return False


def simulation(name: str) -> Simulation:
    """Simulation of a sensor type.

    Raises:
        ConfigError: Unknown name, or a spec without simulation.
    """
    try:
        known = spec(name).simulation
    except ConfigError:
        known = None
    if known is None:
        also = "A sensor plugin can be simulated where its SensorSpec has a simulation."
        raise ConfigError(unknown("simulated sensor", name, SIMULATED, also))
    return known


#: Sensors of this package with a simulation.
SIMULATED = tuple(name for name, known in SPECS.items() if known.simulation)


def pixel_spacing(sensor: str, height: int) -> float:
    """Width of a pixel, mm, in an image of ``height`` rows of the sensor's type."""
    shown = simulation(sensor).height_mm or (spec(sensor).area_mm or (0.0,))[0]
    if not shown:
        raise ConfigError(
            f"{sensor}: give area_mm in its SensorSpec, or height_mm in its simulation"
        )
    return shown / height
