"""Pointers of Git LFS and git-annex: lines of text in place of an unfetched file."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from tactileforge.errors import DataError

#: First bytes of a pointer (Git LFS specification 1; git-annex, pointer files), and what fetches.
_STARTS = {
    b"version https://git-lfs.github.com/spec/": ("Git LFS", "git lfs pull"),
    b"version https://hawser.github.com/spec/": ("Git LFS", "git lfs pull"),
    b"/annex/objects/": ("git-annex", "git annex get"),
}
#: Largest size of a pointer: Git LFS looks at no larger files, bytes.
_LARGEST = 1024


def pointer_words(content: bytes) -> str:
    """Kind of a pointer, and the way to get its file; "" for another.

    Args:
        content: The file, or its first bytes.

    Example:
        >>> pointer_words(b"version https://git-lfs.github.com/spec/v1")
        'a pointer of Git LFS, not the file: git lfs pull, or download it again'
    """
    for start, (program, fix) in _STARTS.items():
        if content.startswith(start):
            return f"a pointer of {program}, not the file: {fix}, or download it again"
    return ""


def check_pointer(path: str | Path, start: int = 0) -> None:
    """Refuse an unreadable file if it is a pointer; an absent file passes.

    Args:
        path: The file.
        start: Position of its first byte, within another file.

    Raises:
        DataError: It is one; says how to get the file.
    """
    with suppress(OSError):
        place = Path(path)
        if start == 0 and not (place.is_file() and place.stat().st_size <= _LARGEST):
            return
        with place.open("rb") as file:
            file.seek(start)
            if words := pointer_words(file.read(64)):
                raise DataError(f"{path}: {words}")
