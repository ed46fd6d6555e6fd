"""The checks of recordings, as the page shows them."""

from __future__ import annotations

from tactileforge.checks import catalogue
from tactileforge_inspect.findings import Reason

#: Checks by name, in the order of the page; docs/checks.md explains each.
NAMES = (
    "no_background",
    "never_in_contact",
    "odd_first_frames",
    "background_changed",
    "saturated",
    "colours_swapped",
    "on_its_side",
    "mirrored",
    "grey_pictures",
    "frozen",
    "repeated_frames",
    "lag",
    "gaps_in_time",
    "paired_times",
    "force_out_of_range",
    "axes_exchanged",
    "untared_force",
    "zero_force",
    "stuck_force",
    "forces_apart",
    "forces_between",
    "pulling_force",
    "tiny_pictures",
    "views_elsewhere",
)
REASONS = {
    name: Reason(f"{check.title} ({check.code})", check.why, check.unit, check.worst)
    for name, check in ((name, catalogue()[name]) for name in NAMES)
}
#: Reasons that compare recordings, or read all of their frames: told apart from those of one.
OF_SEVERAL = ("colours_swapped", "on_its_side", "mirrored", "grey_pictures", "lag")
#: Reasons of labels and times, checked on all recordings; the others are of frames.
OF_LABELS = tuple(name for name in NAMES if not catalogue()[name].needs & {"frames", "all frames"})
OF_FRAMES = tuple(name for name in NAMES if name not in (*OF_LABELS, *OF_SEVERAL))
