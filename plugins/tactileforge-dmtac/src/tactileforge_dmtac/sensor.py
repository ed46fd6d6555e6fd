"""DM-Tac as the camera that it is: its pictures, without the software of its maker."""

from __future__ import annotations

from collections.abc import Sequence

from tactileforge.plugin import SPECS, Camera

#: What its camera has in its name.
NAME = "N160MU2"


class DmTac(Camera):
    """A DM-Tac W, whose pictures are shown as its camera gives them.

    Its modes, crop and orientation are not public, so nothing is asked for and nothing is cut off
    unless told.

    Args:
        serial: Serial number on USB; "" takes the one that is attached.
        device: Path of the camera, or of a video file in its place; "" finds it by its name.
        width: Columns to ask for; None for what it gives.
        height: Rows to ask for.
        fps: Frames a second to ask for.
        crop: Left, top, width and height of the gel, in pixels; None for all.
        rotation: Degrees to turn it counter-clockwise then: 0, 90, 180 or 270.
        resize: Height and width at last; None to leave it.
        warmup: Frames to throw away when it is opened.
    """

    spec = SPECS["dm"]

    def __init__(
        self,
        serial: str = "",
        device: str = "",
        width: int | None = None,
        height: int | None = None,
        fps: float | None = None,
        crop: Sequence[int] | None = None,
        rotation: int = 0,
        resize: Sequence[int] | None = None,
        warmup: int = 10,
    ) -> None:
        super().__init__(
            device=device or (f"serial:{serial}" if serial else f"name:{NAME}"),
            type="dm",
            width=width,
            height=height,
            fps=fps,
            crop=crop,
            rotation=rotation,
            resize=resize,
            warmup=warmup,
        )
