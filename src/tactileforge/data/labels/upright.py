"""Recordings with a right way up, such as a touch of letters."""

from __future__ import annotations

from tactileforge.contracts import Recording
from tactileforge.errors import DataError

#: Spellings in labels: a CSV has text, a shard a number.
_WORDS = {
    **dict.fromkeys(("1", "1.0", "true", "yes"), True),
    **dict.fromkeys(("", "0", "0.0", "false", "no", "nan"), False),
}


def is_upright(recording: Recording) -> bool:
    """Whether a mirrored or turned clip would be wrong, by the label ``upright``.

    Raises:
        DataError: The label is neither true nor false.

    Example:
        >>> import numpy as np
        >>> from tactileforge.data import ArrayFrames
        >>> frames = ArrayFrames(np.zeros((1, 2, 2, 3), np.uint8))
        >>> letters = Recording(key="a", sensor="digit", frames=frames, times=np.zeros(1),
        ...                     no_contact=None, labels={"upright": "yes"})
        >>> is_upright(letters)
        True
    """
    value = recording.labels.get("upright", "")
    known = _WORDS.get(str(value).strip().lower())
    if known is None:
        raise DataError(f"{recording.key}: the label upright is {value!r}: give yes or no")
    return known
