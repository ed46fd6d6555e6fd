"""Words for sides and turns in captions."""

from __future__ import annotations

import re
from collections.abc import Collection

#: Words that a mirror, or a turn, makes wrong; ``left`` of "what is left" and ``right`` of "all
#: right" are not sides.
_ACROSS = (
    r"(?<!what is )(?<!what's )(?<!are )(?<!be )\bleft(wards?|most|-hand)?\b(?! (over|behind|of a))"
    r"|(?<!all )\bright(wards?|most|-hand)?\b(?! (now|away|angles?))"
)
_ALONG = (
    r"\b(up|down)wards?\b|\b(mov|slid|slip|drag|push|pull|roll|swip|shift|scrap|rub)\w* "
    r"((it|the \w+|across|along) )?(up|down)\b|\b(above|below|topmost|bottommost)\b"
    r"|\b(at|to|from|near) the (top|bottom)\b"
)
_ROUND = r"\b(counter|anti)?-?\s?clock-?wise\b"
_WORDS = {
    "horizontal": re.compile(f"{_ACROSS}|{_ROUND}", re.IGNORECASE),
    "vertical": re.compile(f"{_ALONG}|{_ROUND}", re.IGNORECASE),
    "turn": re.compile(f"{_ACROSS}|{_ALONG}", re.IGNORECASE),
}


def side_of(text: str, changes: Collection[str]) -> str:
    """First word for a side, or turn, that a change of clips makes wrong; "" without one.

    Args:
        text: Caption.
        changes: Changes of clips, of ``horizontal`` and ``vertical`` (mirrors) and ``turn``.

    Example:
        >>> side_of("the ball slides left", ["horizontal"]), side_of("slides left", ["vertical"])
        ('left', '')
        >>> side_of("turn it counter-clockwise", ["vertical"]), side_of("pick up a cup", ["turn"])
        ('counter-clockwise', '')
    """
    for change in ("horizontal", "vertical", "turn"):
        if change in changes and (found := _WORDS[change].search(text)):
            return found[0].strip()
    return ""
