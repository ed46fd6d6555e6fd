"""The installed checks by name, and the chosen ones."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache

from tactileforge.checks.check import Check
from tactileforge.errors import ConfigError, PluginError, unknown
from tactileforge.plugins import registry


@cache
def catalogue() -> dict[str, type[Check]]:
    """Classes of the installed checks, by name, in the order of their codes.

    Raises:
        PluginError: A check cannot be imported, or two have one code.
    """
    found: dict[str, type[Check]] = {}
    codes: dict[str, str] = {}
    for name in registry.names("checks"):
        plugin: type[Check] = registry.get("checks", name)
        plugin.name = name
        if plugin.code in codes:
            raise PluginError(
                f"checks {codes[plugin.code]!r} and {name!r} both have the code {plugin.code}: "
                "uninstall one of the two packages"
            )
        codes[plugin.code] = name
        found[name] = plugin
    return dict(sorted(found.items(), key=lambda item: item[1].code))


def chosen(
    select: Iterable[str] = (), ignore: Iterable[str] = (), without: Iterable[str] = ()
) -> list[type[Check]]:
    """Choose checks by their codes, the beginnings of codes, or names.

    Args:
        select: Codes to run; none for all.
        ignore: Codes to leave out.
        without: Needs of checks that cannot be met; see `check.NEEDS`.

    Raises:
        ConfigError: No check has such a code.

    Example:
        >>> " ".join(check.code for check in chosen(select=["TF2"], ignore=["TF20"]))
        'TF210 TF211'
        >>> " ".join(check.name for check in chosen(select=["TF202", "mirrored"]))
        'pulling_force mirrored'
    """
    select, ignore, without = tuple(select), tuple(ignore), frozenset(without)
    known = catalogue()
    for key, given in (("select", select), ("ignore", ignore)):
        for one in given:
            if not any(_is(check, one) for check in known.values()):
                every = [*(check.code for check in known.values()), *known]
                raise ConfigError(f"{key}: {unknown('check', one, every)}")
    return [
        check
        for check in known.values()
        if (not select or any(_is(check, one) for one in select))
        and not any(_is(check, one) for one in ignore)
        and not check.needs & without
    ]


def _is(check: type[Check], given: str) -> bool:
    return given == check.name or (given != "" and check.code.startswith(given))


def built(checks: Sequence[type[Check]]) -> list[Check]:
    """Build checks anew, for one set."""
    return [check() for check in checks]
