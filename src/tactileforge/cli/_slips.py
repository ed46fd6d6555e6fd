"""Errors of Hydra and YAML in one line, with the fix, read from their objects."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import QuotedString
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from tactileforge.cli._command import Command
from tactileforge.cli._known import unknown_below
from tactileforge.cli._options import options, own_places, yaml_groups
from tactileforge.cli._words import Words
from tactileforge.errors import ConfigError, TactileForgeError, unknown
from tactileforge.plugins.distributions import how_to_get
from tactileforge.plugins.kinds import GROUPS
from tactileforge.plugins.loading import dotted

#: Longest message of another library that is repeated, characters.
_LONGEST = 600
#: Options of Hydra's own groups that come as packages, ``hydra-NAME-GROUP``; source: Hydra 1.3.
_OF_PACKAGES = {
    "launcher": ("joblib", "ray", "rq", "submitit"),
    "sweeper": ("ax", "nevergrad", "optuna"),
}


@contextmanager
def told(
    verb: str, command: Command, words: Words, composing: Callable[[], bool] = lambda: True
) -> Iterator[None]:
    """Turns errors of composing a configuration into a ConfigError of one line.

    Args:
        verb: Verb and action as typed.
        command: Command whose configuration is composed.
        words: Words of the command line.
        composing: Tells whether composing is still going on, so that no work has begun; general
            Python errors are turned only then.

    Raises:
        ConfigError: The configuration cannot be composed; says the fix.
    """
    try:
        yield
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(_composing(command, verb, error, words)) from error
    except yaml.YAMLError as error:
        raise ConfigError(yaml_slip(error)) from error
    except RecursionError as error:
        if not composing():  # no YAML is to blame
            raise
        raise ConfigError(
            "the defaults of a YAML of yours choose its own group: an option that changes another "
            "one of its group begins with defaults: [OTHER, _self_]"
        ) from error
    except (ValueError, TypeError, AttributeError, LookupError, AssertionError) as error:
        if not composing():
            raise
        raise ConfigError(_wrong(error, words)) from error


def _wrong(error: Exception, words: Words) -> str:
    """Message for errors of composing without a message of Hydra's own."""
    overrides, own = own_places(words.overrides, words.flags)
    for override in OverridesParser.create().parse_overrides([*overrides]):
        given = override.value()
        names = override.is_delete() or isinstance(given, str | dict)
        if isinstance(given, list):
            names = all(isinstance(one, str | QuotedString) for one in given)
        if not (override.is_sweep_override() or names) and (
            known := _options(group := override.key_or_group, own)
        ):
            _, _, value = str(override.input_line).partition("=")
            return f"{group}={value}: give the name of an option. Known: {', '.join(known)}"
    places = f" in {', '.join(own)}" if own else ""
    if isinstance(error, UnicodeDecodeError):
        return f"a YAML{places} is not UTF-8 ({error.reason}); save it as UTF-8"
    return f"the configuration cannot be composed{places}: {type(error).__name__}: {_line(error)}"


def _known(group: str, own: Sequence[str]) -> str:
    return ", ".join(_options(group, own)) or "(none)"


def _options(group: str, own: Sequence[str]) -> list[str]:
    """Options of a group, including groups of Hydra itself."""
    return _of_hydra(group) if group.startswith("hydra/") else options(group, own)


def _line(error: BaseException | str) -> str:
    return re.sub(r"\s*\n\s*", "; ", str(error).strip())[:_LONGEST]


def _of_hydra(group: str) -> list[str]:
    """Options of a group of Hydra itself, such as ``hydra/launcher``."""
    from hydra.core.config_store import ConfigStore

    return sorted(name.removesuffix(".yaml") for name in ConfigStore.instance().list(group))


def yaml_slip(error: yaml.YAMLError) -> str:
    """Describes a YAML syntax error and its place in one line."""
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    where = f"{mark.name}, line {mark.line + 1}" if mark else "a YAML"
    what = getattr(error, "problem", None) or _line(error)
    return f"{where}: no YAML ({what}); correct that line or the one before it"


def _composing(command: Command, verb: str, error: Exception, words: Words) -> str:
    """Message for an error of composing, by its class, its attributes and its causes."""
    overrides, own = own_places(words.overrides, words.flags)
    if isinstance(error, OverrideParseException):
        fix = "quote values with special characters: \"key='value'\""
        return f"{error.override}: not key=value; {fix}"
    if isinstance(error, MissingConfigException):
        return _missing(error, overrides, own)
    for cause in _causes(error):
        if isinstance(cause, TactileForgeError):
            return _line(cause)
        if isinstance(cause, ConfigAttributeError | ConfigKeyError) and cause.full_key:
            key = str(cause.full_key)  # up to the first word that is unknown
            keys = (word.lstrip("+").partition("=")[0] for word in overrides)
            key = next((whole for whole in keys if whole.startswith(f"{key}.")), key)
            return unknown_key(command.name(verb), key, overrides, own)
    groups = dict(command.groups) or (yaml_groups(command.yaml) if command.yaml else {})
    typed = [word.partition("=")[0] for word in overrides]
    needed = [group for group, option in groups.items() if option == "???" and group not in typed]
    if needed:
        return f"give {needed[0]}=NAME; Known: {_known(needed[0], own)}"
    if key := _unused(groups, overrides, own):
        return unknown_key(command.name(verb), key, overrides, own)
    # the place of a slip often stands in the cause alone
    said, reason = str(error), str(error.__cause__ or "")
    return _line(said if reason in said else f"{said}\n{reason}")


def _causes(error: BaseException) -> Iterator[BaseException]:
    """The error, and those that it was raised from."""
    while error:
        yield error
        if error.__cause__ is None:
            return
        error = error.__cause__


def _missing(error: MissingConfigException, overrides: Sequence[str], own: Sequence[str]) -> str:
    """Message for an option that no place has: the nearest, or what brings it."""
    group, _, name = (error.missing_cfg_file or "").rpartition("/")
    if group.startswith("hydra/"):
        kind = group.partition("/")[2]
        if not name:
            return f"{group}=: give the name of an option. Known: {_known(group, own)}"
        package_of = name.removesuffix("_slurm").removesuffix("_local")
        if package_of in _OF_PACKAGES.get(kind, ()):
            package = f"hydra-{package_of}-{kind}"
            return f"{group}={name} comes with {package}: pip install {package}"
        return unknown(group, name, {*_of_hydra(group), *_OF_PACKAGES.get(kind, ())})
    if not group:
        return _line(str(error))
    # what was typed comes before a default, which Hydra may have looked for first
    typed = [word.partition("=")[::2] for word in overrides]
    missing = [(one, value) for one, value in typed if value not in options(one, own)]
    for one, value in [*missing, (group, name)]:
        if fix := how_to_get(GROUPS.get(one, one), value):
            return f"{one}={value} {fix}"
        if one == "data" and value and Path(value).expanduser().exists():
            return (
                f"data={value} is a path: videos and images are data=recordings data.root={value}; "
                f"tactileforge data inspect {value} says what reads anything else"
            )
    fix = dotted(name) if group in GROUPS else ""
    fix = fix or ("" if own else "Options of your own need --config-dir DIR")
    return unknown(group, name, options(group, own), fix)


def _unused(groups: Iterable[str], overrides: Sequence[str], own: Sequence[str]) -> str:
    """The typed group of options that the command has not; "" for none."""
    for override in OverridesParser.create().parse_overrides([*overrides]):
        name = override.key_or_group
        plain = not (override.is_add() or override.is_force_add() or override.is_delete())
        if plain and (name not in groups or override.package) and options(name, own):
            return f"{name}@{override.package}" if override.package else name
    return ""


def unknown_key(name: str, key: str, overrides: Sequence[str], own: Sequence[str] = ()) -> str:
    """Message for an unknown key, with the nearest key beside it or of the same name elsewhere.

    Args:
        name: Name of the configuration, see `compose.composed`.
        key: Key as typed.
        overrides: The typed ``key=value`` words.
        own: Further places of options, see `_options.own_places`.
    """
    from tactileforge.cli._compose import composed

    # keys depend on the chosen options alone; other words may be the ones that fail
    chosen = []
    for word in overrides:
        name_of_it = word.partition("=")[0]
        group = name_of_it.partition("@")[0].lstrip("+")
        if name_of_it.lstrip("+~") != key and "." not in group and options(group, own):
            chosen.append(word)
    try:
        config = composed(name, chosen)
    except HydraException:  # an option is unknown as well
        return f"unknown key {key!r}"
    group, _, rest = key.partition(".")
    if group == "callbacks" and rest and not config.get(group):
        name = rest.partition(".")[0]
        return (
            f"nothing reads {key}: callback {name!r} is not chosen; callbacks=[{name}] chooses it"
        )
    fix = ""
    if re.match(r"(data|tasks|curriculum)\..", key):  # blocks with names of the user's own
        fix = f". A key that is new: +{key}=..."
    return unknown_below(config, key, fix)
