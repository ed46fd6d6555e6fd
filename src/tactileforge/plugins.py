"""``tactileforge plugins list | check | new``."""

from __future__ import annotations

import argparse
import json
import keyword
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.resources import files
from inspect import Parameter
from pathlib import Path
from typing import Any

from tactileforge import registry
from tactileforge.errors import ConfigError, PluginError, SensorError, unknown

_KINDS = [kind.removesuffix("s") for kind in registry.KINDS]


def main(argv: Sequence[str]) -> int:
    """Runs the verb.

    Args:
        argv: The words after ``tactileforge plugins``.

    Returns:
        The exit code: 1 if a check failed, else 0.

    Raises:
        PluginError: A name that is not installed.
        ConfigError: Options that do not fit, or a package that exists already.
        SensorError: Attached sensors are to be checked, and none is attached.
    """
    parser = _parser()
    words, rest = parser.parse_known_args(argv)
    if words.action == "check":
        # argparse leaves words after a flag
        return _check([*words.words, *rest], words.kind, words.attached)
    if rest:
        parser.error(f"unknown words: {' '.join(rest)}")
    if words.action == "new":
        return _new(words.kind, words.name, words.out)
    return _list(words.json)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "tactileforge plugins", description="Plugins: see, check, make."
    )
    actions = parser.add_subparsers(dest="action", required=True)
    show = actions.add_parser("list", help="what is installed; imports none of it")
    show.add_argument("--json", action="store_true", help="for programs")
    check = actions.add_parser("check", help="the conformance suite")
    check.add_argument("words", nargs="*", metavar="NAME | key=value", help="names; options of one")
    check.add_argument("--kind", choices=_KINDS, help="only this kind")
    check.add_argument("--attached", action="store_true", help="each sensor that is attached")
    new = actions.add_parser("new", help="write a package to start from")
    new.add_argument("kind", choices=sorted(_FILES))
    new.add_argument("name", help="the word users will type, snake_case")
    new.add_argument(
        "--out", type=Path, default=Path(), help="folder to write it in (default: here)"
    )
    return parser


def _list(as_json: bool) -> int:
    rows = [asdict(plugin) for plugin in registry.list_plugins()]
    for row in rows:
        row["kind"] = row["kind"].removesuffix("s")
    if as_json:
        print(json.dumps(rows, indent=2))
        return 0
    columns = ("name", "kind", "distribution", "version", "status")
    table = [columns, *(tuple(str(row[column]) for column in columns) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for line in table:
        print("  ".join(map(str.ljust, line, widths)).rstrip())
    return 0


def _check(words: Sequence[str], kind: str | None, attached: bool) -> int:
    from omegaconf import OmegaConf

    from tactileforge.testing import check

    names = [word for word in words if "=" not in word]
    settings = [word for word in words if "=" in word]
    plugins = _chosen(names, kind)
    if settings and len(plugins) != 1:
        raise ConfigError(
            f"{settings[0]} is an option of one plugin, and {len(plugins)} are checked: "
            "name one, and its --kind"
        )
    options: Any = OmegaConf.to_container(OmegaConf.from_dotlist(settings))
    runs = _attached(plugins, options) if attached else [(*plugin, options) for plugin in plugins]
    counts = dict.fromkeys(("ran", "failed", "expected", "skipped"), 0)
    for plugin_kind, name, given in runs:
        address = [f"{key}={given[key]}" for key in _ADDRESSES if attached and key in given]
        print(" ".join([plugin_kind.removesuffix("s"), name, *address]), flush=True)
        for result in check(plugin_kind, name, **given):
            counts[result.status] += 1
            first, *_ = result.detail.splitlines() or [""]
            print(f"  {result.status:<9}{result.name}{': ' * bool(first)}{first}")
    print(", ".join(f"{count} {status}" for status, count in counts.items()))
    return 1 if counts["failed"] else 0


#: Options that say which device a sensor opens.
_ADDRESSES = ("device", "port")


def _attached(
    plugins: Sequence[tuple[str, str]], options: Mapping[str, Any]
) -> list[tuple[str, str, dict[str, Any]]]:
    """Each sensor that is attached, with the options that open it; and each that is broken."""
    found = []
    for kind, name in plugins:
        if kind != "sensors":
            continue
        try:
            known = registry.parameters(registry.get(kind, name))
        except PluginError:
            found.append((kind, name, dict(options)))
            continue
        if any(known[key] is Parameter.empty and key not in options for key in known):
            continue
        key = next((key for key in _ADDRESSES if key in known), "")
        for address in registry.build(kind, {"name": name, **options}).discover():
            found.append((kind, name, {**options, key: address} if key else dict(options)))
    if not found:
        raise SensorError("none of the sensors is attached: plug one in, or give its port=")
    return found


def _chosen(names: Sequence[str], kind: str | None) -> list[tuple[str, str]]:
    installed = [(k, n) for k in registry.KINDS for n in registry.names(k)]
    within = [(k, n) for k, n in installed if kind in (None, k.removesuffix("s"))]
    for name in names:
        if name not in (n for _, n in within):
            raise PluginError(unknown(kind or "plugin", name, {n for _, n in within}))
    return [(k, n) for k, n in within if not names or n in names]


#: Files of the example that a plugin of a kind needs, beside those that every package has.
_FILES = {
    "sensor": ("sensor.py", "synthetic.py"),
    "dataset": ("dataset.py", "synthetic.py"),
    "objective": ("objective.py", "head.py"),
}
#: What the example calls its plugin of a kind.
_NAMES = {"sensor": "dummy", "dataset": "dummy_presses", "objective": "contact_area"}


def _new(kind: str, name: str, out: Path) -> int:
    class_name = _camel(name)
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name) or keyword.iskeyword(class_name):
        raise ConfigError(f"{name!r} is no name for a plugin: use snake_case, e.g. my_{kind}")
    if name in registry.names(f"{kind}s"):
        raise ConfigError(f"an installed {kind} has the name {name!r}: choose another")
    package = f"tactileforge_{name}"
    folder = out / package.replace("_", "-")
    if folder.exists():
        raise ConfigError(f"{folder} exists: choose another name, or --out another folder")
    own = _NAMES[kind]
    words = {
        "dummy": "digit",  # a published type of sensor stands in for the example's own
        "tactileforge-example": folder.name,
        "tactileforge_example": package,
        own: name,
        _camel(own): class_name,
    }
    longest_first = sorted(words, key=len, reverse=True)
    pattern = re.compile("|".join(map(re.escape, longest_first)))
    source = files("tactileforge.example") / "tactileforge-example"
    for path in _paths(kind):
        text = _sections_of(kind, source.joinpath(path).read_text("utf-8"))
        target = folder / path.replace("tactileforge_example", package)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(pattern.sub(lambda match: words[match[0]], text), "utf-8")
    print(f"wrote {folder}\nnext: pip install -e {folder} && tactileforge plugins check {name}")
    return 0


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _paths(kind: str) -> list[str]:
    modules = [f"src/tactileforge_example/{file}" for file in ("__init__.py", *_FILES[kind])]
    return ["pyproject.toml", "README.md", *modules, f"tests/test_{kind}.py"]


def _sections_of(kind: str, text: str) -> str:
    """Drops the sections of pyproject.toml and README.md that are about other kinds."""
    sections = re.split(r"^(?=## |\[)", text, flags=re.MULTILINE)
    foreign = set(_KINDS) - {kind} - ({"head"} if kind == "objective" else set())
    heads = [
        rf"## The {other}$|\[project\.entry-points\.\"tactileforge\.{other}s" for other in foreign
    ]
    about_others = re.compile("|".join(heads), re.MULTILINE)
    return "".join(section for section in sections if not about_others.match(section))
