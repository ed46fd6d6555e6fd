"""The errors that users meet. Each says what is wrong, where, and the fix."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class TactileForgeError(Exception):
    """Base of every error the package raises on purpose; the CLI prints it without a traceback."""


class PluginError(TactileForgeError):
    """A plugin is not installed, is ambiguous, or cannot be imported."""


class ConfigError(TactileForgeError):
    """The configuration contradicts itself, or the data it is to run on."""


class DataError(TactileForgeError):
    """A file of a data set is unreadable, or contradicts its labels."""


class DataNotFoundError(DataError):
    """A folder or file of a data set does not exist."""


class SensorError(TactileForgeError):
    """A device is absent, busy or unplugged, or does not send what it should."""


def nearest_name(name: str, known: Iterable[str]) -> str:
    """What follows an unknown name in an error: the nearest that is known, or a full stop.

    Example:
        >>> nearest_name("trian", ["train", "report"])
        "; did you mean 'train'?"
    """
    near = get_close_matches(name, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else "."


def unknown(what: str, name: str, known: Iterable[str], fix: str = "") -> str:
    """Says that a name is unknown, which names are known, and the nearest one.

    Example:
        >>> unknown("sensor", "digitt", ["digit", "gelsight"])
        "unknown sensor 'digitt'; did you mean 'digit'? Known: digit, gelsight"
    """
    names = sorted(known)
    text = (
        f"unknown {what} {name!r}{nearest_name(name, names)} Known: {', '.join(names) or '(none)'}"
    )
    return f"{text}. {fix}" if fix else text
