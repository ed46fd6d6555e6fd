"""Models saved as they are now, and created by name."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from PIL import Image
from torch import nn

import tactileforge
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.hub.creating import create
from tactileforge.hub.loading import list_models
from tactileforge.hub.model import Model
from tactileforge.hub.store import fetch_weights
from tactileforge.util.licences import NO_LICENCE

RNG = np.random.default_rng(0)
REST = RNG.integers(0, 256, (64, 64, 3), np.uint8)
SMALL: dict[str, Any] = {"size": "tiny", "depth": 3, "image_size": 32, "patch": 16, "frames": 2}


def _clip(model: Model) -> np.ndarray:
    return RNG.integers(0, 256, (model.frames, 64, 64, 3), np.uint8)


def test_a_model_trained_in_a_plain_loop_is_saved_with_its_lineage(tmp_path: Path) -> None:
    model = tactileforge.load("anytouch2.tiny")
    before = model.part_hashes()
    clip = _clip(model)
    model.encoder.requires_grad_(True)
    optimizer = torch.optim.SGD(model.encoder.parameters(), 0.1)
    model(clip, REST, "digit").sum().backward()
    optimizer.step()
    found = tactileforge.load(model.save(tmp_path / "mine.safetensors", name="mine.tiny"))
    assert torch.equal(found.encode(clip, REST, "digit"), model.encode(clip, REST, "digit"))
    lineage = found.header.source["lineage"]
    assert lineage["base"] == "anytouch2.tiny"
    assert lineage["changed"] == ["encoder"]
    assert lineage["base_hashes"] == before
    assert lineage["hashes"] == found.part_hashes() != before
    assert found.header.licence == "Apache-2.0"


def test_unchanged_weights_have_no_lineage(tmp_path: Path) -> None:
    model = tactileforge.load("anytouch2.tiny")
    found = tactileforge.load(str(model.save(tmp_path / "same.safetensors")))
    assert "lineage" not in found.header.source
    assert found.fingerprint == model.fingerprint


def test_a_folder_has_a_card(tmp_path: Path) -> None:
    model = create("tactile_vit", **SMALL)
    folder = model.save_pretrained(tmp_path / "a folder", name="x | y", licence="MIT")
    assert "license: mit" in (folder / "README.md").read_text()
    for given in (folder, str(folder)):
        assert tactileforge.load(given).fingerprint == model.fingerprint


def test_a_model_without_a_name_has_that_of_its_folder(tmp_path: Path) -> None:
    model = create("tactile_vit", **SMALL)
    model.header = replace(model.header, name="")
    folder = model.save_pretrained(tmp_path / "my touches", licence="MIT")
    assert "# my touches" in (folder / "README.md").read_text()
    assert tactileforge.load(folder).header.name == "my touches"
    tactileforge.load(folder).save_pretrained(tmp_path / "elsewhere")
    assert tactileforge.load(tmp_path / "elsewhere").header.name == "my touches"


def test_the_licence_of_the_base_holds(tmp_path: Path) -> None:
    model = tactileforge.load("anytouch2.tiny")
    with pytest.raises(ConfigError, match=r"come from weights under Apache-2\.0"):
        model.save(tmp_path / "x.safetensors", licence="MIT")


def test_rounded_weights_and_heads_of_nowhere_are_refused(tmp_path: Path) -> None:
    model = tactileforge.load("anytouch2.tiny", dtype="bfloat16")
    with pytest.raises(ConfigError, match="load it in float32"):
        model.save(tmp_path / "x.safetensors")
    other = create("tactile_vit", **SMALL)
    other.heads["own"] = nn.Linear(2, 2)
    with pytest.raises(ConfigError, match="head own is not one of the model's file"):
        other.save(tmp_path / "x.safetensors")


def test_a_state_dict_says_what_to_do(tmp_path: Path) -> None:
    model = create("tactile_vit", **SMALL)
    torch.save(model.state_dict(), tmp_path / "mine.pth")
    with pytest.raises(DataError, match=r"a state_dict of yours.*model.save\(FILE\)"):
        tactileforge.load(tmp_path / "mine.pth")


def test_a_checkpoint_of_lightning_says_which_call_reads_it(tmp_path: Path) -> None:
    place = tmp_path / "run" / "checkpoints" / "x.ckpt"
    place.parent.mkdir(parents=True)
    torch.save({"state_dict": {}, "pytorch-lightning_version": "2.6.0"}, place)
    said = r"x\.ckpt: a checkpoint of Lightning: .*TouchModule\.load_from_checkpoint\('.*x.ckpt'\)"
    for given in (place, str(place), f"file:{place}"):
        with pytest.raises(DataError, match=f"{said}.*encoder$"):
            tactileforge.load(given)
    (place.parents[1] / "config.yaml").write_text("a: 1\n")
    with pytest.raises(DataError, match=rf"{said}.*and tactileforge\.load\('.*/run'\) its run$"):
        tactileforge.load(place)


def test_load_from_checkpoint_says_what_is_none(tmp_path: Path) -> None:
    from tactileforge.training import TouchModule

    (tmp_path / "bad.ckpt").write_bytes(b"hello")
    torch.save({"state_dict": {}, "hyper_parameters": {"width": 3}}, tmp_path / "other.ckpt")
    for name, said in (
        ("none.ckpt", r"no checkpoint at .*none\.ckpt"),
        ("bad.ckpt", r"not a checkpoint: damaged, or something else; .*tactileforge\.load\("),
        ("other.ckpt", "a checkpoint of another LightningModule: its own class loads it"),
    ):
        with pytest.raises((ConfigError, DataNotFoundError), match=said):
            TouchModule.load_from_checkpoint(tmp_path / name)


def test_a_created_model_has_random_weights_and_a_head_for_classes(tmp_path: Path) -> None:
    model = create("anytouch2.tiny", num_classes=5)
    trained = tactileforge.load("anytouch2.tiny")
    shapes = {key: x.shape for key, x in trained.encoder.state_dict().items()}
    assert shapes == {key: x.shape for key, x in model.encoder.state_dict().items()}
    assert model.fingerprint != trained.fingerprint
    assert model.header.licence == NO_LICENCE
    assert model.read_head("classify", _clip(model)[None], REST, "digit").shape == (1, 5)
    found = tactileforge.load(model.save(tmp_path / "x.safetensors"))
    assert found.heads["classify"].linear.weight.shape[0] == 5  # type: ignore[union-attr]


def test_a_created_pretrained_model_is_the_loaded_one() -> None:
    model = create("anytouch2.tiny", pretrained=True, num_classes=2)
    assert model.encoder_hash == tactileforge.load("anytouch2.tiny").encoder_hash


@pytest.mark.parametrize("count", [0, -1, True, 2.5])
def test_numbers_of_classes_are_whole(count: object) -> None:
    with pytest.raises(ConfigError, match="num_classes"):
        create("tactile_vit", num_classes=count)  # type: ignore[arg-type]


def test_layers_are_the_outputs_of_blocks() -> None:
    model = create("tactile_vit", **SMALL)
    seen: list[torch.Tensor] = []
    blocks = model.encoder.transformer.blocks
    for block in blocks:
        block.register_forward_hook(lambda _module, _given, out: seen.append(out))
    clips = np.stack([_clip(model) for _ in range(3)])
    found = model.features(clips, REST, "digit", layers=[1, -1, 0], batch_size=3)
    for row, got in zip((1, 2, 0), found, strict=True):
        torch.testing.assert_close(got, seen[row])
    single = model.features(clips[0], REST, "digit", layers=[-1])
    torch.testing.assert_close(single[0], found[1][0])
    for wrong in ([3], [-4], [], [0.5]):
        with pytest.raises(ConfigError, match="-3 to 2"):
            model.features(clips, REST, "digit", layers=wrong)  # type: ignore[arg-type]


def test_a_tap_and_layers_are_one_too_many() -> None:
    model = create("tactile_vit", **SMALL)
    clip = _clip(model)
    with pytest.raises(ConfigError, match=r"^tap='cls' and layers=\[-1\]: .*; give one of the two"):
        model.features(clip, REST, "digit", tap="cls", layers=[-1])
    for key, value in (("tap", "cls"), ("layers", [-1])):
        with pytest.raises(ConfigError, match=rf"takes no {key}=: model\.features\(.*{key}=\.\.\."):
            model.encode(clip, REST, "digit", **{key: value})
    tokens = model.features(clip, REST, "digit")
    assert torch.equal(tokens, model.features(clip, REST, "digit", tap="tokens"))


def test_floats_pictures_and_paths_are_taken_as_uint8_are(tmp_path: Path) -> None:
    model = create("tactile_vit", **SMALL)
    clip = _clip(model)
    wanted = model.encode(clip, REST, "digit")
    paths = []
    for row, frame in enumerate(clip):
        paths.append(tmp_path / f"{row}.png")
        cv2.imwrite(str(paths[-1]), frame[..., ::-1])
    pictures = [Image.fromarray(frame) for frame in clip]
    floats = torch.from_numpy(clip).float() / 255
    for frames in (floats, clip / 255, pictures, paths, list(clip)):
        for rest in (REST, REST / 255, Image.fromarray(REST)):
            assert torch.equal(model.encode(frames, rest, "digit"), wanted)
    for missing, said in ((tmp_path / "no.png", "no such file"), (Path(__file__), "not an image")):
        with pytest.raises(DataError, match=said):
            model.encode(missing, REST, "digit")


def test_the_background_is_read_from_a_path_wherever_one_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("rest.png", REST[..., ::-1])
    model = create("tactile_vit", num_classes=64, **SMALL)
    model.heads["classify"].met.fill_(True)  # type: ignore[union-attr,operator]
    clips = np.stack([_clip(model) for _ in range(3)])
    reads = {
        "encode": model.encode,
        "features": model.features,
        "groups": lambda *given: model.groups(*given)["difference"],
        "forward": lambda *given: model(*given).detach(),
        "read_head": lambda *given: model.read_head("classify", *given),
        "readings": lambda *given: model.readings(*given).vector,
        "classify": lambda *given: model.classify(*given, names=["a", "b"]).probability,
    }
    for name, read in reads.items():
        wanted = read(clips, REST, "digit")
        for rest in ("rest.png", Path("rest.png"), str(tmp_path / "rest.png"), ["rest.png"] * 3):
            assert torch.equal(read(clips, rest, "digit"), wanted), (name, rest)
    video, times = np.concatenate([*clips]), np.arange(6) / 30
    ends = [
        model.encode_video(video, background=rest, sensor="digit", times=times, hop=0.1)[1]
        for rest in (REST, "rest.png")
    ]
    assert torch.equal(*map(torch.as_tensor, ends))
    streams = [
        model.stream("digit", background=rest)
        for rest in (REST, "rest.png", Path("rest.png"), Image.fromarray(REST), REST / 255)
    ]
    streams.append(model.stream("digit", background=torch.from_numpy(REST)))
    for stream in streams:
        assert np.array_equal(stream.background, REST)


@pytest.mark.parametrize(
    ("background", "message"),
    [
        (
            "fisrt",
            r"^background='fisrt': no such word or file; did you mean 'first'\? Give a frame",
        ),
        ("no.png", "background: no.png: no such file; correct the path"),
        (Path("rest"), "background: rest: no such file; correct the path"),
        (".", r"background: \.: a folder; give its images, as sorted\("),
        (None, "no background: give a frame without contact"),
    ],
)
def test_a_background_that_is_none_is_one_line(background, message, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    model = create("tactile_vit", **SMALL)
    for read in (model.encode, model.features):
        with pytest.raises((ConfigError, DataError), match=message):
            read(_clip(model), background, "digit")
    if background is not None:
        with pytest.raises((ConfigError, DataError), match=message):
            model.stream("digit", background=background)


def test_lists_tell_what_can_be_loaded() -> None:
    assert "anytouch2.tiny" in list_models(available="shipped", reads="force", sensor="digit")
    assert "touch.tiny" not in list_models(reads="force")
    assert "dino.base" in list_models(licence="CC-BY-NC-*", available="downloadable")
    assert list_models(available="by hand", pattern="unit.*") == ["unit.vqgan"]
    with pytest.raises(ConfigError, match="forces"):
        list_models(reads="forces")


def test_torch_hub_has_the_same_models() -> None:
    spec = importlib.util.spec_from_file_location(
        "hubconf", Path(__file__).parents[2] / "hubconf.py"
    )
    assert spec
    assert spec.loader
    hubconf = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hubconf)
    assert hubconf.anytouch2_tiny().encoder_hash == tactileforge.load("anytouch2.tiny").encoder_hash
    assert hubconf.create("tactile_vit", **SMALL).frames == 2
    root = str(Path(__file__).parents[2])
    made = torch.hub.load(  # type: ignore[no-untyped-call]
        root, "create", "tactile_vit", source="local", **SMALL
    )
    assert made.frames == 2


def test_a_shipped_file_is_what_it_says() -> None:
    """Loading by name keeps its hash check; `fetch_weights` is what both use."""
    from tactileforge.hub.cards import find_card

    assert fetch_weights(*find_card("anytouch2.tiny")).is_file()
