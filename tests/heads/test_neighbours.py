"""The masked decoder against ridge regression on the patches beside the masked one."""

from itertools import islice
from pathlib import Path

import pytest
import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.compose import compose
from tactileforge.contracts import Batch, MaskedFeatures
from tactileforge.heads.decoder import masked_patches
from tactileforge.module import TouchModule
from tactileforge.train import train

pytestmark = pytest.mark.slow

STEPS = 250
WORDS = ["scale=demo", "objective=[pixel]", "data.scenes=24", "data.val=6", "data.size=96"]
WORDS += ["batch.size=16", f"trainer.max_steps={STEPS}", f"trainer.val_check_interval={STEPS}"]


def means(patches: Tensor) -> Tensor:
    """Means over 4 x 4 pixels of patches (..., 3 * 2 * 16 * 16): (..., 96)."""
    return patches.unflatten(-1, (6, 4, 4, 4, 4)).mean((-1, -3)).flatten(-3)


def beside(patches: Tensor, features: MaskedFeatures) -> Tensor:
    """What lies left, right, above and below of every masked patch: (rows, numbers and a 1).

    A hidden or missing neighbour is zeros; a number each says whether it is seen.
    """
    slots, rows, columns = features.grid
    seen = torch.zeros(len(patches), rows * columns).scatter(1, features.kept, 1.0)
    seen = seen.view(-1, 1, rows, columns, 1).expand(-1, slots, -1, -1, -1)
    known = torch.cat([patches.unflatten(2, (rows, columns)) * seen, seen], dim=-1)
    wide = F.pad(known, (0, 0, 1, 1, 1, 1))
    middle, low, high = slice(1, -1), slice(None, -2), slice(2, None)
    around = [(middle, low), (middle, high), (low, middle), (high, middle)]
    sides = torch.cat([wide[:, :, row, column] for row, column in around], dim=-1).flatten(2, 3)
    found = masked_patches(sides, features).flatten(0, 2)
    return torch.cat([found, torch.ones(len(found), 1)], dim=1).double()


def seen_and_true(module: TouchModule, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
    """Neighbours, truth and the decoder's answer for every masked patch of a batch."""
    views = module.encoder.views(batch)
    low = means(views.patches)
    true = masked_patches(low, views.masked).flatten(0, 2)
    answer = means(module.heads["pixel"].decoder(views.masked)).flatten(0, 2)
    return beside(low, views.masked), true.double(), answer.double()


def explained(answer: Tensor, true: Tensor, mean: Tensor) -> float:
    return float(1 - (answer - true).square().sum() / (true - mean).square().sum())


def test_the_decoder_beats_ridge_on_the_neighbours(tmp_path: Path) -> None:
    """On new touches, with the same masks; ridge has its best penalty on these very touches."""
    module = train(compose("anytouch2", WORDS), tmp_path).eval()
    data = module.trainer.datamodule
    torch.manual_seed(0)
    with torch.no_grad():
        old = [seen_and_true(module, batch) for batch in islice(data.train_dataloader(), 30)]
        new = [seen_and_true(module, batch) for batch in data.val_dataloader()]
    sides, true = (torch.cat([part[i] for part in old]) for i in (0, 1))
    new_sides, new_true, answer = (torch.cat([part[i] for part in new]) for i in range(3))
    square, ridge = sides.T @ sides, []
    for penalty in (1.0, 10.0, 100.0, 1000.0):
        weights = torch.linalg.solve(square + penalty * torch.eye(len(square)), sides.T @ true)
        ridge.append(explained(new_sides @ weights, new_true, true.mean(0)))
    found = explained(answer, new_true, true.mean(0))
    print(f"decoder {found:.3f}, ridge {max(ridge):.3f}")
    assert found > max(ridge) > 0.3
