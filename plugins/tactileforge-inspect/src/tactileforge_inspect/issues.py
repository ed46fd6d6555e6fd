"""Sections of the page on problems: verdict, duplicates, suspicious recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from markupsafe import Markup

from tactileforge.checks import CODES, is_sure
from tactileforge.contracts import LABELS
from tactileforge.pages import (
    SPLIT_WORDS,
    Section,
    captioned,
    cards,
    details,
    duration,
    facts,
    figure,
    heading,
    image,
    items,
    paragraph,
    table,
    verdict,
)
from tactileforge_inspect.findings import Suspect
from tactileforge_inspect.reasons import OF_LABELS, REASONS
from tactileforge_inspect.scan import Scan
from tactileforge_inspect.sections import recording_card

#: Groups, pairs and keys of duplicates that are shown, and lines about unreadable recordings: the
#: page of a large set stays small.
_SHOWN, _LINES = 12, 100


def top_section(name: str, survey: Scan, doubts: Sequence[str] = ()) -> Markup:
    """Top of the page: the data set in brief, the guesses about it, and the verdict on it."""
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
    guessed = (("plain", f"To be checked: {line}.") for line in doubts)
    return facts(about) + verdict([*guessed, *_verdict(survey)])


def _verdict(survey: Scan) -> Iterator[tuple[str, str]]:
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
    for line in result.notes:
        # a single class is the purpose of some sets, so it is no fault
        mark = "plain" if line.startswith(f"{CODES['one_class']} ") else "bad"
        yield mark, f"{line[0].upper()}{line[1:]}."
    if not any(result.counts.values()):
        yield "good", "No recording is suspicious."
    telling = sum(is_sure(lag) for _, lag in survey.lags)
    if telling and not result.counts["lag"]:
        tested = _count(telling, "recording")
        yield "good", f"Images and forces fit in time in {tested} whose lag can be told."
    for count, words in (
        (len(result.duplicates), "group of recordings with the same pixels"),
        (len(result.similar), "pair of recordings that are nearly the same"),
        (len(result.repeated), "key that several recordings have"),
    ):
        if count:
            yield "bad", f"{_count(count, words)}; see Duplicates."


def _of(reason: str, count: int, survey: Scan) -> str:
    if reason in OF_LABELS:
        return f"{count:,} of {_count(survey.findings.recordings, 'recording')}"
    if reason == "lag":
        return f"{count} of {_count(len(survey.lags), 'recording')} that were tested"
    return f"{count:,} of {_count(survey.findings.looked, 'recording')} that were looked at"


def _count(count: int, words: str) -> str:
    first, _, rest = words.partition(" ")
    return f"{count:,} {first}{'s' * (count != 1)} {rest}".rstrip()


def duplicates_section(survey: Scan) -> Section:
    """Section of identical and nearly identical recordings, and of repeated keys."""
    body = Markup()
    if survey.same:
        groups = [_group(survey, group) for group in survey.same[:_SHOWN]]
        note = (
            f"{_count(len(survey.same), 'group')}; at the frames that were looked at, bit by bit."
        )
        body += heading("The same pixels") + paragraph(note, soft=True) + cards(groups, 15)
    if survey.similar:
        pairs = [
            _group(survey, (i, j), f"differ by {level:.1f} grey levels; ")
            for i, j, level in survey.similar[:_SHOWN]
        ]
        note = (
            f"{_count(len(survey.similar), 'pair')}, closest first: small images at the same "
            "places in time, all but 0.5 % of which differ by less than what is said."
        )
        body += heading("Nearly the same") + paragraph(note, soft=True) + cards(pairs, 15)
    if survey.findings.repeated:
        counts = dict(survey.tally.names.top("key", _SHOWN))
        rows = [(key, str(counts[key])) for key in survey.findings.repeated]
        note = "A key has to be unique: labels and files are found by it. The most frequent ones:"
        body += heading("Keys that several recordings have")
        body += table("keys", ("Key", "recordings"), rows, note)
    text = f"None among the {_count(survey.findings.looked, 'recording')} that were looked at."
    return Section("duplicates", "Duplicates", body or paragraph(text))


def _group(survey: Scan, group: Sequence[int], words: str = "") -> Markup:
    ones = [survey.seen[i] for i in group]
    # said first: validation then measures what was learnt by heart
    splits = {member.of.split for member in ones}
    across = "IN BOTH SPLITS: " if len(splits) > 1 else ""
    keys = ", ".join(member.of.recording.key for member in ones[:4])
    more = f" and {len(ones) - 4} more" if len(ones) > 4 else ""
    caption = f"{across}{words}{keys}{more}"
    return figure([member.look.frame for member in ones[:2]], caption, "", 2)


def suspicious_section(survey: Scan) -> Section:
    """Section of the worst recordings of each reason, and of unreadable ones."""
    body = Markup()
    if count := len(survey.findings.unreadable):
        lines = survey.findings.unreadable[:_LINES]
        more = [f"and {count - _LINES:,} more"] if count > _LINES else []
        why = "Training goes on without them. Download them again, or remove them."
        body += heading(f"{_count(count, 'recording')} that cannot be read")
        body += paragraph(why, soft=True)
        body += details("Which", items([*lines, *more]), is_open=count <= 10)
    seen = {item.of.order: item for item in survey.seen}
    for reason, worst in survey.findings.worst.items():
        about = REASONS[reason]
        count = survey.findings.counts[reason]
        body += heading(f"{about.title}: {_of(reason, count, survey)}")
        body += paragraph(about.why, soft=True)
        body += cards(
            recording_card(seen[suspect.order], _words(suspect))
            if suspect.order in seen
            else captioned(
                Markup() if suspect.picture is None else image(suspect.picture, suspect.key),
                _words(suspect),
            )
            for suspect in worst
        )
    if not body:
        body = paragraph("None. Each check is explained in the documentation of data inspect.")
    return Section("suspicious", "Suspicious recordings", body)


def _words(suspect: Suspect) -> str:
    return f"{suspect.words}: {suspect.key}, {suspect.sensor}, {SPLIT_WORDS[suspect.split]}"
