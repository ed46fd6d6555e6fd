"""GelSight Mini: a camera on USB with one large mode, cut to its middle."""

from __future__ import annotations

from dataclasses import replace

from tactileforge.errors import ConfigError
from tactileforge.sensors import Camera, v4l2
from tactileforge.specs import SPECS

#: Beginning of the name of every Mini. Its USB id is not unique: other cameras share it.
NAME = "GelSight Mini"
#: The only mode of the camera: width, height and its promised frames a second.
WIDTH, HEIGHT, PROMISED = 3280, 2464, 25.0
#: Share of height and width to cut off at each side; height and width of the resized frame.
BORDER, SHAPE = 1 / 7, (240, 320)


class GelSightMini(Camera):
    """A GelSight Mini with a gel without markers.

    The frames of the camera are cut to the part that shows the gel, and resized to 240 x 320
    pixels. The camera promises 25 frames a second; on Linux about 18 come. The true rate is
    measured at opening, on frames that are thrown away, as the first ones are black.

    Args:
        unit: Number on the unit, for example ``2BKR-9FKA``; "" takes the only attached one.
        device: Path of the camera, or of a video file in its place; "" finds it by its name.
        width: Columns of the camera.
        height: Rows of the camera.
        border: Share of height and width to cut off at each side.
        warmup: Frames to throw away at opening, 2 or more.

    Raises:
        ConfigError: ``warmup`` is below 2.
    """

    spec = SPECS["gelsight_mini"]

    def __init__(
        self,
        unit: str = "",
        device: str = "",
        width: int = WIDTH,
        height: int = HEIGHT,
        border: float = BORDER,
        warmup: int = 20,
    ) -> None:
        if warmup < 2:
            raise ConfigError(f"warmup={warmup}: give 2 or more; the rate is measured on them")
        super().__init__(
            device=device or f"name:{unit or NAME}",
            type=self.spec.name,
            width=width,
            height=height,
            fourcc="MJPG",
            border=border,
            resize=SHAPE,
        )
        self.frames = warmup

    def number(self, camera: v4l2.VideoDevice) -> str:
        """Serial number of a camera; else the last word of its name, the number on the unit."""
        return camera.serial or camera.name.removeprefix(NAME).split(":")[0].strip().split(" ")[-1]

    def open(self) -> None:
        """Claims the camera, and measures its rate.

        Raises:
            SensorError: The camera cannot be opened (see `Camera.open`), or no frames come.
        """
        super().open()
        if not self.address:
            return  # a video file keeps its stated rate
        try:
            times = [self.read(2.0).time for _ in range(self.frames)]
        except BaseException:
            self.close()
            raise
        half = len(times) // 2  # buffered frames may come at once at first: measure the second half
        self.spec = replace(self.spec, fps=half / (times[-1] - times[-1 - half]))


class GelSightMiniMarkers(GelSightMini):
    """A GelSight Mini with a gel with markers, and the options of `GelSightMini`."""

    spec = replace(SPECS["gelsight_mini"], name="gelsight_mini_markers", markers=True)
