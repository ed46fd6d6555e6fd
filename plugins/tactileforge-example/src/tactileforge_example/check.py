"""A check of touch data."""

from collections.abc import Iterable

import numpy as np

from tactileforge.checks import Check, Examples, Finding, Seen, made_touch

#: Number of presses, as the label ``presses`` counts them, after which a gel is worn.
WORN = 10_000


class WornGel(Check):
    """A gel with more presses than it lasts."""

    code = "EX101"
    title = "The gel is worn"
    level = "warning"
    needs = frozenset({"labels"})
    why = f"A gel of more than {WORN:,} presses is thinner, and reads forces too small."
    fix = "change the gel, and calibrate again"
    unit = "presses"

    def look(self, seen: Seen) -> Iterable[Finding]:
        """Looks at the label ``presses`` of a recording."""
        count = float(seen.recording.labels.get("presses", np.nan))
        if count > WORN:
            yield self.found(seen.key, f"{count:.0f} presses on one gel", count)

    @staticmethod
    def examples() -> Examples:
        """A new gel, and an old one."""
        return Examples(
            [made_touch(labels={"presses": 20})], [made_touch(labels={"presses": 20_000})]
        )
