"""Words of direction in captions: changed with a mirrored picture, or left out with the caption."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple


class _Words(NamedTuple):
    """Patterns of words changed by a mirror: left to right, top to bottom, and by either."""

    sides: str
    ends: str
    turns: str


#: Words by language, ISO 639-1. Of scripts without blanks, parts of words count.
_WORDS = {
    "en": _Words(
        r"\b(?:left|right)(?:wards?|most|[- ]hand(?:ed)?)?\b",
        r"\b(?:up|down)(?:wards?|ward|side|most|hill)?\b|\b(?:top|bottom|upper|lower|above|below)"
        r"(?:most)?\b",
        r"\b(?:counter[- ]?|anti[- ]?)?clockwise\b|\bc?cw\b",
    ),
    "de": _Words(
        r"\b(?:links|rechts|linke[rsnm]?|rechte[rsnm]?)\b",
        r"\b(?:oben|unten|hoch|runter|hinauf|hinab|herauf|herunter|aufwärts|abwärts|obere\w*"
        r"|untere\w*)\b",
        r"\buhrzeigersinn\b",
    ),
    "fr": _Words(r"\b(?:gauche|droite?)\b", r"\b(?:haut|bas|dessus|dessous)\b", r"horaire\b"),
    "es": _Words(
        r"\b(?:izquierd|derech)[ao]s?\b", r"\b(?:arriba|abajo|superior|inferior)\b", r"horari[oa]\b"
    ),
    "it": _Words(
        r"\b(?:sinistr|destr)[aoie]\b", r"\b(?:su|giù|alto|basso|sopra|sotto)\b", r"orari[oa]\b"
    ),
    "pt": _Words(r"\b(?:esquerd|direit)[ao]s?\b", r"\b(?:cima|baixo)\b", r"horári[oa]\b"),
    "nl": _Words(
        r"\b(?:links|rechts|linker|rechter)\w*\b",
        r"\b(?:boven|beneden|onder|omhoog|omlaag)\w*\b",
        r"\bklok\b",
    ),
    "ru": _Words(
        r"\b(?:лев|прав|влев|вправ|слев|справ)\w+\b", r"\b(?:вверх|вниз|верх|низ)\w*\b", r"часов\w+"
    ),
    "zh": _Words("[左右]", "[上下]", "[顺逆順]时针|[順逆]時針"),
    "ja": _Words("[左右]", "[上下]", "時計"),
    "ko": _Words("왼|오른|좌|우측", "위로|아래|상단|하단", "시계"),
}
LANGUAGES = tuple(_WORDS)
#: English words of another direction after a mirror.
_PAIRS = (("left", "right"), ("up", "down"), ("clockwise", "counter-clockwise"), ("cw", "ccw"))
_SWAPPED = {a: b for pair in _PAIRS for a, b in (pair, pair[::-1])}
_SWAPPED |= {"anticlockwise": "clockwise", "counterclockwise": "clockwise"}
#: English words that are a direction of motion wherever they stand.
_PLAIN = re.compile(r"(?:left|right|up|down)wards?|(?:counter[- ]?|anti-?)?clockwise|c?cw")
#: Verbs of a motion in the plane of the picture: "press down" and "pick up" are not.
_MOTION = r"\b(?:slid|swip|glid|strok|rubb?|dragg?|slipp?|shear|sweep|swept|scrap)\w*"
_SIDEWAYS = rf"(?:{_MOTION}|\b(?:mov|shift|push|pull|roll|translat|tilt)\w*)"
#: What follows a direction, rather than the thing that lies there (the left button).
_NEXT = (
    r"(?=\s*(?:$|[,.;:!?)]|(?:and|then|while|on|over|across|along|with|in|by|until|at|again|slowly"
    r"|quickly|gently|fast|from|for|before|after)\b))"
)
_THERE = r"(?:\s+\S+){0,3}?\s+(?:to the |towards? the |to )?"
#: Letters of Latin scripts lie below.
_LATIN = 0x250


def mirrored_caption(
    text: str,
    horizontal: bool,
    vertical: bool,
    turned: bool = False,
    languages: Sequence[str] = ("en",),
) -> str:
    """Caption of a mirrored or turned clip; "" if its words of direction cannot be changed.

    Directions of motion in English are exchanged (``slides left``); a caption with others (``press
    the left button``, ``pick up``), in another language, or of a turned clip, is left out.

    Args:
        text: The caption.
        horizontal: Whether left and right are exchanged.
        vertical: Whether top and bottom are.
        turned: Whether the clip is turned, by any angle that changes directions.
        languages: Languages of captions, of `LANGUAGES`.

    Example:
        >>> mirrored_caption("the ball slides left", horizontal=True, vertical=False)
        'the ball slides right'
        >>> mirrored_caption("press the left button", horizontal=True, vertical=False)
        ''
    """
    changed = (horizontal or turned, vertical or turned, horizontal != vertical)
    for language in languages:
        patterns = [one for one, is_on in zip(_WORDS[language], changed, strict=True) if is_on]
        found = re.compile("|".join(patterns), re.IGNORECASE) if patterns else None
        if found is None or not found.search(text):
            continue
        if language != "en" or turned:
            return ""
        swapped = _swapped(text, found)
        if swapped is None:
            return ""
        text = swapped
    return text


def _swapped(text: str, words: re.Pattern[str]) -> str | None:
    """An English text with its directions exchanged; None if one is not a direction of motion."""
    motions = {
        match.end()
        for verbs, sides in ((_SIDEWAYS, "left|right"), (_MOTION, "up|down"))
        for match in re.finditer(rf"{verbs}{_THERE}\b(?:{sides})\b{_NEXT}", text, re.IGNORECASE)
    }
    out, at = "", 0
    for match in words.finditer(text):
        word = match[0].lower()
        if not (_PLAIN.fullmatch(word) or match.end() in motions):
            return None
        stem = re.sub(r"wards?$", "", word)
        other = _SWAPPED[stem.replace("counter clock", "counter-clock").replace("anti-", "anti")]
        other += word[len(stem) :]
        out += text[at : match.start()] + (other.capitalize() if match[0][0].isupper() else other)
        at = match.end()
    return out + text[at:]


def undeclared_words(text: str, languages: Sequence[str]) -> str:
    """A word of direction, or of a script, of an undeclared language; "" for none.

    Args:
        text: The caption.
        languages: The declared languages.

    Example:
        >>> undeclared_words("die Kugel rollt nach links", ["en"])
        "'links' (de)"
    """
    for language, words in _WORDS.items():
        found = re.search(f"{words.sides}|{words.turns}", text, re.IGNORECASE)
        if language not in languages and found:
            if any(
                re.search(f"{own.sides}|{own.turns}", found[0], re.IGNORECASE)
                for own in (_WORDS[one] for one in languages)
            ):
                continue
            return f"{found[0]!r} ({language})"
    if all(language not in languages for language in ("ru", "zh", "ja", "ko")):
        odd = next((one for one in text.split() if any(_is_foreign(c) for c in one)), "")
        return repr(odd) if odd else ""
    return ""


def _is_foreign(letter: str) -> bool:
    return letter.isalpha() and ord(letter) >= _LATIN
