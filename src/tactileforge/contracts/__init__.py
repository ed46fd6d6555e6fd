"""Contracts of sensors, data sets, encoders, heads and objectives, for plugin authors.

A plugin is a class. Its constructor parameters are explicit, their defaults are plain data (they
become the plugin's configuration), its construction does no I/O, and the module imports no vendor
SDK at top level. Parameters named in `CONTEXT` are not configuration: the framework passes them in.

Data flows one way::

    sensor or data set -> Recording -> batch (uint8) -> encoder -> views -> heads -> objectives ->
    loss

Axes. ``x`` points to the right of the image, ``y`` down the image, ``z`` into the gel. Forces are
those of the object on the gel, in newton: pressing is positive ``z``, an object that drags the gel
to the right of the image is positive ``x``.

A batch is a plain dict:

| key | type and shape | meaning |
|---|---|---|
| `frames` | uint8 (B, T, 3, H, W) | RGB, oldest first |
| `background` | uint8 (B, 3, H, W) | no-contact frame of the same recording |
| `sensor` | list of B names | the encoder maps names to its own rows |
| `force` | float32 (B, T, 3), `force_valid` bool (B, 3) | newton; which axes are labelled |
| `force_scale` | float32 (B, 3) | divisor of forces, newton, from the `SensorSpec` |
| `action` | int64 (B,) | index into `ACTIONS`; -1 unknown |
| `object` | int64 (B,) | identity across sensors; -1 unknown |
| `text` | list of B strings | "" where there is none |
| `image` | uint8 (B, 3, h, w), `image_valid` bool (B,) | paired camera image |
| `surface` | uint8 (B, T, 3, 32, 32), `surface_valid` bool (B,) | see `data.labels.displacement` |
| `group` | int64 (B,) | samples with one non-negative group were drawn together for matching |
| `aspect` | float32 (B,) | width over height of the frames as recorded, before they are resized |
| `upright` | bool (B,) | True where a mirrored or turned clip would be wrong, see `Recording` |

A sample without a label stays out of that objective's loss, and changes nothing in it.

Heads and objectives may declare extra columns (`Column`), which are cut from tracks of the
recordings:

| key | type and shape | meaning |
|---|---|---|
| NAME | float32 or int64 (B, steps, ...) | the track at the clip's frames, or in a window |
| NAME `_valid` | bool (B, steps) | False without the track, at NaN, outside of the recording |

A data set with a ``cut`` of its own may add further keys, listed in its `provides`, and
``tokens``, float16 (B, touches of a sample, L, width), of a frozen encoder in place of frames
(`Remembering`).
"""

from tactileforge.contracts.data import (
    ACTIONS,
    AXES,
    LABELS,
    NEUTRAL_BACKGROUND,
    Column,
    ColumnSize,
    Dataset,
    Frames,
    FrameSubset,
    Guess,
    Recording,
)
from tactileforge.contracts.sensors import (
    Frame,
    Lamp,
    MarkerPattern,
    Sensor,
    SensorSpec,
    Simulation,
)
from tactileforge.contracts.training import (
    BATCH_KEYS,
    CONTEXT,
    AfterStep,
    Batch,
    Encoder,
    Features,
    Head,
    MaskedFeatures,
    Objective,
    OptimizerPlugin,
    Prepared,
    Ramped,
    Remembering,
    Scored,
    TrainingClips,
    Views,
)

__all__ = [
    "ACTIONS",
    "AXES",
    "BATCH_KEYS",
    "CONTEXT",
    "LABELS",
    "NEUTRAL_BACKGROUND",
    "AfterStep",
    "Batch",
    "Column",
    "ColumnSize",
    "Dataset",
    "Encoder",
    "Features",
    "Frame",
    "FrameSubset",
    "Frames",
    "Guess",
    "Head",
    "Lamp",
    "MarkerPattern",
    "MaskedFeatures",
    "Objective",
    "OptimizerPlugin",
    "Prepared",
    "Ramped",
    "Recording",
    "Remembering",
    "Scored",
    "Sensor",
    "SensorSpec",
    "Simulation",
    "TrainingClips",
    "Views",
]
