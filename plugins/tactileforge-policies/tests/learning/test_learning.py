"""A policy learns commands visible in touch alone, and a killed run equals an unbroken one."""

from pathlib import Path

import numpy as np
import pytest
import torch
from demonstrated import demonstrations, episode, rest
from diffusers.training_utils import EMAModel
from tactileforge_policies import load_policy
from tactileforge_policies.heads.diffusion_policy import DiffusionPolicy, PowerEMA
from tactileforge_policies.heads.ranges import Ranges
from tactileforge_policies.robot import Robot

from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.runs.checkpoint_file import read_checkpoint
from tactileforge.runs.folder import LAST, read_config
from tactileforge.training.checkpoints import Checkpoints
from tactileforge.training.module import TouchModule


def small(**options) -> DiffusionPolicy:
    robot = Robot(
        fingers=("left",),
        sensors=("digit",),
        state_size=3,
        action_size=2,
        rate=6.0,
        horizon=4,
        touch="none",
    )
    encoder = TactileViT("tiny", image_size=32, depth=1)
    return DiffusionPolicy(encoder, robot.facts, (16, 32), 16, **options)


@pytest.mark.parametrize("power", [0.75, 2 / 3])
def test_the_slow_copy_is_that_of_diffusers(power: float) -> None:
    layer = torch.nn.Linear(3, 2)
    ours = PowerEMA(layer, power, 0.9)
    theirs = EMAModel(layer.parameters(), decay=0.9, power=power, use_ema_warmup=True)
    ours.after_step(layer, 0, 60)
    for step in range(1, 60):
        with torch.no_grad():
            for parameter in layer.parameters():
                parameter += torch.randn_like(parameter)
        ours.after_step(layer, step, 60)
        theirs.step(layer.parameters())
        assert ours.keep(step, 60) == pytest.approx(theirs.cur_decay_value, abs=1e-12)
    for slow, true in zip(ours.network.parameters(), theirs.shadow_params, strict=True):
        torch.testing.assert_close(slow, true)


@pytest.mark.parametrize("name", ["ddim", "ddpm"])
def test_noise_that_is_known_is_taken_away(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the noise of q(x_t | x_0) for a fixed x_0, the scheduler ends at x_0."""
    head = small(scheduler=name, steps=100 if name == "ddpm" else 10).eval()
    clean = torch.rand(1, 4, 2) * 1.6 - 0.8
    betas = head.scheduler.betas.double()
    kept = torch.cumprod(1 - betas, 0)
    torch.testing.assert_close(head.kept.double(), kept, atol=1e-6, rtol=0)

    def denoise(x, steps, perceived):
        share = kept[steps].float()[:, None, None]
        return (x - share.sqrt() * clean) / (1 - share).sqrt()

    monkeypatch.setattr(head.slow.network[1], "denoise", denoise)
    batch = {"state": torch.zeros(1, 2, 3)}
    found = head.chunk(None, batch, torch.Generator().manual_seed(1))
    torch.testing.assert_close(found, clean, atol=1e-3, rtol=0)


def test_noise_is_added_as_diffusers_does(monkeypatch: pytest.MonkeyPatch) -> None:
    head = small().train()
    chunk = torch.rand(5, 4, 2) * 2 - 1
    batch = {"state": torch.zeros(5, 2, 3), "action_chunk": chunk}
    seen = {}

    def forward(x, steps, condition):
        seen.update(x=x, steps=steps)
        return torch.zeros_like(x)

    monkeypatch.setattr(head.unet, "forward", forward)
    noise = head(None, batch).target
    true = head.scheduler.add_noise(chunk, noise, seen["steps"])
    torch.testing.assert_close(seen["x"], true)
    many = {"state": torch.zeros(2000, 2, 3), "action_chunk": torch.zeros(2000, 4, 2)}
    noise = head(None, many).target
    assert abs(float(noise.mean())) < 0.03
    assert float(noise.std()) == pytest.approx(1, abs=0.03)
    counts = torch.bincount(seen["steps"], minlength=100)
    assert counts.min() > 0


def test_ranges_are_min_max() -> None:
    ranges = Ranges(3)
    low, high = np.array([0, -2, 5], np.float32), np.array([4, 2, 5], np.float32)
    ranges.fit(low, high)
    values = torch.tensor([[0.0, 2.0, 5.0], [1.0, 0.0, 5.5]])
    torch.testing.assert_close(ranges(values), torch.tensor([[-1.0, 1.0, 0.0], [-0.5, 0.0, 0.5]]))
    # A constant number is inverted to its value, for any prediction.
    back = torch.tensor([[0.0, 2.0, 5.0], [1.0, 0.0, 5.0]])
    torch.testing.assert_close(ranges.invert(ranges(values)), back)
    assert ranges.unit.tolist() == [2.0, 2.0, 0.0]


FOLLOW = ["scale=demo", "data.camera=false", "data.horizon=4", "data.observations=1"]
FOLLOW += ["trainer.max_epochs=80", "trainer.precision=32-true", "head.denoise.channels=[32,64]"]
FOLLOW += ["trainer.check_val_every_n_epoch=10", "optim.schedule=constant"]


def error_of(folder: Path) -> float:
    """Mean absolute error of the first number of the command on new episodes."""
    policy, errors = load_policy(folder), []
    for number in range(100, 106):
        pair = episode(number, seed=1)
        shown = {one.labels["finger"]: one.frames.read(range(12)) for one in pair}
        policy.reset({name: rest() for name in shown}, seed=number)
        for step in range(12):
            frames = {name: images[step] for name, images in shown.items()}
            found = policy.step(frames, pair[0].tracks["state"][step])
            if step % 2 == 0:  # first command of its chunk: not predicted ahead
                errors.append(abs(float(found[0]) - pair[0].tracks["robot_action"][step, 0]))
    return float(np.mean(errors))


@pytest.mark.slow
def test_touch_with_the_frozen_tiny_encoder_beats_no_touch(tmp_path: Path) -> None:
    """The right command is visible in touch alone; without touch it cannot be known."""
    root = demonstrations(tmp_path / "data", 24)
    found = {}
    for touch in ("frames", "none"):
        words = ["data=demonstrations", f"data.root={root}", f"data.touch={touch}", *FOLLOW]
        module = train(compose("diffusion_policy", words), tmp_path / touch)
        assert not any(p.requires_grad for p in module.encoder.parameters())
        found[touch] = error_of(tmp_path / touch)
    print(found)
    assert found["frames"] < 0.4  # the best constant command errs by 0.43
    assert found["frames"] < 0.5 * found["none"]


@pytest.mark.slow
def test_a_killed_run_ends_as_one_that_was_not(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    more = ["head.denoise.channels=[16,32]", "trainer.max_epochs=3", "trainer.save_every=4"]
    more += ["init=anytouch2.tiny"]  # weights independent of the seed
    config = compose("diffusion_policy", [*words, *more])
    train(config, tmp_path / "whole")
    end = Checkpoints.on_train_batch_end

    def stop(self, trainer, *rest):
        self.interrupted = trainer.global_step == 6
        end(self, trainer, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(Checkpoints, "on_train_batch_end", stop)
        with pytest.raises(KeyboardInterrupt):
            train(config, tmp_path / "killed")
    assert read_checkpoint(tmp_path / "killed")["global_step"] == 6
    plain = read_config(tmp_path / "killed") | {"resume": str(tmp_path / "killed")}
    train(plain, tmp_path / "killed")
    a, b = (read_checkpoint(tmp_path / name / LAST)["state_dict"] for name in ("whole", "killed"))
    assert a.keys() == b.keys()
    for key, value in a.items():
        assert torch.equal(value, b[key]), key


def test_what_is_frozen_stays_in_evaluation_mode() -> None:
    head, encoder = small(), TactileViT("tiny", image_size=32, depth=1)
    module = TouchModule(encoder, {"denoise": head}, {}, {}, {}, {}, freeze=True)
    module.train()
    assert module.heads["denoise"].training
    assert not encoder.training
