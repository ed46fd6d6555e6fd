"""Each class breaks one thing, and its check sees it."""

import re

import pytest
import torch

from tactileforge.encoders.byte import ByteEncoder
from tactileforge.encoders.tactile_vit import TactileViT


def small(**changes):
    return {"size": "tiny", "depth": 1, "image_size": 32, "frames": 2, **changes}


class Tiny(TactileViT):
    def __init__(self) -> None:
        super().__init__(**small())


class LiesAboutWidth(Tiny):
    def __init__(self) -> None:
        super().__init__()
        self.width = 200

    def encode(self, patches, sensor, kept=None):
        return super().encode(patches, sensor, kept) if kept is None else patches


class LiesAboutGrid(Tiny):
    def forward(self, frames, background, sensor):
        self.grid = (1, 2, 3)
        return super().forward(frames, background, sensor)


class Twice(Tiny):
    def views(self, batch, universal=0.0):
        class Views:
            @property
            def full(self):
                return made.full.__class__(**vars(made.full))

            masked = property(lambda self: made.masked)
            patches = property(lambda self: made.patches)

        made = super().views(batch, universal)
        return Views()


class OverlappingMask(Tiny):
    def views(self, batch, universal=0.0):
        made = super().views(batch, universal)
        made.masked.masked[:, 0] = made.masked.kept[:, 0]
        return made


class Noisy(ByteEncoder):
    def forward(self, text):
        return super().forward(text) + torch.rand(1)


class LooksAtNeighbours(ByteEncoder):
    def forward(self, text):
        out = super().forward(text)
        return out - out.mean(0)


class ForgetsState(ByteEncoder):
    def __init__(self) -> None:
        super().__init__()
        self.shift = torch.rand(1)

    def forward(self, text):
        return super().forward(text) + self.shift


class Branches(Tiny):
    def preprocess(self, frames, background):
        x = super().preprocess(frames, background)
        return x + 1 if x.mean() > 0 else x


class DiffersInExport(Tiny):
    def preprocess(self, frames, background):
        x = super().preprocess(frames, background)
        return x + 1 if torch.compiler.is_exporting() else x


EXPORT = "torch export matches"
SAVE = "save and load are bit equal"


@pytest.mark.parametrize(
    ("plugin", "name"),
    [
        (LiesAboutWidth, "declared sizes are true"),
        (LiesAboutGrid, "declared sizes are true"),
        (Twice, "views are what they declare"),
        (OverlappingMask, "views are what they declare"),
        (Noisy, "eval is deterministic"),
        (LooksAtNeighbours, "batch of one equals a row"),
        (ForgetsState, SAVE),
        (Branches, EXPORT),
        (DiffersInExport, EXPORT),
    ],
)
def test_broken_encoder(result_of, plugin, name):
    assert result_of("encoder", plugin, name).status == "failed"


class Views(Tiny):
    """Takes pixels for contiguous, as those of readers are not."""

    def preprocess(self, frames, background, sensor=None):
        flat = frames.view(-1)
        return super().preprocess(flat.view(frames.shape), background, sensor)


class FixedSensors(Tiny):
    """Its parameter does nothing."""

    def __init__(self, sensors: dict[str, int] | None = None) -> None:
        TactileViT.__init__(self, **small(sensor_tokens=0, sensors={}))


class HidesNothing(TactileViT):
    def __init__(self) -> None:
        super().__init__(**small(mask_ratio=0.0))


class Restless(Tiny):
    """Its state is not in its checkpoint."""

    def __init__(self) -> None:
        super().__init__()
        self.steps = 0

    def encode(self, patches, sensor, kept=None, class_only=False):
        self.steps += self.training
        return super().encode(patches, sensor, kept, class_only) * (1 + 0.1 * self.steps)


STEP = "a step of each objective it serves"


@pytest.mark.parametrize(
    ("plugin", "name", "said"),
    [
        (Views, "declared sizes are true", "view size is not compatible"),
        (FixedSensors, STEP, "gives an encoder with"),
        (HidesNothing, STEP, "objective pixel: ConfigError.*say so in 'serves'"),
        (Restless, "resumes to the same bits", "ends with other weights"),
    ],
)
def test_what_training_would_meet(result_of, plugin, name, said):
    result = result_of("encoder", plugin, name)
    assert result.status == "failed"
    assert re.search(said, result.detail), result.detail


class ServesForce(HidesNothing):
    serves = ("force",)


class NoSensors(Tiny):
    """Every sensor is welcome; it has no table."""

    def __init__(self) -> None:
        TactileViT.__init__(self, **small(sensor_tokens=0, sensors={}))


@pytest.mark.parametrize("plugin", [ServesForce, NoSensors])
def test_what_an_encoder_does_not_have_is_not_asked_for(result_of, plugin):
    for name in ("views are what they declare", STEP):
        assert result_of("encoder", plugin, name).status == "ran"
