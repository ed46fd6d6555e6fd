"""Any object as a shape: a mesh, a point cloud, or a height image.

An object touches the gel with its upper side: it is seen along its own -z axis, its x to the right
and its y up. Only the part within `REACH` of the touched place counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError, DataError
from tactileforge.plugins import open_picture
from tactileforge_sim.geometry.indenter_geometry import CELLS, DEEP, REACH, Shape, shape_of
from tactileforge_sim.geometry.mesh_files import (
    Mesh,
    check_count,
    existing_file,
    load_mesh,
    load_points,
)
from tactileforge_sim.geometry.sdf2d import Array, Point

#: Height of cells without material, far below any object.
_EMPTY = -1e6
#: Largest number of samples of triangles at a time, to bound memory.
_SAMPLES = 2_000_000


def mesh_shape(
    source: str | Path | Mesh,
    mm_per_unit: float = 1.0,
    at: Point = (0.0, 0.0),
    spacing_mm: float = 0.05,
    name: str | None = None,
) -> Shape:
    """A triangle mesh as a shape.

    Args:
        source: Path of a file for ``trimesh``, or a mesh with ``vertices`` and ``faces``.
        mm_per_unit: Length of the mesh's unit, mm; 1000 for metres.
        at: Touched place, mm from the middle of the mesh, right and up.
        spacing_mm: Spacing of the sampling grid, mm.
        name: Name of the shape; None for that of the file.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is no mesh or larger than `mesh_files.MAX_BYTES`, or the mesh is empty,
            not finite or of more than `mesh_files.MAX_PARTS` faces or vertices.
        ConfigError: The mesh is finer than the grid, is not at that place, or ``trimesh`` is not
            installed.
    """
    mesh, name = load_mesh(source, name)
    check_count(name, len(getattr(mesh, "faces", ())), "faces")
    faces = np.asarray(getattr(mesh, "faces", ()), dtype=np.int64).reshape(-1, 3)
    if not len(faces):
        raise DataError(f"{name}: the mesh has no faces; read a point cloud with cloud_shape")
    points = _placed(np.asarray(mesh.vertices), name, mm_per_unit, at, spacing_mm)
    if faces.min() < 0 or faces.max() >= len(points):
        raise DataError(f"{name}: a face refers to a vertex beyond the {len(points)} of the mesh")
    return _shape(name, _rasterised(points[faces], spacing_mm), spacing_mm)


def cloud_shape(
    source: str | Path | NDArray[Any],
    mm_per_unit: float = 1.0,
    at: Point = (0.0, 0.0),
    gap_mm: float | None = None,
    spacing_mm: float = 0.05,
    name: str | None = None,
) -> Shape:
    """A cloud of points as a shape; the space between points is closed.

    Args:
        source: Points (N, 3), path of a ``.npy`` file of them, or path of a file for ``trimesh``.
        mm_per_unit: Length of the cloud's unit, mm; 1000 for metres.
        at: Touched place, mm from the middle of the cloud, right and up.
        gap_mm: Widest gap between points to close, mm; None for one from the number of points.
        spacing_mm: Spacing of the sampling grid, mm.
        name: Name of the shape; None for that of the file.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: There are no points, they are not finite, or more than `mesh_files.MAX_PARTS`.
        ConfigError: The cloud is finer than the grid, is not at that place or has too few points,
            or ``trimesh`` is not installed.
    """
    if isinstance(source, np.ndarray):
        raw, name = source, name or "cloud"
    elif Path(source).suffix == ".npy":
        raw, name = load_points(source), name or Path(source).stem
    else:
        cloud, name = load_mesh(source, name)
        raw = np.asarray(cloud.vertices)
    points = _placed(raw, name, mm_per_unit, at, spacing_mm)
    width, height = np.ptp(points[:, :2], axis=0)
    # Random points on a closed surface leave voids some seven times this wide.
    gap = 7 * float(np.sqrt(width * height / len(points))) if gap_mm is None else gap_mm
    if gap > max(width, height) / CELLS:
        raise ConfigError(
            f"{name}: {len(points)} points over {width:.3g} x {height:.3g} mm leave gaps of "
            f"{gap:.3g} mm; the limit is a width / {CELLS:g}: give more points, or a smaller gap_mm"
        )
    return _shape(name, _splatted(points, spacing_mm, gap), spacing_mm)


def picture_shape(
    path: str | Path, mm_per_pixel: float, range_mm: float, name: str | None = None
) -> Shape:
    """A grey height image as a shape: white touches first, black lies ``range_mm`` below.

    Args:
        path: A grey image, 8 or 16 bit.
        mm_per_pixel: Width of a pixel, mm.
        range_mm: Height of white above black, mm.
        name: Name of the shape; None for that of the file.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is not an image, or is not grey.
        ConfigError: A size is 0 or less, or the image has too few pixels.
    """
    path = existing_file(path)
    if not mm_per_pixel > 0 or not range_mm > 0:
        raise ConfigError(
            f"{path}: mm_per_pixel is {mm_per_pixel:g} and range_mm {range_mm:g}: both must be "
            "above 0"
        )
    try:
        with open_picture(path) as opened:
            mode, grey = opened.mode, np.asarray(opened)
    except (OSError, SyntaxError, ValueError) as error:
        raise DataError(f"{path}: not a readable image: {error}") from error
    if grey.ndim != 2 or grey.dtype not in (np.uint8, np.uint16):
        raise DataError(f"{path}: an image of mode {mode}; save it as grey, 8 or 16 bit")
    if min(grey.shape) < CELLS:
        raise ConfigError(
            f"{path}: {grey.shape[1]} x {grey.shape[0]} pixels; the limit is {CELLS:g} each way"
        )
    top = grey.astype(np.float64) / np.iinfo(grey.dtype).max * range_mm
    return _shape(name or path.stem, top, mm_per_pixel)


def _placed(
    raw: NDArray[Any], name: str, mm_per_unit: float, at: Point, spacing_mm: float
) -> Array:
    """Points in mm about the touched place, y downwards."""
    check_count(name, len(raw), "points")
    if raw.ndim != 2 or raw.shape[1] != 3 or not len(raw):
        raise DataError(f"{name}: points of shape {raw.shape}; give (N, 3) with N above 0")
    numeric = np.issubdtype(raw.dtype, np.number)
    if not numeric or not np.isfinite(raw).all():
        bad = int((~np.isfinite(raw)).any(1).sum()) if numeric else len(raw)
        raise DataError(f"{name}: {bad} of {len(raw)} points are not finite numbers")
    if not mm_per_unit > 0 or not spacing_mm > 0:
        raise ConfigError(
            f"{name}: mm_per_unit is {mm_per_unit:g} and spacing_mm {spacing_mm:g}: both must be "
            "above 0"
        )
    points = raw.astype(np.float64) * mm_per_unit
    low, high = points.min(0), points.max(0)
    size = float((high - low)[:2].max())
    if size < CELLS * spacing_mm:
        raise ConfigError(
            f"{name} is {size:.3g} mm wide, finer than the grid: the limit is {CELLS:g} cells of "
            f"{spacing_mm:.3g} mm = {CELLS * spacing_mm:.3g} mm; is it in metres "
            "(mm_per_unit=1000)?"
        )
    points[:, :2] -= (low + high)[:2] / 2 + np.asarray(at)
    points[:, 1] *= -1
    return points


def _cells(spacing_mm: float) -> int:
    """Cells of a row of the grid within reach; one is in the middle."""
    return 2 * int(np.ceil(REACH / spacing_mm)) + 1


def _rasterised(triangles: Array, spacing_mm: float) -> Array:
    """The highest z of triangles (F, 3, 3) at each cell, by a depth buffer."""
    cells = _cells(spacing_mm)
    top = np.full(cells * cells, _EMPTY)
    triangles = triangles.copy()
    triangles[..., :2] = triangles[..., :2] / spacing_mm + (cells - 1) / 2
    for index, z in _samples(triangles, cells):
        np.maximum.at(top, index, z)
    return top.reshape(cells, cells)


def _samples(triangles: Array, cells: int) -> Iterator[tuple[NDArray[np.int64], Array]]:
    """Cells under triangles and their heights, for triangles of about one size at a time."""
    low = np.clip(np.ceil(triangles[..., :2].min(1)), 0, cells).astype(np.int64)
    high = np.clip(np.floor(triangles[..., :2].max(1)), -1, cells - 1).astype(np.int64)
    span = high - low + 1
    seen = (span > 0).all(1)
    triangles, low, span = triangles[seen], low[seen], span[seen]
    # Boxes are padded to powers of two: few sizes, and so few batches, cover all triangles.
    sizes = 2 ** np.ceil(np.log2(span)).astype(np.int64)
    for width, height in np.unique(sizes, axis=0):
        rows = np.flatnonzero((sizes == (width, height)).all(1))
        v, u = np.divmod(np.arange(width * height), width)
        step = max(1, _SAMPLES // (width * height))
        for start in range(0, len(rows), step):
            part = rows[start : start + step]
            column, row = low[part, :1] + u, low[part, 1:] + v
            z, inside = _over(triangles[part], column, row)
            inside &= (column < cells) & (row < cells)
            yield (row * cells + column)[inside], z[inside]


def _over(
    triangles: Array, x: NDArray[np.int64], y: NDArray[np.int64]
) -> tuple[Array, NDArray[np.bool_]]:
    """Height of each triangle over its own points (F, P), and whether it covers them."""
    a, b, c = (triangles[:, corner, :, None] for corner in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    flat = np.abs(area) < 1e-12  # seen from its edge
    area = np.where(flat, 1.0, area)
    wb = ((x - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (y - a[:, 1])) / area
    wc = ((b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (x - a[:, 0]) * (b[:, 1] - a[:, 1])) / area
    inside = ~flat & (wb >= -1e-9) & (wc >= -1e-9) & (wb + wc <= 1 + 1e-9)
    return a[:, 2] + wb * (b[:, 2] - a[:, 2]) + wc * (c[:, 2] - a[:, 2]), inside


def _splatted(points: Array, spacing_mm: float, gap_mm: float) -> Array:
    """The highest z of points at each cell, gaps closed."""
    cells = _cells(spacing_mm)
    column, row = np.round(points[:, :2].T / spacing_mm + (cells - 1) / 2).astype(np.int64)
    near = (column >= 0) & (column < cells) & (row >= 0) & (row < cells)
    top = np.full((cells, cells), _EMPTY, dtype=np.float32)
    np.maximum.at(top, (row[near], column[near]), points[near, 2].astype(np.float32))
    width = 2 * int(np.ceil(gap_mm / spacing_mm / 2)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    return np.asarray(cv2.morphologyEx(top, cv2.MORPH_CLOSE, kernel), dtype=np.float64)


def _shape(name: str, top: Array, spacing_mm: float) -> Shape:
    """A shape from the height of its upper side on a grid."""
    rows, columns = top.shape
    v, u = np.ogrid[:rows, :columns]
    away = np.hypot(u - (columns - 1) / 2, v - (rows - 1) / 2) * spacing_mm
    touched = top[(away <= REACH) & (top > _EMPTY / 2)]
    if not touched.size:
        raise ConfigError(f"{name}: nothing within {REACH:g} mm of the place that is touched")
    # A rim without material, so that interpolation beyond the grid gives `DEEP`.
    below = np.pad(np.clip(touched.max() - top, 0, DEEP), 1, constant_values=DEEP)

    def height(x: Array, y: Array) -> Array:
        column = np.clip(x / spacing_mm + (columns - 1) / 2 + 1, 0, columns + 0.999)
        row = np.clip(y / spacing_mm + (rows - 1) / 2 + 1, 0, rows + 0.999)
        j, i = column.astype(np.int64), row.astype(np.int64)
        s, t = column - j, row - i
        above = below[i, j] * (1 - s) + below[i, j + 1] * s
        under = below[i + 1, j] * (1 - s) + below[i + 1, j + 1] * s
        return np.where(np.hypot(x, y) <= REACH, above * (1 - t) + under * t, DEEP)

    return shape_of(name, height)
