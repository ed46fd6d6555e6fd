"""Force along axes of its own: losses, partial labels, deviations, scores."""

import numpy as np
import pytest
import torch

from tactileforge.contracts import Batch, Recording
from tactileforge.data.batches.clips import Clips
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError
from tactileforge.heads.force import ForceHead, Forces
from tactileforge.objectives.force import Force
from tactileforge.specs.published import spec

FORMULAS = {
    "l1": lambda e: abs(e),
    "huber": lambda e: e * e / 2 if abs(e) < 1 else abs(e) - 0.5,
    "mse": lambda e: e * e,
}


def prediction(batch: Batch, seed: int = 0) -> Forces:
    torch.manual_seed(seed)
    shape = (len(batch["force"]), batch["force"].shape[1] - 1, 3)
    return Forces(torch.randn(shape).requires_grad_(), torch.randn(shape).requires_grad_())


@pytest.mark.parametrize("loss", FORMULAS)
def test_losses_of_partial_labels_follow_the_formula(batch: Batch, loss: str) -> None:
    """Errors over the labelled axes, in units of each axis' deviation."""
    batch["force_valid"][0, :2] = False  # z alone
    said = prediction(batch)
    objective = Force(delta=0.5, loss=loss, scaled=True)
    objective.deviation.copy_(torch.tensor([[0.1, 0.2, 0.3], [0.04, 0.05, 0.06]]))
    total, count = 0.0, 0
    force = batch["force"] / batch["force_scale"][:, None]
    for b, axis in batch["force_valid"].nonzero().tolist():
        count += 1
        for t in range(1, 4):
            of_force = (said.force[b, t - 1, axis] - force[b, t, axis]) / objective.deviation[
                0, axis
            ]
            change = force[b, t, axis] - force[b, t - 1, axis]
            of_delta = (said.delta[b, t - 1, axis] - change) / objective.deviation[1, axis]
            of_both = FORMULAS[loss](of_force.item()) + 0.5 * FORMULAS[loss](of_delta.item())
            total += of_both / 3
    assert count == 10
    found, logs = objective(said, batch)
    assert found.item() == pytest.approx(total / count, rel=1e-5)
    assert set(logs) == {"mae_x_N", "mae_y_N", "mae_z_N"}


def test_an_axis_without_a_label_changes_nothing(batch: Batch) -> None:
    batch["force_valid"][:, :2] = False
    said = prediction(batch)
    Force()(said, batch)[0].backward()
    labelled = batch["force_valid"][:, 2]
    for part in (said.force, said.delta):
        assert (part.grad[..., :2] == 0).all()
        assert (part.grad[labelled, :, 2] != 0).all()
    garbage = torch.where(batch["force_valid"][:, None], batch["force"], 1e6)
    other = Force()(said, batch | {"force": garbage})
    assert other[0].item() == Force()(said, batch)[0].item()
    assert other[1]["mae_x_N"].count == 0  # an error of 0 N would be one that was never measured
    scores = Force().scores(Force().sums(said, batch))
    assert not [name for name in scores if "_x" in name or "_y" in name]
    true = batch["force"][labelled, 1:, 2]
    error = said.force[labelled, :, 2] * batch["force_scale"][labelled, None, 2] - true
    assert scores["mae_z_N"] == pytest.approx(error.abs().mean().item(), rel=1e-5)


def recordings() -> list[Recording]:
    rng = np.random.default_rng(0)
    made = []
    for number, (sensor, known) in enumerate((("digit", 3), ("gelsight_mini", 3), ("digit", 1))):
        force = rng.normal(0, [0.2, 0.5, 4.0], (40, 3)).astype(np.float32)
        force[:, : 3 - known] = np.nan
        made.append(
            Recording(
                key=str(number),
                sensor=sensor,
                frames=ArrayFrames(np.zeros((40, 8, 8, 3), np.uint8)),
                times=np.arange(40) / 30,
                no_contact=None,
                force=force,
            )
        )
    return made


def test_deviations_are_those_of_the_data() -> None:
    made = recordings()
    clips = Clips(made, frames=3, spacing=1 / 15, hop=0.1, size=(8, 8))  # every second frame
    objective = Force(scaled=True)
    objective.prepare(clips)
    units = [one.force / np.array(spec(one.sensor).force_scale) for one in made]
    expected = [
        np.nanstd(np.concatenate(units), axis=0),
        np.nanstd(np.concatenate([one[2:] - one[:-2] for one in units]), axis=0),
    ]
    np.testing.assert_allclose(objective.deviation.numpy(), expected, rtol=1e-5)
    assert "deviation" in objective.state_dict()
    plain = Force()
    plain.deviation.fill_(0.1)  # as weights to start from may bring
    plain.prepare(clips)
    assert (plain.deviation == 1).all()  # as in the paper


def test_deviations_of_what_is_not_labelled_or_does_not_move() -> None:
    made = recordings()[2:]
    clips = Clips(made, frames=3, spacing=1 / 15, hop=0.1, size=(8, 8))
    objective = Force(scaled=True)
    objective.prepare(clips)
    assert objective.deviation[:, :2].tolist() == [[1, 1], [1, 1]]
    made[0].force[:, 0] = 2.0
    objective.prepare(Clips(made, frames=3, spacing=1 / 15, hop=0.1, size=(8, 8)))
    x, _, z = objective.deviation[0].tolist()
    assert x == pytest.approx(0.05 * z)  # not zero: noise is not blown up without limit


def test_scores_are_those_of_the_whole_split(batch: Batch) -> None:
    """R2 by its definition over two batches with different labels; x is constant."""
    objective = Force()
    other = {
        key: value.clone() if torch.is_tensor(value) else value for key, value in batch.items()
    }
    other["force"] = other["force"] * 3 + 1
    other["force_valid"][:, 1] = False
    sums, true, found = 0, [], []
    for number, one in enumerate((batch, other)):
        said = prediction(one, number)
        said.force.data[..., 0] = 0.0
        sums = sums + objective.sums(said, one)
        valid = one["force_valid"][:, None].expand_as(said.force)
        newton = said.force.detach() * one["force_scale"][:, None]
        true.append(torch.where(valid, one["force"][:, 1:], torch.nan).flatten(0, 1))
        found.append(torch.where(valid, newton, torch.nan).flatten(0, 1))
    measured, predicted = torch.cat(true).double().numpy(), torch.cat(found).double().numpy()
    scores = objective.scores(sums)
    for i, axis in enumerate("xyz"):
        error = np.nanmean((measured[:, i] - predicted[:, i]) ** 2)
        assert scores[f"r2_{axis}"] == pytest.approx(1 - error / np.nanvar(measured[:, i]))
        deviation = np.nanstd(predicted[:, i])
        assert scores[f"deviation_{axis}_N"] == pytest.approx(deviation, abs=1e-7, rel=1e-4)
    assert scores["deviation_x_N"] == 0  # collapsed, and it is seen
    batch["force_valid"][:] = False
    assert objective.scores(objective.sums(prediction(batch), batch)) == {}


def test_the_head_is_shown_differences_between_slots(encoder: TactileViT, batch: Batch) -> None:
    head = ForceHead(encoder, difference=True)
    full = encoder.views(batch).full
    slots, rows, columns = full.grid
    tokens = head._tokens(full)
    assert tokens.shape[1] == full.tokens.shape[1] + (slots - 1) * rows * columns
    first = full.tokens[:, full.prefix + 1]
    later = full.tokens[:, full.prefix + rows * columns + 1]
    torch.testing.assert_close(tokens[:, full.tokens.shape[1] + 1], head.norm(later - first))
    assert head(encoder.views(batch), batch).force.shape == (8, 3, 3)
    with pytest.raises(ConfigError, match="compares temporal slots, and the encoder has one"):
        ForceHead(TactileViT("tiny", frames=2, image_size=32), difference=True)


def test_a_loss_that_there_is_not_is_named() -> None:
    with pytest.raises(ConfigError, match=r"objective\.force\.loss 'l3'"):
        Force(loss="l3")


def test_a_mean_readout_is_linear_in_the_mean_of_the_patches(
    batch: Batch, encoder: TactileViT
) -> None:
    head = ForceHead(encoder, readout="mean")
    views = encoder.views(batch)
    patches = views.full.tokens[:, encoder.prefix :].mean(1)
    prediction = head(views, batch)
    want = patches @ head.force.linear.weight.T + head.force.linear.bias
    torch.testing.assert_close(prediction.force, want.view(8, 3, 3))
    assert head.hidden(views).shape == (8, 3, encoder.width)
    with pytest.raises(ConfigError, match="readout=attention"):
        ForceHead(encoder, readout="mean", difference=True)
