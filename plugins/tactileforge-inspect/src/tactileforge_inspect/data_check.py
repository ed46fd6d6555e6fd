"""Checks a data set for silent faults: codes, places and fixes."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tactileforge.checks import CheckRun, Finding
from tactileforge.cli import Command
from tactileforge.contracts import Dataset
from tactileforge.errors import ConfigError, DataError
from tactileforge.plugins import Bar, build, load_json, write_text
from tactileforge_inspect.fix import fix_layouts
from tactileforge_inspect.guess import guess_words, lost_labels
from tactileforge_inspect.scan import has_layout

#: Lines of one code that are printed; JSON has all.
_SHOWN = 12


#: Recordings whose lag is estimated without being asked for.
_LAGS = 6


@dataclass(frozen=True, kw_only=True)
class _Check:
    """Keys of ``data check``.

    Attributes:
        path: Folder or file, in place of ``data=``: its format is guessed.
        select: Codes to check, their beginnings or names; none for all.
        ignore: The same of checks to leave out.
        baseline: File of findings that are known: they are not told. Written where it is missing.
        frames: Whether frames are decoded; without, labels and times alone are checked.
        lag: Whether the delay of images behind forces is estimated in each recording, which reads
            all frames; otherwise only in the first six with forces.
        notes: Whether notes, which are choices and no faults, count.
        fix: Whether keys that put pictures right are written into the layout file.
        json: Whether to print JSON, for programs.
    """

    path: str | None = None
    select: list[str] = field(default_factory=list)
    ignore: list[str] = field(default_factory=list)
    baseline: str | None = None
    frames: bool = True
    lag: bool = False
    notes: bool = False
    fix: bool = False
    json: bool = False


def _check(keys: _Check, config: dict[str, Any]) -> int:
    """Checks a data set for silent faults; exits with 1 where there are some."""
    dataset = build("datasets", config["data"], "data")
    without = {"all frames"} if not keys.lag and "TF104" not in keys.select else set()
    run = CheckRun(keys.select, keys.ignore, without if keys.frames else {"frames", "all frames"})
    # of one rig all recordings have the lag
    few = CheckRun(["TF104"], keys.ignore) if without and keys.frames and not keys.select else None
    left = _LAGS
    total, findings = Counter[str](), list[Finding]()
    for recording, split in Bar(_both(dataset), desc="check", unit="recording", disable=keys.json):
        total[split] += 1
        findings += run.look(recording, split, has_layout(dataset))
        if few and left and recording.force is not None:
            left -= 1
            findings += few.look(recording, split, has_layout(dataset))
    if not total:
        raise DataError(f"no recording to check; {[*dataset.skipped, 'the set is empty'][0]}")
    findings += run.end()
    findings = [one for one in findings if keys.notes or one.level != "note"]
    known = _known(keys.baseline, findings)
    findings = [one for one in findings if _name(one) not in known]
    unread = [*dataset.skipped, *run.unreadable, *_lost]
    fixed = fix_layouts(dataset, findings) if keys.fix else {}
    if keys.json:
        print(json.dumps(_plain(total, findings, unread, fixed), indent=2))
    else:
        _print(total, findings, unread, fixed)
    return 1 if findings or unread else 0


#: Lines about labels that the guess of a path leaves out.
_lost: list[str] = []


def _prepare(words: list[str]) -> list[str]:
    doubts: list[str] = []
    words = guess_words(words, doubts)
    _lost[:] = lost_labels(doubts)  # not those of an earlier command in this process
    return words


def _both(dataset: Dataset) -> list[tuple[Any, str]]:
    return [(one, split) for split in ("train", "val") for one in dataset.recordings(split)]


def _name(one: Finding) -> str:
    """What a baseline keeps of a finding: its number may change with every run."""
    return f"{one.where}: {one.code}"


def _known(path: str | None, findings: Sequence[Finding]) -> set[str]:
    """Findings of the baseline; writes them where there is no such file."""
    if path is None:
        return set()
    file = Path(path)
    if not file.exists():
        kept = sorted({_name(one) for one in findings})
        write_text(file, json.dumps({"findings": kept}, indent=2) + "\n")
        return set(kept)
    try:
        plain = load_json(file.read_text("utf-8"))
        kept = plain["findings"]
        if not all(isinstance(one, str) for one in kept):
            raise TypeError
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            f"baseline={path}: no baseline of data check; remove it, and it is written anew"
        ) from error
    return set(kept)


def _plain(
    total: Counter[str],
    findings: Sequence[Finding],
    unread: Sequence[str],
    fixed: dict[str, dict[str, Any]],
) -> dict[str, Any]:
    return {
        "recordings": total.total(),
        "held_out": total["val"],
        "findings": [asdict(one) | {"keys": dict(one.keys)} for one in findings],
        "unreadable": list(unread),
        "fixed": fixed,
    }


def _print(
    total: Counter[str],
    findings: Sequence[Finding],
    unread: Sequence[str],
    fixed: dict[str, dict[str, Any]],
) -> None:
    by_code: dict[str, list[Finding]] = {}
    for one in findings:
        by_code.setdefault(one.code, []).append(one)
    for code in sorted(by_code):
        for one in by_code[code][:_SHOWN]:
            print(one)
        if (more := len(by_code[code]) - _SHOWN) > 0:
            print(f"and {more} more of {code}")
    for line in unread:
        print(f"unreadable: {line}")
    for name, keys in fixed.items():
        print(f"layout {name}: wrote {', '.join(f'{key}: {value}' for key, value in keys.items())}")
    places = len({one.where for one in findings})
    told = f"{len(findings)} findings in {places} places" if findings else "nothing found"
    print(f"{total.total()} recordings checked, {total['val']} of them held out: {told}")


COMMANDS = {
    "": Command(run=_check, keys=_Check, groups={"data": "???"}, bare=("path",), prepare=_prepare)
}
