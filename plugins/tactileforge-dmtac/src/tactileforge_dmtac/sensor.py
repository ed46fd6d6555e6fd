"""DM-Tac as a plain camera, without the software of its maker."""

from __future__ import annotations

from collections.abc import Sequence

from tactileforge.sensors import Camera
from tactileforge.specs import SPECS

#: Part of the name of its camera.
NAME = "N160MU2"


class DmTac(Camera):
    """A DM-Tac W, with the pictures of its camera unchanged.

    Its modes, crop and orientation are not public. By default no mode is requested, and the
    pictures are neither cut nor turned.

    Args:
        serial: Serial number on USB; "" takes the only attached one.
        device: Path of the camera, or of a video file in its place; "" finds it by its name.
        width: Columns to request from the camera; None for its default.
        height: Rows to request from the camera; None for its default.
        fps: Frames a second to request from the camera; None for its default.
        crop: Left, top, width and height of the gel, in pixels; None for the whole picture.
        rotation: Counter-clockwise rotation after the crop, degrees: 0, 90, 180 or 270.
        resize: Height and width of the final picture; None to keep its size.
        warmup: Frames to throw away at opening.
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
