"""Cost of augmentation for one batch, beside the flips of the recipes and no augmentation.

A batch of 16 clips of 4 frames at 224 x 224, with surfaces. ``labels`` is drawn on the host, while
the device computes; ``forward`` changes the pixels.  CPU seconds of one thread, in turn.

Run: python augment.py
"""

from __future__ import annotations

import time
from typing import Any

import torch
from common import save, side_by_side

from tactileforge.data import Augment
from tactileforge.testing import batch as make_batch

CLIPS, ROUNDS = 16, 5
FLIPS = {"horizontal": 0.5, "vertical": 0.5}
MOVES = {"rotate": 180.0, "shift": 0.1, "scale": 0.2}
LIGHT = {"gain": 0.2, "colour": 0.1}
#: Options of each subject, beside those of the flips.
SUBJECTS: dict[str, dict[str, Any]] = {
    "flips, as in the recipes": {},
    "rotate": {"rotate": 180.0},
    "rotate, shift, scale": MOVES,
    "gain, colour": LIGHT,
    "blur": {"blur": 1.5},
    "noise": {"noise": 3.0},
    "all": {**MOVES, **LIGHT, "blur": 1.5, "noise": 3.0},
    "jitter": {"jitter": 0.2},
}


def main() -> None:
    """Times and saves."""
    torch.set_num_threads(1)
    batch = make_batch(size=CLIPS, image=224)
    augments = {name: Augment(**{**FLIPS, **options}) for name, options in SUBJECTS.items()}
    subjects: dict[str, Any] = {
        "none: a copy of the pixels": lambda: batch["frames"].clone(),
        **{
            name: (lambda augment=augment: augment(augment.labels(dict(batch))))
            for name, augment in augments.items()
        },
        "all, labels alone": lambda: augments["all"].labels(dict(batch)),
    }
    times = side_by_side(subjects, ROUNDS, clock=time.process_time)
    save(
        "augment",
        {
            "what": f"augmentation of {CLIPS} clips of 4 frames and a background, 224 x 224",
            "how": f"CPU seconds of one thread, median of {ROUNDS} rounds, in turn",
            "options": {name: {**FLIPS, **options} for name, options in SUBJECTS.items()},
            "ms of a clip": {
                name: round(1000 * each["median_s"] / CLIPS, 3) for name, each in times.items()
            },
            "cpu_s": times,
        },
    )


if __name__ == "__main__":
    main()
