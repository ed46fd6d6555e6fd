"""Codecs of zarr allowed to decode a chunk: none can run code of the file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from tactileforge.errors import DataError, unknown

#: Codecs of plain bytes and numbers, by their names in zarr 2 and 3.
KNOWN = frozenset(
    {
        *("blosc", "zstd", "lz4", "zlib", "gzip", "bz2", "lzma", "bytes", "transpose"),
        *("delta", "shuffle", "bitround", "quantize", "fixedscaleoffset", "packbits", "astype"),
        *("vlen-utf8", "vlen-bytes", "sharding_indexed"),
        *("crc32", "crc32c", "adler32", "fletcher32", "jenkins_lookup3"),
    }
)
#: Codecs whose output may be any number of times larger than the chunk.
PACKERS = frozenset({"blosc", "zstd", "lz4", "zlib", "gzip", "bz2", "lzma"})
#: Codecs of Python objects: their decoder runs what the file says.
_UNSAFE = frozenset({"pickle", "msgpack2", "json2", "categorize"})
#: Package of codecs for pictures, such as JPEG XL.
_PICTURES = "imagecodecs"


def check_codecs(where: str, metadata: Mapping[str, Any]) -> None:
    """Checks the codecs of an array of zarr, and registers those of pictures.

    Args:
        where: File and key of the array, for messages.
        metadata: The array's ``.zarray`` (zarr 2) or ``zarr.json`` (zarr 3).

    Raises:
        DataError: A codec can run code, is unknown, or its package is not installed.
    """
    names = [*_names(metadata)]
    if len([name for name in names if name in PACKERS]) > 1:
        raise DataError(f"{where}: compressed twice ({', '.join(names)}); write it again")
    for name in names:
        if name in _UNSAFE:
            raise DataError(
                f"{where}: its codec {name!r} holds Python objects and can run code, so it is not "
                "read; write the array with a fixed type, or leave it out of the map"
            )
        if name.startswith(f"{_PICTURES}_"):
            _register(where, name)
        elif name not in KNOWN:
            raise DataError(f"{where}: {unknown('codec', name, KNOWN)}")


def _names(metadata: Mapping[str, Any]) -> Iterator[str]:
    """Names of all codecs of an array, with those inside of shards."""
    if "codecs" in metadata or "index_codecs" in metadata:
        codecs = [*(metadata.get("codecs") or ()), *(metadata.get("index_codecs") or ())]
        for codec in codecs:
            about = codec if isinstance(codec, Mapping) else {"name": codec}
            yield plain_name(about.get("name"))
            inner = about.get("configuration")
            yield from _names(inner) if isinstance(inner, Mapping) else ()
    for codec in (metadata.get("compressor"), *(metadata.get("filters") or ())):
        if codec is not None:
            yield plain_name(codec.get("id") if isinstance(codec, Mapping) else codec)


def plain_name(name: Any) -> str:
    """Name of a codec without the prefix of numcodecs."""
    return re.sub(r"^numcodecs\.", "", str(name))


def _register(where: str, name: str) -> None:
    if find_spec(_PICTURES) is None:
        raise DataError(
            f"{where}: its pictures are coded by {name!r}; install its codec: pip install "
            f"{_PICTURES}"
        )
    import_module(f"{_PICTURES}.numcodecs").register_codecs(verbose=False)
