"""Published files become models of the zoo."""

import json
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tactileforge_published as published
import torch
from bomb import Bomb
from tactileforge_published import importing
from tactileforge_published.importing import import_published

import tactileforge
from tactileforge.cli import dispatch
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.heads.force import ForceDecoder
from tactileforge.hub import cards, store
from tactileforge.util.files import sha256

main = partial(dispatch, "zoo")
AddCard = Callable[..., None]


ROWS = [
    {"tag": "tiny", "licence": "MIT", "layout": "press", "encoder": {"size": "tiny"}},
    {"tag": "small", "licence": "MIT", "layout": "press", "encoder": {"size": "small"}},
    {"tag": "short", "licence": "MIT", "layout": "press", "frames": 2, "spacing": 0.1},
    {"tag": "other", "licence": "MIT", "layout": "pull"},
]


@pytest.fixture
def download(
    add_card: AddCard, vit: TactileViT, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A file in the layout of some authors, and its importer."""
    add_card("press", weights=[row | {"source": "https://example.org"} for row in ROWS])
    path = tmp_path / "press.pth"
    torch.save(vit.state_dict(), path)
    node = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32}
    monkeypatch.setattr(importing, "read_tensors", lambda path: torch.load(path), raising=False)
    monkeypatch.setattr(
        importing,
        "convert",
        lambda state: SimpleNamespace(
            name="press",
            encoder_config=node,
            state=state,
            report="",
            head=None,
            probe=None,
            temperature=0.05,
        ),
        raising=False,
    )
    return path


def test_an_import_is_found_by_its_name(download: Path, vit: TactileViT) -> None:
    assert tactileforge.list_models(weights=True) == []
    with pytest.raises(DataNotFoundError, match=r"zoo get press.tiny --from FILE"):
        tactileforge.load("press")
    path = import_published("press.tiny", download)
    model = tactileforge.load("press")
    for key, value in vit.state_dict().items():
        assert torch.equal(model.encoder.state_dict()[key], value)
    assert model.header.source["sha256"] == sha256(download)
    assert model.header.source["file"] == "press.pth"
    assert model.header.source["temperature"] == 0.05
    assert model.header.recipe == {}
    assert tactileforge.list_models(weights=True) == ["press.tiny"]
    record = json.loads((store.weights_folder() / "press.tiny.json").read_text())
    assert record["sha256"] == sha256(path)
    assert {p.name for p in store.weights_folder().iterdir()} == {path.name, "press.tiny.json"}


def test_an_import_is_verified_on_every_load(download: Path) -> None:
    path = import_published("press", download)
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"its sha256 is .* zoo get press.tiny --from FILE"):
        tactileforge.load("press")
    import_published("press", download)
    tactileforge.load("press")


def test_a_failed_import_keeps_the_one_before(
    download: Path, monkeypatch: pytest.MonkeyPatch, vit: TactileViT
) -> None:
    import_published("press", download)
    with torch.no_grad():
        vit.class_token += 1
    torch.save(vit.state_dict(), download)

    def full(*given: Any, **named: Any) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(DataError, match=r"cannot be written \(no space left on device\)"):
        import_published("press", download)
    monkeypatch.undo()
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(download.parent / "cache"))
    kept = tactileforge.load("press").encoder.class_token
    assert torch.allclose(kept + 1, vit.class_token)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("press.small", r"'size': 'tiny'.*'size': 'small'.*it fits press.tiny$"),
        ("press.short", r"'frames': 4.*'frames': 2.*it fits press.tiny$"),
        ("press.other", r"'layout': 'press'.*'layout': 'pull'.*it fits press.tiny$"),
    ],
)
def test_the_file_of_another_model(download: Path, model: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        import_published(model, download)
    assert not list(store.weights_folder().glob("*"))


def test_what_cannot_be_imported(download: Path, add_card: AddCard, weight: dict[str, Any]) -> None:
    with pytest.raises(DataNotFoundError, match=r"download it from https://example.org"):
        import_published("press", download.with_name("nothing.pth"))
    add_card("thing", weights=[weight | {"url": "https://example.org/a"}])
    with pytest.raises(ConfigError, match=r"thing.tiny is remote, not imported"):
        import_published("thing", download)


def anytouch2_file(path: Path, frames: int) -> dict[str, torch.Tensor]:
    """A file in the published layout of AnyTouch 2: its names and shapes, narrow and one deep."""
    wide, slots = 192, frames // 2
    layer = "touch_model.encoder.layers.0."
    shapes: dict[str, tuple[int, ...]] = {
        "sensor_token": (20, 5, wide),
        "touch_model.embeddings.class_embedding": (wide,),
        "touch_model.embeddings.patch_embedding.weight": (wide, 3, 2, 16, 16),
        "touch_model.embeddings.position_embedding.weight": (1 + slots * 196, wide),
        "touch_projection.weight": (512, wide),
        f"{layer}mlp.fc1.weight": (4 * wide, wide),
        f"{layer}mlp.fc1.bias": (4 * wide,),
        f"{layer}mlp.fc2.weight": (wide, 4 * wide),
        f"{layer}mlp.fc2.bias": (wide,),
    }
    for norm in ("pre_layrnorm", "post_layernorm"):
        shapes |= {f"touch_model.{norm}.{x}": (wide,) for x in ("weight", "bias")}
    for norm in ("layer_norm1", "layer_norm2"):
        shapes |= {f"{layer}{norm}.{x}": (wide,) for x in ("weight", "bias")}
    for x in "qkv":
        shapes |= {f"{layer}self_attn.{x}_proj.weight": (wide, wide)}
        shapes |= {f"{layer}self_attn.{x}_proj.bias": (wide,)}
    shapes |= {f"{layer}self_attn.out_proj.weight": (wide, wide)}
    shapes |= {f"{layer}self_attn.out_proj.bias": (wide,)}
    state = {f"touch_mae_model.{key}": 0.1 * torch.randn(shape) for key, shape in shapes.items()}
    positions = torch.arange(1 + slots * 196)[None]
    torch.save(state | {"touch_mae_model.new_position_ids": positions}, path)
    return state


def test_a_published_file_becomes_a_model_of_the_zoo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The real importer and the real card, but for the size: a miniature in place of 87 M."""
    fixed = importing._variant

    def any_size(card: cards.Card, weight: cards.Weight) -> dict[str, Any]:
        return {k: v for k, v in fixed(card, weight).items() if k not in ("size", "depth")}

    monkeypatch.setattr(importing, "_variant", any_size)
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "cache"))
    file = tmp_path / "checkpoint-4frames.pth"
    state = anytouch2_file(file, frames=4)
    assert main(["get", "anytouch2", "--from", str(file)]) == 0
    model = tactileforge.load("anytouch2")
    assert torch.equal(model.encoder.sensor_table, state["touch_mae_model.sensor_token"])
    assert model.spacing == pytest.approx(1 / 15)
    assert model.header.source["layout"] == "anytouch2"
    assert model.header.licence == "NOASSERTION"
    frames = np.random.default_rng(0).integers(0, 256, (4, 60, 80, 3), dtype=np.uint8)
    built = published.convert(published.read_tensors(file)).build()
    batch = torch.from_numpy(frames).movedim(-1, 1)[None]
    with torch.no_grad():
        expected = built(batch, batch[:, 0], torch.tensor([1]))[1]
    assert torch.allclose(model.encode(frames, "first", "digit"), expected[0], atol=1e-6)

    anytouch2_file(file, frames=2)
    with pytest.raises(DataError, match=r"'frames': 2.*it fits anytouch2.base-2f$"):
        main(["get", "anytouch2", "--from", str(file)])
    assert main(["get", "anytouch2.base-2f", "--from", str(file)]) == 0
    assert tactileforge.load("anytouch2.base-2f").spacing == pytest.approx(0.2)

    anytouch2_file(file, frames=4)  # other numbers: the file before is removed, and no other
    assert main(["get", "anytouch2", "--from", str(file)]) == 0
    names = {path.name for path in store.weights_folder().iterdir()}
    assert len(names) == 6  # the file before, and a mark beside it
    [mark] = store.weights_folder().glob("*.old")
    os.utime(mark, (time.time() - 7200,) * 2)
    assert main(["get", "anytouch2", "--from", str(file)]) == 0
    assert len(list(store.weights_folder().iterdir())) == 4
    assert (
        tactileforge.load("anytouch2").frames + tactileforge.load("anytouch2.base-2f").frames == 6
    )
    with pytest.raises(DataError, match=r"checkpoint-4frames.pth is .*'layout': 'clip'"):
        main(["get", "clip", "--from", str(file)])


def head_tensors(wide: int, last: dict[str, tuple[int, ...]]) -> dict[str, torch.Tensor]:
    block = "head.pooler.cross_attention_block."
    shapes: dict[str, tuple[int, ...]] = {"head.pooler.query_tokens": (1, 1, wide), **last}
    for norm in ("norm1", "norm2"):
        shapes |= {f"{block}{norm}.{kind}": (wide,) for kind in ("weight", "bias")}
    sizes = {"xattn.q": (wide, wide), "xattn.kv": (2 * wide, wide), "xattn.proj": (wide, wide)}
    sizes |= {"mlp.fc1": (4 * wide, wide), "mlp.fc2": (wide, 4 * wide)}
    for name, size in sizes.items():
        shapes |= {f"{block}{name}.weight": size, f"{block}{name}.bias": size[:1]}
    torch.manual_seed(5)
    return {key: 0.2 * torch.randn(shape) for key, shape in shapes.items()}


@pytest.fixture
def miniature(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, torch.Tensor]:
    """Tensors of an AnyTouch 2 of 192 channels, accepted by its card."""
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(importing, "_variant", lambda card, weight: {"layout": weight.layout})
    return anytouch2_file(tmp_path / "plain.pth", frames=4)


@pytest.mark.parametrize(
    ("name", "sensor", "newton"),
    [
        (
            "checkpoint-4frames-touchd-digit.pth",
            "digit",
            lambda f: f * f.new([-5.25, 10.61, 14.14]),
        ),
        (
            "checkpoint-4frames-touchd-gelsight.pth",
            "gelsight_mini",
            lambda f: f[..., [1, 0, 2]] * f.new([9.87, 6.84, 8.52]),
        ),
    ],
)
def test_a_published_force_head_is_imported_with_its_units(
    miniature: dict[str, torch.Tensor], tmp_path: Path, name: str, sensor: str, newton: Any
) -> None:
    last = {"head.probe.0.weight": (48, 192), "head.probe.0.bias": (48,)}
    last |= {"head.probe.2.weight": (3, 48), "head.probe.2.bias": (3,)}
    head = head_tensors(192, last)
    head["head.probe.2.weight"] *= 0.05  # what it says stays within the scale of the sensor
    torch.save(miniature | head, tmp_path / name)
    import_published("anytouch2", tmp_path / name)
    model = tactileforge.load("anytouch2")
    frames = np.random.default_rng(0).integers(0, 256, (2, 4, 60, 80, 3), dtype=np.uint8)
    decoder = ForceDecoder(192, 1, 16)
    decoder.load_state_dict(published.force_head(head))
    with torch.no_grad():
        expected = newton(decoder(model.features(frames, "first", sensor)))
    with pytest.warns(UserWarning, match="no calibration= of this unit"):
        force = model.force(frames, "first", sensor, unit="uncalibrated")
    assert force.shape == (2, 1, 3)
    torch.testing.assert_close(force, expected, atol=1e-4, rtol=1e-4)
    torch.save(miniature | head, tmp_path / "unnamed.pth")
    with pytest.raises(ConfigError, match=r"give sensor=, one of: digit, gelsight_mini"):
        import_published("anytouch2", tmp_path / "unnamed.pth")


@pytest.mark.parametrize("pooled", [True, False])
def test_a_published_head_for_classes_is_imported(
    miniature: dict[str, torch.Tensor], tmp_path: Path, pooled: bool
) -> None:
    head = head_tensors(192, {"head.probe.0.weight": (20, 192), "head.probe.0.bias": (20,)})
    if not pooled:
        head = {"head.weight": torch.randn(20, 512), "head.bias": torch.randn(20)}
    torch.save(miniature | head, tmp_path / "checkpoint.pth")
    import_published("anytouch2", tmp_path / "checkpoint.pth")
    model = tactileforge.load("anytouch2")
    assert set(model.heads) == {"classes"}
    frames = np.random.default_rng(0).integers(0, 256, (2, 4, 60, 80, 3), dtype=np.uint8)
    logits = model.read_head("classes", frames, "first", "digit")
    assert logits.shape == (2, 20)
    if not pooled:
        expected = model.encode(frames, "first", "digit") @ head["head.weight"].T
        torch.testing.assert_close(logits, expected + head["head.bias"], atol=1e-4, rtol=1e-4)
    with pytest.raises(ConfigError, match="unknown head of the model 'class'; did you mean 'clas"):
        model.read_head("class", frames, "first", "digit")


def test_another_architecture_is_not_imported_as_the_published_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names and prefixes are those of AnyTouch 2: 192 wide, one block, or a table of ten rows."""
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "cache"))
    file = tmp_path / "checkpoint-4frames.pth"
    state = anytouch2_file(file, frames=4)
    said = r"'size': 'tiny', 'depth': 1, .*but anytouch2.base is .*'size': 'base', 'depth': 12"
    with pytest.raises(DataError, match=said):
        import_published("anytouch2", file)
    name = "touch_mae_model.sensor_token"
    torch.save(state | {name: state[name][:10]}, file)
    with pytest.raises(DataError, match=r"'sensor_rows': 10\}, but .*'sensor_rows': 20\}"):
        import_published("anytouch2", file)
    assert not store.weights_folder().exists() or not list(store.weights_folder().iterdir())


def test_every_card_of_published_weights_fixes_its_architecture() -> None:
    rows = [(name, weight) for name, _, weight in cards.list_cards() if weight and weight.layout]
    assert len(rows) >= 17
    for name, weight in rows:
        transformer = {"size", "depth"} <= weight.encoder.keys()
        assert transformer or weight.encoder["name"] in ("resnet18", "vqgan"), name


def test_a_published_file_that_would_run_code_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "cache"))
    file = tmp_path / "checkpoint.pth"
    torch.save({"model": Bomb(tmp_path / "executed")}, file)
    with pytest.raises(DataError, match=r"checkpoint.pth"):
        main(["get", "anytouch2", "--from", str(file)])
    assert not (tmp_path / "executed").exists()
    torch.load(file, weights_only=False)
    assert (tmp_path / "executed").exists()  # so the file did hold code
    torch.save({"weight": torch.zeros(3)}, file)
    with pytest.raises(DataError, match=r"checkpoint.pth: not a published touch encoder"):
        main(["get", "anytouch2", "--from", str(file)])
