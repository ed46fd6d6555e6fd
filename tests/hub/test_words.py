"""Words for clips: closed forms with a table for a text tower, and models trained here."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from lookup import Lookup
from tiny_clip import save_clip
from torch.nn import functional as F

import tactileforge
from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.encoders.byte import ByteEncoder
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError, PluginError
from tactileforge.heads.align import AlignHead
from tactileforge.hub import cards, pack
from tactileforge.hub.aligned import aligned_head
from tactileforge.hub.files import make_header, open_model, save_checkpoint
from tactileforge.hub.header import Header
from tactileforge.hub.model import Model
from tactileforge.runs.checkpoint_file import read_checkpoint

NODE = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32, "projected": 64}
SENTENCE = "This image gives tactile feelings of {}."
BYTE = {"name": "byte", "width": 48, "depth": 1, "heads": 2}


@pytest.fixture(scope="module")
def encoder() -> TactileViT:
    torch.manual_seed(7)
    return TactileViT("tiny", frames=4, image_size=32, projected=64).eval()


@pytest.fixture
def imported(encoder: TactileViT) -> Model:
    """A model as imported by `zoo get tvl`, with an encoder of a test's size."""
    header = make_header(
        encoder, NODE, licence="MIT", spacing=0.05, name="tvl.vitb", source={"layout": "tvl"}
    )
    return Model(encoder, header)


def touches(count: int) -> np.ndarray:
    return np.random.default_rng(count).integers(0, 256, (count, 4, 40, 40, 3), np.uint8)


def across(vector: torch.Tensor) -> torch.Tensor:
    """A vector at a right angle to another."""
    other = torch.linspace(-1, 2, len(vector))
    return other - vector * (other @ vector) / (vector @ vector)


def test_the_word_with_the_vector_of_the_clip_wins(imported: Model) -> None:
    (clip,) = touches(1)
    vector = imported.encode(clip, clip[0], "digit")
    tower = Lookup({"wood": 3 * across(vector), "metal": 5 * vector, "felt": -vector})
    found = imported.match_words(
        clip,
        ["wood", "metal", "felt"],
        clip[0],
        "digit",
        template="{}",
        text_encoder=tower,
        temperature=0.5,
    )
    assert found.name == "metal"
    assert found.names == ("wood", "metal", "felt")
    assert found.cosine.tolist() == pytest.approx([0, 1, -1], abs=1e-5)
    expected = np.exp([0, 2, -2]) / np.exp([0, 2, -2]).sum()
    assert found.probability.tolist() == pytest.approx(expected, abs=1e-5)
    assert found.probability.dtype == torch.float32


def test_a_batch_has_a_row_for_each_clip(imported: Model) -> None:
    clips = touches(3)
    vectors = imported.encode(clips, clips[:, 0], "digit")
    words = ["a", "b", "c"]
    tower = Lookup(dict(zip(words, vectors.flip(0), strict=True)))
    options = {"template": "{}", "text_encoder": tower}
    found = imported.match_words(clips, words, clips[:, 0], "digit", **options)
    assert found.name == ["c", "b", "a"]
    assert found.probability.shape == found.cosine.shape == (3, 3)
    torch.testing.assert_close(found.probability.sum(1), torch.ones(3))
    one = imported.match_words(clips[1], words, clips[1, 0], "digit", **options)
    torch.testing.assert_close(one.cosine, found.cosine[1], atol=1e-5, rtol=0)
    still = imported.match_words(clips[0, 0], words, "none", "digit", **options)
    assert still.probability.shape == (3,)


def test_the_sentence_is_that_of_the_card_or_ones_own(imported: Model) -> None:
    (clip,) = touches(1)
    vector = imported.encode(clip, "none", "digit")
    table = {SENTENCE.format("wood"): vector, SENTENCE.format("felt"): -vector}
    table |= {"like wood": -vector, "like felt": vector}
    options = {"sensor": "digit", "background": "none", "text_encoder": Lookup(table)}
    assert imported.match_words(clip, ["wood", "felt"], **options).name == "wood"
    other = imported.match_words(clip, ["wood", "felt"], template="like {}", **options)
    assert other.name == "felt"
    assert other.temperature == 0.07, "its file keeps none"


def test_the_temperature_of_training_is_taken(encoder: TactileViT, imported: Model) -> None:
    header = replace(imported.header, source={"layout": "tvl", "temperature": 0.02})
    (clip,) = touches(1)
    vector = imported.encode(clip, "none", "digit")
    tower = Lookup({"x": vector, "y": across(vector)})
    found = Model(encoder, header).match_words(
        clip, ["x", "y"], "none", "digit", template="{}", text_encoder=tower
    )
    assert found.temperature == 0.02
    assert found.probability[0].item() == pytest.approx(1 / (1 + math.exp(-50)), abs=1e-6)


@pytest.mark.parametrize(
    ("words", "options", "said"),
    [
        ("wood", {}, "give a list of words"),
        ([], {}, "give a list of words"),
        (["wood", ""], {}, "give a list of words"),
        (["wood", "felt", "wood"], {}, "'wood' is there twice"),
        (["wood"], {"template": "feels soft"}, "give one {} for the word"),
        (["wood"], {"template": "{} and {}"}, "give one {} for the word"),
        (["wood"], {"temperature": 0}, "temperature=0: give a number above 0"),
        (["wood"], {"background": "first"}, "the image itself"),
        (["wood"], {"text_encoder": ByteEncoder(48, 1, 2)}, "encodes text to 48 numbers, and"),
        (["wood"], {"text_encoder": torch.nn.Linear(64, 64)}, "encodes touch to 0 numbers"),
    ],
)
def test_what_does_not_fit_is_said(
    imported: Model, words: Any, options: dict[str, Any], said: str
) -> None:
    tower = Lookup({"wood": torch.ones(64), SENTENCE.format("wood"): torch.ones(64)})
    given = {"background": "none", "text_encoder": tower} | options
    image = touches(1)[0, 0]
    with pytest.raises(ConfigError) as error:
        imported.match_words(image, words, sensor="digit", **given)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_models_without_language_name_those_with_it() -> None:
    model = tactileforge.load("touch.tiny")
    with pytest.raises(ConfigError, match="is not aligned with language") as error:
        model.match_words(touches(1)[0, :2], ["wood"], "none", "digit")
    for name in ("anytouch1.large", "anytouch2.base", "tvl.vittiny", "unitouch.large"):
        assert name in str(error.value)
    assert "objective=[...,align]" in str(error.value)


def test_an_own_file_is_not_taken_for_the_card_it_names(encoder: TactileViT) -> None:
    header = make_header(encoder, NODE, licence="MIT", spacing=0.05, name="tvl.vitb")
    with pytest.raises(ConfigError, match="is not aligned with language"):
        Model(encoder, header).match_words(touches(1)[0], ["wood"], "none", "digit")


def test_cards_name_the_tower_of_their_training() -> None:
    found = {
        name: weight.text_encoder.split("ViT-")[1][:4]
        for name, _, weight in cards.list_cards()
        if weight and weight.text_encoder
    }
    assert found == {
        "anytouch1.large": "L-14",
        "anytouch2.base": "B-16",
        "anytouch2.base-2f": "B-16",
        "clip.vitb16": "B-16",
        "clip.vitl14": "L-14",
        "tvl.vitb": "L-14",
        "tvl.vits": "L-14",
        "tvl.vittiny": "L-14",
        "unitouch.large": "H-14",
    }


def test_an_absent_tower_is_named(imported: Model, tmp_path: Path) -> None:
    pytest.importorskip("transformers")
    with pytest.raises(PluginError, match=r"text tower of .*tvl\.vitb.* is absent: .*nothing"):
        imported.match_words(
            touches(1)[0], ["a"], "none", "digit", text_encoder=tmp_path / "nothing"
        )


# models trained here


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    words = ["encoder.image_size=32", "batch.size=4", "data.scenes=3", "data.val=1"]
    words += ["data.size=32"]
    config = compose("anytouch2", ["scale=demo", "debug=steps", "objective=[pixel,align]", *words])
    train(config, folder)
    return folder


@pytest.mark.slow
def test_a_run_matches_words_by_what_it_learned(run: Path, tmp_path: Path) -> None:
    model = tactileforge.load(run)
    state = read_checkpoint(run)["state_dict"]
    tower = ByteEncoder(**{k: v for k, v in model.recipe["text_encoder"].items() if k != "name"})
    prefix = "heads.align.text_encoder."
    tower.load_state_dict({k.removeprefix(prefix): v for k, v in state.items() if prefix in k})
    clips, words = touches(2), ["a ball", "an edge", "nothing"]
    with torch.no_grad():
        text = tower.eval()([f"pressing {word}" for word in words])
        text = F.normalize(text @ state["heads.align.text_project.weight"].T, dim=1)
    touch = F.normalize(model(clips, clips[:, 0], "digit"), dim=1)
    found = model.match_words(clips, words, clips[:, 0], "digit", template="pressing {}")
    torch.testing.assert_close(found.cosine, touch @ text.T, atol=1e-5, rtol=0)
    scale = state["heads.align.log_scale"].exp()
    assert found.temperature == pytest.approx(1 / scale.item())
    expected = (scale * (touch @ text.T)).softmax(1)
    torch.testing.assert_close(found.probability, expected, atol=1e-4, rtol=0)
    packed = tactileforge.load(pack.pack_run(run, tmp_path / "a.safetensors"))
    again = packed.match_words(clips, words, clips[:, 0], "digit", template="pressing {}")
    assert torch.equal(again.probability, found.probability)
    assert not any("image_" in key for key in packed.heads["align"].state_dict())
    with pytest.raises(ConfigError, match="leave text_encoder out"):
        packed.match_words(clips, words, "none", "digit", text_encoder=tower)
    with pytest.raises(ConfigError, match="read with words"):
        packed.read_head("align", clips, "none", "digit")
    half = tactileforge.load(run, dtype="bfloat16")
    near = half.match_words(clips, words, clips[:, 0], "digit", template="pressing {}")
    torch.testing.assert_close(near.cosine, found.cosine, atol=0.05, rtol=0)


def test_heads_that_a_file_does_not_have_are_named(run: Path) -> None:
    with pytest.warns(UserWarning, match="pixels a side"):
        model = tactileforge.load(run, image_size=64)
    with pytest.raises(ConfigError, match="image_size= left its heads out"):
        model.match_words(touches(1)[0], ["a"], "none", "digit")
    header = replace(tactileforge.load(run).header, heads={})
    bare = Model(tactileforge.load(run).encoder, header)
    with pytest.raises(ConfigError, match="pack its run again"):
        bare.match_words(touches(1)[0], ["a"], "none", "digit")


def saved(
    encoder: TactileViT, tower: dict[str, Any], built: torch.nn.Module, path: Path
) -> Header | None:
    """Writes the model of a run with a text tower; None where it cannot be kept."""
    config = {"head": {"align": {"name": "align"}}, "text_encoder": tower}
    found = aligned_head(config, encoder, AlignHead(encoder, built, None).state_dict())
    if found is None:
        return None
    head, entry, state = found
    head.load_state_dict(state)
    header = make_header(encoder, NODE, licence="MIT", spacing=0.05, recipe={"text_encoder": tower})
    header = replace(header, heads={"align": entry})
    save_checkpoint(path, encoder, header, heads={"align": head})
    return header


def test_a_frozen_clip_is_not_in_the_file_and_is_asked_for(
    encoder: TactileViT, tmp_path: Path
) -> None:
    pytest.importorskip("transformers")
    from tactileforge.encoders.clip import ClipTower

    place = save_clip(tmp_path / "clip")
    clip = ClipTower(str(place), "text")
    tower = {"name": "clip", "path": str(place), "tower": "text", "frozen": True}
    path = tmp_path / "m.safetensors"
    header = saved(encoder, tower, clip, path)
    assert header is not None
    assert header.heads["align"] == {
        "node": {"name": "align"},
        "text_width": 24,
        "text_name": "clip",
    }
    model = tactileforge.load(path)
    assert model.heads["align"].state_dict().keys() == {"text_project.weight", "log_scale"}
    given = touches(1)[0], ["ball", "bar"], "none", "digit"
    with pytest.raises(ConfigError, match="text tower clip, which is not in its file"):
        model.match_words(*given)
    found = model.match_words(*given, text_encoder=place)
    text = model.heads["align"].text_project(clip(["ball", "bar"]))
    touch = model(given[0], "none", "digit")
    torch.testing.assert_close(found.cosine, F.cosine_similarity(touch[None], text))
    assert saved(encoder, tower | {"frozen": False}, clip, path) is None
    recipe = {"objective": {"align": {}}, "text_encoder": tower | {"frozen": False}}
    bare = Model(encoder, replace(header, heads={}, recipe=recipe))
    with pytest.raises(ConfigError, match=r"text_encoder\.frozen=true"):
        bare.match_words(*given)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"text_encoder": {"name": "clip", "path": "a/b", "tower": "text"}}, "names no file"),
        ({"text_encoder": {"name": "clip", "path": "ab", "tower": "text"}}, "names no file"),
        ({"text_encoder": {"name": "tactile_vit"}}, "encodes no text|the model it describes has"),
        ({"text_encoder": {}}, "text_encoder has no name"),
        ({"text_width": -1}, "text_width is -1"),
        ({"text_width": 9}, "not the weights"),
        ({"text_name": 3}, "text_name is 3"),
    ],
)
def test_a_bent_text_side_is_refused(
    encoder: TactileViT, tmp_path: Path, change: dict[str, Any], said: str
) -> None:
    torch.manual_seed(0)
    path = tmp_path / "m.safetensors"
    header = saved(encoder, BYTE, ByteEncoder(48, 1, 2), path)
    assert header is not None
    head = open_model(path)[1]["align"]
    bent = replace(header, heads={"align": header.heads["align"] | change})
    save_checkpoint(path, encoder, bent, heads={"align": head})
    with pytest.raises(DataError, match=said):
        tactileforge.load(path)
