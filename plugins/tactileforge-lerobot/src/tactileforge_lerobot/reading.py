"""Options of a data set to read, checked before anything is opened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from tactileforge.errors import ConfigError, unknown
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
class Reading:
    """Options shared by all touch features.

    Attributes:
        background: ``first`` where episodes begin without contact, or ``none``.
        drawing: How numbers become pictures.
        sign: Factors of the forces along x, y and z.
        zero_rows: Number of first rows whose median force is subtracted; 0 for none.
        zero_most: Largest force along z in those rows, in units of the feature; None for any.
        turn_z: Whether z is turned so that its mean over a data set is positive.
        tracks: Numeric features kept as tracks.
        missing: Numbers stored in place of an unknown value.
        objects: Whether a data set is one recording of one object, cut into episodes.
    """

    background: str = "first"
    drawing: Drawing = field(default_factory=Drawing)
    sign: Sequence[float] = (1.0, 1.0, 1.0)
    zero_rows: int = 0
    zero_most: float | None = None
    turn_z: bool = False
    tracks: Sequence[str] = ()
    missing: Sequence[float] = ()
    objects: bool = False

    def __post_init__(self) -> None:
        if self.background not in _BACKGROUNDS:
            raise ConfigError(unknown("data.background", self.background, _BACKGROUNDS))
        if len(self.sign) != 3 or 0 in self.sign:
            raise ConfigError(f"data.force_sign={list(self.sign)}: give three factors, none 0")
        if self.zero_rows < 0:
            raise ConfigError(f"data.zero_rows={self.zero_rows}: give a number of rows, 0 for none")
        if self.zero_most is not None and (self.zero_rows == 0 or self.zero_most <= 0):
            raise ConfigError(
                f"data.zero_most={self.zero_most:g}: give a force above 0, and data.zero_rows"
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
