"""The public interface for authors of plugins: all names for import by other packages.

    from tactileforge.plugin import Frame, Sensor, SensorError, SensorSpec

These names, those of `tactileforge` itself and of `tactileforge.testing` keep their places. Every
other module is private, and may change with any release. `VERSION` counts the changes that authors
have to follow; the changelog has a line for each.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tactileforge.plugins.command import Command
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
    Guess,
    Head,
    Lamp,
    MarkerPattern,
    MaskedFeatures,
    Objective,
    OptimizerPlugin,
    Prepared,
    Recording,
    Remembering,
    Scored,
    Sensor,
    SensorSpec,
    Simulation,
    TrainingClips,
    Views,
)
from tactileforge.data.frames.companions import without_companions
from tactileforge.data.frames.cut import held_clips
from tactileforge.data.frames.encoded import Blob, EncodedFrames, LazyImages
from tactileforge.data.frames.image_codecs import encode_image
from tactileforge.data.frames.lazy import ArrayFrames, ImageFrames, VideoFrames
from tactileforge.data.frames.pictures import upright_size
from tactileforge.data.labels.actions import label_actions
from tactileforge.data.labels.align import estimate_lag, nearest
from tactileforge.data.labels.clock import check_rising
from tactileforge.data.labels.missing import stated
from tactileforge.data.labels.newtons import NEWTONS, named_unit, newtons_of
from tactileforge.data.shards.shards import describe_recording, read_shard, write_shard
from tactileforge.errors import (
    ConfigError,
    DataError,
    DataNotFoundError,
    PluginError,
    SensorError,
    TactileForgeError,
    check_names,
    home_path,
    unknown,
)
from tactileforge.pages.json_text import to_json
from tactileforge.pages.local_page import LocalPage, PageAnswer
from tactileforge.pages.pictures import difference_image, page_jpeg
from tactileforge.plugins.moves import VERSION
from tactileforge.plugins.registry import build, names
from tactileforge.reading.notes import add_once
from tactileforge.reading.official import OfficialSplit
from tactileforge.reading.pickles import load_pickled_array
from tactileforge.reading.published import (
    PublishedDataset,
    RecordingItem,
    still_background,
)
from tactileforge.reading.splits import is_held_out
from tactileforge.reading.tables import read_cells
from tactileforge.sensors.capture import Capture
from tactileforge.sensors.checksums import CHECKSUMS
from tactileforge.sensors.continuity import Arrival, changes_by_at_most
from tactileforge.sensors.drivers import v4l2
from tactileforge.sensors.drivers.camera import Camera
from tactileforge.sensors.drivers.force_torque import ForceTorque
from tactileforge.sensors.drivers.replay import Replay
from tactileforge.sensors.drivers.serial_robot import SerialRobot
from tactileforge.sensors.framing import Framing, PacketParser, Parser, hex_bytes, payload_size
from tactileforge.sensors.links import Link, SerialLink, attached_ports
from tactileforge.sensors.opening import close_sensor, open_sensor
from tactileforge.sensors.stream import StreamSensor
from tactileforge.sensors.streaming.buffer import warn_of_slow_frames
from tactileforge.sensors.streaming.contact import ContactDetector, ContactOptions
from tactileforge.sensors.taxels import TaxelLayout
from tactileforge.specs.published import SPECS, spec
from tactileforge.util import strict
from tactileforge.util.files import cache_folder, new_part, write_text
from tactileforge.util.licences import check_data_licence
from tactileforge.util.locks import locked
from tactileforge.util.untrusted import load_json, load_yaml, open_picture

if TYPE_CHECKING:
    from tactileforge.data.batches.clips import Clips, resize_frame, view_of
    from tactileforge.data.batches.columns import CutColumns, take_steps
    from tactileforge.encoders.backbone import Backbone, patches_at
    from tactileforge.encoders.preprocess import ANYTOUCH2
    from tactileforge.encoders.transformer import AttentivePooler, Transformer
    from tactileforge.heads.ema import EMA
    from tactileforge.hub.model import Model
    from tactileforge.reading.figure import plot_recording
    from tactileforge.util.distributed import masked_mean, rand_rows
    from tactileforge.util.means import Mean

__all__ = [
    "ACTIONS",
    "ANYTOUCH2",
    "CHECKSUMS",
    "EMA",
    "NEUTRAL_BACKGROUND",
    "NEWTONS",
    "SPECS",
    "VERSION",
    "AfterStep",
    "ArrayFrames",
    "Arrival",
    "AttentivePooler",
    "Backbone",
    "Batch",
    "Blob",
    "Camera",
    "Capture",
    "Clips",
    "Column",
    "ColumnSize",
    "Command",
    "ConfigError",
    "ContactDetector",
    "ContactOptions",
    "CutColumns",
    "DataError",
    "DataNotFoundError",
    "Dataset",
    "EncodedFrames",
    "Encoder",
    "Features",
    "ForceTorque",
    "Frame",
    "FrameSubset",
    "Frames",
    "Framing",
    "Guess",
    "Head",
    "ImageFrames",
    "Lamp",
    "LazyImages",
    "Link",
    "LocalPage",
    "MarkerPattern",
    "MaskedFeatures",
    "Mean",
    "Model",
    "Objective",
    "OfficialSplit",
    "OptimizerPlugin",
    "PacketParser",
    "PageAnswer",
    "Parser",
    "PluginError",
    "Prepared",
    "PublishedDataset",
    "Recording",
    "RecordingItem",
    "Remembering",
    "Replay",
    "Scored",
    "Sensor",
    "SensorError",
    "SensorSpec",
    "SerialLink",
    "SerialRobot",
    "Simulation",
    "StreamSensor",
    "TactileForgeError",
    "TaxelLayout",
    "TrainingClips",
    "Transformer",
    "VideoFrames",
    "Views",
    "add_once",
    "attached_ports",
    "build",
    "cache_folder",
    "changes_by_at_most",
    "check_data_licence",
    "check_names",
    "check_rising",
    "close_sensor",
    "describe_recording",
    "difference_image",
    "encode_image",
    "estimate_lag",
    "held_clips",
    "hex_bytes",
    "home_path",
    "is_held_out",
    "label_actions",
    "load_json",
    "load_pickled_array",
    "load_yaml",
    "locked",
    "masked_mean",
    "named_unit",
    "names",
    "nearest",
    "new_part",
    "newtons_of",
    "open_picture",
    "open_sensor",
    "page_jpeg",
    "patches_at",
    "payload_size",
    "plot_recording",
    "rand_rows",
    "read_cells",
    "read_shard",
    "resize_frame",
    "spec",
    "stated",
    "still_background",
    "strict",
    "take_steps",
    "to_json",
    "unknown",
    "upright_size",
    "v4l2",
    "view_of",
    "warn_of_slow_frames",
    "without_companions",
    "write_shard",
    "write_text",
]


#: Names that need torch or matplotlib, imported on first use: sensor modules need neither.
_HEAVY = {
    "ANYTOUCH2": "encoders.preprocess",
    "AttentivePooler": "encoders.transformer",
    "Backbone": "encoders.backbone",
    "Clips": "data.batches.clips",
    "CutColumns": "data.batches.columns",
    "EMA": "heads.ema",
    "Mean": "util.means",
    "Model": "hub.model",
    "Transformer": "encoders.transformer",
    "masked_mean": "util.distributed",
    "patches_at": "encoders.backbone",
    "plot_recording": "reading.figure",
    "rand_rows": "util.distributed",
    "resize_frame": "data.batches.clips",
    "take_steps": "data.batches.columns",
    "view_of": "data.batches.clips",
}


def __getattr__(name: str) -> Any:
    if name not in _HEAVY:
        raise AttributeError(f"module 'tactileforge.plugin' has no attribute {name!r}")
    return getattr(import_module(f"tactileforge.{_HEAVY[name]}"), name)
