"""Files: the cache folder, atomic writing, and checksums."""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import os
import platform
import re
import shutil
import stat
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

from platformdirs import user_cache_path

from tactileforge.errors import ConfigError, DataError, full, home_path, too_many_files
from tactileforge.util.regular import open_regular
from tactileforge.util.untrusted import dump_yaml, load_json, load_yaml

log = logging.getLogger(__name__)

#: Seconds without a write after which a part counts as left by a killed process.
_ABANDONED = 3600.0
#: Ending of the name of a part: its machine and process, then further words.
_PART = re.compile(r"(?:\.([^.-]+)-(\d+)\.\w+|\.\w+)?\.part(?:\.\w+)?$")
#: Error numbers of a place that cannot be written.
_UNWRITABLE = frozenset({errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.ENAMETOOLONG})
#: Error numbers of too many open files, of this process and of the machine.
NO_FILES = frozenset({errno.EMFILE, errno.ENFILE})
_CACHE_FIX = "set TACTILEFORGE_CACHE= to a folder that can be written"
_SPECIAL = "a device, pipe or socket"
#: Bytes of a trial write, which fails on a full disk.
_BLOCK = 4096
#: First line of a sealed YAML, up to the checksum of the text below it.
_SEAL = "# sha256 (remove this line where you change the file): "


def cache_folder(path: str | None = None) -> Path:
    r"""The folder given, else ``$TACTILEFORGE_CACHE``, else the system's folder for it.

    That is ``~/.cache/tactileforge`` on Linux, ``~/Library/Caches/tactileforge`` on macOS and
    ``%LOCALAPPDATA%\tactileforge\Cache`` on Windows.

    Example:
        >>> cache_folder("kept").name
        'kept'
    """
    if path := path or os.environ.get("TACTILEFORGE_CACHE"):
        return home_path(path)
    return user_cache_path("tactileforge", appauthor=False)


@contextmanager
def usual_mode(path: Path) -> Iterator[None]:
    """Gives a new file of a library, private to its owner, the permissions of the umask.

    Example:
        >>> with usual_mode(Path("a.safetensors")):
        ...     _ = Path("a.safetensors").write_bytes(b"")
    """
    path.touch()
    mode = path.stat().st_mode
    yield
    path.chmod(mode)


def write_text(path: Path, text: str) -> None:
    """Writes a text file beside its place, then renames it; creates its folder.

    Example:
        >>> write_text(Path("out/table.csv"), "a,b")
        >>> Path("out/table.csv").read_text()
        'a,b'
    """
    with new_part(path) as part:
        part.write_text(text, encoding="utf-8")
        part.replace(path)


@contextmanager
def new_part(target: Path, suffix: str = "") -> Iterator[Path]:
    """A temporary name beside a file or folder, unique to this process, to write to.

    The part is removed at the end, if it still exists. Parts of the same target left by killed
    processes are removed at the start; see `sweep_parts`.

    Args:
        target: The file or folder to write.
        suffix: Ending of the name, for writers that choose a format by it.

    Raises:
        DataError: The target is a device, pipe or socket.

    Example:
        >>> with new_part(Path("table.csv")) as part:
        ...     _ = part.write_text("a,b")
        ...     _ = part.rename("table.csv")
        >>> Path("table.csv").read_text()
        'a,b'
    """
    if _is_special(target):  # renaming a part would put a file in place of a device
        raise DataError(f"{target}: {_SPECIAL}, not a file; give another place")
    target.parent.mkdir(parents=True, exist_ok=True)
    sweep_parts(target.parent, f".{target.name}.")
    part = part_name(target, suffix)
    try:
        yield part
    finally:
        _remove(part)


def _is_special(path: Path) -> bool:
    try:
        mode = path.stat().st_mode  # asked once: another process may remove the file meanwhile
    except (OSError, ValueError):  # absent, or not to be looked at: an attempt to write says why
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def part_name(target: Path, suffix: str = "") -> Path:
    """A new name beside a file, with its machine and process; see `sweep_parts`."""
    owner = f"{_node()}-{os.getpid()}"
    return target.with_name(f".{target.name}.{owner}.{uuid4().hex[:8]}.part{suffix}")


def say_swept(folder: Path, count: int) -> None:
    """Logs the number of parts removed by `sweep_parts`, if any."""
    if count:
        parts = "1 part of a file" if count == 1 else f"{count} parts of files"
        log.warning("%s: removed %s that a stopped command had left", folder, parts)


def sweep_parts(folder: Path, start: str = "", alone: bool = False) -> int:
    """Removes parts of files left in a folder by killed processes.

    A part is abandoned if the process in its name no longer runs on this machine, or if nobody has
    written to it for an hour.

    Args:
        folder: Folder of the parts; folders below are not searched.
        start: Start of their names.
        alone: Whether no other process writes into the folder, so that every part is abandoned.

    Returns:
        Number of removed parts.
    """
    found = [path for path in _listed(folder) if path.name.startswith(start)]
    abandoned = [
        path
        for path in found
        if (match := _PART.search(path.name)) and (alone or _is_abandoned(path, match))
    ]
    for path in abandoned:
        _remove(path)
    return len(abandoned)


def _listed(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:  # it does not exist, or is a file
        return []


def _is_abandoned(path: Path, match: re.Match[str]) -> bool:
    if match[1] == _node() and not _runs(int(match[2])):
        return True
    try:
        return time.time() - path.stat().st_mtime > _ABANDONED
    except FileNotFoundError:  # another process has removed it meanwhile
        return False


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # it runs, for another user
        return True
    return True


def _remove(part: Path) -> None:
    if part.is_dir() and not part.is_symlink():
        shutil.rmtree(part, ignore_errors=True)
    else:
        part.unlink(missing_ok=True)


def _node() -> str:
    """Name of this machine in the names of parts."""
    return re.sub(r"\W", "", platform.node()) or "machine"


def sync(path: Path) -> None:
    """Waits until a file is on the disk; renamed before, a power cut could leave an empty one."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def check_writable(path: Path, fix: str = "give another out=", folder: bool = False) -> None:
    """Checks whether a file or folder can be written, before work on its content.

    Args:
        path: The file or folder; folders above it need not exist yet.
        fix: Fix to state in the error.
        folder: Whether ``path`` is a folder.

    Raises:
        ConfigError: The place is read-only, full, or of the other kind; states the fix.
    """
    try:
        if path.is_dir() and not folder:
            raise IsADirectoryError(errno.EISDIR, "a folder is there")
        if _is_special(path):
            raise FileExistsError(errno.EEXIST, f"{_SPECIAL} is there")
        place = path.absolute() if folder else path.absolute().parent
        while not place.exists():
            place = place.parent
        if not place.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"{place} is a file, not a folder")
        # by its own name: a part has a longer one, which may be too long
        with new_part(place / ("probe" if folder else path.name)) as part:
            part.write_bytes(bytes(_BLOCK))
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        reason = getattr(error, "strerror", None) or str(error)
        raise ConfigError(f"{path}: cannot be written ({reason}); {fix}") from error


def check_cache(path: str | None = None) -> None:
    """Checks whether the cache can be written, before work on its content.

    Args:
        path: Folder of the cache; None for the default of `cache_folder`.

    Raises:
        ConfigError: The cache cannot be written; states the fix.
    """
    check_writable(cache_folder(path), _CACHE_FIX, folder=True)


@contextmanager
def disk_errors_named(path: Path) -> Iterator[None]:
    """Turns disk errors into a one-line error with its fix.

    Args:
        path: File or folder being written.

    Raises:
        DataError: The disk is full or read-only, or the folder cannot be made.
    """
    try:
        yield
    except Exception as error:
        is_disk = isinstance(error, OSError) or type(error).__name__ == "SafetensorError"
        if not is_disk or isinstance(error, DataError):
            raise
        if getattr(error, "errno", None) in NO_FILES:
            raise DataError(f"{path}: {too_many_files()}") from error
        reason = (getattr(error, "strerror", None) or str(error)).splitlines()[0]
        raise DataError(
            f"{path}: cannot be written ({reason}); make room, or choose another place: out=, or "
            "TACTILEFORGE_CACHE for weights that are fetched"
        ) from error


def unwritable(error: OSError) -> str:
    """Message on a read-only or full place, or too many open files, with the fix; "" for others.

    Example:
        >>> unwritable(OSError(errno.EROFS, "Read-only file system", "a"))
        'a: cannot be written (Read-only file system); give another out= or hydra.run.dir='
        >>> unwritable(OSError(errno.ENOENT, "No such file"))
        ''
    """
    if error.errno in NO_FILES:
        return too_many_files()
    if error.errno not in _UNWRITABLE or not isinstance(error.filename, str):
        return full(error)
    path = Path(error.filename).absolute()
    fix = "give another out= or hydra.run.dir="
    if path.is_relative_to(cache_folder().absolute()):
        fix = _CACHE_FIX
    return full(error) or f"{error.filename}: cannot be written ({error.strerror}); {fix}"


def sha256(path: Path) -> str:
    """The hash of a regular file, in hexadecimal digits.

    Raises:
        DataError: It is a pipe, socket or device, which would be waited for, or a pointer.
    """
    with os.fdopen(open_regular(path), "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sealed(plain: Mapping[str, Any]) -> str:
    """Plain data as JSON with its checksum, ``sha256``; see `unsealed`."""
    return json.dumps({**plain, "sha256": _checksum(plain)}, indent=1)


def unsealed(text: str | bytes) -> dict[str, Any]:
    """The data of a text made by `sealed`.

    Raises:
        ValueError: The text is not JSON, has no checksum, or does not match it.
    """
    plain = load_json(text)
    if not isinstance(plain, dict) or "sha256" not in plain:
        raise ValueError("it has no checksum")
    stated = plain.pop("sha256")
    if stated != _checksum(plain):
        raise ValueError("its checksum does not match: bytes of it have changed")
    return plain


def refuse_shards(folder: Path) -> None:
    """Refuses a folder with shards, or with an index of shards.

    Raises:
        ConfigError: The folder has some; states the fix.
    """
    if any([*folder.glob("*.tar"), *folder.glob("index.json")]):
        raise ConfigError(f"{folder} holds shards of something else; give another out=")


def claim_folder(path: Path, made: Mapping[str, Any], what: str) -> None:
    """Records the settings of a folder's content, or checks them against the record.

    Shards without a record count as made with other settings.

    Args:
        path: File of the record.
        made: Settings, as plain data.
        what: The content of the folder, for errors.

    Raises:
        ConfigError: The folder was made with other settings, or the record is damaged.
    """
    wanted = json.loads(json.dumps(made))
    folders = [path.parent, *filter(Path.is_dir, _listed(path.parent))]
    say_swept(path.parent, sum(map(sweep_parts, folders)))
    if not path.exists():
        refuse_shards(path.parent)
        write_text(path, sealed(wanted))
        return
    try:
        recorded = unsealed(path.read_bytes())
    except ValueError as error:
        raise ConfigError(f"{path}: damaged ({error}); give another out=") from error
    if changed := [key for key in wanted if recorded.get(key) != wanted[key]]:
        raise ConfigError(
            f"{path.parent} holds {what} of another configuration (other {', '.join(changed)}); "
            "give another out="
        )


def sealed_yaml(plain: Mapping[str, Any], **options: Any) -> str:
    """Plain data as YAML, with its checksum in the first line.

    Args:
        plain: The data.
        options: Options of `untrusted.dump_yaml`.
    """
    text = dump_yaml(dict(plain), **options)
    return f"{_SEAL}{hashlib.sha256(text.encode()).hexdigest()}\n{text}"


def unsealed_yaml(text: str) -> Any:
    """Values of a text made by `sealed_yaml`.

    A text without the line of the checksum is not checked: users who edit the file remove the line.

    Raises:
        ValueError: The text is not YAML, or does not match its checksum.

    Example:
        >>> text = sealed_yaml({"a": 1})
        >>> unsealed_yaml(text), unsealed_yaml("a: 2")
        ({'a': 1}, {'a': 2})
        >>> unsealed_yaml(text.replace("a: 1", "a: 3"))
        Traceback (most recent call last):
        ValueError: its checksum does not match: it was changed, or damaged
    """
    first, _, rest = text.partition("\n")
    is_sealed = "sha256" in first or "remove this line" in first  # the line may be damaged
    if is_sealed and first != f"{_SEAL}{hashlib.sha256(rest.encode()).hexdigest()}":
        raise ValueError("its checksum does not match: it was changed, or damaged")
    return load_yaml(text)


def _checksum(plain: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()
