"""Contracts of sensors: a type with its simulation, a frame, a driver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import (
    TYPE_CHECKING,
    Literal,
    Protocol,
    Self,
    runtime_checkable,
)

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class Lamp:
    """A light at the side of the gel.

    Attributes:
        azimuth: Direction, rad, clockwise from the right of the image.
        elevation: Angle of its light to the gel at rest, rad.
        colour: Grey levels added to R, G, B of a surface facing it.
        fall: Loss of light from its edge of the image to the centre, as a share.
        shadow: Loss of light in its shadow, as a share.

    Example:
        >>> red = Lamp(azimuth=0.0, elevation=0.5, colour=(90.0, 0.0, 0.0))
        >>> red.fall, red.shadow
        (0.3, 0.3)
    """

    azimuth: float
    elevation: float
    colour: tuple[float, float, float]
    fall: float = 0.3
    shadow: float = 0.3


@dataclass(frozen=True)
class MarkerPattern:
    """Printed markers: rows and columns of dots, or dots anywhere (speckle).

    Attributes:
        columns: Number of dots from left to right.
        rows: Number of dots from top to bottom.
        pitch: Distance between dots, right and down, mm.
        radius: Radius of the dots, mm.
        jitter: Standard deviation of the positions of dots, mm.

    Example:
        >>> dots = MarkerPattern(columns=9, rows=7, pitch=(1.8, 1.8), radius=0.3)
        >>> dots.columns * dots.rows
        63
    """

    columns: int
    rows: int
    pitch: tuple[float, float]
    radius: float
    jitter: float = 0.02


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """Simulation of a type of sensor; without lamps or calibration, its gel is dark.

    Attributes:
        dome: Radius of curvature of the gel at rest, mm; None for a flat gel.
        thickness: Thickness of the gel, mm.
        modulus: Young's modulus of the gel, MPa.
        friction: Smallest and largest coefficient of friction between gel and objects.
        calibrations: Names of shipped optical calibrations; a unit has one of them.
        lamps: Lights of a type without calibration.
        base: Ambient light of a type without calibration, R, G, B in grey levels.
        dim: Loss of light towards the border, as a share, see
            `depth.lighting.lamp_calibration`.
        height_mm: Height of the field of view, mm; None takes it from the sensing area.
        level: Mean R, G, B of a background, for cameras with automatic colours; None leaves them
            to the lights.
        clouds: Unevenness of the light, grey levels.
        wear: Mean number of scratches, and of specks of dust.
        pattern: Printed markers of its marker gel; None without such a gel.
        markers: Whether units have the marker gel by default.

    Example:
        >>> gel = Simulation(thickness=3.0, lamps=(Lamp(0.0, 0.5, (90.0, 0.0, 0.0)),))
        >>> gel.dome is None, len(gel.lamps)
        (True, 1)
    """

    dome: float | None = None
    thickness: float = 4.0
    modulus: float = 0.435
    friction: tuple[float, float] = (0.5, 1.2)
    calibrations: tuple[str, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    base: tuple[float, float, float] = (0.0, 0.0, 0.0)
    dim: float = 0.0
    height_mm: float | None = None
    level: tuple[float, float, float] | None = None
    clouds: float = 2.0
    wear: tuple[float, float] = (3.0, 6.0)
    pattern: MarkerPattern | None = None
    markers: bool = False


@dataclass(frozen=True, kw_only=True)
class SensorSpec:
    """A type of sensor, as data. A live driver, a data set and an encoder refer to it by name.

    Attributes:
        name: Name that users type.
        height: Rows of a frame as the sensor gives it; 0 for a wrench or robot.
        width: Columns of a frame; 0 for a wrench or robot.
        fps: Frames, or samples, received per second.
        area_mm: Height and width of the sensing area, mm; None where it is not public.
        force_scale: Divisor of forces along x, y and z, newton.
        markers: Whether the gel carries markers.
        dome: Whether the gel is domed (else flat).
        kind: Content of a `Frame`: ``image`` pixels of a camera; ``array`` taxels, drawn as pixels,
            and their values; ``wrench`` forces and torques alone; ``robot`` its state and command.
        states: Number of values of a robot's state, the first in `Frame.raw`.
        actions: Number of values of a robot's command, after its state.
        simulation: Parameters of the simulation, see `Simulation`; None without
            one.
    """

    name: str
    height: int
    width: int
    fps: float
    area_mm: tuple[float, float] | None
    force_scale: tuple[float, float, float]
    markers: bool = False
    dome: bool = False
    kind: Literal["image", "array", "wrench", "robot"] = "image"
    states: int = 0
    actions: int = 0
    simulation: Simulation | None = None


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One frame of a live sensor; its content depends on `SensorSpec.kind`.

    Attributes:
        array: uint8 (H, W, 3), RGB. For an ``array`` sensor its taxels, drawn by its layout: red,
            green and blue are x, y and z, and 128 is the value without contact (`sensors.taxels`).
            Empty, (0, 0, 3), for a ``wrench`` or ``robot``.
        time: Time of capture, monotonic seconds (``time.monotonic()``).
        raw: float32, the values as the sensor gave them: for a ``wrench`` sensor (6,), forces x, y,
            z in N and torques x, y, z in N m; for an ``array`` sensor (taxels, values of each); for
            a ``robot`` (states + actions,), its state and the command that follows it; None for an
            ``image`` sensor.

    Example:
        >>> import numpy as np
        >>> frame = Frame(array=np.zeros((240, 320, 3), np.uint8), time=12.5)
        >>> frame.array.shape, frame.raw is None
        ((240, 320, 3), True)
    """

    array: NDArray[np.uint8]
    time: float
    raw: NDArray[np.float32] | None = None


@runtime_checkable
class Sensor(Protocol):
    """A live sensor: a camera, taxel array, wrench sensor or robot, as its ``spec.kind`` says.

    A sensor is a context manager, and closes on an exception. It needs no thread of its own:
    recorders and viewers read it in a thread of theirs, and open it again after a `SensorError`.
    `open` must therefore work after `close`. A sensor that is zeroed in `open` also has ``reopen``,
    which is then called in its place and keeps the zero.

    A class that inherits from this one is opened and closed by ``with`` without further code.

    A sensor may have an ``address``, a string with the open device, for example ``/dev/video2``;
    "" while none is open. Two open sensors must not have the same address. It may also have a
    ``unit``, the serial number of the open device, which does not depend on the port.

    Example:
        >>> import numpy as np
        >>> from tactileforge.specs import spec
        >>> class Still(Sensor):
        ...     spec = spec("digit")
        ...     def discover(self):
        ...         return ["still"]
        ...     def open(self):
        ...         pass
        ...     def read(self, timeout=1.0):
        ...         return Frame(array=np.full((320, 240, 3), 110, np.uint8), time=0.0)
        ...     def close(self):
        ...         pass
        >>> with Still() as sensor:
        ...     sensor.read().array.shape
        (320, 240, 3)
    """

    spec: SensorSpec

    def discover(self) -> list[str]:
        """Addresses of the attached devices; [] without any."""
        ...

    def open(self) -> None:
        """Claims the device.

        Raises:
            SensorError: The device is absent, busy, or not the one asked for.
            ConfigError: An option is missing or wrong.
        """
        ...

    def read(self, timeout: float = 1.0) -> Frame:
        """Returns the next unread frame.

        Raises:
            TactileForgeError: The sensor is not open.
            SensorError: The device is gone; it may be opened again.
            TimeoutError: No new frame came within ``timeout`` seconds.
            EOFError: A finite source has ended.
        """
        ...

    def close(self) -> None:
        """Releases the device; a second call does nothing."""
        ...

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
