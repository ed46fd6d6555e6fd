from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tactileforge.data import encode_image
from tactileforge.datasets import Recordings
from tactileforge.reading.guessing.layout import guess_layout
from tactileforge.reading.guessing.tiles import tiles

RNG = np.random.default_rng(0)


def gel(height: int, width: int, level: int = 120, noise: int = 6) -> NDArray[np.uint8]:
    """A smooth picture, with marker dots and noise."""
    ramp = np.linspace(0, 60, width)[None, :, None] + np.linspace(0, 30, height)[:, None, None]
    picture = level + ramp * [0.3, 0.6, -0.5] + RNG.normal(0, noise / 3, (height, width, 3))
    for y in range(12, height - 6, 24):
        for x in range(12, width - 6, 24):
            picture[y - 2 : y + 2, x - 2 : x + 2] = 30
    return picture.clip(0, 255).astype(np.uint8)


def put_together(rows: int, columns: int, bar: int, size: int = 96) -> NDArray[np.uint8]:
    """Tiles of several gels, each with a black bar and white letters below."""
    levels = iter(np.resize([60, 190, 100, 150], rows * columns + 8))
    lines = []
    for _ in range(rows):
        tiles = [gel(size, size, int(next(levels))) for _ in range(columns)]
        next(levels)
        line = np.concatenate(tiles, axis=1)
        below = np.zeros((bar, line.shape[1], 3), np.uint8)
        below[4 : bar - 4, ::31] = 255
        lines.append(np.concatenate([line, below]))
    return np.concatenate(lines)


@pytest.mark.parametrize(
    ("rows", "columns", "bar"),
    [(3, 3, 12), (1, 2, 12), (1, 3, 0), (2, 1, 0), (2, 2, 16), (4, 4, 0)],
)
def test_pictures_that_are_put_together_are_seen(rows: int, columns: int, bar: int) -> None:
    pictures = np.stack([put_together(rows, columns, bar)] * 2)
    wanted = [
        (96 * column, (96 + bar) * row, 96, 96) for row in range(rows) for column in range(columns)
    ]
    assert tiles(pictures) == wanted


def test_one_gel_is_no_tiles() -> None:
    step = gel(240, 320)
    step[:, 160:] = np.minimum(step[:, 160:], 90)  # an edge in its middle, but not across it all
    step[:100, 158:162] = 120
    noise = RNG.integers(0, 255, (1, 120, 160, 3), np.uint8)
    for pictures in (gel(240, 320)[None], gel(320, 240, 60, 30)[None], step[None], noise):
        assert tiles(pictures) == []
    bars = gel(240, 320)
    bars[:40] = bars[200:] = 0
    assert tiles(bars[None]) == []


def soft(height: int, width: int) -> NDArray[np.uint8]:
    """A gel with a little light from one side and noise."""
    light = 100 + np.linspace(0, 8, width)[None, :, None] * [1, 0.5, -0.5]
    return (light + RNG.normal(0, 2, (height, width, 3))).clip(0, 255).astype(np.uint8)


def test_two_gels_of_one_kind_beside_each_other_are_seen_by_their_seam() -> None:
    pictures = np.stack([np.concatenate([soft(96, 128), soft(96, 128)], axis=1)] * 2)
    assert tiles(pictures) == [(0, 0, 128, 96), (128, 0, 128, 96)]
    assert tiles(soft(96, 256)[None]) == [], "one wide gel"
    half = soft(96, 128)
    mirrored = np.concatenate([half, half[:, ::-1]], axis=1)
    assert tiles(mirrored[None]) == [], "light from the middle"
    square = np.concatenate([soft(128, 96), soft(128, 96)], axis=1)
    assert tiles(square[None]) == [], "of no odd shape"


def test_a_film_of_nine_sensors_is_not_taken_for_one(tmp_path: Path) -> None:
    writer = cv2.VideoWriter(
        str(tmp_path / "demo.avi"), cv2.VideoWriter.fourcc(*"FFV1"), 30, (288, 324)
    )
    first = put_together(3, 3, 12)
    for _ in range(6):
        writer.write(first)
    writer.release()
    guess = guess_layout(tmp_path)
    assert guess is not None
    [layout] = guess.options["layouts"].values()
    assert layout["sensor"] == "gelsight_mini"  # by the shape of a part, not of all
    assert [crop["box"] for crop in layout["crops"].values()][3:5] == [
        [0, 108, 96, 96],
        [96, 108, 96, 96],
    ]
    told = [line for line in guess.doubts if line.startswith("crops:")]
    assert len(told) == 1
    assert "3 x 3, each taken for a sensor of its own" in told[0]
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert len(found) == 9
    assert {one.frames.shape for one in found} == {(96, 96)}
    assert "9 recordings" not in data.held_out[0]  # of one film: held out as one
    np.testing.assert_array_equal(found[4].frames.read([2])[0], first[108:204, 96:192, ::-1])


def write(path: Path, picture: NDArray[np.uint8], kind: str = "png") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encode_image(picture, kind))


def presses(folder: Path, count: int, first: int = 1) -> None:
    for number in range(first, first + count):
        picture = gel(60, 80)
        y, x = RNG.integers(8, 50), RNG.integers(8, 70)
        picture[y - 8 : y + 8, x - 8 : x + 8] //= 2
        write(folder / f"frame_{number}.jpg", picture, "jpg")


def test_the_first_picture_and_the_only_one_of_its_kind_is_the_background(tmp_path: Path) -> None:
    presses(tmp_path / "images", 20)
    write(tmp_path / "images/frame_0.png", gel(60, 80))
    write(tmp_path / "images/pseudo_bg_img.png", np.zeros((60, 80, 3), np.uint8))
    guess = guess_layout(tmp_path)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    names = {one.key.rpartition("/")[2] for one in found}
    assert names == {f"frame_{number}.jpg" for number in range(1, 21)}  # neither still is a touch
    for one in found:
        assert one.no_contact is not None
        assert one.no_contact.read([0]).max() > 50
    told = [line for line in guess.doubts if line.startswith("background:")]
    assert any("images/frame_0.png, by its place as the first" in line for line in told)
    assert any("pseudo_bg_img.png is not of the size and colours" in line for line in told)


def test_a_picture_of_another_kind_is_no_background_by_that_alone(tmp_path: Path) -> None:
    presses(tmp_path / "last", 20)
    write(tmp_path / "last/frame_21.png", gel(60, 80))
    presses(tmp_path / "few", 4)
    write(tmp_path / "few/frame_0.png", gel(60, 80))
    for folder in ("last", "few"):
        guess = guess_layout(tmp_path / folder)
        assert guess is not None
        [layout] = guess.options["layouts"].values()
        assert layout["background"] == "none"
        data = Recordings(**guess.options)
        names = [one.key for split in ("train", "val") for one in data.recordings(split)]
        assert len(names) == (21 if folder == "last" else 5)


@pytest.mark.parametrize(("moves", "each"), [(True, "sequence"), (False, "touch")])
def test_noise_of_a_camera_is_no_change(moves: bool, each: str, tmp_path: Path) -> None:
    """A small imprint in a noisy picture: sliding, or at a place of its own."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:96, :128]
    at = rng.uniform(20, 76, (60, 2))
    for number in range(60):
        row, column = (30 + 36 * number / 59, 48) if moves else at[number]
        bump = 40 * np.exp(-((y - row) ** 2 + (x - column) ** 2) / 60)
        frame = 110 + bump[..., None] + rng.normal(0, 3, (96, 128, 3))
        cv2.imwrite(str(tmp_path / f"{number:03d}.png"), frame.clip(0, 255).astype(np.uint8))
    guess = Recordings.recognise(tmp_path)
    assert guess is not None
    (layout,) = guess.options["layouts"].values()
    assert layout["each"] == each
