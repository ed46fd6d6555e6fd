"""An optical calibration of a unit, from presses of a ball."""

import csv
import math
import re
import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from tactileforge_depth.lighting import load_optics, optics_names, polynomial_background
from tactileforge_depth.presses import Presses
from tactileforge_depth.reader import DepthReader
from tactileforge_live.calibrate.depth import calibrate_depth
from tactileforge_live.calibrate.depth_options import DepthOptions
from tactileforge_live.calibrate.depth_page import depth_page
from tactileforge_sim.optics.render import Optics
from tactileforge_sim.optics.sensor_instances import SensorInstance

from tactileforge import cli
from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.errors import ConfigError, DataError

ROWS, COLUMNS = 80, 60
SPACING = 16.3 / ROWS
OPTIONS = DepthOptions(ball_mm=6.0, gel_mm=2.5)


def background() -> torch.Tensor:
    return polynomial_background(load_optics("digit").backgrounds[0], ROWS, COLUMNS)


@pytest.fixture(scope="module")
def made() -> Presses:
    """Sixteen presses on a DIGIT with exchanged red and green lights."""
    rng = np.random.default_rng(0)
    circles = np.stack([rng.uniform(15, 45, 16), rng.uniform(20, 60, 16), rng.uniform(5, 8, 16)], 1)
    about = {"spacing": SPACING, "ball": 3.0, "thickness": 2.5}
    still = background()
    blank = torch.zeros(16, 3, ROWS, COLUMNS, dtype=torch.uint8)
    presses = Presses(still, blank, torch.tensor(circles, dtype=torch.float32), **about)
    swap = torch.tensor([[0.2, 0.9, 0.0], [0.9, 0.2, 0.0], [0.0, 0.0, 1.0]])
    optics = load_optics("digit").coloured(swap)
    unit = Optics(SensorInstance("digit", 0, still, optics, SPACING, 0.0))
    shown = torch.cat([unit.render(presses.dent(number)) for number in range(16)])
    return replace(presses, pictures=shown.round().clamp(0, 255).byte())


def recordings(presses: Presses, *, marked: bool = True) -> list[Recording]:
    still = ArrayFrames(presses.background.round().byte().movedim(0, -1).numpy()[None])
    found = []
    for number, (picture, circle) in enumerate(zip(presses.pictures, presses.circles, strict=True)):
        names = ("center_x_px", "center_y_px", "radius_px")
        labels = dict(zip(names, circle.tolist(), strict=True)) if marked else {}
        # the ball comes down: the deepest frame is not the first one
        frames = np.concatenate([still.read([0]), picture.movedim(0, -1).numpy()[None]])
        one = Recording(
            key=f"press{number}",
            sensor="digit",
            frames=ArrayFrames(frames),
            times=np.arange(2) / 10,
            no_contact=still,
            labels=labels,
        )
        found.append(one)
    return found


@pytest.mark.slow
def test_a_unit_is_read_better_than_by_the_shipped_calibration(made: Presses) -> None:
    result = calibrate_depth(recordings(made), OPTIONS)
    assert result.before is not None
    assert result.after.correlation.mean() > 0.98 > 0.5 > result.before.correlation.mean()
    assert result.after.error.mean() < 0.3 * result.before.error.mean()
    assert result.notes == []
    page = depth_page(result)
    assert "Depth calibration of digit" in page
    assert page.count("<img") == 6 * 4


@pytest.mark.slow
def test_a_calibration_is_judged_on_presses_that_it_did_not_see(made: Presses) -> None:
    """Pictures of other circles cannot be read, however well they are fitted."""
    mixed = replace(made, circles=made.circles.roll(5, 0))
    assert calibrate_depth(recordings(mixed), OPTIONS).after.correlation.mean() < 0.5


@pytest.mark.slow
def test_circles_are_found_where_none_are_marked(made: Presses) -> None:
    result = calibrate_depth(recordings(made, marked=False), OPTIONS)
    centres = (result.presses.circles - made.circles)[:, :2].norm(dim=1)
    assert centres.median() < 5
    assert "circles of 16 presses are found in the pictures" in result.notes[0]


@pytest.mark.slow
def test_presses_that_cannot_be_used_are_named(made: Presses) -> None:
    good = recordings(made)
    with pytest.raises(DataError, match="7 presses: press the ball at least 8 times"):
        calibrate_depth(good[:7], OPTIONS)
    outside = [replace(good[0], labels=good[0].labels | {"center_x_px": 600}), *good[1:]]
    with pytest.raises(DataError, match=r"press0: a circle of radius .* is not in a picture of 60"):
        calibrate_depth(outside, OPTIONS)
    wordy = [replace(good[0], labels=good[0].labels | {"radius_px": "big"}), *good[1:]]
    with pytest.raises(DataError, match="press0: center_x_px, center_y_px, radius_px: could not"):
        calibrate_depth(wordy, OPTIONS)
    calm = [*good[1:], replace(good[0], frames=good[0].no_contact)]
    with pytest.raises(DataError, match="press0: no frame shows contact"):
        calibrate_depth(calm, OPTIONS)
    wide = ArrayFrames(np.zeros((1, 50, 60, 3), np.uint8))
    with pytest.raises(DataError, match="pictures of 50 x 60 and 80 x 60 pixels"):
        calibrate_depth([*good, replace(good[0], frames=wide)], OPTIONS)
    units = [replace(one, labels={"unit": "AB"[number % 2]}) for number, one in enumerate(good)]
    with pytest.raises(ConfigError, match="digit A, digit B"):
        calibrate_depth(units, OPTIONS)
    with pytest.raises(ConfigError, match="sensing area of gelslim unknown: give mm_per_pixel="):
        calibrate_depth([replace(one, sensor="gelslim") for one in good], OPTIONS)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ball_mm": -1}, "ball_mm=-1: give millimetres above 0"),
        ({"ball_mm": 4, "circle_share": 1.5}, "circle_share=1.5: give a number above 0, at most 1"),
        ({"ball_mm": 4, "steepest": 0}, "steepest=0"),
    ],
)
def test_options_out_of_range(options: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        DepthOptions(**options)


@pytest.mark.slow
def test_the_command_line_writes_a_calibration_and_its_page(
    made: Presses, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def write(name: str, picture: torch.Tensor) -> None:
        rgb = picture.round().byte().movedim(0, -1).numpy()
        cv2.imwrite(str(tmp_path / name), rgb[..., ::-1])

    write("background.png", made.background)
    rows = [["file", "center_x_px", "center_y_px", "radius_px"]]
    for number, (picture, circle) in enumerate(zip(made.pictures, made.circles, strict=True)):
        write(f"press_{number}.png", picture)
        rows.append([f"press_{number}.png", *map(str, circle.tolist())])
    with open(tmp_path / "circles.csv", "w", newline="") as file:
        csv.writer(file).writerows(rows)
    (tmp_path / "tactileforge.yaml").write_text(
        "layouts:\n  balls:\n    path: .\n    images: press_*.png\n    each: touch\n"
        "    sensor: digit\n    background: {file: background.png}\n"
        "    labels: {file: circles.csv, key: file}\n    source: mine\n    licence: MIT\n"
    )
    words = ["calibrate", "depth", "data=recordings", f"data.root={tmp_path}", "ball_mm=6"]
    assert cli.run([*words, "gel_mm=2.5", f"out={tmp_path / 'mine.json'}"]) == 0
    told = capsys.readouterr().out
    assert "shipped calibration: correlation" in told
    assert "this calibration: correlation" in told
    assert (tmp_path / "mine.html").is_file()
    picture = made.pictures[0].movedim(0, -1).numpy()
    still = made.background.round().byte().movedim(0, -1).numpy()
    found = DepthReader("digit", tmp_path / "mine.json", ROWS).read(picture, still).depth
    assert float(found.max()) == pytest.approx(float(made.dent(0).max()), rel=0.5)
    assert cli.run([*words, "out=mine.yaml"]) == 1
    assert (
        "out=mine.yaml: give the name of a file, for example digit.json" in capsys.readouterr().err
    )


def grey_levels(name: str) -> np.ndarray:
    still = polynomial_background(load_optics(name).backgrounds[0], ROWS, COLUMNS)
    return still.clamp(0, 255).byte().movedim(0, -1).numpy()


@pytest.mark.parametrize("name", optics_names())
def test_a_background_of_another_sensor_is_told(name: str) -> None:
    for other in optics_names():
        reader = DepthReader("digit", other, 40)
        still = grey_levels(name)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            warnings.filterwarnings("ignore", "depth: an estimate")
            for _ in range(2):
                reader.read(still, still)
        assert len(told) == (name != other), (name, other)  # once for a background
        if told:
            assert "do not fit the calibration" in str(told[0].message)
            # of those that ship, the right one alone is named, and none is rated
            assert re.findall("calibration='([a-z_]+)'", str(told[0].message)) == [name]


#: Public backgrounds of DIGITs and Minis, and one of a DIGIT with other lights.
PUBLIC = [
    ("digit", "digit_ball_presses/unitA/background.png"),
    *(("digit", f"sensor_backgrounds/digit_{name}") for name in ("D00011.png", "D00024.png")),
    *(("digit", f"sensor_backgrounds/digit_{name}") for name in ("tactile_act.png", "tacto.jpg")),
    ("gelsight_mini", "gelsight_mini_gs_sdk/background.png"),
    ("gelsight_mini", "gsmini_calib_ball_cmu/images/frame_0.png"),
    ("", "sensor_backgrounds/digit_tvl.png"),
    ("", "sensor_backgrounds/geltip.png"),
    # GelSights with other lights than the one that was calibrated, which rates them last or nearly
    ("", "sensor_backgrounds/gelsight2017_mit.jpg"),
    ("", "sensor_backgrounds/gelsight2014_smartlab.png"),
    ("", "wedge_ball_presses/calibration/bg-0.jpg"),
]


@pytest.mark.realdata
@pytest.mark.parametrize(("fits", "file"), PUBLIC)
def test_public_backgrounds_fit_the_calibration_of_their_type(
    fits: str, file: str, realdata: Path
) -> None:
    still = cv2.imread(str(realdata / file))[..., ::-1].copy()
    silent = []
    for name in optics_names():
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            warnings.filterwarnings("ignore", "depth: an estimate")
            DepthReader("digit", name, 8).read(still, still)
        silent += [] if told else [name]
        said = " ".join(str(one.message) for one in told)
        assert re.findall("calibration='([a-z_]+)'", said) == ([fits] if told and fits else [])
    assert silent == ([fits] if fits else [])


@pytest.mark.slow
@pytest.mark.realdata
def test_a_real_unit_is_read_better_than_by_the_shipped_calibration(realdata: Path) -> None:
    folder = realdata / "digit_ball_presses"
    still = cv2.imread(str(folder / "unitA/background.png"))[None, ..., ::-1].copy()
    found = []
    with open(folder / "labels.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["unit"] == "unitA" and row["kind"] == "ball":
                labels = {
                    "center_x_px": row["center_x"],
                    "center_y_px": row["center_y"],
                    "radius_px": row["radius_px"],
                }
                picture = cv2.imread(str(folder / row["file"]))[None, ..., ::-1].copy()
                found.append(
                    Recording(
                        key=row["file"],
                        sensor="digit",
                        frames=ArrayFrames(picture),
                        times=np.zeros(1),
                        no_contact=ArrayFrames(still),
                        labels=labels,
                    )
                )
    assert len(found) == 31
    options = DepthOptions(ball_mm=8.8, gel_mm=2.5, mm_per_pixel=1 / 18.48)
    result = calibrate_depth(found, options)
    assert result.before is not None
    wins = result.after.correlation - result.before.correlation
    print(result.before.correlation.mean(), result.after.correlation.mean())
    print(result.before.error.mean(), result.after.error.mean())
    assert wins.mean() > 2 * wins.std() / math.sqrt(len(wins))
    assert result.after.error.mean() < result.before.error.mean()
