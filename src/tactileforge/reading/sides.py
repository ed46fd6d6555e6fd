"""Words of sides and fingers, for telling the sensors of one touch apart."""

from __future__ import annotations

import re

#: Words of sides, each behind those that mean the same.
_WORDS = (
    *("left l lf lh leftfinger lefthand", "right r rf rh rightfinger righthand"),
    *("top", "bottom", "upper", "lower", "front", "back", "inner", "outer"),
    *("thumb", "index", "middle", "ring", "pinky little"),
)
#: Words of sides, each with the usual word of its side.
SIDES = {word: words.split()[0] for words in _WORDS for word in words.split()}
#: Words of one sensor of several in a longer name.
SIDE_WORDS = re.compile("|".join((*SIDES, "finger", "palm", "wrist")))
#: Whole names of one of several files or folders; within longer ones, they may mean anything.
SIDE_NAMES = SIDES.keys() | {"finger", "palm", "wrist", "up", "down", "first", "second", "a", "b"}


def side_of(name: str) -> str:
    """Side of a file or folder by its whole name, or by the only word of a side in it; "" for none.

    Example:
        >>> side_of("Left"), side_of("left_tactile"), side_of("palm_rgb"), side_of("left_right")
        ('left', 'left', '', '')
    """
    name = name.lower()
    if name in SIDE_NAMES:
        return name
    words = SIDES.keys() & {*re.findall(r"[a-z]+", name)}
    return words.pop() if len(words) == 1 else ""
