"""Statements of a user about a data set, beside its map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from tactileforge.reading import OptionalKeys


@dataclass(frozen=True)
class Statements:
    """Statements of a user about a data set, beside its map.

    Attributes:
        fps: Rows per second; None for what the map or the file says.
        sensors: Type of the sensor for names in the files; ``any`` stands for every name.
        span: Change of taxels that is drawn as full colour; None for that of the map.
        draw: Which numbers are touch, ``none``, ``grids`` or ``all``; None for what the map says.
        background: ``first`` or ``none``; None for what the map says.
        large: Names of large tracks that are read too.
        channels: Order of the channels; None for what the map says.
        licence: Licence of the recordings; "" for that of the map.
        signs: Sign of z of each entry of touch whose force has the sign ``mean``.
        optional: Is told which files have the optional keys of the map.
    """

    fps: float | None = None
    sensors: Mapping[str, str] = field(default_factory=dict)
    span: float | None = None
    draw: str | None = None
    background: str | None = None
    large: tuple[str, ...] = ()
    channels: Literal["rgb", "bgr"] | None = None
    licence: str = ""
    signs: Mapping[int, float] = field(default_factory=dict)
    optional: OptionalKeys = field(default_factory=OptionalKeys)
