from typing import Any

import numpy as np
import pytest
import torch

from tactileforge.contracts import Batch
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.positions import sincos_position_embedding
from tactileforge.encoders.preprocess import SPARSH
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError
from tactileforge.testing import batch, check

SMALL = {"size": "tiny", "depth": 1, "image_size": [64, 48]}
T3 = {
    "size": "tiny",
    "depth": 2,
    "frames": 1,
    "tube": 1,
    "spacing": 0.0,
    "image_size": 32,
    "positions": "learned",
    "class_token": True,
    "pool": "class",
    "stems": 3,
    "stem_depth": 1,
    "sensors": {"digit": 2, "gelsight": 0, "mini": 1},
    "eps": 1e-5,
    "layer_scale": None,
    "pixels": SPARSH | {"mean": [[0.1] * 3, [0.2] * 3, [0.3] * 3], "std": [[1.0] * 3] * 3},
}
VARIANTS: dict[str, dict[str, Any]] = {
    "sparsh": SMALL,
    "registers": SMALL | {"registers": 2, "frames": 4, "layer_scale": 1e-5},
    "t3": T3,
    "tvl": SMALL
    | {
        "class_token": True,
        "positions": "learned",
        "norm": "pooled",
        "projected": 40,
        "length": 1.0,
        "layer_scale": None,
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIANTS)
def test_it_keeps_the_contract(name: str) -> None:
    results = check("encoder", PlainViT, **VARIANTS[name])
    assert not [result for result in results if result.status in ("failed", "expected")]
    assert len([result for result in results if result.status == "ran"]) >= 8


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"frames": 1, "tube": 1, "sensor_tokens": 0, "activation": "quick_gelu", "length": 5.0},
        {"norm_in": False, "bias_kv": True, "eps": 1e-6},
    ],
)
def test_the_variants_of_the_other_class_keep_it_too(options: dict[str, Any]) -> None:
    results = check("encoder", TactileViT, size="tiny", depth=1, image_size=32, **options)
    assert not [result for result in results if result.status in ("failed", "expected")]


def test_fixed_positions_are_sines_and_cosines_of_the_grid() -> None:
    table = sincos_position_embedding((1, 5, 4), 16).numpy().reshape(5, 4, 16)
    frequency = 10000 ** -(np.arange(4) / 4)
    for row, column in ((0, 0), (3, 2)):
        want = [f(place * frequency) for place in (row, column) for f in (np.sin, np.cos)]
        np.testing.assert_allclose(table[row, column], np.concatenate(want), atol=1e-6)
    video = (
        sincos_position_embedding((2, 5, 4), 20).numpy().reshape(2, 5, 4, 20)
    )  # 4 frequencies, 24 numbers, cut
    newest = [np.sin(0 * frequency), np.cos(0 * frequency)]
    np.testing.assert_allclose(video[1, 3, 2, :8], np.concatenate(newest), atol=1e-6)
    np.testing.assert_allclose(video[0, 3, 2, :4], np.sin(frequency), atol=1e-6)


def test_each_sample_goes_through_the_stem_of_its_sensor() -> None:
    encoder = PlainViT(**T3).eval()
    sensors = ["digit", "gelsight", "mini", "digit"]
    mixed = batch(4, frames=1, image=32) | {"sensor": sensors}
    with torch.no_grad():
        together = encoder.views(mixed).full.cls
        alone = {
            name: PlainViT(**(T3 | {"stems": 1, "sensors": None}))
            for name in ("digit", "gelsight", "mini")
        }
        for i, name in enumerate(sensors):
            own = alone[name].eval()
            row = encoder.sensors[name]
            state = {
                key.replace(f"stems.{row}.", "stems.0."): value
                for key, value in encoder.state_dict().items()
                if not key.startswith("stems.") or key.startswith(f"stems.{row}.")
            }
            own.load_state_dict(state)
            own.pixels.mean, own.pixels.std = encoder.pixels.mean[row], encoder.pixels.std[row]
            single = {key: value[i : i + 1] for key, value in mixed.items()}
            torch.testing.assert_close(own.views(single).full.cls[0], together[i])


def test_a_sensor_without_a_stem_is_an_error_and_one_stem_takes_all() -> None:
    with pytest.raises(ConfigError, match=r"'digitt'; did you mean 'digit'.*no stem"):
        PlainViT(**T3).sensor_ids(["digitt"])
    assert PlainViT(**SMALL).sensor_ids(["anything", "digit"]).tolist() == [0, 0]


@pytest.mark.parametrize("name", ["sparsh", "registers", "t3"])
def test_every_parameter_gets_a_gradient(name: str) -> None:
    encoder = PlainViT(**VARIANTS[name])
    data = batch(2, frames=encoder.frames, image=32) | {"sensor": ["digit", "digit"]}
    encoder.views(data).masked.tokens.square().sum().backward()
    assert all(p.grad is not None for p in encoder.parameters())


def test_masked_pixels_cannot_change_the_masked_view(batch: Batch) -> None:
    encoder = PlainViT("tiny", depth=1, image_size=32, frames=4, pixels=SPARSH | {"fit": "squash"})
    torch.manual_seed(3)
    before = encoder.views(batch).masked
    hidden = torch.zeros(8, 4, dtype=torch.bool).scatter(1, before.masked, True)
    pixels = hidden.view(8, 1, 1, 2, 1, 2, 1).expand(8, 4, 3, 2, 16, 2, 16).reshape(8, 4, 3, 32, 32)
    changed = torch.where(pixels, 255 - batch["frames"], batch["frames"])
    torch.manual_seed(3)
    after = encoder.views(batch | {"frames": changed}).masked
    torch.testing.assert_close(after.tokens, before.tokens, atol=0, rtol=0)
    assert before.tokens.shape == (8, 2 * 1, 192)


@pytest.mark.parametrize(
    "change",
    [{"pool": "class"}, {"stems": 2}, {"stems": 2, "sensors": {"digit": 2}}, {"image_size": 50}],
)
def test_options_that_do_not_fit_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="encoder: "):
        PlainViT(**(SMALL | change))
