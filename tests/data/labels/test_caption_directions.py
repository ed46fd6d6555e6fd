"""Captions of mirrored clips: directions are exchanged, or the caption is left out."""

import pytest
import torch

from tactileforge.data.labels.augment import Augment, fill_captions
from tactileforge.data.labels.caption_directions import (
    LANGUAGES,
    mirrored_caption,
    undeclared_words,
)
from tactileforge.errors import ConfigError


@pytest.mark.parametrize(
    ("text", "sides", "ends", "wanted"),
    [
        ("The ball slides to the left.", True, False, "The ball slides to the right."),
        ("slides right across the gel", True, False, "slides left across the gel"),
        ("Leftward slip", True, False, "Rightward slip"),
        ("slide up and then right", True, True, "slide down and then left"),
        ("slides left", False, True, "slides left"),
        ("rotating counter-clockwise", True, False, "rotating clockwise"),
        ("a counter clockwise turn", False, True, "a clockwise turn"),
        ("twist clockwise", True, False, "twist counter-clockwise"),
        ("twist clockwise", True, True, "twist clockwise"),
        ("press the left button", True, False, ""),
        ("a right angle", True, False, ""),
        ("pick up the mug", False, True, ""),
        ("pick up the mug", True, False, "pick up the mug"),
        ("pressing down on the top", False, True, ""),
        ("a bright uproar", True, True, "a bright uproar"),
        ("sliding {action} over a mug", True, True, "sliding {action} over a mug"),
    ],
)
def test_a_mirror_exchanges_motions_and_leaves_out_the_rest(text, sides, ends, wanted):
    assert mirrored_caption(text, sides, ends) == wanted


def test_a_turn_leaves_directions_out_and_keeps_turns():
    assert mirrored_caption("slides left", False, False, turned=True) == ""
    assert mirrored_caption("twists clockwise", False, False, turned=True) == "twists clockwise"


@pytest.mark.parametrize(
    ("language", "text"),
    [
        ("de", "die Kugel rollt nach links"),
        ("fr", "la balle glisse à gauche"),
        ("es", "hacia la izquierda"),
        ("it", "verso destra"),
        ("pt", "para a direita"),
        ("nl", "naar rechts"),
        ("ru", "шар движется влево"),
        ("zh", "向左滑动"),
        ("ja", "右に滑る"),
        ("ko", "왼쪽으로 민다"),
    ],
)
def test_other_languages_leave_the_caption_out_once_declared(language, text):
    assert mirrored_caption(text, True, False, languages=["en", language]) == ""
    assert mirrored_caption(text, True, False) == text
    assert undeclared_words(text, ["en"])
    assert undeclared_words(text, ["en", *LANGUAGES]) == ""


def batch(texts):
    count = len(texts)
    return {
        "frames": torch.zeros(count, 1, 3, 8, 8, dtype=torch.uint8),
        "background": torch.zeros(count, 3, 8, 8, dtype=torch.uint8),
        "force": torch.zeros(count, 1, 3),
        "force_valid": torch.ones(count, 3, dtype=torch.bool),
        "action": torch.full((count,), 2),
        "group": torch.full((count,), -1),
        "sensor": ["gelsight_mini"] * count,
        "upright": torch.tensor([text.startswith("upright") for text in texts]),
        "aspect": torch.ones(count),
        "text": list(texts),
    }


def test_augmentation_changes_captions_with_the_picture(caplog):
    texts = ["slides left", "press the left button", "{action}", "upright, left", "nach links"]
    out = Augment(horizontal=1, vertical=0).labels(batch(texts))
    fill_captions(out)
    wanted = ["slides right", "", "sliding right", "upright, left", "nach links"]
    assert out["text"] == wanted
    (line,) = caplog.messages
    assert "'links' (de)" in line
    assert "augment.languages=[en]" in line
    caplog.clear()
    german = Augment(horizontal=1, vertical=0, languages=["en", "de"])
    assert german.labels(batch(texts))["text"][-1] == ""
    assert Augment(horizontal=0, vertical=0).labels(batch(texts))["text"] == texts
    turned = Augment(horizontal=0, vertical=0, rotate=180)
    torch.manual_seed(0)
    assert turned.labels(batch(["slides left"] * 8))["text"].count("") >= 6
    assert not caplog.messages


def test_an_unknown_language_is_refused():
    with pytest.raises(ConfigError, match=r"augment\.languages.*'english'"):
        Augment(languages=["english"])
