"""The parts of the page that tell what is wrong: the verdict, duplicates, suspicious recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

from tactileforge.contracts import LABELS
from tactileforge.inspection.checks import REASONS, is_sure
from tactileforge.inspection.findings import InspectionFindings, Suspect
from tactileforge.inspection.scan import Scan
from tactileforge.inspection.sections import card_grid, recording_card
from tactileforge.pages.images import figure, image
from tactileforge.pages.page import SPLIT_WORDS, Section, duration, paragraph, table

#: Reasons that are told without a pixel, of all recordings.
_COUNTED = ("no_background", "gaps_in_time", "force_out_of_range", "pulling_force")
_SHOWN = 12
_LINES = 100


def top_section(name: str, found: Scan) -> str:
    """What the data set is, and whether it can be trusted."""
    all_of = found.findings
    carried = [
        label
        for label in LABELS
        if any(label in total.carrying for total in all_of.totals.values())
    ]
    about = {
        "Data": name,
        "Recordings": f"{all_of.recordings:,}",
        "Frames": f"{all_of.frames:,}",
        "Time": duration(all_of.seconds),
        "Sensors": ", ".join(sorted({sensor for _, sensor in all_of.totals})),
        "Labels": ", ".join(carried) or "none",
        "Looked at": f"{all_of.looked:,} recordings",
    }
    cells = "".join(f"<div><dt>{k}</dt><dd>{escape(v)}</dd></div>" for k, v in about.items())
    lines = "".join(f'<li class="{mark}">{escape(text)}</li>' for mark, text in _verdict(found))
    return f'<dl>{cells}</dl><ul class="verdict">{lines}</ul>'


def _verdict(found: Scan) -> Iterator[tuple[str, str]]:
    result = found.findings
    unread = len(result.unreadable)
    if unread:
        yield "bad", f"{_count(unread, 'recording')} could not be read."
    else:
        yield "good", "Every recording that was opened could be read."
    for reason, count in result.counts.items():
        if count:
            mark = "plain" if reason == "no_background" else "bad"
            yield mark, f"{REASONS[reason].title}: {_of(reason, count, found)}."
    if not any(result.counts.values()):
        yield "good", "No recording is suspicious."
    telling = sum(is_sure(lag) for _, lag in found.lags)
    if telling and not result.counts["lag"]:
        tested = _count(telling, "recording")
        yield "good", f"Pictures and forces fit in time in {tested} whose lag can be told."
    for count, words in (
        (len(result.duplicates), "group of recordings with the same pixels"),
        (len(result.similar), "pair of recordings that are nearly the same"),
        (len(result.repeated), "key that several recordings have"),
    ):
        if count:
            yield "bad", f"{_count(count, words)}; see Duplicates."


def _of(reason: str, count: int, found: Scan) -> str:
    if reason in _COUNTED:
        return f"{count:,} of {_count(found.findings.recordings, 'recording')}"
    if reason == "lag":
        return f"{count} of {_count(len(found.lags), 'recording')} that were tested"
    return f"{count:,} of {_count(found.findings.looked, 'recording')} that were looked at"


def _count(count: int, words: str) -> str:
    first, _, rest = words.partition(" ")
    return f"{count:,} {first}{'s' * (count != 1)} {rest}".rstrip()


def duplicates_section(found: Scan) -> Section:
    """Recordings that show the same or nearly the same, and keys that are used twice."""
    body = ""
    if found.same:
        groups = [_group(found, group) for group in found.same[:_SHOWN]]
        note = f"{_count(len(found.same), 'group')}; at the frames that were looked at, bit by bit."
        body += "<h3>The same pixels</h3>" + paragraph(note, soft=True) + card_grid(groups, 15)
    if found.similar:
        pairs = [
            _group(found, (i, j), f"differ by {level:.1f} grey levels; ")
            for i, j, level in found.similar[:_SHOWN]
        ]
        note = (
            f"{_count(len(found.similar), 'pair')}, closest first: small pictures at the same "
            "places in time, all but 0.5 % of which differ by less than what is said."
        )
        body += "<h3>Nearly the same</h3>" + paragraph(note, soft=True) + card_grid(pairs, 15)
    if found.findings.repeated:
        counts = dict(found.tally.names.top("key", _SHOWN))
        rows = [(key, str(counts[key])) for key in found.findings.repeated]
        note = "A key has to be unique: labels and files are found by it. The most frequent ones:"
        body += "<h3>Keys that several recordings have</h3>"
        body += table("keys", ("Key", "recordings"), rows, note)
    text = f"None among the {_count(found.findings.looked, 'recording')} that were looked at."
    return Section("duplicates", "Duplicates", body or paragraph(text))


def _group(found: Scan, group: Sequence[int], words: str = "") -> str:
    ones = [found.seen[i] for i in group]
    splits = {one.of.split for one in ones}
    across = "IN BOTH SPLITS: " if len(splits) > 1 else ""
    keys = ", ".join(one.of.recording.key for one in ones[:4])
    more = f" and {len(ones) - 4} more" if len(ones) > 4 else ""
    caption = f"{across}{words}{keys}{more}"
    return figure([one.look.frame for one in ones[:2]], caption, "", 2)


def suspicious_section(found: Scan) -> Section:
    """The worst recordings of each reason, and those that cannot be read."""
    body = _unreadable(found.findings)
    seen = {one.of.order: one for one in found.seen}
    for reason, worst in found.findings.worst.items():
        about = REASONS[reason]
        body += f"<h3>{escape(about.title)}: {_of(reason, found.findings.counts[reason], found)}"
        body += f"</h3>{paragraph(about.why, soft=True)}"
        body += card_grid(
            recording_card(seen[one.order], _words(one)) if one.order in seen else _unseen(one)
            for one in worst
        )
    if not body:
        body = paragraph("None. Each check is explained in the documentation of data inspect.")
    return Section("suspicious", "Suspicious recordings", body)


def _words(one: Suspect) -> str:
    return f"{one.words}: {one.key}, {one.sensor}, {SPLIT_WORDS[one.split]}"


def _unseen(one: Suspect) -> str:
    picture = "" if one.picture is None else image(one.picture, one.key)
    return f"<figure>{picture}<figcaption>{escape(_words(one))}</figcaption></figure>"


def _unreadable(found: InspectionFindings) -> str:
    if not found.unreadable:
        return ""
    count = len(found.unreadable)
    shown = "".join(f"<li>{escape(line)}</li>" for line in found.unreadable[:_LINES])
    more = f"<li>and {count - _LINES:,} more</li>" if count > _LINES else ""
    why = "Training goes on without them. Download them again, or remove them."
    return (
        f"<h3>{_count(count, 'recording')} that cannot be read</h3>{paragraph(why, soft=True)}"
        f"<details{' open' if count <= 10 else ''}><summary>Which</summary><ul>{shown}{more}</ul>"
        "</details>"
    )
