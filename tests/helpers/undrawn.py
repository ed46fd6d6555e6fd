"""Draws no figure nobody looks at: a third of a short run is its report's figures."""

from typing import IO, Any

import pytest

#: Parts of the paths of tests that look at figures.
LOOKED_AT = ("pages", "report", "output", "inspect", "calibrate", "manipulation", "rollouts")
LOOKED_AT += ("test_figure.py", "test_loggers.py", "test_gallery.py")
_EMPTY = '<svg xmlns="http://www.w3.org/2000/svg" width="1pt" height="1pt" viewBox="0 0 1 1"></svg>'


def _write(canvas: Any, file: IO[str], **_: Any) -> None:
    file.write(_EMPTY)


def undraw(patch: pytest.MonkeyPatch) -> None:
    """Writes figures as empty ones, until the patch is undone."""
    patch.setattr("matplotlib.backends.backend_svg.FigureCanvasSVG.print_svg", _write)


def is_looked_at(path: str) -> bool:
    """Whether a test looks at figures, by its path."""
    return any(part in path for part in LOOKED_AT)
