"""Maps as data: those of the package, and a user's own."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from made_episodes import FORMATS, pictures, write_hdf5, write_zarr
from tactileforge_episodes.dataset import Episodes
from tactileforge_episodes.map_files import parse_map, preset_names, read_preset
from tactileforge_episodes.names import fill, match, match_end

from tactileforge.plugin import ConfigError, DataError
from tactileforge.testing import check

OWN = """
about: my rig
licence: CC0-1.0
source: my lab
tier: 1
files: ["{object}/{name}.h5"]
fps: {array: rate}
times: {array: clock, unit: ms}
touch:
  - array: sensors/{finger}/pixels
    sensor: digit
    axes: chw
    channels: bgr
    reference: sensors/{finger}/rest?
    force: {array: "sensors/{finger}/load", columns: [null, null, 0], unit: gf, sign: [1, 1, -1]}
    tracks: {temperature: "sensors/{finger}/celsius?"}
    labels: {serial: {array: "sensors/{finger}/pixels", attr: serial}}
camera: {array: scene}
state: [arm]
command: ["command?", next_state]
text: "touching a {object}"
object: "{object}"
background: first
"""


@pytest.fixture
def rig(tmp_path):
    for number, name in enumerate(("mug", "pen")):
        frames = pictures(6, 24, 32, 3, seed=number)
        arrays = {
            "clock": np.arange(6) * 40,
            "rate": 25.0,
            "sensors/thumb/pixels": np.moveaxis(frames[..., ::-1], -1, 1),
            "sensors/thumb/load": np.linspace(0, -200, 6)[:, None],
            "sensors/thumb/celsius": np.full(6, 30.5),
            "scene": pictures(6, 16, 16, 3, seed=9),
            "arm": np.arange(12.0).reshape(6, 2),
        }
        path = write_hdf5(tmp_path / name / "0.h5", arrays)
        with h5py.File(path, "r+") as file:
            file["sensors/thumb/pixels"].attrs["serial"] = f"D2{number}"
    (tmp_path / "own.yaml").write_text(OWN)
    return tmp_path


@pytest.mark.parametrize("read_first", [False, True])
def test_an_optional_key_that_only_some_files_have_is_said(read_first, rig):
    (rig / "mug/0.h5").replace(rig / "mug/first.h5")
    for name in ("mug/second", "mug/third"):
        (rig / f"{name}.h5").write_bytes((rig / "pen/0.h5").read_bytes())
    for name in ("mug/second", "pen/0"):
        with h5py.File(rig / f"{name}.h5", "r+") as file:
            del file["sensors/thumb/celsius"]
    data = Episodes(str(rig), map=str(rig / "own.yaml"), val=0)
    if read_first:
        assert data.provides
    tracks = {one.key.rpartition("/")[0]: {*one.tracks} for one in data.recordings("train")}
    assert {name for name, found in tracks.items() if "temperature" not in found} == {
        "mug/second",
        "pen/0",
    }
    # `rest?` and `command?` are in no file, which is no doubt
    (line,) = [note for note in data.notes if ": no '" in note]
    assert line == (
        f"{rig}/mug/second.h5: no 'sensors/thumb/celsius' (nor in 1 more), which 2 of 4 have; "
        "copy it again, or leave the key out of the map"
    )


def test_a_map_of_a_user_reads_without_a_package(rig):
    data = Episodes(str(rig), map=str(rig / "own.yaml"), val=0)
    mug, pen = data.recordings("train")
    assert (mug.key, mug.sensor, mug.text, mug.object) == (
        "mug/0/pixels",
        "digit",
        "touching a mug",
        "mug",
    )
    np.testing.assert_array_equal(pen.frames.read([3]), pictures(6, 24, 32, 3, seed=1)[[3]])
    np.testing.assert_array_equal(pen.background(), pictures(6, 24, 32, 3, seed=1)[0])
    np.testing.assert_allclose(mug.times, np.arange(6) * 0.04)
    np.testing.assert_allclose(mug.force[:, 2], np.linspace(0, 200, 6) * 9.80665e-3, rtol=1e-6)
    assert np.isnan(mug.force[:, :2]).all()
    assert mug.tracks["temperature"].tolist() == [30.5] * 6
    assert mug.tracks["robot_action"].tolist() == [
        [2, 3],
        [4, 5],
        [6, 7],
        [8, 9],
        [10, 11],
        [10, 11],
    ]
    assert (mug.labels["serial"], pen.labels["serial"]) == ("D20", "D21")
    assert (mug.licence, mug.source, mug.tier) == ("CC0-1.0", "my lab", 1)
    assert data.provides == {"force", "image", "object", "text"}
    results = check("dataset", Episodes, root=str(rig), map=str(rig / "own.yaml"), val=0)
    assert not [one for one in results if one.status == "failed"]


def test_a_rate_that_is_read_and_units_of_times(rig):
    for line, step in {
        "": 0.04,
        "times: {array: clock, unit: us}": 4e-5,
        "times: {array: clock, unit: frames}": 1.6,
    }.items():
        text = OWN.replace("times: {array: clock, unit: ms}", line)
        (rig / "own.yaml").write_text(text)
        one = next(iter(Episodes(str(rig), map=str(rig / "own.yaml"), val=0).recordings("train")))
        np.testing.assert_allclose(one.times, np.arange(6) * step, err_msg=line)


def test_episodes_are_held_out_by_a_unit(rig):
    options = {"map": str(rig / "own.yaml"), "hold_out": "all"}
    counts = [
        len(list(Episodes(str(rig), val=val, **options).recordings("val"))) for val in (0, 0.99)
    ]
    assert counts == [0, 2]


def test_a_unit_that_is_not_known_is_named(rig):
    data = Episodes(str(rig), map=str(rig / "own.yaml"), hold_out="{objct}")
    with pytest.raises(ConfigError, match=r"placeholder of data\.hold_out 'objct'; did you mean"):
        list(data.recordings("train"))


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("channels: bgr", "chanels: bgr", "unknown key of .*'chanels'; did you mean 'channels'"),
        ("fps:", "fsp:", "unknown key of .*'fsp'; did you mean 'fps'"),
        ("    sensor: digit\n", "", "'sensor' is missing; for example sensor: gelsight_mini"),
        ("channels: bgr", "channels: gbr", "unknown channels 'gbr'"),
        ("channels: bgr", "rotate: 45", "rotate is 45; give the degrees, clockwise"),
        ("channels: bgr", "colours: bgr", "'colours' is now called 'channels'"),
        ("command: [", "action: [", "'action' is now called 'command'"),
        ("- array: sensors", "- key: sensors", "'key' is now called 'array'"),
        ("tier: 1", "tier: 9", "tier is 9, but must be 1 to 5"),
        ("unit: gf", "unit: stone", "unknown unit 'stone'"),
        ("unit: ms", "unit: minutes", "unknown .*'minutes'"),
        ("[null, null, 0]", "[null, null, -1]", "give columns from 0, or null"),
        ("sensor: digit", "sensor: digit\n    white: 0", "give the value of white"),
        (
            "sensor: digit",
            "sensor: digit\n    taxels: {columns: [0, 1]}",
            "columns has 2; give 1 or 3",
        ),
        ("sensor: digit", "sensor: digit\n    taxels: {span: 0}", "a span above 0"),
        (
            "sensor: digit",
            "sensor: digit\n    parts: {a: [4, 2]}",
            "first column, and the one after",
        ),
        ("about: my rig", "about: [", "cannot be read .*not YAML"),
        ("about: my rig", "about: a\nabout: b", "'about' comes twice"),
    ],
)
def test_a_map_with_a_slip_is_told_which(old, new, wanted, rig):
    assert old in OWN
    (rig / "own.yaml").write_text(OWN.replace(old, new, 1))
    with pytest.raises(ConfigError, match=wanted) as error:
        list(Episodes(str(rig), map=str(rig / "own.yaml")).recordings("train"))
    assert "own.yaml" in str(error.value)


def test_a_map_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match=r"data\.map=.*absent\.yaml: cannot be read"):
        list(Episodes(str(tmp_path), map=str(tmp_path / "absent.yaml")).recordings("train"))
    with pytest.raises(ConfigError, match="touch is empty"):
        parse_map("x.yaml", {"about": "x", "touch": []})


def test_names_of_variables_stay_text(rig):
    """Nothing of this machine gets in by a map."""
    (rig / "own.yaml").write_text(OWN.replace("my lab", "${oc.env:HOME} {HOME} {__class__}"))
    one = next(iter(Episodes(str(rig), map=str(rig / "own.yaml"), val=0).recordings("train")))
    assert one.source == "${oc.env:HOME} {HOME} {__class__}"


def test_two_fingers_of_one_name_are_refused(rig):
    with h5py.File(rig / "mug/0.h5", "r+") as file:
        file.copy("sensors/thumb", file["sensors"], "index")
    data = Episodes(str(rig), map=str(rig / "own.yaml"), val=0)
    assert [one.object for one in data.recordings("train")] == ["pen"]
    assert "two arrays of touch are called 'pixels'; give `finger` a placeholder" in data.skipped[0]


def test_a_force_in_another_unit_by_its_key(rig):
    lbf = OWN.replace("/load", "/load_lbf").replace(" unit: gf,", "")
    (rig / "own.yaml").write_text(lbf)
    with pytest.raises(ConfigError, match=r"load_lbf' is in lbf by its name.*unit: lbf"):
        list(Episodes(str(rig), map=str(rig / "own.yaml"), val=0).recordings("train"))


def test_a_force_of_the_gel_that_has_no_such_column(rig):
    (rig / "own.yaml").write_text(OWN.replace("[null, null, 0]", "[0, 1, 2]"))
    data = Episodes(str(rig), map=str(rig / "own.yaml"), val=0)
    with pytest.raises(DataError, match=r"load: \(6, 1\) has no column 2"):
        list(data.recordings("train"))


POINTS = """
about: points
fps: 10
touch:
  - array: skin
    sensor: my array
    taxels: {form: points, span: 2, baseline: first, columns: [2, 1, 0]}
"""


def test_points_are_drawn_from_their_first_row_on_and_nan_is_at_rest(tmp_path):
    values = np.random.default_rng(0).normal(0, 1, (5, 4, 3)).astype("f4")
    values[2, 1] = np.nan
    write_zarr(tmp_path / "x.zarr", {"skin": values})
    (tmp_path / "m.yaml").write_text(POINTS)
    (one,) = Episodes(str(tmp_path), map=str(tmp_path / "m.yaml"), val=0).recordings("train")
    shown = one.frames.read([0, 2]).reshape(2, 4, 3)
    assert (shown[0] == 128).all()
    assert (shown[1, 1] == 128).all()
    change = (values[2] - values[0])[:, ::-1]
    wanted = np.rint(128 + 127 / 2 * change).clip(1, 255)
    np.testing.assert_array_equal(np.delete(shown[1], 1, 0), np.delete(wanted, 1, 0))
    np.testing.assert_array_equal(one.tracks["taxels"], values)


def test_names_with_placeholders():
    assert match("a/{x}_{y#}", ["a/left_7", "a/left_b", "b/left_7"]) == [
        ("a/left_7", {"x": "left", "y": "7"})
    ]
    assert match("{a}/{a}", ["x/x", "x/y"]) == [("x/x", {"a": "x"})]
    assert match("a.b", ["axb"]) == []
    assert fill("{x}-{z}", {"x": 1}) == "1-{z}"
    assert match_end("{a}/{b}.zarr", ["x.zarr"]) is None


def test_each_preset_is_an_option_of_its_own_with_every_key():
    places = Path(parse_map.__code__.co_filename).parent / "conf/data"
    assert sorted(path.stem for path in places.glob("*.yaml")) == preset_names() == sorted(FORMATS)
    for name in preset_names():
        assert read_preset(name).citation, name


def test_pictures_are_put_upright_with_their_reference_and_camera(tmp_path):
    frames, scene = pictures(4, 24, 32, 3), pictures(4, 16, 20, 3, seed=1)
    write_zarr(tmp_path / "x.zarr", {"pad": frames, "rest": frames[:1], "scene": scene})
    lie = "rotate: 90, mirror: x, channels: bgr"
    (tmp_path / "m.yaml").write_text(
        f"about: mine\nfps: 10\nlicence: CC0-1.0\ncamera: {{array: scene, {lie}}}\n"
        f"touch: [{{array: pad, sensor: digit, reference: rest, {lie}}}]"
    )
    data = Episodes(str(tmp_path), map=str(tmp_path / "m.yaml"), val=0)
    (one,) = data.recordings("train")
    for found, stored in ((one.frames, frames), (one.image, scene)):
        # mirrored left to right, then turned clockwise
        want = np.stack([np.rot90(frame[:, ::-1, ::-1], -1) for frame in stored])
        assert found.shape == want.shape[1:3]
        np.testing.assert_array_equal(found.read(range(4)), want)
    np.testing.assert_array_equal(one.no_contact.read([0]), one.frames.read([0]))
