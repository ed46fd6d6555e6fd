"""Pictures and films without contact, found by their names."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.reading.guessing.media import names_still, stills_among

GREY = 90


def picture(path: Path, grey: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((24, 32, 3), grey, np.uint8))


def film(path: Path, grey: int) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20, (32, 24))
    for i in range(6):
        writer.write(np.full((24, 32, 3), grey + 5 * i, np.uint8))
    writer.release()


def read(root: Path) -> tuple[dict[str, Recording], list[str], dict[str, Any]]:
    guess = Recordings.recognise(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert not data.skipped
    layouts: Any = guess.options["layouts"]
    (layout,) = layouts.values()
    return {one.key.partition("/")[2]: one for one in found}, [*guess.doubts], dict(layout)


@pytest.mark.parametrize(
    "name",
    ["base", "flat_0", "empty", "no_touch", "Initial", "init_frame", "undeformed", "noncontact"],
)
def test_a_picture_beside_classes_is_the_background(name: str, tmp_path: Path) -> None:
    for i, of in enumerate(("bolt", "nut", "bolt", "nut")):
        picture(tmp_path / of / f"{i}.png", GREY + 20 * i)
    picture(tmp_path / f"{name}.png", GREY)
    found, _, layout = read(tmp_path)
    assert layout["background"] == {"file": f"{name}.png"}
    assert sorted(found) == ["bolt/0.png", "bolt/2.png", "nut/1.png", "nut/3.png"]
    for one in found.values():
        assert one.no_contact is not None
        assert (one.no_contact.read([0]) == GREY).all()


def test_a_folder_of_the_background_is_no_object(tmp_path: Path) -> None:
    names = [f"object{letter}" for letter in "abcdefghij"]
    for i, name in enumerate(names):
        picture(tmp_path / name / "0.png", GREY + 3 * i)
        picture(tmp_path / "no_contact" / f"{i}.png", GREY)
    found, doubts, layout = read(tmp_path)
    assert {one.object for one in found.values()} == {*names}
    assert layout["background"] == {"file": "no_contact/0.png"}
    assert any(line.startswith("background: no_contact/0.png, by its name") for line in doubts)


def test_each_take_has_the_background_of_its_folder(tmp_path: Path) -> None:
    for take in range(3):
        for i in range(8):
            picture(tmp_path / f"trial_{take}/frames/{i}.png", GREY + 5 * i)
        for i in range(2):
            picture(tmp_path / f"trial_{take}/background/{i}.png", GREY + take)
    found, _, _ = read(tmp_path)
    assert sorted(found) == [f"trial_{take}/frames" for take in range(3)]
    for take in range(3):
        still = found[f"trial_{take}/frames"].no_contact
        assert still is not None
        assert (still.read([0]) == GREY + take).all()


def test_a_film_without_contact_is_the_background(tmp_path: Path) -> None:
    for take in range(3):
        film(tmp_path / f"trial_{take}.avi", GREY)
    film(tmp_path / "no_contact.avi", GREY - 20)
    found, doubts, _ = read(tmp_path)
    assert sorted(found) == [f"trial_{take}.avi" for take in range(3)]
    for one in found.values():
        assert one.no_contact is not None
        assert abs(float(one.no_contact.read([0]).mean()) - (GREY - 20)) < 3
    assert any(line.startswith("background: no_contact.avi, by its name") for line in doubts)


@pytest.mark.parametrize("name", ["basement", "flat_screw", "blanket", "zeros", "empty_can"])
def test_words_within_others_name_no_background(name: str) -> None:
    assert not names_still(name)


@pytest.mark.parametrize(
    ("names", "stills"),
    [
        (("flat", "sphere", "cube"), []),  # indenters
        (("flat/0", "sphere/0"), []),
        (("flat", "frame_0", "frame_1"), ["flat"]),
        (("flat", "trial_0/0", "trial_1/0"), ["flat"]),
        (("empty", "full"), ["empty"]),
        (("background", "bg_2"), []),  # nothing else is there
    ],
)
def test_objects_of_such_names(names: tuple[str, ...], stills: list[str]) -> None:
    found = stills_among([Path(f"{name}.png") for name in names], Path())
    assert sorted(path.stem for path in found) == stills
