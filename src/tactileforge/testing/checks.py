"""Checks of checks: rules about touch data."""

from __future__ import annotations

import re

from tactileforge.checks.check import LEVELS, NEEDS, Examples, findings_of
from tactileforge.checks.check import Check as DataCheck
from tactileforge.testing.results import Check, CheckSubject, require


def _examples(subject: CheckSubject) -> Examples:
    require(
        issubclass(subject.plugin, DataCheck), "it is not a subclass of tactileforge.checks.Check"
    )
    shown: Examples = subject.plugin.examples()
    require(bool(shown.good) and bool(shown.bad), "examples() lacks good or bad input")
    return shown


def it_says_what_it_is(subject: CheckSubject) -> None:
    """It has a code, title, level, needs, a reason and a fix."""
    plugin = subject.plugin
    good = re.fullmatch(r"[A-Z]{2,4}\d{3}", plugin.code) is not None
    require(good, f"code is {plugin.code!r}: two to four capitals and three digits, as TF101")
    ours = plugin.__module__.partition(".")[0] == "tactileforge"
    taken = plugin.code.startswith("TF") and not ours
    require(not taken, "codes with TF are those of tactileforge: take letters of your own")
    require(plugin.level in LEVELS, f"level is {plugin.level!r}: one of {', '.join(LEVELS)}")
    odd = sorted(plugin.needs - set(NEEDS))
    require(bool(plugin.needs) and not odd, f"needs are {sorted(plugin.needs)}: some of {NEEDS}")
    for name in ("title", "why", "fix"):
        require(bool(getattr(plugin, name)), f"{name} is empty")


def it_is_silent_on_good_input(subject: CheckSubject) -> None:
    """It finds nothing in its good example."""
    shown = _examples(subject)
    found = findings_of(subject.build(), shown.good, shown.sensor)
    require(not found, f"it finds {found[:2]} in its good example")


def it_finds_what_is_wrong(subject: CheckSubject) -> None:
    """It finds something in its bad example, and says so with its code."""
    shown = _examples(subject)
    found = findings_of(subject.build(), shown.bad, shown.sensor)
    require(bool(found), "it finds nothing in its bad example")


def it_forgets_what_it_saw(subject: CheckSubject) -> None:
    """A check that is built anew knows nothing of the set before."""
    shown = _examples(subject)
    findings_of(subject.build(), shown.bad, shown.sensor)
    found = findings_of(subject.build(), shown.good, shown.sensor)
    require(not found, "after a bad set, it finds something in a good one")


CHECKS: list[Check] = [
    it_says_what_it_is,
    it_is_silent_on_good_input,
    it_finds_what_is_wrong,
    it_forgets_what_it_saw,
]
