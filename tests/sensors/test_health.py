import numpy as np
import pytest

from tactileforge.contracts import Frame
from tactileforge.sensors.health import FrozenPictures, exposure_trouble


def frames(pictures, fps=10):
    return [Frame(array=picture, time=i / fps) for i, picture in enumerate(pictures)]


def noise(count, seed=0):
    rng = np.random.default_rng(seed)
    return [rng.integers(60, 200, (48, 64, 3), np.uint8) for _ in range(count)]


def test_the_same_picture_for_a_second_is_frozen_until_it_changes():
    still = noise(1)[0]
    pictures = FrozenPictures()
    shown = [*noise(3, 1), *[still.copy() for _ in range(15)], *noise(2, 2)]
    found = [pictures.look(frame) for frame in frames(shown)]
    assert [i for i, what in enumerate(found) if what] == list(range(13, 18))  # 3 + ten, to 18


def test_one_pixel_that_changes_is_not_frozen():
    pictures, picture = FrozenPictures(), noise(1)[0]
    for i in range(30):
        picture = picture.copy()
        picture[33, 7, 1] = i
        assert not pictures.look(Frame(array=picture, time=float(i)))


@pytest.mark.parametrize(
    ("picture", "trouble"),
    [
        (np.full((48, 64, 3), 3, np.uint8), "black"),
        (np.full((48, 64, 3), 254, np.uint8), "saturated"),
        (np.full((48, 64, 3), 128, np.uint8), ""),
        (np.concatenate([np.full((48, 32, 3), v, np.uint8) for v in (0, 90)], 1), ""),
        (np.concatenate([np.full((48, 32, 3), v, np.uint8) for v in (90, 255)], 1), ""),
    ],
)
def test_black_and_saturated(picture, trouble):
    assert exposure_trouble(picture) == trouble


@pytest.mark.realdata
def test_real_sensors_without_contact_are_well(realdata):
    import cv2

    paths = sorted((realdata / "sensor_backgrounds").glob("*.*g"))
    assert len(paths) >= 10
    for path in paths:
        assert exposure_trouble(cv2.imread(str(path))) == "", path.name
