"""CLIP towers load from disk: a small random CLIP, saved in the layout of transformers."""

from pathlib import Path

import pytest
import torch

from tactileforge.encoders.clip import ClipTower
from tactileforge.errors import PluginError

transformers = pytest.importorskip("transformers")


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clip")
    words = [*map(chr, range(97, 123))]
    vocabulary = words + [f"{w}</w>" for w in words] + ["<|startoftext|>", "<|endoftext|>"]
    transformers.CLIPTokenizer(
        vocab={word: i for i, word in enumerate(vocabulary)}, merges=[]
    ).save_pretrained(folder)
    end = len(vocabulary) - 1
    both = {
        "hidden_size": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "projection_dim": 24,
    }
    config = transformers.CLIPConfig(
        text_config={**both, "vocab_size": end + 1, "eos_token_id": end, "bos_token_id": end - 1},
        vision_config={**both, "image_size": 32, "patch_size": 16},
        projection_dim=24,
    )
    torch.manual_seed(0)
    transformers.CLIPModel(config).save_pretrained(folder)
    return folder


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
