"""Files: the cache folder, whole or absent, and their hashes."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

from tactileforge.errors import ConfigError, DataError
from tactileforge.untrusted import dump_yaml, load_json, load_yaml

#: Seconds after which a part that nobody writes to is that of a process that was killed.
_ABANDONED = 3600.0
#: First line of a sealed YAML, before the checksum of what follows.
_SEAL = "# sha256 (remove this line where you change the file): "


def cache_folder(path: str | None = None) -> Path:
    """The folder given, else ``$TACTILEFORGE_CACHE``, else ``tactileforge`` in the user's cache.

    Example:
        >>> cache_folder("kept").name
        'kept'
    """
    if path := path or os.environ.get("TACTILEFORGE_CACHE"):
        return Path(path).expanduser()
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "tactileforge"


def write_text(path: Path, text: str) -> None:
    """Writes a text file beside its place, then renames it; makes its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def new_part(target: Path) -> Iterator[Path]:
    """A name beside a file, for the time in which it is written; of this process alone.

    It is removed at the end, if it is still there. Parts that killed processes left are removed
    when nobody has written to them for an hour.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    for old in target.parent.glob(f".{target.name}.*.part"):
        with suppress(FileNotFoundError):  # another process may do the same
            if time.time() - old.stat().st_mtime > _ABANDONED:
                old.unlink()
    part = target.with_name(f".{target.name}.{uuid4().hex}.part")
    try:
        yield part
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turns what goes wrong with a disk into an error of one line, with the fix.

    Args:
        path: That is written.

    Raises:
        DataError: The disk is full or read-only, or the folder cannot be made.
    """
    try:
        yield
    except Exception as error:
        is_disk = isinstance(error, OSError) or type(error).__name__ == "SafetensorError"
        if not is_disk or isinstance(error, DataError):
            raise
        reason = (getattr(error, "strerror", None) or str(error)).splitlines()[0]
        raise DataError(
            f"{path}: cannot be written ({reason}); make room, or choose another place: out=, or "
            "TACTILEFORGE_CACHE for weights that are fetched"
        ) from error


def sha256(path: Path) -> str:
    """The hash of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sealed(plain: Mapping[str, Any]) -> str:
    """Plain data as JSON with its checksum, ``sha256``; see `unsealed`."""
    return json.dumps({**plain, "sha256": _checksum(plain)}, indent=1)


def unsealed(text: str | bytes) -> dict[str, Any]:
    """The data of a text that `sealed` made.

    Raises:
        ValueError: It is another text, or one byte that counts has changed.
    """
    plain = load_json(text)
    if not isinstance(plain, dict) or "sha256" not in plain:
        raise ValueError("it has no checksum")
    stated = plain.pop("sha256")
    if stated != _checksum(plain):
        raise ValueError("its checksum is another: bytes of it have changed")
    return plain


def refuse_shards(folder: Path) -> None:
    """Refuses a folder that holds shards, or their index.

    Raises:
        ConfigError: It does; says the fix.
    """
    if any([*folder.glob("*.tar"), *folder.glob("index.json")]):
        raise ConfigError(f"{folder} holds shards of something else; give another out=")


def claim(path: Path, made: Mapping[str, Any], what: str) -> None:
    """Records in a folder what it is made with, or checks that it is made with the same.

    Shards without a record are those of something else.

    Args:
        path: File of the record.
        made: Plain data.
        what: The content of the folder, for errors.

    Raises:
        ConfigError: The folder is made with something else, or the record is damaged.
    """
    wanted = json.loads(json.dumps(made))
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
        options: Of `untrusted.dump_yaml`.
    """
    text = dump_yaml(dict(plain), **options)
    return f"{_SEAL}{hashlib.sha256(text.encode()).hexdigest()}\n{text}"


def unsealed_yaml(text: str) -> Any:
    """Values of a text that `sealed_yaml` made; who changes it on purpose removes the first line.

    Raises:
        ValueError: It is another text, or one byte that counts has changed.

    Example:
        >>> text = sealed_yaml({"a": 1})
        >>> unsealed_yaml(text), unsealed_yaml("a: 2")
        ({'a': 1}, {'a': 2})
        >>> unsealed_yaml(text.replace("a: 1", "a: 3"))
        Traceback (most recent call last):
        ValueError: its checksum is another: it was changed, or damaged
    """
    first, _, rest = text.partition("\n")
    is_sealed = "sha256" in first or "remove this line" in first  # one of them, at least
    if is_sealed and first != f"{_SEAL}{hashlib.sha256(rest.encode()).hexdigest()}":
        raise ValueError("its checksum is another: it was changed, or damaged")
    return load_yaml(text)


def _checksum(plain: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()
