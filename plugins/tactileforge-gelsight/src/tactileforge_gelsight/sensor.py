"""GelSight Mini: a camera on USB with one large mode, of which the middle is shown."""

from __future__ import annotations

from dataclasses import replace

from tactileforge.plugin import SPECS, Camera, ConfigError, v4l2

#: What every Mini's name begins with. Its USB id is that of other cameras as well.
NAME = "GelSight Mini"
#: The one mode that it has: width, height, and frames a second that it promises.
WIDTH, HEIGHT, PROMISED = 3280, 2464, 25.0
#: Share of height and width to cut off at each side, and height and width of a frame then.
BORDER, SHAPE = 1 / 7, (240, 320)


class GelSightMini(Camera):
    """A GelSight Mini with a gel without markers.

    The frames of the camera are cut to the part that shows the gel, and made 240 x 320 pixels. The
    camera promises 25 frames a second; on Linux about 18 come. The rate that comes is measured when
    it is opened, on frames that are thrown away: the first ones are black.

    Args:
        unit: Number on the unit, for example ``2BKR-9FKA``; "" takes the one that is attached.
        device: Path of the camera, or of a video file in its place; "" finds it by its name.
        width: Columns of the camera.
        height: Rows of the camera.
        border: Share of height and width to cut off at each side.
        warmup: Frames to throw away when it is opened.

    Raises:
        ConfigError: Too few frames to throw away.
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
        """Its serial number; else the last word of its name, the number on the unit."""
        return camera.serial or camera.name.removeprefix(NAME).split(":")[0].strip().split(" ")[-1]

    def open(self) -> None:
        """Claims the camera, and measures its rate.

        Raises:
            SensorError: See `Camera.open`; or no frames come.
        """
        super().open()
        if not self.address:
            return  # a file keeps the rate that it says
        try:
            times = [self.read(2.0).time for _ in range(self.frames)]
        except BaseException:
            self.close()
            raise
        half = len(times) // 2  # the first ones may come at once
        self.spec = replace(self.spec, fps=half / (times[-1] - times[-1 - half]))


class GelSightMiniMarkers(GelSightMini):
    """A GelSight Mini with a gel with markers; its options are those of `GelSightMini`."""

    spec = replace(SPECS["gelsight_mini"], name="gelsight_mini_markers", markers=True)
