"""The public door for authors of plugins: everything that a package may import.

    from tactileforge.plugin import Frame, Sensor, SensorError, SensorSpec

These names, those of `tactileforge` itself and of `tactileforge.testing` stay where they are. Every
other module is private, and may change with any release. `VERSION` counts the changes that authors
have to follow; the changelog has a line for each.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tactileforge.cli._command import Command
from tactileforge.contracts import (
    ACTIONS,
    NEUTRAL_BACKGROUND,
    AfterStep,
    Batch,
    Column,
    ColumnSize,
    Dataset,
    Encoder,
    Features,
    Frame,
    Frames,
    FrameSubset,
    Head,
    MaskedFeatures,
    Objective,
    OptimizerPlugin,
    Prepared,
    Recording,
    Remembering,
    Scored,
    Sensor,
    SensorSpec,
    TrainingClips,
    Views,
)
from tactileforge.data.frames.lazy import ArrayFrames, ImageFrames, VideoFrames
from tactileforge.data.labels.actions import label_actions
from tactileforge.data.labels.align import estimate_lag, nearest
from tactileforge.errors import (
    ConfigError,
    DataError,
    DataNotFoundError,
    PluginError,
    SensorError,
    TactileForgeError,
)
from tactileforge.live.publish import to_json
from tactileforge.moves import VERSION
from tactileforge.registry import build, names
from tactileforge.sensors.capture import Capture
from tactileforge.sensors.checksums import CHECKSUMS
from tactileforge.sensors.continuity import Arrival
from tactileforge.sensors.drivers import v4l2
from tactileforge.sensors.drivers.camera import Camera
from tactileforge.sensors.drivers.force_torque import ForceTorque
from tactileforge.sensors.drivers.replay import Replay
from tactileforge.sensors.drivers.serial_array import SerialArray
from tactileforge.sensors.drivers.serial_robot import SerialRobot
from tactileforge.sensors.framing import Parser
from tactileforge.sensors.links import Link, SerialLink
from tactileforge.sensors.opening import close_sensor, open_sensor
from tactileforge.sensors.simulation import Lamp, MarkerPattern, Simulation
from tactileforge.sensors.specs import SPECS, spec
from tactileforge.sensors.taxels import TaxelLayout

if TYPE_CHECKING:
    from tactileforge.distributed import masked_mean
    from tactileforge.encoders.backbone import Backbone, patches_at
    from tactileforge.encoders.preprocess import ANYTOUCH2
    from tactileforge.means import Mean

__all__ = [
    "ACTIONS",
    "ANYTOUCH2",
    "CHECKSUMS",
    "NEUTRAL_BACKGROUND",
    "SPECS",
    "VERSION",
    "AfterStep",
    "ArrayFrames",
    "Arrival",
    "Backbone",
    "Batch",
    "Camera",
    "Capture",
    "Column",
    "ColumnSize",
    "Command",
    "ConfigError",
    "DataError",
    "DataNotFoundError",
    "Dataset",
    "Encoder",
    "Features",
    "ForceTorque",
    "Frame",
    "FrameSubset",
    "Frames",
    "Head",
    "ImageFrames",
    "Lamp",
    "Link",
    "MarkerPattern",
    "MaskedFeatures",
    "Mean",
    "Objective",
    "OptimizerPlugin",
    "Parser",
    "PluginError",
    "Prepared",
    "Recording",
    "Remembering",
    "Replay",
    "Scored",
    "Sensor",
    "SensorError",
    "SensorSpec",
    "SerialArray",
    "SerialLink",
    "SerialRobot",
    "Simulation",
    "TactileForgeError",
    "TaxelLayout",
    "TrainingClips",
    "VideoFrames",
    "Views",
    "build",
    "close_sensor",
    "estimate_lag",
    "label_actions",
    "masked_mean",
    "names",
    "nearest",
    "open_sensor",
    "patches_at",
    "spec",
    "to_json",
    "v4l2",
]


#: Module of what needs torch, and is imported on first use: the module of a sensor costs none.
_HEAVY = {
    "ANYTOUCH2": "encoders.preprocess",
    "Backbone": "encoders.backbone",
    "Mean": "means",
    "masked_mean": "distributed",
    "patches_at": "encoders.backbone",
}


def __getattr__(name: str) -> Any:
    if name not in _HEAVY:
        raise AttributeError(f"module 'tactileforge.plugin' has no attribute {name!r}")
    return getattr(import_module(f"tactileforge.{_HEAVY[name]}"), name)
