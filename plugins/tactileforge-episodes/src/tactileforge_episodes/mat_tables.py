"""Tables of MATLAB: variables of one length are columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactileforge.errors import DataError
from tactileforge.reading import MOST_BYTES, rows_of_arrays
from tactileforge_episodes.hdf_chunks import Chunks
from tactileforge_episodes.mat_limits import check_mat5
from tactileforge_episodes.packages import need


def read_mat_table(path: Path) -> list[tuple[str, dict[str, str]]]:
    """Place and cells of the rows of a .mat, of version 5 or 7.3.

    ``force`` of shape (T, 3) is ``force.0`` to ``force.2``; fields of structs are ``data.force``.

    Args:
        path: Path of the file.

    Raises:
        DataError: It is large, or has no columns of numbers.
        ConfigError: scipy is not installed, which version 5 needs.
    """
    if path.stat().st_size > MOST_BYTES:
        raise DataError(f"{path}: {path.stat().st_size >> 20} MB, where a table of labels is small")
    with path.open("rb") as file:
        is_hdf5 = file.read(10) == b"MATLAB 7.3"
    if is_hdf5:
        with need("h5py", str(path)).File(path, "r") as content:
            return rows_of_arrays(path, dict(_of_hdf5(content)))
    with path.open("rb") as file:
        check_mat5(str(path), file)
    scipy = need("scipy.io", str(path))
    names = [name for name, _, kind in scipy.whosmat(str(path)) if kind != "sparse"]
    content = scipy.loadmat(str(path), variable_names=names, simplify_cells=True)
    return rows_of_arrays(path, dict(_of_structs(content)))


def _of_structs(content: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Values of MATLAB's variables, and of the fields of structs."""
    for name, value in content.items():
        if name.startswith("__"):
            continue
        if isinstance(value, Mapping):
            yield from _of_structs(value, f"{above}{name}.")
        else:
            yield above + name, np.asarray(value)


def _of_hdf5(
    group: Any, above: str = "", seen: set[int] | None = None
) -> Iterator[tuple[str, Any]]:
    """Values of MATLAB 7.3: arrays of HDF5 with their axes turned round. Links are not followed."""
    h5py = need("h5py", group.name)
    seen = set() if seen is None else seen  # a group may have several names, also within itself
    seen.add(h5py.h5o.get_info(group.id).addr)
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        node = group[name]
        if isinstance(node, h5py.Group):
            if h5py.h5o.get_info(node.id).addr not in seen:
                yield from _of_hdf5(node, f"{above}{name}.", seen)
        elif isinstance(node, h5py.Dataset) and _is_plain(node):
            if node.chunks is not None:
                Chunks(f"{node.file.filename}, {above}{name}", node).check(0, node.shape[0])
            array = np.asarray(node[()]).T
            if node.attrs.get("MATLAB_class") == b"char":
                array = np.array("".join(map(chr, array.ravel().tolist())))
            yield above + name, array


def _is_plain(node: Any) -> bool:
    """Whether an array has values of its own, read at once."""
    if node.external or node.is_virtual or node.dtype.hasobject or node.shape is None:
        return False
    return bool(node.size * node.dtype.itemsize <= MOST_BYTES)
