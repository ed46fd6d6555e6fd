"""Licences by SPDX identifiers: checks of cards, files of weights and recordings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

from tactileforge.errors import ConfigError

#: Word for weights whose authors state no licence (SPDX).
NO_LICENCE = "NOASSERTION"
#: Identifiers that errors offer: those of code, weights and data of this field.
_COMMON: Sequence[str] = (
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "CC-BY-4.0",
    "CC-BY-NC-4.0",
    "CC-BY-NC-SA-4.0",
    "CC-BY-SA-4.0",
    "CC0-1.0",
    "GPL-3.0-or-later",
    "MIT",
)


def check_licence(where: str, licence: str) -> None:
    """Check the licence of a card or of weights: an SPDX expression, or `NO_LICENCE`.

    Args:
        where: Place of the licence, for errors.
        licence: SPDX identifier or expression; ``LicenseRef-NAME`` for a licence without one.

    Raises:
        ConfigError: It is neither; names the nearest identifier.

    Example:
        >>> check_licence("card mine", "Apache-2.0")
        >>> check_licence("card mine", "LicenseRef-lab-internal")
    """
    if licence != NO_LICENCE and not _is_spdx(licence):
        raise ConfigError(_wrong(where, licence, f"or {NO_LICENCE} where none is stated"))


def check_data_licence(where: str, licence: str) -> None:
    """Check the licence of recordings: an SPDX expression, "", or two and more plain words.

    Words that spell an identifier in another way are no plain words.

    Args:
        where: Place of the licence, for errors.
        licence: SPDX identifier or expression, or words such as ``none stated``.

    Raises:
        ConfigError: It is none of these; names the nearest identifier.

    Example:
        >>> check_data_licence("layout 'cups'", "CC-BY-4.0")
        >>> check_data_licence("layout 'cups'", "none stated, ask the authors")
    """
    is_words = " " in licence.strip() and _plain(licence) not in map(_plain, _COMMON)
    if licence and not is_words and licence != NO_LICENCE and not _is_spdx(licence):
        raise ConfigError(_wrong(where, licence, "or say it in several words"))


def _is_spdx(licence: str) -> bool:
    try:
        return canonicalize_license_expression(licence) == licence
    except InvalidLicenseExpression:
        return False


def _wrong(where: str, licence: str, other: str) -> str:
    near = _nearest(licence)
    return (
        f"{where}: {licence!r} is not an SPDX identifier{near and f'; did you mean {near!r}?'}"
        f"{'' if near else '.'} Known: {', '.join(_COMMON)} and the others of SPDX. Give "
        f"LicenseRef-NAME for a licence without one, {other}"
    )


def _nearest(licence: str) -> str:
    """The nearest identifier; "" if none is near."""
    try:
        return canonicalize_license_expression(licence)
    except InvalidLicenseExpression:
        plain, given = {_plain(name): name for name in _COMMON}, _plain(licence)
        begun = [name for name in plain if given and name.startswith(given)]
        near = begun[:1] or get_close_matches(given, plain, n=1)
        return plain[near[0]] if near else ""


def _plain(licence: str) -> str:
    """Letters and digits of a licence, without the words licence, license and version."""
    return re.sub(r"licen[cs]e|version|[^a-z0-9]", "", licence.lower())
