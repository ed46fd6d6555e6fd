"""Arrays of 16 bits: pictures of touch with their range, a depth, and numbers of taxels."""

import numpy as np
import pytest
from made_episodes import write_hdf5, write_zarr
from tactileforge_episodes.dataset import Episodes

from tactileforge.errors import DataError

COUNT = 12


def values(*shape: int, bits: int = 12) -> np.ndarray:
    rng = np.random.default_rng(0)
    out = rng.integers(0, 2**bits, (COUNT, *shape)).astype(np.uint16)
    out[0].flat[0] = 2**bits - 1
    return out


def write(root, arrays, kind="hdf5"):
    if kind == "npz":
        np.savez(root / "lab.npz", **arrays)
    elif kind == "zarr":
        write_zarr(root / "lab.zarr", arrays)
    else:
        write_hdf5(root / "lab.hdf5", arrays)


def read(root, **options):
    guess = Episodes.recognise(root)
    assert guess is not None
    data = Episodes(**{**guess.options, **options}, val=0)
    return list(data.recordings("train")), guess.options["map"]


@pytest.mark.parametrize("kind", ["hdf5", "zarr", "npz"])
@pytest.mark.parametrize(("shape", "axes"), [((64, 80), "hw"), ((64, 80, 3), "hwc")])
@pytest.mark.parametrize("bits", [10, 12, 16])
def test_pictures_of_touch(tmp_path, kind, shape, axes, bits):
    stored = values(*shape, bits=bits)
    write(tmp_path, {"tactile": stored}, kind)
    (one,), keys = read(tmp_path)
    (touch,) = keys["touch"]
    assert (touch.get("axes", "hwc"), touch["white"]) == (axes, 2**bits - 1)
    assert any(line.startswith("white: ") and f"({bits} bits)" in line for line in keys["doubts"])
    shown = np.rint(stored * (255 / (2**bits - 1))).astype(np.uint8)
    shown = shown if len(shape) == 3 else np.repeat(shown[..., None], 3, -1)
    np.testing.assert_array_equal(one.frames.read(range(COUNT)), shown)


@pytest.mark.parametrize("name", ["depth", "tactile_depth", "camera/depth", "range"])
def test_a_depth_is_no_touch(tmp_path, name):
    rng = np.random.default_rng(1)
    touch = rng.integers(0, 255, (COUNT, 64, 80, 3)).astype(np.uint8)
    write(tmp_path, {"tactile": touch, name: values(64, 80)})
    (one,), keys = read(tmp_path)
    assert [entry["array"] for entry in keys["touch"]] == ["tactile"]
    assert "camera" not in keys
    np.testing.assert_array_equal(one.frames.read([3])[0], touch[3])


def test_a_depth_alone_is_no_touch(tmp_path):
    write(tmp_path, {"depth": values(64, 80)})
    with pytest.raises(DataError, match="no array of pictures or touch"):
        Episodes.recognise(tmp_path)


def test_taxels_of_16_bits_are_drawn(tmp_path):
    write(tmp_path, {"tactile": values(16, 16)})
    _, keys = read(tmp_path)
    assert keys["touch"][0]["taxels"]["form"] == "grid"


def test_a_given_array_is_read_as_pictures(tmp_path):
    write(tmp_path, {"cell": values(64, 80)})
    (one,), keys = read_given(tmp_path, "cell")
    assert keys["touch"][0]["white"] == 4095
    assert one.frames.read([0]).max() == 255


def read_given(root, key):
    data = Episodes(root=str(root), touch=[key], val=0)
    found = list(data.recordings("train"))
    return found, {"touch": [{"white": data.keys.touch[0].white}]}


def test_a_picture_without_contact_has_the_same_white(tmp_path):
    stored = values(64, 80, 3)
    write(tmp_path, {"tactile": stored, "tactile_reference": stored[0]})
    (one,), keys = read(tmp_path)
    assert keys["touch"][0]["reference"] == "tactile_reference"
    np.testing.assert_array_equal(one.background(), one.frames.read([0])[0])


def test_a_map_without_white_says_so(tmp_path):
    write(tmp_path, {"tactile": values(64, 80)})
    entry = {"array": "tactile", "sensor": "digit", "axes": "hw"}
    keys = {"about": "mine", "touch": [entry], "fps": 30}
    data = Episodes(root=str(tmp_path), map=keys, val=0)
    with pytest.raises(DataError, match="for fractions or 16 bits give `white`"):
        list(data.recordings("train"))
