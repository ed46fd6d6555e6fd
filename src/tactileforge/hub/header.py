"""The header of a one-file checkpoint, read and checked without torch.

The file is safetensors: eight bytes with the length of a JSON text, that text, then the numbers.
Its ``__metadata__`` has one key, ``tactileforge``, which holds `Header` as JSON. One key, because
the order of several would differ from one writing to the next, and so would the hash of the file.
Beside the fields of `Header` there is ``sha256``: of the whole file, with zeros in its own place.
"""

from __future__ import annotations

import hashlib
import json
import math
import zipfile
import zlib
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, TypeGuard

from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.plugins import local
from tactileforge.runs.folder import CONFIG
from tactileforge.util import strict
from tactileforge.util.pointers import check_pointer
from tactileforge.util.untrusted import load_json

#: Version of the format that this package writes and reads.
FORMAT = 1
#: Longest JSON text that is read, in bytes: names and shapes of a million tensors are less.
_LONGEST = 64 << 20
#: Longest header of ours in it.
_LONGEST_OWN = 1 << 20
_KEY = "tactileforge"
#: Rows of a table of sensors.
_ROWS = 1 << 16
#: Types of numbers in safetensors files, and the bytes of one.
_BYTES = {
    **dict.fromkeys(("BOOL", "U8", "I8", "F8_E5M2", "F8_E4M3"), 1),
    **dict.fromkeys(("F16", "BF16", "I16", "U16"), 2),
    **dict.fromkeys(("F32", "I32", "U32"), 4),
    **dict.fromkeys(("F64", "I64", "U64"), 8),
}
#: The checksum before it is known, and what stands before it in the file (JSON within JSON).
_UNKNOWN, _BEFORE = "0" * 64, b'\\"sha256\\": \\"'


@dataclass(frozen=True, kw_only=True)
class Header:
    """Metadata of a one-file checkpoint, as plain data.

    Attributes:
        format: Version of the format.
        name: Name of the model; "" if it has none.
        encoder: Plugin and constructor arguments: ``{"name": ..., ...}``.
        package: Distribution that provides the plugin.
        package_version: Version of that distribution when the file was written.
        versions: Versions of the packages that trained or imported the weights.
        sensors: Row of each sensor in the encoder's table.
        input: Form of the input: frames, height and width, mean and standard deviation.
        spacing: Seconds between the frames of a clip; 0 for one frame.
        dtype: Type in which the numbers are kept.
        licence: SPDX identifier.
        commit: Commit of the source that wrote the file; "" if unknown.
        data: Training data: name of the data set, and the licences of its recordings.
        recipe: The resolved recipe; empty for imported weights.
        source: Steps of the run, or the published file and its sha256.
        heads: Heads that are kept with the encoder, by name: plugin and constructor arguments
            (``node``), the newton that count as 1 for each sensor (``scale``), names of the classes
            (``names``), and of an aligned head its text tower (``text_encoder``), or the size of
            the vectors and the name of one outside of the file (``text_width``, ``text_name``).
    """

    format: int
    name: str
    encoder: dict[str, Any]
    package: str
    package_version: str
    sensors: dict[str, int]
    input: dict[str, Any]
    spacing: float
    dtype: str
    licence: str
    commit: str = ""
    versions: dict[str, str] = field(default_factory=dict)
    data: dict[str, Any] = field(default_factory=dict)
    recipe: dict[str, Any] = field(default_factory=dict)
    source: dict[str, Any] = field(default_factory=dict)
    heads: dict[str, Any] = field(default_factory=dict)

    @property
    def titles_of_heads(self) -> list[str]:
        """Names of the heads, sorted; with the class of those of somebody's own."""
        return [
            f"{key} ({name})" if local.is_local(name := entry["node"]["name"]) else key
            for key, entry in sorted(self.heads.items())
        ]

    def metadata(self, has_place: bool = False) -> dict[str, str]:
        """The metadata of the safetensors file.

        Args:
            has_place: Whether there is a place for the checksum, for `seal_checkpoint`.

        Raises:
            ConfigError: The metadata is not plain data, or is longer than a reader accepts.
        """
        content = asdict(self) | ({"sha256": _UNKNOWN} if has_place else {})
        if not self.heads:  # so files without heads are what they always were
            del content["heads"]
        try:
            # sorted: one header, one text. NaN is not JSON, and other readers would refuse it
            text = json.dumps(content, sort_keys=True, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ConfigError(f"the header of a checkpoint is plain data: {error}") from error
        if len(text.encode()) > _LONGEST_OWN:
            raise ConfigError(f"the header of a checkpoint has at most {_LONGEST_OWN} bytes")
        return {_KEY: text}


def seal_checkpoint(path: Path) -> None:
    """Writes the checksum of a file into its header; see `Header.metadata`."""
    digest = hashlib.sha256()
    with path.open("rb+") as file:
        text = file.read(8 + int.from_bytes(file.read(8), "little"))
        file.seek(0)
        place = 8 + text.index(_BEFORE + _UNKNOWN.encode()) + len(_BEFORE)
        while chunk := file.read(1 << 20):
            digest.update(chunk)
        file.seek(place)
        file.write(digest.hexdigest().encode())


def _check_sum(path: Path, text: bytes, stated: Any) -> None:
    whole = _BEFORE + str(stated).encode()
    # the place of the checksum is known by what stands in it: it must be there once
    if len(str(stated)) != len(_UNKNOWN) or text.count(whole) != 1:
        raise ConfigError("its checksum is invalid: bytes of it have changed")
    digest = hashlib.sha256()
    with path.open("rb") as file:
        # as it was hashed: with zeros in the place of the checksum
        digest.update(file.read(8) + text.replace(whole, _BEFORE + _UNKNOWN.encode()))
        file.seek(len(text), 1)
        while chunk := file.read(1 << 20):
            digest.update(chunk)
    if digest.hexdigest() != stated:
        raise ConfigError("its checksum does not match: bytes of it have changed; fetch it again")


def read_header(path: str | Path) -> Header:
    """Reads the header of a one-file checkpoint; a checksum, if there is one, must be right.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is truncated, damaged, something else, or not one of ours; says which.
    """
    path = Path(path)
    if path.is_dir():
        from tactileforge.hub.cards import say_folder

        raise DataNotFoundError(say_folder(path))
    if not path.is_file():
        raise DataNotFoundError(f"{path}: no such file; correct the path")
    check_pointer(path)
    with path.open("rb") as file:
        text = _json_text(path, file)
    try:
        table = strict.mapping("its table of tensors", load_json(text))
        content = strict.mapping("__metadata__", table.pop("__metadata__", {})).get(_KEY)
        _check_table(path, 8 + len(text), table)
        if not isinstance(content, str):
            raise ConfigError(
                "safetensors, but not written by tactileforge; for published weights: "
                "tactileforge zoo get NAME --from FILE; for a state_dict of a model of yours: "
                "model.load_state_dict(safetensors.torch.load_file(FILE)), then model.save(FILE)"
            )
        if len(content) > _LONGEST_OWN:
            raise ConfigError(
                f"its header has {len(content)} characters, at most {_LONGEST_OWN} go"
            )
        plain = strict.mapping("the header", load_json(content))
        stated = plain.pop("sha256", None)
        header = _parse(plain)
        # last: it reads the whole file
        if stated is not None:
            _check_sum(path, text, stated)
        return header
    except (ConfigError, ValueError, RecursionError) as error:
        raise DataError(f"{path}: not a checkpoint that can be read: {error}") from error


def _parse(content: Any) -> Header:
    version = strict.mapping("the header", content).get("format")
    if version != FORMAT:
        raise ConfigError(f"format {version!r}; this tactileforge reads {FORMAT}: upgrade it")
    header = strict.build(Header, "the header", content)
    if not isinstance(header.encoder.get("name"), str):
        raise ConfigError("the header: encoder has no name")
    if not 0 <= header.spacing < math.inf:
        raise ConfigError(f"the header: spacing is {header.spacing}, not seconds between frames")
    if not all(0 <= row < _ROWS for row in header.sensors.values()):
        raise ConfigError("the header: sensors have rows, whole numbers from 0 on")
    temperature = header.source.get("temperature", 1.0)
    if not _is_positive(temperature):
        raise ConfigError(f"the header: source.temperature is {temperature!r}, not above 0")
    for key, head in header.heads.items():
        _check_tower(key, strict.mapping(f"head {key}", head))
        node = strict.mapping(f"head {key}", head).get("node")
        if not isinstance(strict.mapping(f"node of head {key}", node).get("name"), str):
            raise ConfigError(f"the header: head {key} has no name")
        for sensor, scale in strict.mapping(f"scale of head {key}", head.get("scale", {})).items():
            if not (isinstance(scale, list) and len(scale) == 3 and all(map(_is_positive, scale))):
                raise ConfigError(f"the header: head {key} has no newtons for {sensor}: {scale!r}")
        names = head.get("names", [])
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ConfigError(f"the header: names of head {key} are no list of names: {names!r}")
    # read by the bench, to tell what a model was trained on
    strict.mapping("the header: recipe.data", header.recipe.get("data") or {})
    return header


def _check_tower(key: str, head: dict[str, Any]) -> None:
    """Checks the text tower of a head's entry."""
    where = f"the header: head {key}"
    tower, width = head.get("text_encoder"), head.get("text_width")
    if tower is not None and not isinstance(
        strict.mapping(f"{where}: text_encoder", tower).get("name"), str
    ):
        raise ConfigError(f"{where}: text_encoder has no name")
    if width is not None and not (type(width) is int and 0 < width < _ROWS):
        raise ConfigError(f"{where}: text_width is {width!r}, not a number of numbers")
    if not isinstance(head.get("text_name", ""), str):
        raise ConfigError(f"{where}: text_name is {head['text_name']!r}, not a name")


def _is_positive(value: Any) -> bool:
    return type(value) in (int, float) and 0 < value < math.inf


def _json_text(path: Path, file: BinaryIO) -> bytes:
    start, first = file.read(8), file.read(1)
    # torch.save writes a zip file (PK), or in old versions a pickle (\x80 and its protocol)
    if first != b"{" and (start[:2] == b"PK" or start[:1] == b"\x80"):
        if _is_of_lightning(file):
            folder = path.absolute().parent.parent
            own = f", and tactileforge.load({str(folder)!r}) its run"
            raise DataError(
                f"{path}: a checkpoint of Lightning: tactileforge.training.TouchModule."
                f"load_from_checkpoint({str(path)!r}) reads it, with the encoder as its .encoder"
                f"{own * (folder / CONFIG).is_file()}"
            )
        raise DataError(
            f"{path}: a pickle, whatever its name says; nothing in it was executed. For published "
            "weights: tactileforge zoo get NAME --from FILE; for a run: tactileforge zoo pack RUN; "
            "for a state_dict of yours: load it into a model by torch, then model.save(FILE)"
        )
    length, size = int.from_bytes(start, "little"), path.stat().st_size
    if size < 9 or (first == b"{" and length > size - 8):
        raise DataError(f"{path}: truncated, {size} bytes are left; fetch or write it again")
    if first != b"{" or length > _LONGEST:
        raise DataError(f"{path}: not a safetensors file; give a one-file checkpoint")
    return first + file.read(length - 1)


def _is_of_lightning(file: BinaryIO) -> bool:
    """Whether a file of ``torch.save`` is a checkpoint of Lightning; nothing in it is executed."""
    try:
        with zipfile.ZipFile(file) as archive:
            name = next((one for one in archive.namelist() if one.endswith("/data.pkl")), "")
            with archive.open(name) as pickled:
                return b"pytorch-lightning_version" in pickled.read(_LONGEST)
    except (zipfile.BadZipFile, KeyError, OSError, ValueError, NotImplementedError, zlib.error):
        return False


def _check_table(path: Path, start: int, table: dict[str, Any]) -> None:
    """Checks the tensors for gaps and overlaps, and the end of the file against the last one."""
    places = [_place(f"tensor {name!r}", entry) for name, entry in table.items()]
    end = 0
    expected, size = start + max((last for _, last in places), default=0), path.stat().st_size
    if size != expected:
        raise ConfigError(f"{size} bytes, expected {expected}; fetch or write it again")
    for first, last in sorted(places):
        if first != end:
            raise ConfigError(f"no tensor begins at byte {end} of the numbers; fetch it again")
        end = last


def _place(where: str, entry: Any) -> tuple[int, int]:
    """First and last place of a tensor's bytes; checks their number against its shape."""
    about = strict.mapping(where, entry)
    offsets, shape, dtype = (about.get(key) for key in ("data_offsets", "shape", "dtype"))
    if not (_counts(offsets) and len(offsets) == 2):
        raise ConfigError(f"{where} has no data_offsets")
    if not (isinstance(dtype, str) and dtype in _BYTES):
        raise ConfigError(f"{where} is of type {dtype!r}; known: {', '.join(_BYTES)}")
    if not _counts(shape) or offsets[1] - offsets[0] != math.prod(shape) * _BYTES[dtype]:
        raise ConfigError(
            f"{where}: its shape, {str(shape)[:99]}, is not that of bytes {offsets[0]} to "
            f"{offsets[1]}; fetch it again"
        )
    return offsets[0], offsets[1]


def _counts(values: Any) -> TypeGuard[list[int]]:
    """Whether a value is a list of numbers of bytes or rows: whole, not negative, of this world."""
    return isinstance(values, list) and all(type(n) is int and 0 <= n < 1 << 48 for n in values)
