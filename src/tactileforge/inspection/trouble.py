"""The sections on problems: verdict, duplicates, suspicious recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

from tactileforge.contracts import LABELS
from tactileforge.inspection.checks import REASONS, is_sure
from tactileforge.inspection.findings import Findings, Suspect
from tactileforge.inspection.sections import card, grid
from tactileforge.inspection.survey import Survey
from tactileforge.pages.images import figure, image
from tactileforge.pages.page import SPLIT_WORDS, Section, duration, paragraph, table

#: Reasons that are told without a pixel, of all recordings.
_COUNTED = ("no_background", "gaps_in_time", "force_out_of_range", "pulling_force")
_SHOWN = 12
_LINES = 100


def top(name: str, survey: Survey) -> str:
    """The top of the page: the data set in brief, and the verdict on it."""
    all_of = survey.findings
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
    lines = "".join(f'<li class="{mark}">{escape(text)}</li>' for mark, text in _verdict(survey))
    return f'<dl>{cells}</dl><ul class="verdict">{lines}</ul>'


def _verdict(survey: Survey) -> Iterator[tuple[str, str]]:
    result = survey.findings
    unread = len(result.unreadable)
    if unread:
        yield "bad", f"{_count(unread, 'recording')} could not be read."
    else:
        yield "good", "Every recording that was opened could be read."
    for reason, count in result.counts.items():
        if count:
            mark = "plain" if reason == "no_background" else "bad"
            yield mark, f"{REASONS[reason].title}: {_of(reason, count, survey)}."
    if not any(result.counts.values()):
        yield "good", "No recording is suspicious."
    telling = sum(is_sure(lag) for _, lag in survey.lags)
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


def _of(reason: str, count: int, survey: Survey) -> str:
    if reason in _COUNTED:
        return f"{count:,} of {_count(survey.findings.recordings, 'recording')}"
    if reason == "lag":
        return f"{count} of {_count(len(survey.lags), 'recording')} that were tested"
    return f"{count:,} of {_count(survey.findings.looked, 'recording')} that were looked at"


def _count(count: int, words: str) -> str:
    first, _, rest = words.partition(" ")
    return f"{count:,} {first}{'s' * (count != 1)} {rest}".rstrip()


def duplicates(survey: Survey) -> Section:
    """Recordings that show the same or nearly the same, and keys that are used twice."""
    body = ""
    if survey.same:
        groups = [_group(survey, group) for group in survey.same[:_SHOWN]]
        note = (
            f"{_count(len(survey.same), 'group')}; at the frames that were looked at, bit by bit."
        )
        body += "<h3>The same pixels</h3>" + paragraph(note, soft=True) + grid(groups, 15)
    if survey.similar:
        pairs = [
            _group(survey, (i, j), f"differ by {level:.1f} grey levels; ")
            for i, j, level in survey.similar[:_SHOWN]
        ]
        note = (
            f"{_count(len(survey.similar), 'pair')}, closest first: small pictures at the same "
            "places in time, all but 0.5 % of which differ by less than what is said."
        )
        body += "<h3>Nearly the same</h3>" + paragraph(note, soft=True) + grid(pairs, 15)
    if survey.findings.repeated:
        counts = dict(survey.tally.names.top("key", _SHOWN))
        rows = [(key, str(counts[key])) for key in survey.findings.repeated]
        note = "A key has to be unique: labels and files are found by it. The most frequent ones:"
        body += "<h3>Keys that several recordings have</h3>"
        body += table("keys", ("Key", "recordings"), rows, note)
    text = f"None among the {_count(survey.findings.looked, 'recording')} that were looked at."
    return Section("duplicates", "Duplicates", body or paragraph(text))


def _group(survey: Survey, group: Sequence[int], words: str = "") -> str:
    ones = [survey.seen[i] for i in group]
    splits = {member.of.split for member in ones}
    across = "IN BOTH SPLITS: " if len(splits) > 1 else ""
    keys = ", ".join(member.of.recording.key for member in ones[:4])
    more = f" and {len(ones) - 4} more" if len(ones) > 4 else ""
    caption = f"{across}{words}{keys}{more}"
    return figure([member.look.frame for member in ones[:2]], caption, "", 2)


def suspicious(survey: Survey) -> Section:
    """The worst recordings of each reason, and those that cannot be read."""
    body = _unreadable(survey.findings)
    seen = {item.of.order: item for item in survey.seen}
    for reason, worst in survey.findings.worst.items():
        about = REASONS[reason]
        body += f"<h3>{escape(about.title)}: {_of(reason, survey.findings.counts[reason], survey)}"
        body += f"</h3>{paragraph(about.why, soft=True)}"
        body += grid(
            card(seen[suspect.order], _words(suspect))
            if suspect.order in seen
            else _unseen(suspect)
            for suspect in worst
        )
    if not body:
        body = paragraph("None. Each check is explained in the documentation of data inspect.")
    return Section("suspicious", "Suspicious recordings", body)


def _words(suspect: Suspect) -> str:
    return f"{suspect.words}: {suspect.key}, {suspect.sensor}, {SPLIT_WORDS[suspect.split]}"


def _unseen(suspect: Suspect) -> str:
    picture = "" if suspect.picture is None else image(suspect.picture, suspect.key)
    return f"<figure>{picture}<figcaption>{escape(_words(suspect))}</figcaption></figure>"


def _unreadable(findings: Findings) -> str:
    if not findings.unreadable:
        return ""
    count = len(findings.unreadable)
    shown = "".join(f"<li>{escape(line)}</li>" for line in findings.unreadable[:_LINES])
    more = f"<li>and {count - _LINES:,} more</li>" if count > _LINES else ""
    why = "Training goes on without them. Download them again, or remove them."
    return (
        f"<h3>{_count(count, 'recording')} that cannot be read</h3>{paragraph(why, soft=True)}"
        f"<details{' open' if count <= 10 else ''}><summary>Which</summary><ul>{shown}{more}</ul>"
        "</details>"
    )
