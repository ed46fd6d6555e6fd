"""A gel in front of a USB camera, by the driver of the framework."""

from __future__ import annotations

from tactileforge.plugin import Camera, SensorSpec


class GelCamera(Camera):
    """A gel of our own on any camera or video.

    Args:
        device: Number or path of the camera, or a video.
        fps: Frames a second to ask for.
    """

    spec = SensorSpec(
        name="gel_camera",
        height=48,
        width=64,
        fps=30.0,
        area_mm=(15.0, 20.0),
        force_scale=(3.0, 3.0, 12.0),
    )

    def __init__(self, device: str = "0", fps: float = 30.0) -> None:
        super().__init__(type="gel_camera", device=device, fps=fps)
