"""The published optical sensors, as data.

Sizes, rates and areas are those of the frames in public data sets, None where nothing is published.
Force scales of ``digit``, ``gelsight_mini`` and ``duragel`` are those of ToucHD's benchmark
(AnyTouch 2, its ``max_abs``); for the others none is published, and they take the Mini's.

More of a sensor, by the same name, where it applies: its gel, to simulate it
(`sim.mechanics.sensor_gels.DEVICES`), its light (`sim.optics.sensor_instances.STYLES`), its markers
(`sim.optics.markers.GRIDS`), and its row in published weights
(`encoders.tactile_vit.PUBLISHED_SENSORS`).
"""

from __future__ import annotations

from tactileforge import registry
from tactileforge.contracts import SensorSpec
from tactileforge.errors import ConfigError, unknown

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
        ),
        SensorSpec(
            name="digit",
            height=320,
            width=240,
            fps=30.0,
            area_mm=(16.3, 12.3),
            force_scale=(5.25, 10.61, 14.14),
        ),
        SensorSpec(
            name="gelslim",
            height=320,
            width=427,
            fps=90.0,
            area_mm=None,
            force_scale=_MINI_FORCE,
        ),
        SensorSpec(
            name="gelsight_mini",
            height=240,
            width=320,
            fps=18.0,
            area_mm=(15.2, 20.3),
            force_scale=_MINI_FORCE,
            dome=True,
        ),
        SensorSpec(
            name="duragel",
            height=240,
            width=320,
            fps=30.0,
            area_mm=None,
            force_scale=(3.92, 3.64, 7.89),
            markers=True,
        ),
        SensorSpec(
            name="dm",
            height=288,
            width=384,
            fps=30.0,
            area_mm=None,
            force_scale=_MINI_FORCE,
            markers=True,
        ),
    )
}


def spec(name: str) -> SensorSpec:
    """The spec of a sensor type: a published one, or that of an installed sensor plugin.

    Raises:
        ConfigError: Nothing is known by that name; lists what is.
    """
    if name in SPECS:
        return SPECS[name]
    if name in registry.names("sensors"):
        known = getattr(registry.get("sensors", name), "spec", None)
        if isinstance(known, SensorSpec):
            return known
    raise ConfigError(
        unknown(
            "sensor",
            name,
            {*SPECS, *registry.names("sensors")},
            "Correct the name, or install the sensor's plugin.",
        )
    )
