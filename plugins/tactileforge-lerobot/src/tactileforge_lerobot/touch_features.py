"""Options of a data set to read, checked before anything is opened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from tactileforge.errors import ConfigError, unknown
from tactileforge.reading import ForceKeys, StreamKeys, check_stream
from tactileforge_lerobot.drawn import Drawing

_BACKGROUNDS = ("first", "none")


@dataclass(frozen=True)
class TouchFeature:
    """A touch feature, its sensor and its force.

    Attributes:
        images: Name of the feature, ``/i`` behind it for one part of its first axis.
        sensor: Type of the sensor.
        force: Name of its force feature, "" where there is none.
        columns: Indices of the columns x, y and z of the force feature.
    """

    images: str
    sensor: str
    force: str = ""
    columns: Sequence[int] = (0, 1, 2)

    @property
    def device(self) -> str:
        """Name of the device in keys and labels."""
        name = self.images.removeprefix("observation.images.").removeprefix("observation.")
        return name.replace("/", "_")


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options shared by all touch features.

    Attributes:
        background: ``first`` where episodes begin without contact, or ``none``.
        drawing: How numbers become pictures.
        stream: How pictures lie.
        force: Unit and signs of the forces.
        tare: Number of first rows whose median force is subtracted; 0 for none.
        tare_most: Largest force along z in those rows, in units of the feature; None for any.
        tracks: Numeric features kept as tracks.
        missing: Numbers stored in place of an unknown value.
        objects: Whether a data set is one recording of one object, cut into episodes.
    """

    background: str = "first"
    drawing: Drawing = field(default_factory=Drawing)
    stream: StreamKeys = field(default_factory=StreamKeys)
    force: ForceKeys = field(default_factory=ForceKeys)
    tare: int = 0
    tare_most: float | None = None
    tracks: Sequence[str] = ()
    missing: Sequence[float] = ()
    objects: bool = False

    def __post_init__(self) -> None:
        if self.background not in _BACKGROUNDS:
            raise ConfigError(unknown("data.background", self.background, _BACKGROUNDS))
        check_stream(self.stream, "data")
        sign = self.force.sign
        if len(sign) != 3 or 0 in sign or any(isinstance(one, str) for one in sign[:2]):
            raise ConfigError(f"data.force_sign={list(sign)}: give three factors, none 0")
        if isinstance(sign[2], str) and sign[2] != "mean":
            raise ConfigError(f"data.force_sign={list(sign)}: z is a factor, or mean")
        self.force.newtons([""] * 3, "data", "force_unit")
        if self.tare < 0:
            raise ConfigError(f"data.force_tare={self.tare}: give a number of rows, 0 for none")
        if self.tare_most is not None and (self.tare == 0 or self.tare_most <= 0):
            raise ConfigError(
                f"data.force_tare_most={self.tare_most:g}: give a force above 0, and "
                "data.force_tare"
            )


def check_columns(columns: Sequence[int], features: int) -> None:
    """Checks the columns of forces.

    Args:
        columns: Indices of x, y and z, for all touch features or for each.
        features: Number of touch features.

    Raises:
        ConfigError: They are not three, nor three for each feature, or one is negative.
    """
    if len(columns) not in (3, 3 * features) or not columns or min(columns) < 0:
        raise ConfigError(
            f"data.force_columns={list(columns)}: give x, y and z, for all or for each"
        )
