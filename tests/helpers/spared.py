"""Spares tests half of the CPU time of a short run: its results nobody looks at."""

import os
from copy import deepcopy
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from typing import IO, Any

import pytest
import torch
from filelock import FileLock
from hydra._internal import defaults_list
from hydra._internal.config_loader_impl import ConfigLoaderImpl
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


def _stamp(file: Path) -> tuple[Path, int, int]:
    seen = file.stat()  # a test may write another file in its place
    return file, seen.st_mtime_ns, seen.st_size


class _Read:
    """One reader of each file of a package, with a record of them.

    Attributes:
        files: Read for the configuration at hand, with their times and sizes.
        others: Paths in the search path, and contents, of what is no file of a package.
    """

    def __init__(self) -> None:
        self.load = ConfigRepository.load_config
        self.files: list[tuple[Path, int, int]] = []
        self.others: list[tuple[str, str]] = []
        self._known: dict[Any, Any] = {}

    def __call__(self, repository: ConfigRepository, config_path: str) -> Any:
        source = repository._find_object_source(config_path, ObjectType.CONFIG)
        if source is None or source.scheme() != "pkg":
            return self._other(repository, config_path)
        file = files(source.path).joinpath(source._normalize_file_name(config_path))
        if not isinstance(file, Path):
            return self._other(repository, config_path)
        self.files.append(_stamp(file))
        key = (source.provider, source.path, *self.files[-1])
        if key not in self._known:
            self._known[key] = self.load(repository, config_path)
        return deepcopy(self._known[key])

    def _other(self, repository: ConfigRepository, config_path: str) -> Any:
        found = self.load(repository, config_path)
        self.others.append((config_path, repr(found and (found.config, found.header))))
        return found


class _Composed(list[Any]):
    """A defaults list with its merged configuration."""

    whole: Any = None


#: What a defaults list says of the choices beside itself.
_CHOICES = ("override_choices", "override_metadata", "known_choices", "known_choices_per_group")
_CHOICES += ("append_group_defaults", "deletions")


class _Lists:
    """Makes a defaults list once for the same choices from the same files and classes."""

    def __init__(self, read: _Read) -> None:
        self.make, self.compose = defaults_list._create_defaults_list, _of_loader()
        self._read = read
        self._known: dict[str, list[Any]] = {}

    def __call__(
        self, repo: Any, config_name: Any, overrides: Any, prepend_hydra: Any, skip_missing: Any
    ) -> Any:
        places = [(one.scheme(), one.provider, one.path) for one in repo.get_sources()]
        asked = [getattr(overrides, name) for name in _CHOICES]
        key = repr((places, config_name, asked, prepend_hydra, skip_missing))
        known = self._known.get(key)
        if known is None or not self._is_as_it_was(repo, *known[:2]):
            repo.cache.clear()
            self._read.files, self._read.others = [], []
            made, tree = self.make(repo, config_name, overrides, prepend_hydra, skip_missing)
            rest = deepcopy([getattr(overrides, name) for name in _CHOICES])
            known = [self._read.files, self._read.others, _Composed(made), tree, rest]
            if all(place[0] != "file" for place in places):
                self._known[key] = known
        for name, value in zip(_CHOICES, deepcopy(known[4]), strict=True):
            setattr(overrides, name, value)
        return known[2], known[3]

    def _is_as_it_was(self, repo: Any, paths: list[Any], others: list[Any]) -> bool:
        self._read.others = []
        for path, _ in others:
            repo.delegate.load_config(path)
        return self._read.others == others and all(_stamp(one[0]) == one for one in paths)

    def whole(self, loader: ConfigLoaderImpl, defaults: list[Any], repo: Any) -> Any:
        if not isinstance(defaults, _Composed):
            return self.compose(loader, defaults, repo)
        if defaults.whole is None:
            defaults.whole = self.compose(loader, defaults, repo)
        return deepcopy(defaults.whole)


def _of_loader() -> Any:
    return ConfigLoaderImpl._compose_config_from_defaults_list


def compose_once(patch: pytest.MonkeyPatch) -> None:
    """Hydra composes a command once, not first for `hydra.mode` only, and reads a file once.

    The merged configuration of the same options is copied before a command's values are set.
    """
    if isinstance(defaults_list._create_defaults_list, _Lists):  # each conftest.py has this fixture
        return
    asked = Hydra.get_mode

    def mode(self: Hydra, config_name: str | None, overrides: list[str]) -> Any:
        typed = any("hydra.mode" in word for word in overrides)
        return asked(self, config_name, overrides) if typed else None

    read = _Read()
    lists = _Lists(read)

    def load_once(self: ConfigRepository, config_path: str) -> Any:
        return read(self, config_path)

    def whole(self: ConfigLoaderImpl, defaults: list[Any], repo: Any) -> Any:
        return lists.whole(self, defaults, repo)

    patch.setattr(Hydra, "get_mode", mode)
    patch.setattr(ConfigRepository, "load_config", load_once)
    patch.setattr(defaults_list, "_create_defaults_list", lists)
    patch.setattr(ConfigLoaderImpl, "_compose_config_from_defaults_list", whole)


def simulate_once(patch: pytest.MonkeyPatch) -> None:
    """Simulates a touch of the common cache in one process; others wait for it."""
    module = import_module("tactileforge_sim.generate")
    if (write := module._write).__name__ == "simulated":  # each conftest.py has this fixture
        return

    def simulated(config: Any, folder: Path, number: int) -> None:
        cache = Path(os.environ.get("TACTILEFORGE_CACHE", os.devnull)).resolve()
        if cache not in folder.resolve().parents:
            write(config, folder, number)
            return
        with FileLock(cache.with_name(f"{cache.name}-{folder.name}-{number}.lock")):
            if not module.path_of(folder, number).exists():
                write(config, folder, number)

    patch.setattr(module, "_write", simulated)


def register_once(patch: pytest.MonkeyPatch) -> None:
    """Copies the table of ONNX operators of the first export for all others."""
    if (export := torch.onnx.export).__name__ == "exported":  # each conftest.py has this fixture
        return
    known: dict[Any, tuple[Any, list[str]]] = {}

    def patched() -> None:
        module = import_module("torch.onnx._internal.exporter._registration")
        make, find = module.ONNXRegistry.from_torchlib.__func__, module._get_overload

        def made(cls: Any, *version: Any, **named: Any) -> Any:
            key = (version, tuple(named.items()))
            if key in known:
                for name in known[key][1]:
                    find(name)  # which says that it is absent
            else:
                absent: list[str] = []
                with pytest.MonkeyPatch.context() as noted:
                    noted.setattr(module, "_get_overload", _noting(find, absent))
                    known[key] = make(cls, *version, **named), absent
            table = cls()
            table._opset_version = known[key][0]._opset_version
            table.functions = {name: [*ways] for name, ways in known[key][0].functions.items()}
            return table

        patch.setattr(module.ONNXRegistry, "from_torchlib", classmethod(made))

    def exported(*given: Any, **options: Any) -> Any:
        if not known:  # its module is read by the first export alone
            patched()
        return export(*given, **options)

    patch.setattr(torch.onnx, "export", exported)


def _noting(find: Any, absent: list[str]) -> Any:
    def noted(name: str) -> Any:
        if (found := find(name)) is None:
            absent.append(name)
        return found

    return noted
