import pytest
import torch
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.encoders.tactile_vit import CLIP_MEAN, CLIP_STD, TactileViT
from tactileforge.errors import ConfigError


def test_preprocessing_is_the_published_recipe(encoder: TactileViT) -> None:
    frames = torch.randint(0, 256, (2, 4, 3, 48, 64), dtype=torch.uint8)
    background = torch.randint(0, 256, (2, 3, 48, 64), dtype=torch.uint8)
    made = encoder.preprocess(frames, background)
    for b in range(2):
        for t in range(4):
            x = (frames[b, t] / 255 - background[b] / 255 + 130 / 255).clamp(0, 1)
            x = F.interpolate(x[None], (32, 32), mode="bilinear", antialias=True)[0]
            for c in range(3):
                expected = (x[c] - CLIP_MEAN[c]) / CLIP_STD[c]
                torch.testing.assert_close(made[b, t, c], expected, atol=2e-5, rtol=0)


def test_patches_embed_like_the_published_convolution(encoder: TactileViT) -> None:
    pixels = torch.randn(2, 4, 3, 32, 32)
    weight = encoder.embed.weight.view(192, 3, 2, 16, 16)
    conv = F.conv3d(pixels.transpose(1, 2), weight, stride=(2, 16, 16))
    embedded = encoder.embed(encoder.patchify(pixels))
    torch.testing.assert_close(
        embedded.flatten(1, 2), conv.flatten(2).transpose(1, 2), atol=1e-5, rtol=1e-5
    )


def test_tubes_keep_the_same_positions_in_every_slot(batch: Batch) -> None:
    encoder = TactileViT("tiny", frames=4, image_size=64)
    features = encoder.views(batch).masked
    assert features.kept.shape == (8, 4)  # a quarter of 16 positions
    assert features.tokens.shape == (8, 6 + 2 * 4, 512)
    both = torch.cat([features.kept, features.masked], dim=1).sort(dim=1).values
    assert (both == torch.arange(16)).all()
    assert len({tuple(row) for row in features.kept.tolist()}) > 1  # each clip has its own mask


def test_masked_pixels_cannot_change_the_masked_view(encoder: TactileViT, batch: Batch) -> None:
    torch.manual_seed(3)
    before = encoder.views(batch).masked
    hidden = torch.zeros(8, 4, dtype=torch.bool).scatter(1, before.masked, True)
    pixels = hidden.view(8, 1, 1, 2, 1, 2, 1).expand(8, 4, 3, 2, 16, 2, 16).reshape(8, 4, 3, 32, 32)
    changed = torch.where(pixels, 255 - batch["frames"], batch["frames"])
    torch.manual_seed(3)
    after = encoder.views(batch | {"frames": changed}).masked
    torch.testing.assert_close(after.tokens, before.tokens, atol=0, rtol=0)


def test_full_view_with_everything_kept_is_the_full_view(encoder: TactileViT, batch: Batch) -> None:
    views = encoder.views(batch)
    everything = torch.arange(4).expand(8, -1)
    tokens = encoder.encode(views.patches, views.sensor, everything)
    torch.testing.assert_close(tokens, views.full.tokens, atol=1e-5, rtol=1e-5)


def test_each_view_is_computed_once(
    encoder: TactileViT, batch: Batch, monkeypatch: pytest.MonkeyPatch
) -> None:
    passes = []
    encode = encoder.encode
    monkeypatch.setattr(encoder, "encode", lambda *a, **k: passes.append(1) or encode(*a, **k))
    views = encoder.views(batch)
    assert passes == []
    for _ in range(3):
        views.full, views.masked  # noqa: B018
    assert len(passes) == 2


def test_universal_tokens_are_drawn_with_the_given_chance(encoder: TactileViT) -> None:
    clips = torch.zeros(4000, 1, 1, 1, 1, dtype=torch.uint8)
    sensors = ["digit"] * 4000
    drawn = encoder.views({"frames": clips, "sensor": sensors}, universal=0.3).sensor
    assert set(drawn.tolist()) == {1, 19}
    assert (drawn == 19).float().mean().item() == pytest.approx(0.3, abs=0.03)
    assert set(encoder.views({"frames": clips, "sensor": sensors}).sensor.tolist()) == {1}


def test_unknown_sensor_is_an_error_or_universal_as_asked() -> None:
    with pytest.raises(ConfigError, match="did you mean 'digit'"):
        TactileViT("tiny", image_size=32).sensor_ids(["digitt"])
    lenient = TactileViT("tiny", image_size=32, unknown_sensor="universal")
    assert lenient.sensor_ids(["digitt", "digit"]).tolist() == [19, 1]


@pytest.mark.parametrize(
    "options",
    [{"frames": 3}, {"image_size": 100}, {"image_size": [32, 40]}, {"mask_ratio": 1.0}],
)
def test_sizes_that_do_not_fit_are_refused(options: dict) -> None:
    with pytest.raises(ConfigError):
        TactileViT("tiny", **options)


@pytest.mark.parametrize(("frames", "size"), [(2, 32), (4, [32, 48]), (8, 16)])
def test_any_size_that_the_tubes_divide(frames: int, size: int | list[int]) -> None:
    encoder = TactileViT("tiny", frames=frames, image_size=size)
    slots, rows, columns = encoder.grid
    clip = torch.zeros(1, frames, 3, 60, 80, dtype=torch.uint8)
    tokens, cls = encoder(clip, clip[:, 0], encoder.sensor_ids(["digit"]))
    assert tokens.shape == (1, 6 + slots * rows * columns, 192)
    assert cls.shape == (1, 512)
