"""Metadata of exported files: one JSON text, under the same key in both formats."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tactileforge.errors import ConfigError, DataError, DataNotFoundError, check_names
from tactileforge.plugins import install_command, load_json, strict

#: Key of the text in ``metadata_props`` of ONNX, and in ``extra_files`` of ``torch.export``.
KEY = "tactileforge"
#: Possible outputs of a graph, with type, shape and meaning.
OUTPUTS = {
    "tokens": "float32 (B, L, width): prefix tokens, then patches",
    "cls": "float32 (B, projected): what model.features gives with tap=projected",
    "vector": "float32 (B, n): what model.encode gives, of models trained here",
    "probability": "float32 (B, classes): of each of the names in classes",
    "force": (
        "float32 (B, n, 3): in the n newest frames, in force.unit: N, or relative, shares of "
        "force.scale, or uncalibrated, estimated newtons; not a number without a scale"
    ),
}
#: Axes of the forces of the object on the gel, see `contracts`.
AXES_OF_FORCE = ["x: to the right of the image", "y: down the image", "z: into the gel"]
#: Description of the input ``background``.
BACKGROUND = (
    "a frame without contact of the same recording, of the frames' size; 130 everywhere subtracts "
    "nothing"
)


@dataclass(frozen=True, kw_only=True)
class Exported:
    """An exported model, and its inputs.

    Its inputs are ``frames`` uint8 (B, T, 3, H, W), RGB, oldest first; ``background`` uint8
    (B, 3, H, W); ``sensor`` int64 (B,), see `sensor_ids`. Its outputs are those of ``outputs``. B
    is any number.

    Attributes:
        path: Path of the file.
        format: Format of the file: ``onnx`` or ``torch_export``.
        model: Name of the model; "" if it has none.
        frames: Number of frames of a clip, T.
        size: Height H and width W of frames, pixels; empty for any.
        spacing: Seconds between the frames; 0 for one frame.
        sensors: Number of each sensor; ``universal`` is for sensors unknown to the model.
        licence: SPDX identifier of the weights; "" if unknown.
        version: Version of the tactileforge that wrote the file.
        weights: Hash of the weights of encoder and force head, see `Model.fingerprint`.
        preprocessing: Preprocessing inside the graph, see `hub.files.describe_input`; frames of a
            model trained here are first ``squashed`` to a height and width.
        outputs: Type, shape and meaning of each output.
        force: ``unit``, see `Model.force`, ``axes``, and the ``scale``, newtons of a share of 1 by
            sensor, which is in the graph unless the unit is ``relative``; empty without a force
            head.
        classes: ``names`` of the classes in the order of ``probability``, the ``sensors`` of the
            pictures that its head was fitted to, and what to give as ``background``; empty without.
        background: Description of the input ``background``.
        error: Largest difference between the outputs of the float graph and those of the module.
        int8: Errors of int8 weights against the module's ``cls``: ``relative``, the length of the
            difference over the length of ``cls``, and ``cosine``, the lowest of all clips. Empty
            for float weights.
    """

    path: str
    format: str
    model: str
    frames: int
    size: list[int]
    spacing: float
    sensors: dict[str, int]
    licence: str
    version: str
    weights: str
    preprocessing: dict[str, Any]
    outputs: dict[str, str]
    force: dict[str, Any]
    classes: dict[str, Any] = field(default_factory=dict)
    background: str = BACKGROUND
    error: float
    int8: dict[str, float]

    def sensor_ids(self, sensors: Sequence[str]) -> list[int]:
        """Numbers of sensors, for the input ``sensor``, by name.

        Raises:
            ConfigError: The model does not know a sensor.
        """
        check_names(f"sensor of {self.path}:", sensors, self.sensors)
        return [self.sensors[name] for name in sensors]

    def text(self) -> str:
        """JSON text for the file, with all fields except the path."""
        content = asdict(self)
        del content["path"]
        return json.dumps(content, sort_keys=True)


def read_facts(path: str | Path) -> Exported:
    """Reads the metadata of an exported file without running it.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file was not written by `export`.
        ConfigError: ONNX is not installed; says what to install.
    """
    path = Path(path)
    if not path.is_file():
        raise DataNotFoundError(f"{path}: no such file; correct the path")
    try:
        # a file of torch.export is a zip archive, and one of ONNX is not
        text = _of_zip(path) if zipfile.is_zipfile(path) else _of_onnx(path)
        content = strict.mapping("its metadata", load_json(text))
        return strict.build(Exported, "its metadata", content | {"path": str(path)})
    except (ConfigError, ValueError) as error:
        raise DataError(f"{path}: not written by tactileforge export: {error}") from error


def need_onnx() -> None:
    """Raises a ConfigError with the install command if the ONNX packages are missing."""
    from importlib.util import find_spec

    missing = [name for name in ("onnx", "onnxscript", "onnxruntime") if find_spec(name) is None]
    if missing:
        raise ConfigError(
            f"format=onnx needs {', '.join(missing)}: "
            f"{install_command('tactileforge-export[onnx]')}"
        )


def _of_zip(path: Path) -> str:
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.endswith(f"extra/{KEY}")]
        return archive.read(names[0]).decode() if names else "{}"


def _of_onnx(path: Path) -> str:
    need_onnx()
    import onnx
    from google.protobuf.message import DecodeError

    try:
        model = onnx.load(path, load_external_data=False)
    except DecodeError as error:
        raise ValueError("neither ONNX nor torch.export") from error
    return next((entry.value for entry in model.metadata_props if entry.key == KEY), "{}")
