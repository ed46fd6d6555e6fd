"""Depth from touch: of pictures, in `live`, in `record`, and on real balls."""

import io
import json
import warnings
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from tactileforge_depth import fit
from tactileforge_depth.lighting import load_optics
from tactileforge_depth.presses import read_known
from tactileforge_depth.reader import DepthReader, depth_image, read_optics
from tactileforge_live.publish import JsonLines
from tactileforge_live.record.options import RecordOptions
from tactileforge_live.record.record import record
from tactileforge_live.session import LiveOptions, LiveSession, ShowBackground, run_session
from tactileforge_sim.optics.render import Optics
from tactileforge_sim.optics.sensor_instances import SensorInstance

from tactileforge.contracts import Frame
from tactileforge.datasets.shards import Shards
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.sensors.background import Background
from tactileforge.specs.published import spec

SPACING = 16.3 / 24  # of a DIGIT's picture of 24 rows, mm per pixel


def dented(peak=1.0):
    """Pictures of a DIGIT (24, 32, 3), without and with a bump left of the middle; its depth."""
    still = torch.full((3, 24, 32), 120.0)
    y, x = (torch.arange(24)[:, None] - 12) * SPACING, (torch.arange(32) - 11) * SPACING
    depth = peak * torch.exp(-(x * x + y * y) / (2 * 2.0**2))
    unit = SensorInstance("", 0, still, load_optics("digit"), SPACING, 0.0)
    picture = Optics(unit).render(depth[None])[0]
    return [part.byte().permute(1, 2, 0).numpy() for part in (still, picture)], depth.numpy()


def place(depth):
    return np.unravel_index(int(np.asarray(depth).argmax()), depth.shape)


def test_a_bump_is_where_it_is_pressed_and_as_deep():
    (still, picture), true = dented()
    reader = DepthReader("digit", rows=24)
    found = reader.read(picture, still)
    assert np.abs(np.subtract(place(found.depth), place(true))).max() <= 1
    assert float(found.depth.max()) == pytest.approx(1.0, rel=0.25)
    both = reader.read(np.stack([still, picture]), still)
    torch.testing.assert_close(both.depth[1], found.depth)
    assert float(both.depth[0].abs().max()) == 0
    assert reader.micrometres(picture, still).max() == round(1000 * float(found.depth.max()))
    # twice as large pixels: the same slopes, twice the depth, but for what scatters
    wide = DepthReader("digit", rows=24, mm_per_pixel=2 * SPACING).read(picture, still)
    assert float(wide.depth.max()) > 1.3 * float(found.depth.max())


def test_a_shipped_calibration_says_once_that_depth_is_an_estimate(tmp_path):
    (still, picture), _ = dented()
    reader = DepthReader("digit", rows=24)
    with pytest.warns(UserWarning, match="^depth: an estimate, not a measurement") as said:
        reader.read(picture, still)
    assert (len(said), said[0].filename) == (1, __file__)
    fit.save_optics(load_optics("digit"), tmp_path / "mine.json", "me")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reader.read(picture, still)
        DepthReader("digit", tmp_path / "mine.json", rows=24).read(picture, still)


def test_pictures_that_are_no_grey_levels_are_refused():
    (still, picture), _ = dented()
    reader = DepthReader("digit", rows=24)
    for wrong in (picture / 255, torch.from_numpy(picture)):
        with pytest.raises(DataError, match=r"numpy arrays of uint8, not (float64|torch\.uint8)"):
            reader.read(wrong, still)
    for options in ({"rows": 0}, {"mm_per_pixel": -1.0}):
        with pytest.raises(ConfigError, match="give them above 0"):
            DepthReader("digit", **options)


def test_files_of_calibrations_are_checked(tmp_path):
    path = tmp_path / "mine.json"
    fit.save_optics(load_optics("digit"), path, "me")
    (still, picture), _ = dented()
    mine = DepthReader("digit", path, rows=24).read(picture, still).depth
    torch.testing.assert_close(
        mine, DepthReader("digit", rows=24).read(picture, still).depth, rtol=0, atol=1e-3
    )
    plain = json.loads(path.read_text())
    tables = [
        {name: np.where(np.arange(np.size(plain[name])) == 1, odd, np.ravel(plain[name]))}
        for name in ("fine", "coarse", "limits")
        for odd in (np.nan, np.inf, -np.inf)
    ]
    tables = [{k: v.reshape(np.shape(plain[k])).tolist() for k, v in t.items()} for t in tables]
    others = [{"fine": plain["fine"][:3]}, {"steepest": 7.0}, {"steepest": np.nan}, {"lights": "x"}]
    for change in (*tables, *others):
        path.write_text(json.dumps(plain | change))
        with pytest.raises(DataError, match="not an optical calibration"):
            read_optics(path)
    path.write_text("[")
    with pytest.raises(DataError, match="not an optical calibration"):
        read_optics(path)
    with pytest.raises(DataNotFoundError, match="digit"):
        DepthReader("digit", "digitt")
    with pytest.raises(ConfigError, match="no optical calibration of duragel"):
        DepthReader("duragel")
    with pytest.raises(DataError, match="give"):
        DepthReader("digit").read(picture, still[:5])


def test_a_calibration_serves_a_sensor_of_any_name(tmp_path):
    path = tmp_path / "mine.json"
    fit.save_optics(load_optics("digit"), path, "me")
    (still, picture), _ = dented()
    wanted = DepthReader("digit", path, rows=24).read(picture, still).depth
    sized = DepthReader("mine", path, rows=24, mm_per_pixel=SPACING)
    torch.testing.assert_close(sized.read(picture, still).depth, wanted)
    own = replace(spec("digit"), name="mine")
    torch.testing.assert_close(DepthReader(own, path, 24).read(picture, still).depth, wanted)
    with pytest.raises(ConfigError, match="area of mine is not known: give mm_per_pixel="):
        DepthReader("mine", path)


def lying(sensor):
    """The sensor of another type: a DIGIT stands upright, and these pictures lie."""
    sensor.spec = replace(sensor.spec, area_mm=(24 * SPACING, 32 * SPACING))
    return sensor


def showing(picture):
    return lambda frame: Frame(array=picture, time=frame.time)


@pytest.mark.slow
def test_live_tells_the_deepest_place(scripted, tmp_path):
    (still, picture), _ = dented()
    cv2.imwrite(str(tmp_path / "still.png"), still)
    events = {n: showing(picture) for n in range(50_000)}
    sensor = lying(scripted(fps=50.0, events=events, type="mine"))
    background = ShowBackground(image=str(tmp_path / "still.png"))
    options = LiveOptions(background=background, depth={"left": "digit"}, frames=5, seconds=20.0)
    lines = io.StringIO()
    with LiveSession({"left": sensor}, None, options) as view:
        run_session(view, [JsonLines(lines)], say=lambda line: None)
        last = view.fingers["left"].readings[-1].depth
    messages = [json.loads(line) for line in lines.getvalue().splitlines()]
    deepest = [message["depth_mm"] for message in messages if "frame" in message]
    assert deepest[-1] == pytest.approx(1.0, rel=0.4)
    assert last.shape == (24, 32)
    image = depth_image(last)
    assert image[place(last)].astype(int).sum() > image[0, -1].astype(int).sum()
    with pytest.raises(ConfigError, match="did you mean 'left'"):
        LiveSession({"left": sensor}, None, LiveOptions(depth={"lefft": "digit"})).__enter__()


@pytest.mark.slow
def test_record_keeps_a_track_that_shards_give_back(scripted, tmp_path):
    (still, picture), true = dented()
    events = {n: showing(still if n < 40 else picture) for n in range(50_000)}
    options = RecordOptions(
        out=str(tmp_path / "out"),
        seconds=1.5,
        background=Background(seconds=0.4),
        codec="png",
        depth={"left": "digit"},
    )
    sensor = lying(scripted(fps=50.0, events=events, type="gelsight_mini"))
    record(options, {"left": sensor}, say=lambda line: None)
    (one,) = Shards(options.out).recordings("train")
    track = one.tracks["depth_um"]
    assert (track.dtype, track.shape) == (np.int16, (len(one.times), 16, 21))
    still_rows = [
        i for i, frame in enumerate(one.frames.read(range(len(track)))) if (frame == still).all()
    ]
    assert (track[still_rows] == 0).all()
    row, column = place(track[-1])
    assert abs(row / 16 - place(true)[0] / 24) < 0.08
    assert abs(column / 21 - place(true)[1] / 32) < 0.08
    assert 500 < track[-1].max() < 1300
    with pytest.raises(ConfigError, match="depth needs a background"):
        RecordOptions(out="x", depth={"a": "digit"}, background=Background(seconds=0.0))


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "least", "share"),
    [
        ("gelsight", 0.88, 0.09),
        ("gelsight_fots", 0.76, 0.16),
        ("digit", 0.75, 0.16),
        ("gelsight_mini", 0.95, 0.03),
    ],
)
def test_held_out_balls_are_read(name, least, share, realdata):
    """Correlation with the surface of a ball by contact mechanics, and error by its depth."""
    presses = read_known(name, realdata)
    train, test = presses.part(slice(0, None, 4)), presses.part(slice(1, None, 8))
    height, width = test.size
    small = (120, round(width * 120 / height))
    from tactileforge_depth.inverse import SurfaceReader

    def shrunk(pictures):
        return torch.nn.functional.interpolate(pictures.float(), small, mode="area")

    reader = SurfaceReader(fit.fit_optics(train), small, test.spacing * height / 120)
    found = reader.read(shrunk(test.pictures), shrunk(test.background[None])[0]).depth
    true = shrunk(torch.stack([test.dent(i) for i in range(len(test))]))[:, 0]
    pairs = list(zip(found.flatten(1), true.flatten(1), strict=True))
    related = [float(torch.corrcoef(torch.stack(pair))[0, 1]) for pair in pairs]
    error = (found - true).square().mean((1, 2)).sqrt() / true.amax((1, 2))
    print(
        name, np.mean(related), error.mean(), found.amax((1, 2)).mean() / true.amax((1, 2)).mean()
    )
    assert np.mean(related) > least
    assert error.mean() < share
