"""Files of meshes and point clouds, read within limits."""

from __future__ import annotations

import zipfile
from importlib import import_module
from pathlib import Path
from tokenize import TokenError
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError, DataError, DataNotFoundError

#: Largest size of a mesh file, bytes, its unpacked members included; and most faces, or points.
MAX_BYTES, MAX_PARTS = 1 << 29, 10_000_000

#: Errors of numpy about an invalid file: it parses headers as Python literals.
_DAMAGE = (ArithmeticError, EOFError, OSError, SyntaxError, TokenError, TypeError, ValueError)


class Mesh(Protocol):
    """Interface of a triangle mesh, as ``trimesh`` has it."""

    vertices: Any
    faces: Any


def existing_file(path: str | Path) -> Path:
    """The path of a file.

    Raises:
        DataNotFoundError: There is no such file.
    """
    if not Path(path).is_file():
        raise DataNotFoundError(f"{path}: no such file")
    return Path(path)


def load_points(path: str | Path) -> NDArray[Any]:
    """The numbers of a ``.npy`` file.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is not an array of numbers.
    """
    path = existing_file(path)
    try:  # mapping fails, without a huge allocation, if a header states more than the file holds
        return np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
    except _DAMAGE as error:
        raise DataError(f"{path}: not an array of numbers: {error}") from error


def load_mesh(source: str | Path | Mesh, name: str | None) -> tuple[Mesh, str]:
    """A mesh and its name; a path is read.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is not a mesh, or is larger than `MAX_BYTES`.
        ConfigError: ``trimesh`` is not installed.
    """
    if not isinstance(source, str | Path):
        return source, name or "mesh"
    path = existing_file(source)
    size = path.stat().st_size
    if zipfile.is_zipfile(path):  # as 3MF is
        with zipfile.ZipFile(path) as archive:
            size += sum(member.file_size for member in archive.infolist())
    if size > MAX_BYTES:
        raise DataError(
            f"{path}: a mesh of {size / 1e6:,.1f} MB, where {MAX_BYTES / 1e6:,.1f} MB are the "
            "limit; make it coarser"
        )
    try:
        trimesh = import_module("trimesh")
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"{path}: reading it needs trimesh: pip install tactileforge-sim[mesh]"
        ) from error
    try:
        mesh = trimesh.load(path)
        if hasattr(mesh, "to_geometry"):  # a scene of several meshes
            mesh = mesh.to_geometry()
    except Exception as error:  # trimesh has a reader per format, each with errors of its own
        raise DataError(f"{path}: not a mesh: {type(error).__name__}: {error}") from error
    if not len(getattr(mesh, "vertices", ())):
        raise DataError(f"{path}: the file holds no points")
    return mesh, name or path.stem


def check_count(name: str, count: int, what: str) -> None:
    """Refuses more faces or points than `MAX_PARTS`.

    Raises:
        DataError: ``count`` is above `MAX_PARTS`.
    """
    if count > MAX_PARTS:
        raise DataError(
            f"{name}: {count:,} {what}, where {MAX_PARTS:,} are the limit; make it coarser"
        )
