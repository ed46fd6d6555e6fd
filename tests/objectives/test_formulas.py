"""Each loss against its formula, written out in loops."""

import math

import pytest
import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.encoders.byte import ByteEncoder
from tactileforge.encoders.positions import sincos_grid
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.encoders.vit import ImageViT
from tactileforge.heads.align import Aligned, AlignHead
from tactileforge.heads.decoder import Reconstruction
from tactileforge.heads.diff import DiffHead
from tactileforge.heads.force import ForceHead, Forces
from tactileforge.heads.match import MatchHead, PairScores
from tactileforge.heads.pixel import PixelHead
from tactileforge.objectives.align import Align
from tactileforge.objectives.diff import Diff
from tactileforge.objectives.force import Force
from tactileforge.objectives.match import Match
from tactileforge.objectives.pixel import Pixel


def patch_of(frame: Tensor, position: int, columns: int) -> Tensor:
    """The 16 x 16 patch at a position of a frame (3, H, W), flattened."""
    row, column = divmod(position, columns)
    return frame[:, 16 * row : 16 * row + 16, 16 * column : 16 * column + 16].flatten()


def test_targets_are_the_masked_tubes_of_the_frames(encoder: TactileViT, batch: Batch) -> None:
    views = encoder.views(batch)
    pixels = encoder.preprocess(batch["frames"], batch["background"])
    pixel = PixelHead(encoder, 64, 1, 2)(views, batch)
    diff = DiffHead(encoder, 64, 1, 2)(views, batch)
    assert pixel.target.shape == pixel.predicted.shape == (8, 3, 4, 768)
    assert diff.target.shape == diff.predicted.shape == (8, 3, 3, 768)
    for b in range(8):
        for m, position in enumerate(pixel.masked[b].tolist()):
            for t in range(4):
                true = patch_of(pixels[b, t], position, 2)
                torch.testing.assert_close(pixel.target[b, m, t], true)
                if t:
                    first = patch_of(pixels[b, 0], position, 2)
                    torch.testing.assert_close(diff.target[b, m, t - 1], true - first)


def test_normed_patches_are_those_of_mae(encoder: TactileViT, batch: Batch) -> None:
    """The decoder's own numbers against patches less their mean and over their deviation."""
    torch.manual_seed(0)
    head = PixelHead(encoder, 64, 1, 2, norm_pix=True)
    views = encoder.views(batch)
    prediction = head(views, batch)
    raw = head.decoder.frames(head.decoder(views.masked))
    errors = []
    for clip, true in zip(raw.flatten(0, 2), prediction.target.flatten(0, 2), strict=True):
        mean = true.sum() / len(true)
        variance = (true - mean).square().sum() / (len(true) - 1)
        errors.append((clip - (true - mean) / (variance + 1e-6).sqrt()).square().mean())
    loss, _ = Pixel()(prediction, batch)
    torch.testing.assert_close(loss, torch.stack(errors).mean())


def test_reconstruction_losses_are_the_papers() -> None:
    def formula(x: Reconstruction, frames: int) -> float:
        total = 0.0
        batch, tubes, shown, _ = x.target.shape
        for b in range(batch):
            for n in range(shown):
                for p in range(tubes):
                    total += (x.predicted[b, p, n] - x.target[b, p, n]).square().mean().item()
        return total / (frames * tubes * batch)

    masked = torch.zeros(2, 3, dtype=torch.long)
    pixels = Reconstruction(torch.randn(2, 3, 4, 6), torch.randn(2, 3, 4, 6), masked)
    assert Pixel()(pixels, {})[0].item() == pytest.approx(formula(pixels, 4))
    differences = Reconstruction(torch.randn(2, 3, 3, 6), torch.randn(2, 3, 3, 6), masked)
    assert Diff()(differences, {})[0].item() == pytest.approx(formula(differences, 4))


def test_decoder_positions_tell_every_place_apart() -> None:
    codes = sincos_grid((2, 3, 4), 64).flatten(0, 2)
    assert codes.shape == (24, 64)
    assert torch.cdist(codes, codes).fill_diagonal_(9).min() > 0.1
    assert sincos_grid((2, 3, 4), 70).shape == (2, 3, 4, 70)


def test_align_is_the_papers_over_the_largest_subsets() -> None:
    torch.manual_seed(1)
    touch, text, image = (torch.randn(6, 5) for _ in range(3))
    text_valid = torch.tensor([True, True, False, True, False, True])
    image_valid = torch.tensor([False, True, True, False, True, True])
    scale = torch.tensor(3.0)

    def one_way(a: Tensor, b: Tensor, valid: Tensor) -> float:
        rows = valid.nonzero()[:, 0].tolist()
        a, b = F.normalize(a, dim=1), F.normalize(b, dim=1)
        total = 0.0
        for i in rows:
            total -= math.log(
                math.exp(3 * a[i] @ b[i]) / sum(math.exp(3 * a[i] @ b[j]) for j in rows)
            )
        return total / len(rows)

    expected = 0.3 / 2 * (one_way(touch, image, image_valid) + one_way(image, touch, image_valid))
    expected += 0.2 / 2 * (one_way(touch, text, text_valid) + one_way(text, touch, text_valid))
    prediction = Aligned(touch, text, text_valid, image, image_valid, scale)
    loss, _ = Align(alpha_tv=0.3, alpha_tl=0.2)(prediction, {})
    assert loss.item() == pytest.approx(expected, rel=1e-5)


def test_align_without_any_pair_is_zero_and_harmless() -> None:
    touch = torch.randn(3, 5, requires_grad=True)
    nothing = torch.zeros(3, dtype=torch.bool)
    pairs = torch.randn(3, 5)
    prediction = Aligned(touch, pairs, nothing, pairs, nothing, torch.tensor(9.0))
    loss, _ = Align()(prediction, {})
    loss.backward()
    assert loss.item() == 0
    assert touch.grad is not None
    assert (touch.grad == 0).all()


def test_scores_are_linear_in_the_product_of_a_pair(encoder: TactileViT, batch: Batch) -> None:
    head = MatchHead(encoder)
    torch.nn.init.normal_(head.object.weight)
    views = encoder.views(batch)
    cls = F.normalize(views.full.cls, dim=-1)
    scores = head(views, batch).object
    for i, j in ((0, 0), (2, 5), (7, 1)):
        torch.testing.assert_close(scores[i, j], 10 * head.object(cls[i] * cls[j])[0])


def test_match_is_the_papers_on_pairs_of_the_batch(batch: Batch) -> None:
    # one possible positive for each anchor; all negatives score alike, so the draw does not matter
    positive = torch.tensor([1, 0, 3, 2, 5, 4, 7, 6])
    scores = torch.full((8, 8), -0.7)
    scores[torch.arange(8), positive] = torch.linspace(-1, 2, 8)
    loss, logs = Match()(PairScores(scores, scores), batch)

    def formula(anchors: range) -> float:
        pos = [-F.logsigmoid(scores[i, positive[i]]).item() for i in anchors]
        return sum(pos) / len(pos) - math.log(1 - 1 / (1 + math.exp(0.7)))

    assert logs["object"].item() == pytest.approx(formula(range(8)), rel=1e-5)
    assert logs["action"].item() == pytest.approx(formula(range(6)), rel=1e-5)  # two are unknown
    assert loss.item() == pytest.approx(formula(range(8)) + formula(range(6)), rel=1e-5)


def test_object_positives_come_from_another_sensor(batch: Batch) -> None:
    scores = torch.zeros(8, 8)
    same_sensor = batch | {"sensor": ["digit"] * 8, "action": torch.full((8,), -1)}
    assert Match()(PairScores(scores, scores), same_sensor)[0].item() == 0


def test_clips_outside_a_group_are_no_anchors(batch: Batch) -> None:
    scores = torch.zeros(8, 8)
    alone = batch | {"group": torch.full((8,), -1)}
    assert Match()(PairScores(scores, scores), alone)[0].item() == 0


def test_force_is_the_papers_over_the_labelled(batch: Batch) -> None:
    prediction = Forces(torch.randn(8, 3, 3), torch.randn(8, 3, 3))
    batch["force"][1] = float("nan")  # not labelled
    total, newtons = 0.0, torch.zeros(3)
    labelled = [0, 2, 4, 6]
    for b in labelled:
        scaled = batch["force"][b] / batch["force_scale"][b]
        for n in range(1, 4):
            total += (prediction.force[b, n - 1] - scaled[n]).abs().sum().item() / (3 * 3)
            step = scaled[n] - scaled[n - 1]
            total += (prediction.delta[b, n - 1] - step).abs().sum().item() / (3 * 3)
            error = prediction.force[b, n - 1] * batch["force_scale"][b] - batch["force"][b, n]
            newtons += error.abs() / (3 * len(labelled))
    loss, logs = Force()(prediction, batch)
    assert loss.item() == pytest.approx(total / len(labelled), rel=1e-5)
    assert [logs[f"mae_{a}_N"].item() for a in "xyz"] == pytest.approx(newtons.tolist(), rel=1e-4)


OBJECTIVES = {
    "pixel": (Pixel, lambda e: PixelHead(e, 64, 1, 2)),
    "diff": (Diff, lambda e: DiffHead(e, 64, 1, 2)),
    "align": (Align, lambda e: AlignHead(e, ByteEncoder(64, 1, 2), ImageViT(depth=1))),
    "match": (Match, MatchHead),
    "force": (Force, ForceHead),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", OBJECTIVES)
def test_one_batch_is_overfitted(name: str, encoder: TactileViT, batch: Batch) -> None:
    objective, build = OBJECTIVES[name][0](), OBJECTIVES[name][1](encoder)
    parameters = [*encoder.parameters(), *build.parameters()]
    optimizer = torch.optim.AdamW(parameters, lr=1e-3)
    # random pixels cannot be told from other patches: they fall as far as memory goes
    share = {"pixel": 0.9, "diff": 0.9}.get(name, 0.3)
    losses: list[float] = []
    while len(losses) < 200 and (not losses or losses[-1] > share * losses[0]):
        torch.manual_seed(5)  # the same masks and pairs each time
        loss, _ = objective(build(encoder.views(batch), batch), batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] <= share * losses[0]
