"""Arrays of taxels: their sums are the forces, their pictures are their values, and they train."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from tactileforge_arrays.dataset import SimArray
from tactileforge_arrays.scenes import Array, taxel_forces
from tactileforge_sim.mechanics.touch import ContactState
from tactileforge_sim.scene import POINTS, SPACING

from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.contracts import ACTIONS
from tactileforge.errors import ConfigError
from tactileforge.pages.curves import read_metrics
from tactileforge.sensors.taxels import REST
from tactileforge.testing import check

QUICK = {"indenters": "small_sphere", "action_seconds": 0.2, "processes": 1}


def contact(
    place: tuple[float, float, float], at: tuple[int, int], traction: tuple[float, float, float]
) -> ContactState:
    """A contact with traction (x, y, z), MPa, at one point (row, column) of the object's grid."""
    pressure, shear = torch.zeros(1, POINTS, POINTS), torch.zeros(1, 2, POINTS, POINTS)
    pressure[0, at[0], at[1]] = traction[2]
    shear[0, :, at[0], at[1]] = torch.tensor(traction[:2])
    pose = torch.tensor([[*place, 0.5, 0.0, 0.0]])
    none = torch.zeros(1)
    return ContactState(pose, pressure, shear, *[none] * 6)


def test_a_load_lands_on_the_taxels_around_it() -> None:
    """By hand: the point is 0.1 mm right of and below the middle of an object at (1, -2)."""
    middle = POINTS // 2
    loads = taxel_forces(contact((1.0, -2.0, 0.0), (middle, middle), (1, 2, 3)), (4, 4), 2.0)
    grid = loads.reshape(4, 4, 3)
    area = SPACING**2
    column, row = 1.5 + 1.1 / 2, 1.5 - 1.9 / 2  # 2.05, 0.55
    for i, down in ((0, 1 - row), (1, row)):
        for j, right in ((2, 3 - column), (3, column - 2)):
            np.testing.assert_allclose(
                grid[i, j], area * down * right * np.array([1, 2, 3]), rtol=1e-4
            )
    np.testing.assert_allclose(loads.sum(0), area * np.array([1, 2, 3]), rtol=1e-5)


def test_shear_turns_with_the_object() -> None:
    """A quarter turn clockwise in the picture: the object's right becomes down."""
    at = (POINTS // 2, POINTS // 2 + 10)
    loads = taxel_forces(contact((0.0, 0.0, np.pi / 2), at, (1, 0, 0)), (8, 8), 2.0).reshape(
        8, 8, 3
    )
    np.testing.assert_allclose(loads.sum((0, 1)) / SPACING**2, [0, 1, 0], atol=1e-6)
    rows, columns = np.nonzero(loads[..., 1] > 1e-6)
    assert rows.min() >= 4  # below the middle
    assert set(columns.tolist()) == {3, 4}


def test_what_presses_beside_the_array_is_lost() -> None:
    middle = POINTS // 2
    beside = taxel_forces(contact((9.0, 0.0, 0.0), (middle, middle), (1, 1, 1)), (8, 8), 2.0)
    assert not beside.any()


def test_the_converter_clips_and_has_steps() -> None:
    array = Array(
        sensor="serial_array", shape=(2, 2), pitch=1, axes=1, span=1.0, noise=0, bits=2, size=None
    )
    forces = np.array([[[0.1], [0.5], [2.0], [-9.0]]])
    found = array.measured(forces, np.random.default_rng(0))
    np.testing.assert_allclose(found[0, :, 0], [0, 2 / 3, 4 / 3, -4 / 3], atol=1e-6)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(tmp_path_factory.mktemp("arrays"))


def test_taxels_sum_to_the_exact_force_and_are_what_is_drawn(cache: str) -> None:
    data = SimArray(scenes=2, val=1, cache=cache, size=None, **QUICK)
    first, other = data.recordings("train")
    assert first.sensor == "serial_array"
    taxels = first.tracks["taxels"]
    assert taxels.shape == (len(first.frames), 64, 3)
    assert first.force[:, 2].max() > 0.4
    noise = data.noise * 8 + 64**0.5 * data.span / 1023  # of 64 taxels: noise and rounding
    assert np.abs(taxels.sum(1) - first.force).max() < 5 * noise
    shown = first.frames.read(range(len(first.frames))).reshape(-1, 64, 3) - float(REST)
    np.testing.assert_allclose(shown / 127 * data.span, taxels, atol=0.51 * data.span / 127)
    assert len(first.no_contact) == 5
    assert np.abs(first.no_contact.read(range(5)).astype(int) - REST).max() <= 2
    assert set(first.action[first.action >= 0]) <= set(range(len(ACTIONS)))
    again = next(
        iter(SimArray(scenes=2, val=1, cache=cache, size=None, **QUICK).recordings("train"))
    )
    np.testing.assert_array_equal(again.frames.read([9]), first.frames.read([9]))
    (held_out,) = data.recordings("val")
    assert len({first.key, other.key, held_out.key}) == 3


def test_the_label_is_what_the_array_feels(cache: str) -> None:
    """An object larger than the array: forces beside it are in no taxel, nor in the label."""
    wide = {"indenters": "square_prism", "motions": "slide_right", "noise": 0.0, "bits": 16}
    options = {**QUICK, **wide, "span": 5.0, "pitch": 1.0}
    full, z = (
        next(
            SimArray(scenes=1, val=0, cache=cache, shape=(4, 4), axes=n, **options).recordings(
                "train"
            )
        )
        for n in (3, 1)
    )
    step = 2 * 5.0 / (2**16 - 1)
    assert full.force[:, 2].max() > 0.4
    np.testing.assert_allclose(full.tracks["taxels"].sum(1), full.force, atol=16 * step)
    np.testing.assert_array_equal(z.force, full.force)


@pytest.mark.slow
def test_processes_write_what_one_does(cache: str, tmp_path: Path) -> None:
    """Also works from a script without a ``__main__`` guard: each process is a new command."""
    script = tmp_path / "script.py"
    script.write_text(
        "from tactileforge_arrays.dataset import SimArray\n"
        f"options = {QUICK | {'processes': 2}}\n"
        f"data = SimArray(scenes=4, val=0, cache={str(tmp_path)!r}, **options)\n"
        "print(len(list(data.recordings('train'))))\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ("4\n", 0), done.stderr
    one, two = (SimArray(scenes=4, val=0, cache=where, **QUICK) for where in (cache, str(tmp_path)))
    for mine, theirs in zip(one.recordings("train"), two.recordings("train"), strict=True):
        np.testing.assert_array_equal(mine.tracks["taxels"], theirs.tracks["taxels"])


def test_one_axis_and_larger_pictures(cache: str) -> None:
    data = SimArray(scenes=1, val=0, cache=cache, axes=1, shape=(4, 6), size=16, **QUICK)
    (recording,) = data.recordings("train")
    assert recording.frames.shape == (16, 24)
    seen = recording.frames.read(range(len(recording.frames)))
    assert (seen[..., :2] == REST).all()
    assert seen[..., 2].max() > REST + 3
    assert recording.tracks["taxels"].shape[1:] == (24, 1)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"scenes": 0}, "scenes=0"),
        ({"shape": [8]}, "give rows and columns"),
        ({"shape": [1, 8]}, "2 taxels or more"),
        ({"pitch": 0.0}, "pitch above 0"),
        ({"axes": 2}, "give 1 or 3"),
        ({"bits": 1}, "2 to 16"),
        ({"size": 4}, "size=4 pixels for 8 rows"),
        ({"motions": "jump"}, "unknown motion 'jump'"),
    ],
)
def test_arrays_that_make_no_sense_are_named(given: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        list(SimArray(**given).recordings("train"))


def test_it_conforms(cache: str) -> None:
    results = check("dataset", SimArray, scenes=2, val=1, cache=cache, size=None, **QUICK)
    assert [r for r in results if r.status == "failed"] == []
    assert sum(r.status == "ran" for r in results) > 5


@pytest.mark.slow
def test_the_recipe_learns_forces_from_taxels(cache: str, tmp_path: Path) -> None:
    overrides = [
        "data=sim_array",
        "scale=demo",
        "encoder.image_size=32",
        "encoder.patch=8",
        "batch.size=8",
    ]
    overrides += [f"data.{key}={value}" for key, value in QUICK.items()]
    overrides += ["data.scenes=2", "data.val=1", "data.size=null", f"data.cache={cache}"]
    overrides += ["objective=[pixel,force]", "batch.workers=0", "batch.match=0"]
    overrides += ["trainer.max_steps=40", "trainer.val_check_interval=40"]
    config = compose("anytouch2_array", overrides)
    assert config.encoder.sensors.serial_array == 6
    train(config, tmp_path)
    losses = read_metrics(tmp_path)["train/force"].values
    assert losses[-1] < 0.8 * losses[0]  # logged every ten steps
