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
    unknown,
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
    from tactileforge.data.batches.clips import Clips, resize_frame, view_of
    from tactileforge.data.batches.columns import CutColumns, take_steps
    from tactileforge.distributed import masked_mean, rand_rows
    from tactileforge.encoders.backbone import Backbone, patches_at
    from tactileforge.encoders.preprocess import ANYTOUCH2
    from tactileforge.encoders.transformer import AttentivePooler, Transformer
    from tactileforge.heads.ema import EMA
    from tactileforge.means import Mean

__all__ = [
    "ACTIONS",
    "ANYTOUCH2",
    "CHECKSUMS",
    "EMA",
    "NEUTRAL_BACKGROUND",
    "SPECS",
    "VERSION",
    "AfterStep",
    "ArrayFrames",
    "Arrival",
    "AttentivePooler",
    "Backbone",
    "Batch",
    "Camera",
    "Capture",
    "Clips",
    "Column",
    "ColumnSize",
    "Command",
    "ConfigError",
    "CutColumns",
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
    "Transformer",
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
    "rand_rows",
    "resize_frame",
    "spec",
    "take_steps",
    "to_json",
    "unknown",
    "v4l2",
    "view_of",
]


#: Module of what needs torch, and is imported on first use: the module of a sensor costs none.
_HEAVY = {
    "ANYTOUCH2": "encoders.preprocess",
    "AttentivePooler": "encoders.transformer",
    "Backbone": "encoders.backbone",
    "Clips": "data.batches.clips",
    "CutColumns": "data.batches.columns",
    "EMA": "heads.ema",
    "Mean": "means",
    "Transformer": "encoders.transformer",
    "masked_mean": "distributed",
    "patches_at": "encoders.backbone",
    "rand_rows": "distributed",
    "resize_frame": "data.batches.clips",
    "take_steps": "data.batches.columns",
    "view_of": "data.batches.clips",
}


def __getattr__(name: str) -> Any:
    if name not in _HEAVY:
        raise AttributeError(f"module 'tactileforge.plugin' has no attribute {name!r}")
    return getattr(import_module(f"tactileforge.{_HEAVY[name]}"), name)
