"""Recordings to shards: ``tactileforge data pack`` (`docs/packing.md`)."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Mapping
from contextlib import closing
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tactileforge.contracts import Dataset
from tactileforge.data.shards.index import INDEX_FILE, Index
from tactileforge.errors import ConfigError, DataError, TactileForgeError, too_many_files
from tactileforge.packing.executors import execute
from tactileforge.packing.options import Filter, PackOptions
from tactileforge.packing.plan import SPLITS, PackPlan, plan_pack
from tactileforge.packing.statistics import COUNTS, PackStatistics
from tactileforge.packing.work import NOTES, ShardNote
from tactileforge.util.bars import Bar
from tactileforge.util.files import (
    NO_FILES,
    say_swept,
    sealed,
    sweep_parts,
    unsealed,
    write_text,
)
from tactileforge.util.locks import locked

__all__ = ["Filter", "PackOptions", "pack", "summary"]

#: Damaged recordings named by an error.
_NAMED = 20
#: Options of data sets without effect on their recordings: a stopped run may go on from another
#: folder, or with other processes.
_PLACES = ("name", "root", "cache", "cache_gb", "processes", "max_bad")


def pack(
    dataset: Dataset,
    name: str,
    out: Path,
    options: PackOptions | None = None,
    data: Mapping[str, Any] | None = None,
) -> Index:
    """Pack the recordings of a data set into shards with an ``index.json``.

    The same data and options give the same bytes, with any executor. A stopped run continues when
    called again: whole shards are not made anew.

    Args:
        dataset: Data set with the splits ``train`` and ``val``.
        name: Name of the data set.
        out: Folder of the shards; only one run at a time may write there.
        options: Options of packing; None for the defaults.
        data: Configuration of the data set; a stopped run continues only with the same one.

    Raises:
        ConfigError: The folder holds shards of other data or options.
        DataError: Too many recordings are damaged, none is left, or two have one key.
        TactileForgeError: A shard cannot be written, or a process died twice while making one.
    """
    options = options or PackOptions()
    out = Path(out).absolute()
    planned = plan_pack(dataset, out, options)
    for line in planned.notes:
        print(f"note: {line}", file=sys.stderr)
    # provenance, all of which but ``by`` must not change within a folder; through JSON, as it is
    # compared with what was read from JSON: tuples become lists
    made = {
        "by": f"tactileforge {version('tactileforge')}",
        "data": name,
        "options": json.loads(json.dumps(_content(data or {}))),
        "recordings": planned.recordings,
        "frames": planned.frames,
        "digest": planned.digest,
        "pack": json.loads(json.dumps(options.content())),
    }
    try:
        # before the lock, which creates files there: a folder of others stays as it is
        _claim(out, made)
        taken = f"{out}: another program packs into it; give another out="
        with locked(out / NOTES / "lock", taken):
            say_swept(out, _sweep(out))
            try:
                notes = _notes(planned, options, out)
                index = Index(name=name, sorted=True, made=made, **_merged(planned, notes))
                index.save(out)
            finally:
                _sweep(out)
    except OSError as error:
        if error.errno in NO_FILES:
            raise TactileForgeError(f"{out}: {too_many_files()}") from error
        whole = sum(ShardNote.of(job) is not None for job in planned.jobs)
        raise TactileForgeError(
            f"{out}: cannot be written ({error.strerror or error}). {whole} of {len(planned.jobs)} "
            "shards are whole and stay: make room, and run the same command again"
        ) from error
    return index


def _notes(planned: PackPlan, options: PackOptions, out: Path) -> dict[int, ShardNote]:
    """Make the missing shards, and return the notes of all, by job number."""
    notes = {job.number: note for job in planned.jobs if (note := ShardNote.of(job))}
    missing = [job for job in planned.jobs if job.number not in notes]
    guard = _Guard(planned, options)
    for note in notes.values():
        guard.see(note)
    done = {job.number: job.frames for job in planned.jobs if job.number in notes}
    with Bar(total=planned.frames, initial=sum(done.values()), unit="frame", desc="pack") as bar:

        def tick(number: int, frames: int) -> None:
            done[number] = frames
            bar.update(sum(done.values()) - bar.n)

        # closed on an error: else its processes would go on until the generator is collected
        with closing(execute(missing, options.executor, options.processes, tick)) as work:
            for job, note in work:
                notes[job.number] = note
                tick(job.number, job.frames)
                for line in note.statistics.skipped:
                    bar.write(f"skipped: {line}", file=sys.stderr)
                guard.see(note)
    return notes


class _Guard:
    """Counter of damaged recordings; raises an error for too many."""

    def __init__(self, planned: PackPlan, options: PackOptions) -> None:
        self.lines = [line for lines in planned.skipped.values() for line in lines]
        self.damaged = len(self.lines)
        self.total = planned.recordings + self.damaged
        self.most = max(int(options.max_bad * self.total), 1 if options.max_bad else 0)
        self.share = options.max_bad
        self._check()

    def see(self, note: ShardNote) -> None:
        """Count the damaged recordings of a shard."""
        self.damaged += note.statistics.damaged
        self.lines += note.statistics.skipped
        self._check()

    def _check(self) -> None:
        if self.damaged <= self.most:
            return
        shown = "".join(f"\n  {line}" for line in self.lines[:_NAMED])
        rest = len(self.lines) - _NAMED
        raise DataError(
            f"{self.damaged} of {self.total} recordings are damaged, pack.max_bad={self.share} "
            f"allows {self.most}; repair them, or allow more:{shown}"
            + (f"\n  and {rest} more" if rest > 0 else "")
        )


def _merged(planned: PackPlan, notes: Mapping[int, ShardNote]) -> dict[str, Any]:
    """Shards and statistics of each split."""
    splits: dict[str, Any] = {split: [] for split in SPLITS}
    by_split = {split: PackStatistics() for split in SPLITS}
    for split, lines in planned.skipped.items():
        by_split[split].skipped += lines
        by_split[split].damaged += len(lines)
    for job in planned.jobs:
        note = notes[job.number]
        by_split[job.split].merge(note.statistics)
        if note.entry is not None:
            splits[job.split].append(note.entry)
    if not splits["train"]:
        raise DataError(
            "the filter leaves no frame to train on: lower pack.filter.laplacian; tactileforge "
            "data filter shows what each value keeps"
        )
    return {"splits": splits, "statistics": {k: each.report() for k, each in by_split.items()}}


def _content(data: Mapping[str, Any]) -> dict[str, Any]:
    """Options with an effect on the recordings, without paths and processes."""
    return {
        key: _content(value) if isinstance(value, Mapping) else value
        for key, value in data.items()
        if key not in _PLACES
    }


def _claim(out: Path, made: Mapping[str, Any]) -> None:
    """Record the provenance in the folder, or compare with the recorded one."""
    claim = out / NOTES / "made.json"
    if not any(out.glob("*.tar")):
        write_text(claim, sealed(made))
        return
    path = next((path for path in (claim, out / INDEX_FILE) if path.exists()), None)
    if path is None:
        raise ConfigError(f"{out} holds shards that were not packed here; give another out=")
    try:
        there = unsealed(path.read_bytes())
        recorded, current = _flat(there["made"] if path.name == INDEX_FILE else there), _flat(made)
    except (ValueError, KeyError, AttributeError) as error:
        raise ConfigError(f"{path}: damaged ({error!r}); give another out=") from error
    changed = [
        f"{key} was {recorded.get(key)!r}, is {current.get(key)!r}"
        for key in {**current, **recorded}
        if key not in ("by", "digest") and recorded.get(key) != current.get(key)
    ]
    # last, as a changed option changes the digest, too, and has a name
    if not changed and recorded.get("digest") != current["digest"]:
        changed = ["its recordings have changed"]
    if changed:
        raise ConfigError(
            f"{out} holds shards that were made with other options: {'; '.join(changed)}. Give "
            "another out=, or remove the folder"
        )


def _flat(plain: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Flatten nested keys, with dots between them."""
    flat: dict[str, Any] = {}
    for key, value in plain.items():
        name = f"{above}{key}"
        flat.update(_flat(value, f"{name}.") if isinstance(value, Mapping) else {name: value})
    return flat


def _sweep(out: Path) -> int:
    """Remove half-written files of a killed run; returns their number."""
    return sum(sweep_parts(folder, alone=True) for folder in (out, out / NOTES))


def summary(index: Index) -> str:
    """Summary of the packed shards in a few lines of plain text."""
    lines = []
    for split, counts in index.statistics.items():
        sensors = ", ".join(f"{name} {count:,}" for name, count in counts["sensors"].items())
        lines.append(
            f"{split}: {counts['recordings']:,} recordings, {counts['frames']:,} frames "
            f"({sensors or 'none'}), {counts['objects']:,} objects, "
            f"{len(index.splits[split]):,} shards, {counts['bytes'] / 2**20:,.1f} MB"
        )
    total = Counter[str]()
    for counts in index.statistics.values():
        total.update({key: counts[key] for key in ("frames", *COUNTS)})
    if total["read"] > total["frames"] or total["emptied"]:
        lines.append(
            f"the filter kept {total['frames']:,} of {total['read']:,} frames that were read; "
            f"recordings of which nothing is left: {total['emptied']:,}"
        )
    if total["damaged"]:
        lines.append(f"damaged recordings: {total['damaged']:,}, index.json lists them")
    if total["unmarked"]:
        lines.append(
            f"recordings without markers: {total['unmarked']:,}, index.json says why; they are "
            "packed without tracks of markers"
        )
    return "\n".join(lines)
