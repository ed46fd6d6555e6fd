"""Touch sensors of tactileforge as cameras of LeRobot, of type ``tactileforge``."""

from lerobot_camera_tactileforge.camera_tactileforge import TactileForgeCamera
from lerobot_camera_tactileforge.config_tactileforge import TactileForgeCameraConfig

__all__ = ["TactileForgeCamera", "TactileForgeCameraConfig"]
