"""Numbers of touched objects, by their names."""

from __future__ import annotations

import hashlib


def object_id(name: str | None) -> int:
    """Hash of an object's name, equal in every process; -1 for none."""
    if name is None:
        return -1
    digest = hashlib.blake2b(name.encode("utf-8", "surrogatepass"), digest_size=8).digest()
    # 63 bits: the number has to fit int64, and -1 to stay free
    return int.from_bytes(digest, "big") >> 1


def object_class(name: str, classes: int) -> int:
    """Class of an object in a head with some classes, see `objectives.classify`."""
    return object_id(name) % classes
