"""Sets with odd pictures, copies and captions; what a fault of some says of the others."""

from dataclasses import replace

import numpy as np
import pytest

from tactileforge.checks.check import Finding
from tactileforge.checks.doors import copy_lines, frame_lines
from tactileforge.checks.made import COUNT, made_touch, resting
from tactileforge.checks.names import plain_name
from tactileforge.checks.run import CheckRun
from tactileforge.checks.sides import side_of
from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.frames.turned import TurnedFrames
from tactileforge.sensors.resting_colours import colour_grid, known_colours, mirror_of


def findings(*recordings: Recording, select: str) -> list[Finding]:
    run = CheckRun([select])
    found = [one for place, r in enumerate(recordings) for one in run.look(r, _split(place))]
    return [*found, *run.end()]


def _split(place: int) -> str:
    return "val" if place % 2 else "train"


@pytest.mark.parametrize(("axis", "mirror"), [("x", np.s_[:, ::-1]), ("y", np.s_[::-1])])
def test_mirrored_sets_are_put_right_by_the_key(axis: str, mirror: tuple[slice, ...]) -> None:
    odd = [made_touch(seed, still=resting(seed)[mirror]) for seed in range(3)]
    found = findings(*odd, select="mirrored")
    assert {one.where for one in found} == {"made/0", "made/1", "made/2"}
    assert all(one.keys == {"mirror": axis} for one in found)
    right = [
        replace(
            one,
            frames=TurnedFrames(one.frames, False, 0, axis),
            no_contact=TurnedFrames(one.no_contact, False, 0, axis),
        )
        for one in odd
        if one.no_contact is not None
    ]
    assert findings(*right, select="mirrored") == []
    assert not any("TF308" in line for line in frame_lines(right))
    assert any("TF308 mirrored in 3 of 3" in line for line in frame_lines(odd))


def test_an_unclear_unit_is_taken_as_its_clear_neighbours_are() -> None:
    digit = known_colours("digit")
    assert digit is not None
    # lights between those of the type and of its mirror image: it tells nothing by itself
    grid = 0.5 * digit + 0.5 * digit[::-1]
    unclear = 110 + 0.25 * np.kron(grid, np.ones((20, 15, 1)))
    assert mirror_of(colour_grid(unclear), digit) == ""
    odd = made_touch(1, still=resting(1)[:, ::-1])
    beside = [odd, made_touch(2, still=unclear[:, ::-1])]
    assert len(findings(*beside, select="mirrored")) == 2
    assert len(findings(*beside, made_touch(3), select="mirrored")) == 1, "one stands upright"
    assert findings(made_touch(2, still=unclear), made_touch(3), select="mirrored") == []


def first_frames(light: float, count: int, odd: int) -> Recording:
    frames = made_touch().frames.read(range(COUNT))
    frames[:odd] = np.clip(frames[:odd] * light, 0, 255).astype(np.uint8)
    film = ArrayFrames(frames)
    return made_touch(frames=film, no_contact=FrameSubset(film, range(count)))


@pytest.mark.parametrize(
    ("light", "count", "odd"), [(0.0, 1, 1), (0.02, 3, 3), (0.5, 3, 5), (1.8, 2, 4), (0.0, 3, 2)]
)
def test_odd_first_frames_are_told_with_the_frames_to_take(
    light: float, count: int, odd: int
) -> None:
    (found,) = findings(first_frames(light, count, odd), select="odd_first_frames")
    assert found.keys == {"background": {"frames": [odd, odd + count]}}
    assert f"settled from frame {odd}" in found.words


@pytest.mark.parametrize("start", [40, COUNT - 3])
def test_a_background_of_odd_frames_anywhere_is_told(start: int) -> None:
    frames = made_touch().frames.read(range(COUNT))
    rest = range(start, start + 3)
    whole = ArrayFrames(frames.copy())
    good = made_touch(frames=whole, no_contact=FrameSubset(whole, rest))
    frames[rest] = frames[rest] // 40
    film = ArrayFrames(frames)
    (found,) = findings(
        made_touch(frames=film, no_contact=FrameSubset(film, rest)), select="odd_first_frames"
    )
    assert found.words.startswith(f"frames {start} to {start + 2}, which are the background")
    assert not found.keys, "which frames are without contact is not known"
    assert start == 40 or findings(good, select="odd_first_frames") == []


def test_green_first_frames_are_told_and_one_of_three_is_not_the_median() -> None:
    frames = made_touch().frames.read(range(COUNT))
    frames[:3] = (0, 255, 0)
    film = ArrayFrames(frames)
    green = made_touch(frames=film, no_contact=FrameSubset(film, range(3)))
    assert len(findings(green, select="odd_first_frames")) == 1
    assert findings(first_frames(0.0, 3, 1), select="odd_first_frames") == []
    assert findings(first_frames(1.0, 3, 0), select="odd_first_frames") == []


def noisy(frames: np.ndarray) -> None:
    frames += np.random.default_rng(5).integers(0, 2, frames.shape, np.uint8)


def test_copies_across_splits_at_the_doors() -> None:
    train = [made_touch(seed) for seed in range(4)]
    assert copy_lines(train, [made_touch(9), made_touch(8)]) == []
    (line,) = copy_lines(train, [made_touch(9), made_touch(2, edit=noisy, key="made/copy")])
    assert line.startswith("TF501 1 held-out recordings are copies of training ones (made/2 and")
    found = findings(made_touch(0), made_touch(0, edit=noisy, key="copy"), select="TF501")
    assert [one.where for one in found] == ["made/0"]
    same = findings(made_touch(0), made_touch(1), made_touch(0, key="copy"), select="TF501")
    assert same == [], "both are trained on"


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("1", "1.0"),
        ("007", "7"),
        ("1e1", "10"),
        ("red cup", " Red_Cup "),
        ("red-cup", "red  cup"),
        ("caf\u00e9", "cafe\u0301"),
        ("\ufeffcup", "cup"),
        ("cup\u200b", "cup"),
    ],
)
def test_two_spellings_of_one_name(one: str, other: str) -> None:
    assert plain_name(one) == plain_name(other)
    assert len(findings(made_touch(object=one), made_touch(1, object=other), select="TF401")) == 1


@pytest.mark.parametrize(("one", "other"), [("1", "11"), ("cup", "cups"), ("-1", "1"), ("a1", "a")])
def test_two_names(one: str, other: str) -> None:
    assert plain_name(one) != plain_name(other)


@pytest.mark.parametrize(
    ("text", "across", "along"),
    [
        ("the ball slides left", "left", ""),
        ("press the left button", "left", ""),
        ("Turn RIGHT", "RIGHT", ""),
        ("move it up", "", "move it up"),
        ("slides downwards", "", "downwards"),
        ("turn the cap clockwise", "clockwise", "clockwise"),
        ("turn it anti-clockwise", "anti-clockwise", "anti-clockwise"),
        ("pick up the cup", "", ""),
        ("it is all right", "", ""),
        ("what is left of it", "", ""),
        ("press {action}", "", ""),
        ("a bright upholstery", "", ""),
    ],
)
def test_words_of_sides(text: str, across: str, along: str) -> None:
    assert side_of(text, ["horizontal"]) == across
    assert side_of(text, ["vertical"]) == along
    assert side_of(text, []) == ""
