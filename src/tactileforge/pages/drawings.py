"""Figures of a page as images, for use outside of the page."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

#: Dots per inch of the images.
_DPI = 150


@dataclass(frozen=True)
class Drawing:
    """A figure as an image.

    Attributes:
        name: Name in words, unique on the page.
        pixels: uint8 (H, W, 3), on a white background.
    """

    name: str
    pixels: NDArray[np.uint8]


_drawings: ContextVar[list[Drawing] | None] = ContextVar("drawings", default=None)


@contextmanager
def collected_drawings(wanted: bool = True) -> Iterator[list[Drawing]]:
    """Collects figures drawn in the context as images; none if ``wanted`` is False."""
    drawings: list[Drawing] = []
    token = _drawings.set(drawings if wanted else None)
    try:
        yield drawings
    finally:
        _drawings.reset(token)


def collect(figure: Figure, words: str, colours: Mapping[str, str]) -> None:
    """Adds a figure to the collected ones, if any are collected.

    The figure is recoloured in place, so draw it for the page first.

    Args:
        figure: Figure as drawn for the page.
        words: Name of the figure; a number is added if another figure has it.
        colours: Colours on white, by their placeholders for the colours of the page.
    """
    drawings = _drawings.get()
    if drawings is None:
        return
    # a bitmap has no CSS to put colours in the place of the placeholders
    for artist in figure.findobj():
        for kind in ("color", "facecolor", "edgecolor"):
            found = getattr(artist, f"get_{kind}", lambda: None)()
            found = np.atleast_2d(found) if isinstance(found, np.ndarray) else [found]
            used = mpl.colors.to_hex(found[0]) if len(found) and found[0] is not None else ""
            if used in colours:
                getattr(artist, f"set_{kind}")(colours[used])
    figure.set(facecolor="white", dpi=_DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    same = sum(re.sub(r" \(\d+\)$", "", other.name) == words for other in drawings)
    name = f"{words} ({same + 1})" if same else words
    drawings.append(Drawing(name, np.array(canvas.buffer_rgba())[..., :3]))
