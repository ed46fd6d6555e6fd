"""The errors shown to users. Each says what is wrong, where, and the fix."""

from __future__ import annotations

import errno
import shlex
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from pathlib import Path


class TactileForgeError(Exception):
    """Base of the errors raised on purpose; the CLI prints them without a traceback."""

    def __init__(self, *words: object) -> None:
        super().__init__(*(in_utf8(one) if isinstance(one, str) else one for one in words))


class PluginError(TactileForgeError):
    """A plugin is not installed, is ambiguous, or cannot be imported."""


class ConfigError(TactileForgeError):
    """The configuration contradicts itself or its data.

    Example:
        >>> raise ConfigError("fps=0: give a value above 0")
        Traceback (most recent call last):
        tactileforge.errors.ConfigError: fps=0: give a value above 0
    """


class DataError(TactileForgeError):
    """A file of a data set is unreadable, or contradicts its labels."""


class DataNotFoundError(DataError):
    """A folder or file of a data set does not exist, or a mixture has no source."""


class SensorError(TactileForgeError):
    """A device is absent, busy or unplugged, or sends invalid data."""


#: Error numbers of a full disk: no space, over the quota, file too large.
_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


def in_utf8(text: str) -> str:
    r"""A text with bytes that are no UTF-8, as names of files may have them, in digits.

    Example:
        >>> in_utf8("touch" + chr(0xDCFF) + ".csv")
        'touch\\udcff.csv'
    """
    return text if text.isascii() else text.encode("utf-8", "backslashreplace").decode("utf-8")


def home_path(path: str | Path) -> Path:
    """A path with ``~`` as the home folder.

    Raises:
        ConfigError: ``~name`` of no user.

    Example:
        >>> home_path("~/touches") == Path.home() / "touches"
        True
    """
    try:
        return Path(path).expanduser()
    except RuntimeError as error:
        raise ConfigError(
            f"{path}: no user of that name has a home folder here; give the whole path, or ./ "
            "before a folder of that name"
        ) from error


def full(error: OSError) -> str:
    """Message on a full disk, with its place and the fix; "" for any other error.

    Example:
        >>> full(OSError(errno.ENOSPC, "No space left on device", "runs/a/report.html"))
        'runs/a/report.html: the disk is full (No space left on device); make room, and go on'
        >>> full(OSError(errno.ENOENT, "No such file"))
        ''
    """
    if error.errno not in _FULL:
        return ""
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}the disk is full ({error.strerror}); make room, and go on"


def too_many_files() -> str:
    """Message on too many open files, with the limit of this process and the fix.

    Example:
        >>> too_many_files().partition(" (")[0]
        'too many open files'
    """
    try:
        import resource
    except ImportError:  # no POSIX system
        return "too many open files: close other programs"
    allowed = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return f"too many open files ({allowed} are allowed): ulimit -n {max(4096, 4 * allowed)} first"


def command(*words: str) -> str:
    """Command of this package, quoted for a shell.

    Example:
        >>> command("train", "resume=runs/a b")
        "tactileforge train 'resume=runs/a b'"
    """
    return shlex.join(["tactileforge", *words])


def nearest_name(name: str, known: Iterable[str]) -> str:
    """Ending of an error on an unknown name: the nearest known name, or a full stop.

    Example:
        >>> nearest_name("trian", ["train", "report"])
        "; did you mean 'train'?"
        >>> nearest_name("fx", ["FX", "FY"])
        "; did you mean 'FX'?"
    """
    spelled = {one.casefold(): one for one in known}
    near = get_close_matches(name.casefold(), list(spelled), n=1)
    return f"; did you mean {spelled[near[0]]!r}?" if near else "."


def check_names(what: str, names: Iterable[str], known: Collection[str], fix: str = "") -> None:
    """Checks names against the known ones; the arguments are those of `unknown`.

    Raises:
        ConfigError: A name is unknown.
    """
    for name in names:
        if name not in known:
            raise ConfigError(unknown(what, name, known, fix))


#: Most known names that an error lists.
_MOST_LISTED = 60


def unknown(what: str, name: str, known: Iterable[str], fix: str = "") -> str:
    """Message on an unknown name, with the nearest known one, and all if they are few.

    Example:
        >>> unknown("sensor", "digitt", ["digit", "gelsight"])
        "unknown sensor 'digitt'; did you mean 'digit'? Known: digit, gelsight"
    """
    names = sorted(known)
    if len(names) > _MOST_LISTED:
        of = f"{len(names)} are known"
    else:
        of = f"Known: {', '.join(names) or '(none)'}"
    text = f"unknown {what} {name!r}{nearest_name(name, names)} {of}"
    return f"{text}. {fix}" if fix else text
