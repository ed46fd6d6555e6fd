"""CLIP towers load from disk: a small random CLIP, saved in the layout of transformers."""

from pathlib import Path

import pytest
import torch
from tiny_clip import save_clip

from tactileforge.encoders.clip import ClipTower
from tactileforge.errors import PluginError

transformers = pytest.importorskip("transformers")


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_clip(tmp_path_factory.mktemp("clip"))


def test_text_tower_gives_clips_text_features(saved: Path) -> None:
    tower = ClipTower(str(saved), "text")
    made = tower(["ball", "a bar"])
    reference = transformers.CLIPModel.from_pretrained(saved)
    tokens = tower.tokenizer(["ball", "a bar"], padding=True, return_tensors="pt")
    hidden = reference.text_model(**tokens).pooler_output
    torch.testing.assert_close(made, reference.text_projection(hidden))
    assert made.shape == (2, tower.width) == (2, 24)
    assert not torch.allclose(made[0], made[1])


def test_image_tower_gives_clips_image_features(saved: Path) -> None:
    tower = ClipTower(str(saved), "image")
    images = torch.randint(0, 256, (2, 3, 32, 32), dtype=torch.uint8)
    reference = transformers.CLIPModel.from_pretrained(saved)
    pixels = (images / 255 - tower.mean) / tower.std
    hidden = reference.vision_model(pixel_values=pixels).pooler_output
    torch.testing.assert_close(tower(images), reference.visual_projection(hidden))


def test_a_frozen_tower_has_no_gradient_and_a_free_one_has(saved: Path) -> None:
    frozen, free = ClipTower(str(saved), "text"), ClipTower(str(saved), "text", frozen=False)
    assert not any(p.requires_grad for p in frozen.parameters())
    assert not frozen.train().model.training
    assert free(["ball"]).requires_grad


def test_a_wrong_path_says_so() -> None:
    with pytest.raises(PluginError, match=r"text_encoder\.path=/nowhere"):
        ClipTower("/nowhere", "text")
