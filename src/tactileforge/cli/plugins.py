"""Lists and checks plugins, and starts your own."""

from __future__ import annotations

import json
import keyword
import re
import shlex
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.resources import files
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactileforge.cli import _options, _verbs
from tactileforge.cli._command import Command
from tactileforge.errors import ConfigError, PluginError, SensorError, check_names, command, unknown
from tactileforge.plugins import local, registry
from tactileforge.plugins.distributions import is_ours
from tactileforge.util.files import disk_errors_named, new_part, write_text
from tactileforge.util.licences import check_licence

if TYPE_CHECKING:
    from tactileforge.testing import CheckResult

#: Kinds of plugins as they are typed, in the singular.
_KINDS = [kind.removesuffix("s") for kind in (*registry.KINDS, *registry.MODULES)]


@dataclass(frozen=True, kw_only=True)
class _List:
    """Keys of ``plugins list``.

    Attributes:
        json: Whether to print JSON, for programs.
    """

    json: bool = False


@dataclass(frozen=True, kw_only=True)
class _Check:
    """Keys of ``plugins check``.

    Attributes:
        names: Plugins, installed or classes of your own (./file.py:Class, my_module:Class); none
            for all installed ones.
        kind: Kind of plugins to check: sensor, dataset, encoder, head, objective, optimizer, check
            or verb; None for all kinds, and that which a class of your own is.
        attached: Whether to check each attached sensor.
        options: Options of the one named plugin; other keys are collected here.
    """

    names: list[str] = field(default_factory=list)
    kind: str | None = None
    attached: bool = False
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.kind not in (None, *_KINDS):
            raise ConfigError(unknown("kind", str(self.kind), _KINDS))


@dataclass(frozen=True, kw_only=True)
class _Keys:
    """Keys of ``plugins keys``.

    Attributes:
        names: Plugins; none for all.
        markdown: Whether to print the page docs/keys.md.
    """

    names: list[str] = field(default_factory=list)
    markdown: bool = False


@dataclass(frozen=True, kw_only=True)
class _New:
    """Keys of ``plugins new``.

    Attributes:
        kind: Kind of plugin: sensor, dataset, container, encoder, objective, optimizer, check, verb
            or suite.
        name: Name of the plugin as users type it, snake_case; with ``from`` None for that of the
            class.
        source: Class of your own that the package is made of (``from=my_module:Contrast``); None
            for an example to start from.
        out: Folder to write it in.
        licence: SPDX identifier of its licence, such as MIT; None states none, which is yours to do
            before others use it.
    """

    kind: str
    name: str | None = None
    source: str | None = None
    out: str = "."
    licence: str | None = None

    def __post_init__(self) -> None:
        if self.licence is not None:
            check_licence("licence", self.licence)
        if self.kind not in _FILES:
            also = "A head comes with its objective"
            raise ConfigError(unknown("kind", self.kind, _FILES, also))
        if self.name is None and self.source is None:
            raise ConfigError(f"give a name: plugins new {self.kind} my_{self.kind}")


def _list(keys: _List, _: dict[str, Any]) -> None:
    """Lists installed plugins; imports none of them."""
    from tactileforge.pages.text_tables import align_columns

    rows = [asdict(plugin) for plugin in registry.list_plugins()]
    for row in rows:
        if row["kind"] == "verbs" and _verbs.is_taken(row["name"]):
            row["status"] = "conflict"  # with a verb of the package itself, which wins
        row["kind"] = row["kind"].removesuffix("s")
    if keys.json:
        print(json.dumps(rows, indent=2))
        return
    columns = ("name", "kind", "distribution", "version", "status")
    table = [columns, *(tuple(str(row[column]) for column in columns) for row in rows)]
    print(align_columns(table))


def _check(keys: _Check, _: dict[str, Any]) -> int:
    """Runs the conformance suite on all plugins or on the named ones."""
    from tactileforge.testing import check, kind_of

    kinds = (*registry.KINDS, *registry.MODULES)
    installed = [(kind, name) for kind in kinds for name in registry.names(kind)]
    within = [plugin for plugin in installed if keys.kind in (None, plugin[0].removesuffix("s"))]
    known = {name for _, name in within}
    own = []
    for wanted in keys.names:
        if local.is_local(wanted):
            kind = f"{keys.kind}s" if keys.kind else kind_of(local.resolve(wanted), wanted)
            registry.adopt(kind, wanted)
            own.append((kind, wanted))
        elif wanted not in known:
            fix = registry.dotted(wanted) or "See them: tactileforge plugins list"
            text = unknown(keys.kind or "plugin", wanted, known, fix)
            raise PluginError(_unchecked(wanted) or text)
    plugins = [plugin for plugin in within if not keys.names or plugin[1] in keys.names] + own
    options, attached = keys.options, keys.attached
    if options and len(plugins) != 1:
        raise ConfigError(
            f"{next(iter(options))}= is an option of one plugin, and {len(plugins)} are checked: "
            "name one, and its --kind"
        )
    runs = _attached(plugins, options) if attached else [(*plugin, options) for plugin in plugins]
    counts = dict.fromkeys(("ran", "failed", "expected", "skipped"), 0)
    for plugin_kind, name, given in runs:
        address = [f"{key}={given[key]}" for key in _ADDRESSES if attached and key in given]
        print(" ".join([plugin_kind.removesuffix("s"), name, *address]), flush=True)
        results = check(plugin_kind, name, **given)
        for result in results:
            counts[result.status] += 1
        print("\n".join(_result_lines(results)))
    print(", ".join(f"{count} {status}" for status, count in counts.items()))
    return 1 if counts["failed"] else 0


def _result_lines(results: Sequence[CheckResult]) -> Iterator[str]:
    """A line for each check; a cause that fails several is said once, with their number."""
    causes = Counter((result.status, result.detail) for result in results)
    said = set()
    for result in results:
        first = (result.detail.splitlines() or [""])[0]
        also = causes[result.status, result.detail] - 1 if result.status == "failed" else 0
        if also and result.detail in said:
            continue
        said.add(result.detail)
        more = f" and {also} more {'check' if also == 1 else 'checks'}" if also else ""
        yield f"  {result.status:<9}{result.name}{more}{': ' * bool(first)}{first}"


def _unchecked(name: str) -> str:
    """The way to check a plugin without a conformance suite; "" for an unknown name."""
    if name in _options.options("suite"):
        shown = command("bench", f"suite={name}", "--cfg", "job")
        tried = command("bench", f"suite={name}", "model=pixels", f"out={name}")
        return f"{name!r} is a suite, which is options: {shown} composes it, and {tried} runs it"
    if name in registry.names("containers"):
        return (
            f"'{name}' is a container, which is checked on a file of its format: "
            "tactileforge.testing.check_container(FILE), as the test of its package does"
        )
    kind = next((kind for kind in registry.OTHERS if name in registry.names(kind)), None)
    what = {"conf": "package of options"}.get(kind or "", (kind or "").removesuffix("s"))
    return f"{name!r} is a {what}, which has no conformance suite: test what it does" * bool(kind)


#: Options with the address of a sensor's device.
_ADDRESSES = ("device", "port")


def _attached(
    plugins: Sequence[tuple[str, str]], options: Mapping[str, Any]
) -> list[tuple[str, str, dict[str, Any]]]:
    """Attached sensors, each with the options to open it, and broken plugins."""
    attached = []
    for kind, name in plugins:
        if kind != "sensors":
            continue
        try:
            known = registry.parameters(registry.get(kind, name))
        except PluginError:  # its check reports the error
            attached.append((kind, name, dict(options)))
            continue
        if any(known[key] is Parameter.empty and key not in options for key in known):
            continue
        key = next((key for key in _ADDRESSES if key in known), "")
        for address in registry.build(kind, {"name": name, **options}).discover():
            attached.append((kind, name, {**options, key: address} if key else dict(options)))
    if not attached:
        raise SensorError("none of the sensors is attached: plug one in, or give its port=")
    return attached


#: Files of the example needed by a plugin of each kind, beside the files of every package.
_FILES = {
    "sensor": ("sensor.py", "synthetic.py"),
    "dataset": ("dataset.py", "synthetic.py"),
    "encoder": ("encoder.py",),
    "objective": ("objective.py", "head.py"),
    "optimizer": ("optimizer.py",),
    "check": ("check.py",),
    "container": ("container.py",),
    "verb": ("verb.py",),
    "suite": ("conf/__init__.py", "conf/suite/forces_at_a_glance.yaml"),
}
#: Name of the example's plugin of each kind.
_NAMES = {
    "sensor": "dummy",
    "dataset": "dummy_presses",
    "encoder": "small_cnn",
    "objective": "contact_area",
    "optimizer": "muon",
    "check": "worn_gel",
    "container": "npy_folder",
    "verb": "brightness",
    "suite": "forces_at_a_glance",
}
#: Group of the entry points of a kind, unless it is the plural of the kind.
_GROUPS = {"suite": "conf"}


def _keys(keys: _Keys, _: dict[str, Any]) -> None:
    """Prints the meaning and default of each option of a plugin."""
    from tactileforge.cli._help import keys_page, plugin_keys

    if keys.markdown:
        print(keys_page(), end="")
        return
    groups = {kind: group for group, kind in reversed(registry.GROUPS.items())}
    known = [one for one in registry.list_plugins() if one.kind in groups]
    check_names("plugin", keys.names, {one.name for one in known})
    for one in known:
        if not keys.names or one.name in keys.names:
            group = groups[one.kind]
            print("\n".join([f"{group}={one.name}", *plugin_keys(group, one.name, "  "), ""]))


def _new(keys: _New, _: dict[str, Any]) -> None:
    """Writes a package to start from."""
    from tactileforge.cli import _own_package

    kind, name, out = keys.kind, keys.name or "", Path(keys.out)
    made: dict[str, str] = {}
    if keys.source is not None:
        name, made = _own_package.package_of(kind, name, keys.source)
    class_name = _camel(name)
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name) or keyword.iskeyword(class_name):
        raise ConfigError(f"{name!r} is not a name for a plugin: use snake_case, e.g. my_{kind}")
    if name in _names_of(kind):
        raise ConfigError(f"an installed {kind} has the name {name!r}: choose another")
    package = f"tactileforge_{name}"
    folder = out / package.replace("_", "-")
    if is_ours(folder.name):
        raise ConfigError(f"{folder.name} is a package of tactileforge's own: choose another name")
    if folder.exists():
        raise ConfigError(f"{folder} exists: choose another name, or --out another folder")
    files_of_it = made or _example(kind, name, package, folder.name)
    files_of_it["pyproject.toml"] = _licensed(files_of_it["pyproject.toml"], keys.licence)
    files_of_it["README.md"] += _own_package.publishing(folder.name, keys.licence)
    with disk_errors_named(folder), new_part(folder) as part:
        for path, text in files_of_it.items():
            write_text(part / path, text)
        part.replace(folder)
    install = shlex.join(["pip", "install", "-e", str(folder)])
    check = ("plugins", "check", name)
    then = ("bench", f"suite={name}", "--cfg", "job") if kind == "suite" else check
    # a container is checked on a file of its format, which its test makes
    last = f"pytest {shlex.quote(str(folder))}" if kind == "container" else command(*then)
    print(f"wrote {folder}\nnext: {install} && {last}")


def _example(kind: str, name: str, package: str, title: str) -> dict[str, str]:
    """Files of the example of a kind by their paths, under another name."""
    own = _NAMES[kind]
    words = {
        "dummy": "digit",  # a published type of sensor stands in for the example's own
        "tactileforge-example": title,
        "tactileforge_example": package,
        own: name,
        _camel(own): _camel(name),
        "stable_decay": f"{name}_decay",  # the schedule beside the optimiser
        "glance_force": f"{name}_force",  # the task of the suite
        "EX101": f"X{re.sub('[^a-z]', '', name)[:3].upper()}101",  # the code of the check
    }
    longest_first = sorted(words, key=len, reverse=True)
    pattern = re.compile("|".join(map(re.escape, longest_first)))
    source = files("tactileforge.example") / "tactileforge-example"

    def renamed(text: str) -> str:
        return pattern.sub(lambda match: words[match[0]], text)

    return {
        renamed(path): renamed(_sections_of(kind, source.joinpath(path).read_text("utf-8")))
        for path in _paths(kind)
    }


def _licensed(project: str, licence: str | None) -> str:
    """A pyproject.toml with this licence, or with none."""
    without = re.sub(r"^license = .*\n", "", project, flags=re.MULTILINE)
    line = f'\nlicense = "{licence}"\ndependencies = ['
    return without.replace("\ndependencies = [", line, 1) if licence else without


def _names_of(kind: str) -> Collection[str]:
    """Names already taken: installed plugins, verbs, or options of ``suite=``."""
    if kind == "suite":
        return _options.options("suite")
    return _verbs.verbs() if kind == "verb" else registry.names(f"{kind}s")


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _paths(kind: str) -> list[str]:
    modules = [f"src/tactileforge_example/{file}" for file in ("__init__.py", *_FILES[kind])]
    return ["pyproject.toml", "README.md", *modules, f"tests/test_{kind}.py"]


def _sections_of(kind: str, text: str) -> str:
    """Drops the sections of pyproject.toml and README.md about other kinds of plugins."""
    sections = re.split(r"^(?=## |\[)", text, flags=re.MULTILINE)
    foreign = (
        {*_KINDS, "container", "suite"} - {kind} - ({"head"} if kind == "objective" else set())
    )
    groups = {other: _GROUPS.get(other, f"{other}s") for other in foreign}
    groups |= {"schedule": "schedules"} if "optimizer" in foreign else {}
    heads = [
        rf"## The {other}$|\[project\.entry-points\.\"tactileforge\.{group}"
        for other, group in groups.items()
    ]
    heads.append("## Licence$")  # of the example itself
    if kind != "suite":
        heads.append(r"\[tool\.setuptools\.package-data")
    about_others = re.compile("|".join(heads), re.MULTILINE)
    kept = "".join(section for section in sections if not about_others.match(section))
    # what tests of another kind need
    return re.sub(rf"^.*  # the ({'|'.join(sorted(foreign))})\n", "", kept, flags=re.MULTILINE)


COMMANDS = {
    "list": Command(run=_list, keys=_List),
    "check": Command(run=_check, keys=_Check, bare=("names",), others="options"),
    "keys": Command(run=_keys, keys=_Keys, bare=("names",)),
    "new": Command(run=_new, keys=_New, into=True, bare=("kind", "name"), also={"from": "source"}),
}
