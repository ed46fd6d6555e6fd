"""A run of demonstrations becomes a policy, with the same steps as in training."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from demonstrated import dent, episode, rest, write
from tactileforge_policies import load_policy
from tactileforge_policies.data.demonstrations import Demonstrations
from tactileforge_policies.reference import GAIN_LABEL

from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.data.batches.clips import collate
from tactileforge.encoders.views import views_of
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, TactileForgeError
from tactileforge.pages.curves import read_metrics
from tactileforge.report.run import report_of_run
from tactileforge.runs import folder as run_folder
from tactileforge.runs.checkpoint_file import read_checkpoint
from tactileforge.runs.folder import BEST, LAST

NARROW = ["head.denoise.channels=[16,32]", "head.denoise.step_width=16", "head.denoise.steps=4"]
NARROW += ["head.denoise.pooler.queries=4"]
IMITATE = ["objective=[imitate]", "trainer.keep_best=val/imitate"]


def test_a_run_steps_as_its_samples_say(folder: Path, root: Path) -> None:
    """The policy's buffers give the head's output for the same steps of the data set."""
    policy = load_policy(folder)
    assert (policy.fingers, policy.sensor) == (("left", "right"), ["digit", "digit"])
    assert (policy.state_size, policy.action_size, policy.rate) == (3, 2, 6.0)
    assert (policy.uses_touch, policy.uses_image, policy.uses_force) == (True, True, False)

    data = Demonstrations(str(root), horizon=4, image_size=16)
    recordings = list(data.recordings("val"))
    cut = data.cut(recordings, 4, 1 / 15, 0.0, (32, 32))
    left = recordings[0]
    policy.reset({name: rest() for name in policy.fingers}, seed=5)
    generator = torch.Generator().manual_seed(5)
    shown = {one.labels["finger"]: one.frames.read(range(12)) for one in recordings}
    camera = left.image.read(range(12))
    for step in range(0, 12, 2):
        batch = collate([cut[step]])
        views = views_of(policy._encoder, batch)
        chunk = policy._head.act(views, batch, generator)[0]
        for place in range(2):  # two of four are carried out
            frames = {name: images[step + place] for name, images in shown.items()}
            state = left.tracks["state"][step + place]
            found = policy.step(frames, state, camera[step + place])
            assert found.dtype == np.float32
            np.testing.assert_allclose(found, chunk[place].numpy(), atol=2e-3)
    low, high = cut.ranges()["action"]
    assert policy._head.action.low.shape == low.shape == high.shape


def test_a_gel_of_twice_the_contrast_gets_the_same_commands(train_policy, tmp_path: Path) -> None:
    gains = [
        replace(one, labels=dict(one.labels) | {GAIN_LABEL: 0.5})
        for number in range(3)
        for one in episode(number)
    ]
    root = write(tmp_path, gains)
    policy = load_policy(
        train_policy(
            *IMITATE, f"data.root={root}", "data.reference_press=true", "trainer.max_epochs=1"
        )
    )
    assert policy.uses_reference
    still = {name: rest() for name in policy.fingers}
    touch = {name: dent(0.4, depth=30) for name in policy.fingers}
    strong = {name: dent(0.4, depth=60) for name in policy.fingers}
    commands = []
    for press, frames in ((30, touch), (60, strong), (60, touch)):
        policy.reset(still, reference={n: dent(0, depth=press) for n in policy.fingers})
        commands.append(policy.step(frames, [0, 0, 0], dent(0, 24)))
    np.testing.assert_allclose(commands[0], commands[1], atol=0.02)
    assert np.abs(commands[0] - commands[2]).max() > np.abs(commands[0] - commands[1]).max()
    policy.reset(still)
    with pytest.raises(ConfigError, match="trained with reference presses: give reset"):
        policy.step(touch, [0, 0, 0], dent(0, 24))
    with pytest.raises(DataError, match="reference press of left: it changes the picture by 0 "):
        policy.reset(still, reference=still)


def test_a_run_of_before_the_package_loads_and_is_told_of_as_before(
    folder: Path, tmp_path: Path
) -> None:
    """Older configurations have the sizes under ``robot``."""
    old = shutil.copytree(folder, tmp_path / "old")
    config = run_folder.read_config(old)
    config["robot"] = config.pop("facts")
    run_folder.write_config(old, config)
    steps = []
    for run in (folder, old):
        policy = load_policy(run)
        policy.reset({name: rest() for name in policy.fingers}, seed=1)
        steps.append(policy.step({n: dent(0.3) for n in policy.fingers}, [0, 0, 0], dent(0, 24)))
    np.testing.assert_array_equal(*steps)
    report = report_of_run(old).read_text()
    assert "Heads on a frozen touch encoder, trained with denoise" in report
    assert "action size" in report


def test_the_best_weights_are_those_of_the_smallest_validation_loss(folder: Path) -> None:
    curve = read_metrics(folder)["val/denoise"]
    best = read_checkpoint(folder / BEST)
    assert len(curve.values) == 4
    assert read_checkpoint(folder / LAST)["global_step"] >= best["global_step"]
    assert best["global_step"] == curve.steps[np.argmin(curve.values)] + 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "flags"),
    [
        ([*NARROW, "data.touch=none"], (False, True, False)),
        ([*NARROW, "data.touch=force", "data.camera=false"], (False, False, True)),
        ([*IMITATE], (True, True, False)),
        ([*IMITATE, "+head@head.imitate=act"], (True, True, False)),
        ([*NARROW, "init=pixels", "data.camera=false"], (True, False, False)),
        ([*IMITATE, "init=touch.tiny"], (True, True, False)),
    ],
    ids=["no touch", "force", "regression", "act", "pixels", "convolutional"],
)
def test_the_other_policies_of_the_table_train_and_step(train_policy, more, flags) -> None:
    policy = load_policy(train_policy(*more, "trainer.max_epochs=1"))
    assert (policy.uses_touch, policy.uses_image, policy.uses_force) == flags
    frames = {name: dent(0.2) for name in policy.fingers}
    force = dict.fromkeys(policy.fingers, (0.0, 0.0, 1.0))
    policy.reset()
    first = policy.step(frames, [0, 0, 0], dent(0, 24), force)
    policy.reset()
    again = policy.step(frames, [0, 0, 0], dent(0, 24), force)
    np.testing.assert_array_equal(first, again)
    low, high = (policy._head.action.invert(torch.tensor(x)).numpy() for x in (-1.0, 1.0))
    assert (first >= low - 1e-6).all()
    assert (first <= high + 1e-6).all()


@pytest.mark.slow
def test_wrong_robots_are_named(folder: Path, words: list[str], tmp_path: Path) -> None:
    policy = load_policy(folder)
    frames = {name: rest() for name in policy.fingers}
    with pytest.raises(ConfigError, match=r"frames of left, and the policy feels with left, right"):
        policy.step({"left": rest()}, [0, 0, 0], rest())
    with pytest.raises(ConfigError, match=r"state: \(4,\), and the policy was trained on \(3,\)"):
        policy.step(frames, [0, 0, 0, 0], rest())
    with pytest.raises(ConfigError, match="the policy uses a camera: give image="):
        policy.step(frames, [0, 0, 0])
    with pytest.raises(DataError, match="a number that is not finite"):
        policy.step(frames, [0, np.nan, 0], rest())
    assert not policy._touch  # a refused step leaves no trace
    assert not policy._seen
    for frame in (rest() / 255, rest()[..., 0], rest().transpose(2, 0, 1)):
        with pytest.raises(ConfigError, match=r"frame of left: .* give RGB, uint8 \(H, W, 3\)"):
            policy.step(frames | {"left": frame}, [0, 0, 0], rest())
    with pytest.raises(ConfigError, match=r"image: float64 .* give RGB"):
        policy.step(frames, [0, 0, 0], rest() / 255)
    policy.reset(frames)
    with pytest.raises(ConfigError, match=r"and its background is"):
        policy.step(frames | {"left": rest(64)}, [0, 0, 0], rest())
    with pytest.raises(ConfigError, match="background of thumb"):
        policy.reset({"thumb": rest()})
    with pytest.raises(ConfigError, match="'left' has a gelsight_mini, and the policy was trained"):
        policy.check_sensors("gelsight_mini")
    policy.check_sensors({"left": "digit", "right": "digit"})

    wide = write(tmp_path / "wide", [one for n in range(2) for one in episode(n, actions=3)])
    asked = [*words, *NARROW, f"data.root={wide}", f"init={folder}"]
    with pytest.raises(ConfigError, match="data whose action_size is 2, and that of this"):
        train(compose("diffusion_policy", asked), tmp_path / "next")


WRONG = {
    "head.denoise.execute=5": "execute=5 of a chunk of 4: give 1 to 4",
    "data.horizon=5": "data.horizon=5 cannot be halved 1 times; give a multiple of 2",
    "data.root=nowhere": r"neither index.json nor train-\*.tar",
}


@pytest.mark.parametrize("word", WRONG)
def test_options_that_do_not_fit_are_named(word: str, words: list[str], tmp_path: Path) -> None:
    with pytest.raises(TactileForgeError, match=WRONG[word]):
        train(compose("diffusion_policy", [*words, *NARROW, word]), tmp_path)


def test_data_of_no_robot_is_named(tmp_path: Path) -> None:
    sim = ["scale=demo", "init=null", "data=sim", "data.scenes=2", "data.val=1", "data.size=32"]
    with pytest.raises(ConfigError, match="objective 'denoise' needs action_chunk, which the data"):
        train(compose("diffusion_policy", sim), tmp_path / "a")


def test_a_run_without_a_policy_is_named(tmp_path: Path) -> None:
    run_folder.write_config(tmp_path, {"facts": {}})
    with pytest.raises(ConfigError, match="its run trained no policy"):
        load_policy(tmp_path)
    with pytest.raises(DataNotFoundError, match="give the folder of a run"):
        load_policy(tmp_path / "nowhere")
