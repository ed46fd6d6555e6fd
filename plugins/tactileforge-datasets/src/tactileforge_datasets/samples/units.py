"""Samples of a tar, and their grouping into recordings."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from tactileforge.data import Blob, is_companion
from tactileforge_datasets.samples.layout import FRAME, SampleLayout
from tactileforge_datasets.samples.members import read_members
from tactileforge_datasets.samples.places import fields_of


@dataclass(frozen=True)
class Sample:
    """Members of a tar with one key.

    Attributes:
        key: Name up to the first dot behind the last slash.
        parts: Content by the ending behind that dot, in lower case.
        frame: Number of the frame, by the key; 0 where a sample is a recording.
    """

    key: str
    parts: Mapping[str, Blob]
    frame: int = 0


@dataclass(frozen=True)
class Unit:
    """A recording before it is opened.

    Attributes:
        name: Its key in the tar; of several samples, the values of the key's placeholders.
        samples: Its samples, in the order of their frames.
        values: Values of the placeholders.
    """

    name: str
    samples: Sequence[Sample]
    values: Mapping[str, str]


@dataclass
class SampleTar:
    """Recordings of a tar before opening, and the problems of the others.

    Attributes:
        units: Recordings, in the order of their first members.
        skipped: Lines about samples that are left out, each with their number.
        unread: Members by ending that no layout names, with their number.
    """

    units: list[Unit] = field(default_factory=list)
    skipped: list[tuple[str, int]] = field(default_factory=list)
    unread: dict[str, int] = field(default_factory=dict)


def read_samples(path: Path, name: str, layout: SampleLayout) -> SampleTar:
    """Samples of a tar, from its headers alone.

    Args:
        path: Path of the tar.
        name: Name of the tar without its ending, the placeholder ``{tar}``.
        layout: Layout of the samples.

    Raises:
        DataError: The file is not a tar, or has no members.
    """
    index, found = read_members(path), SampleTar()
    samples, twice, odd = grouped(index.members)
    if index.damage:
        found.skipped.append((f"{path}: damaged ({index.damage}); download it again", 1))
        if samples:  # the last one may lack a part
            samples.pop(next(reversed(samples)))
    _say(found, path, "members without a key and an ending", odd)
    _say(found, path, "samples with a part that comes twice", twice)
    for key in twice:
        samples.pop(key, None)
    known = layout.parts
    numbered = _pattern(layout.touch) if layout.numbered else None
    for parts in samples.values():
        for part in parts:
            if part not in known and not (numbered and numbered.fullmatch(part)):
                found.unread[part] = found.unread.get(part, 0) + 1
    found.units = list(_units(samples, name, layout, path, found))
    return found


def grouped(
    members: Sequence[tuple[str, Blob]],
) -> tuple[dict[str, dict[str, Blob]], list[str], list[str]]:
    """Samples by key; keys of samples with a repeated part; names without a key.

    Args:
        members: Names and contents, see `members.TarIndex`.
    """
    samples: dict[str, dict[str, Blob]] = {}
    twice: dict[str, None] = {}
    odd = []
    for name, blob in members:
        folder, slash, file = name.removeprefix("./").rpartition("/")
        start, _, part = file.partition(".")
        if not start or not part or is_companion(PurePosixPath(name.removeprefix("./"))):
            odd.append(name)
            continue
        parts = samples.setdefault(folder + slash + start, {})
        if part.lower() in parts:
            twice[folder + slash + start] = None
        parts[part.lower()] = blob
    return samples, list(twice), odd


def _units(
    samples: Mapping[str, dict[str, Blob]],
    name: str,
    layout: SampleLayout,
    path: Path,
    found: SampleTar,
) -> Iterator[Unit]:
    """Yields the recordings of samples; notes keys unlike the layout's."""
    pattern = _pattern(layout.samples) if layout.samples else None
    clips: dict[tuple[str, ...], list[Sample]] = {}
    unlike = []
    for key, parts in samples.items():
        match = pattern.fullmatch(key) if pattern else None
        if pattern and not match:
            unlike.append(key)
            continue
        values = match.groupdict() if match else {}
        number = values.pop(FRAME, "0")
        alike = (*values.items(), *([] if layout.by_frame else [("key", key)]))
        # 18 digits fit int64
        row = Sample(key, parts, int(number[-18:]))
        clips.setdefault(tuple(map("=".join, alike)), []).append(row)
    _say(found, path, f"samples whose key is unlike layout.samples={layout.samples}", unlike)
    for rows in clips.values():
        rows.sort(key=lambda row: row.frame)
        numbers = [row.frame for row in rows]
        again = [row.key for row, last in zip(rows[1:], numbers, strict=False) if row.frame == last]
        if again:
            _say(found, path, "recordings with two frames of one number", again[:1])
            continue
        match = pattern.fullmatch(rows[0].key) if pattern else None
        values = match.groupdict() if match else {}
        values.pop(FRAME, None)
        unit = "/".join(values.values()) if layout.by_frame else rows[0].key
        folder = rows[0].key.rpartition("/")[0]
        always = {"key": rows[0].key, "tar": name, "folder": folder}
        yield Unit(unit or name, rows, {**always, **values})


def _pattern(template: str) -> re.Pattern[str]:
    """Pattern of a template of keys or parts: a placeholder holds no slash, ``{frame}`` digits."""
    text = re.escape(template)
    for field_ in fields_of(template):
        value = r"\d+" if field_ == FRAME else "[^/]+"
        text = text.replace(re.escape(f"{{{field_}}}"), f"(?P<{field_}>{value})")
    return re.compile(text)


def numbered_parts(sample: Sample, template: str) -> list[str]:
    """Parts of numbered pictures, by value of their numbers.

    Args:
        sample: The sample.
        template: Name of the parts with ``{frame}``.
    """
    pattern = _pattern(template.lower())
    found = [(pattern.fullmatch(part), part) for part in sample.parts]
    return [part for _, part in sorted((int(m[FRAME]), part) for m, part in found if m)]


def _say(found: SampleTar, path: Path, what: str, names: Sequence[str]) -> None:
    if names:
        found.skipped.append((f"{path}: {len(names)} {what}, the first {names[0]!r}", len(names)))
