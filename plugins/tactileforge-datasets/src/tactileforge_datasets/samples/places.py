"""Places of values in a sample, and their reading: plain data within limits, nothing executed."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from io import BytesIO
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data import Blob
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.plugins import load_json

#: Kinds of parts, by the last ending of their names.
PICTURES = ("jpg", "jpeg", "png", "webp")
VIDEOS = ("mp4", "m4v", "mov", "avi")
TEXTS = ("json", "cls", "txt")
KINDS = (*PICTURES, *VIDEOS, "npy", *TEXTS)
#: Endings whose usual readers run what a file says.
_EXECUTED = frozenset({"pyd", "pickle", "pkl", "pth", "pt", "ten", "dill", "joblib"})
_FIELD = re.compile(r"\{([^{}]*)\}")
#: Most bytes of a text, and of an array of values.
_TEXT, _ARRAY = 1 << 24, 1 << 28
#: Most bytes of the header of an array (`numpy.lib.format` has the same limit).
_HEADER = 10_000

#: numpy reads the header as a literal of Python, and lets the errors of its parsers through.
_NO_HEADER = (
    *(ValueError, KeyError, SyntaxError, TypeError, RecursionError, MemoryError),
    TokenError,
)


@dataclass(frozen=True)
class Place:
    """A value of a sample.

    Attributes:
        part: Name of the part.
        keys: Names and numbers on the way to the value in a JSON; () for the whole part.
        optional: Whether samples may lack it.
    """

    part: str
    keys: tuple[str, ...]
    optional: bool

    def __str__(self) -> str:
        return f"{self.part}:{'.'.join(self.keys)}" if self.keys else self.part


def parse_place(text: str) -> Place:
    """A place from ``PART``, ``PART:KEY.KEY`` and either with ``?`` behind it.

    Example:
        >>> parse_place("meta.json:contact.force?")
        Place(part='meta.json', keys=('contact', 'force'), optional=True)
    """
    name = text.removesuffix("?")
    part, _, keys = name.partition(":")
    return Place(part.lower(), tuple(keys.split(".")) if keys else (), text != name)


def fields_of(template: str) -> list[str]:
    """Places and placeholders of a template, in braces.

    Raises:
        ConfigError: A brace is not closed, or has nothing in it.

    Example:
        >>> fields_of("a {material} {json:object}")
        ['material', 'json:object']
    """
    names = _FIELD.findall(template)
    if set("{}") & set(_FIELD.sub("", template)) or not all(names):
        raise ConfigError(f"template {template!r}: write values in braces, {{cls}}")
    return names


def fill(template: str, value: Callable[[str], str]) -> str:
    """Text of a template.

    Args:
        template: Text with fields in braces.
        value: Function from a field to its text.
    """
    return _FIELD.sub(lambda found: value(found[1]), template)


def kind_of(part: str) -> str:
    """Kind of a part: its last ending, in lower case."""
    return part.rpartition(".")[2].lower()


def check_kind(part: str, kinds: Iterable[str], where: str) -> None:
    """Check of the kind of a part.

    Raises:
        ConfigError: It is none of ``kinds``; names those.
    """
    kind = kind_of(part)
    if kind in kinds:
        return
    if kind in _EXECUTED:
        raise ConfigError(
            f"{where} is {part}: {kind} can run code when it is loaded, so it is never read; write "
            "the values as npy or json"
        )
    raise ConfigError(f"{where}: {unknown('kind of part', kind, kinds)}")


def read_value(place: Place, blob: Blob, where: str) -> Any:
    """Value of a place: text, a number, a list of a JSON, or an array.

    Args:
        place: The place.
        blob: Content of its part.
        where: Name of the sample, for messages.

    Returns:
        None where an optional name of a JSON is missing, or its value is null.

    Raises:
        DataError: The part is damaged or too large, or lacks a name.
    """
    kind = kind_of(place.part)
    if kind == "npy":
        return read_array(blob, f"{where}.{place.part}")
    text = _text(blob, f"{where}.{place.part}")
    if kind != "json":
        return text.strip()
    try:
        value = load_json(text)
    except ValueError as error:
        raise DataError(f"{where}.{place.part}: not JSON ({error}); write it again") from error
    for key in place.keys:
        value = _inner(value, key, place, where)
        if value is None:
            return None
    return value


def _inner(value: Any, key: str, place: Place, where: str) -> Any:
    if isinstance(value, list) and key.isdecimal() and int(key) < len(value):
        return value[int(key)]
    if isinstance(value, dict) and key in value:
        return value[key]
    if place.optional:
        return None
    known = value if isinstance(value, dict) else ()
    raise DataError(f"{where}.{place.part}: {unknown('key', key, map(str, known), 'Correct it')}")


def _text(blob: Blob, where: str) -> str:
    if blob.size > _TEXT:
        raise DataError(f"{where}: {blob.size:,} bytes of text, where {_TEXT:,} are the limit")
    try:
        return blob.read().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{where}: byte {error.start} is not UTF-8; write it again") from error


def array_header(blob: Blob, where: str) -> tuple[np.dtype[Any], tuple[int, ...], bool, int]:
    """Type, shape, order (True for Fortran's) and start of the values of an ``npy``.

    Raises:
        DataError: It is not an array, holds Python objects, or is shorter or longer than it says.
    """
    head = Blob(blob.path, blob.offset, min(blob.size, _HEADER + 64)).read()
    stream = BytesIO(head)
    try:
        version = np.lib.format.read_magic(stream)
        reader = {1: np.lib.format.read_array_header_1_0, 2: np.lib.format.read_array_header_2_0}
        shape, fortran, dtype = reader[version[0]](stream)
    except _NO_HEADER as error:
        raise DataError(f"{where}: not a plain array ({error}); write it again") from error
    if dtype.hasobject or dtype.kind not in "biuf":
        raise DataError(
            f"{where}: an array of {dtype}: only numbers are read, no objects; save numbers"
        )
    # in Python's integers: numpy's product would wrap around for the sides of a hostile file
    count = 1
    for side in shape:
        count *= side
    start = stream.tell()
    if min(shape, default=1) < 0 or start + count * dtype.itemsize != blob.size:
        raise DataError(
            f"{where}: {blob.size - start:,} bytes for an array of {shape} {dtype}; write it again"
        )
    return dtype, tuple(shape), bool(fortran), start


def read_array(blob: Blob, where: str) -> NDArray[Any]:
    """Values of an ``npy``.

    Raises:
        DataError: See `array_header`, or it is too large for values.
    """
    dtype, shape, fortran, start = array_header(blob, where)
    if blob.size > _ARRAY:
        raise DataError(f"{where}: {blob.size:,} bytes of values, where {_ARRAY:,} are the limit")
    flat = np.frombuffer(blob.read(), dtype, offset=start)
    return flat.reshape(shape, order="F" if fortran else "C")


def as_numbers(value: Any, where: str) -> NDArray[np.float64]:
    """Numbers of a value; null is NaN.

    Raises:
        DataError: They are not numbers, infinite, or not of one shape.
    """
    try:
        numbers = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(f"{where}: not numbers of one shape ({error}); correct it") from error
    if np.isinf(numbers).any():
        raise DataError(f"{where}: an infinite value; correct it")
    return numbers
