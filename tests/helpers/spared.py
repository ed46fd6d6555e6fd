"""Spares tests half of the CPU time of a short run: its results nobody looks at."""

from copy import deepcopy
from importlib.resources import files
from pathlib import Path
from typing import IO, Any

import pytest
from hydra._internal.config_repository import ConfigRepository
from hydra._internal.hydra import Hydra
from hydra.core.object_type import ObjectType
from markupsafe import Markup

#: Parts of the paths of tests that look at figures.
LOOKED_AT = ("pages", "report", "output", "inspect", "calibrate", "manipulation", "rollouts")
LOOKED_AT += ("test_figure.py", "test_loggers.py", "test_gallery.py")
_EMPTY = '<svg xmlns="http://www.w3.org/2000/svg" width="1pt" height="1pt" viewBox="0 0 1 1"></svg>'
#: Figures of a run, where its report makes them.
_FIGURES = ("sections.curve_figure", "sections.lines_figure", "forces.lines_figure")
_FIGURES += ("embedding.scatter_figure",)


def _write(canvas: Any, file: IO[str], **_: Any) -> None:
    file.write(_EMPTY)


def _blank(*_: Any, **__: Any) -> Markup:
    return Markup(_EMPTY)


def undraw(patch: pytest.MonkeyPatch) -> None:
    """Writes figures as empty ones, until the patch is undone."""
    patch.setattr("matplotlib.backends.backend_svg.FigureCanvasSVG.print_svg", _write)
    for name in _FIGURES:
        patch.setattr(f"tactileforge.report.{name}", _blank)


def is_looked_at(path: str) -> bool:
    """Whether a test looks at figures, by its path."""
    return any(part in path for part in LOOKED_AT)


def compose_once(patch: pytest.MonkeyPatch) -> None:
    """Hydra composes a command once, not first for `hydra.mode` only, and reads a file once."""
    asked = Hydra.get_mode

    def mode(self: Hydra, config_name: str | None, overrides: list[str]) -> Any:
        typed = any("hydra.mode" in word for word in overrides)
        return asked(self, config_name, overrides) if typed else None

    load = ConfigRepository.load_config
    known: dict[Any, Any] = {}

    def load_once(self: ConfigRepository, config_path: str) -> Any:
        source = self._find_object_source(config_path, ObjectType.CONFIG)
        if source is None or source.scheme() != "pkg":
            return load(self, config_path)
        file = files(source.path).joinpath(source._normalize_file_name(config_path))
        if not isinstance(file, Path):
            return load(self, config_path)
        seen = file.stat()  # a test may write another file in its place
        key = (source.provider, source.path, file, seen.st_mtime_ns, seen.st_size)
        if key not in known:
            known[key] = load(self, config_path)
        return deepcopy(known[key])

    patch.setattr(Hydra, "get_mode", mode)
    patch.setattr(ConfigRepository, "load_config", load_once)
