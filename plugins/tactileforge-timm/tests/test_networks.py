"""Networks by name, and their weights from timm and from files."""

import pickle
from pathlib import Path

import pytest
import timm
import torch
from safetensors.torch import save_file
from tactileforge_timm.encoder import TimmEncoder
from tactileforge_timm.networks import create_network, read_weights

from tactileforge.errors import ConfigError, DataError, DataNotFoundError

NAME = "test_vit"  # timm's own small network for tests


@pytest.fixture
def network():
    return timm.create_model(NAME, num_classes=10)


def same(ours, state):
    own = ours.state_dict()
    assert own
    for key, value in own.items():
        assert torch.equal(value, state[key]), key


@pytest.mark.parametrize(
    ("model", "said"),
    [
        ("vit_tini_patch16_224", r"no such model; did you mean 'vit_tiny_patch16_224'\?$"),
        ("vit_tiny_patch16_224.nonsense", "no such weights of vit_tiny_patch16_224; known: augreg"),
        ("hf-hub:somebody/something", "give a name of timm"),
        ("local-dir:/tmp", "give a name of timm"),
        ("../x", "give a name of timm"),
    ],
)
def test_a_name_that_timm_has_not_is_an_error_of_a_line(model, said):
    with pytest.raises(ConfigError, match=said) as error:
        create_network(model, None, False, None)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", ["safetensors", "pth", "wrapped", "distributed", "in_a_run"])
def test_weights_of_a_file_are_those_of_the_network(kind, network, tmp_path):
    state = network.state_dict()
    file = tmp_path / f"weights.{'safetensors' if kind == 'safetensors' else 'pth'}"
    if kind == "safetensors":
        save_file(state, file)
    else:
        wrapped = {
            "pth": state,
            "wrapped": {"epoch": 3, "state_dict": state},
            "distributed": {"model": {f"module.{key}": x for key, x in state.items()}},
            "in_a_run": {"model": {"state_dict": {f"_orig_mod.{k}": x for k, x in state.items()}}},
        }
        torch.save(wrapped[kind], file)
    same(create_network(NAME, None, False, str(file)), state)


def test_positions_of_a_file_are_resampled_as_timm_does(tmp_path):
    whole = timm.create_model("vit_tiny_patch16_224", num_classes=0)
    torch.nn.init.normal_(whole.pos_embed)
    save_file(whole.state_dict(), tmp_path / "weights.safetensors")
    ours = create_network(
        "vit_tiny_patch16_224", (96, 64), False, str(tmp_path / "weights.safetensors")
    )
    whole.set_input_size(img_size=(96, 64))
    assert ours.pos_embed.shape == (1, 1 + 6 * 4, 192)
    torch.testing.assert_close(ours.pos_embed, whole.pos_embed, rtol=0, atol=1e-6)


def test_weights_of_another_network_are_refused(network, tmp_path):
    file = tmp_path / "weights.pth"
    torch.save(network.state_dict(), file)
    with pytest.raises(DataError, match=r"not weights of resnet18: .*missing.*unexpected"):
        create_network("resnet18", None, False, str(file))
    half = {k: x for k, x in network.state_dict().items() if not k.startswith("blocks.0.")}
    torch.save(half, file)
    with pytest.raises(DataError, match=r"not weights of test_vit: 1\d missing \(blocks\.0\."):
        create_network(NAME, None, False, str(file))


class Bomb:
    """Makes a file when it is unpickled."""

    def __init__(self, place):
        self.place = place

    def __reduce__(self):
        return Path.touch, (self.place,)


def test_nothing_in_a_file_is_executed(network, tmp_path):
    file, place = tmp_path / "weights.pth", tmp_path / "executed"
    torch.save({"state_dict": network.state_dict(), "hook": Bomb(place)}, file)
    with pytest.raises(DataError, match="holds more than weights, and is not read"):
        create_network(NAME, None, False, str(file))
    file.write_bytes(pickle.dumps(Bomb(place)))
    with pytest.raises(DataError, match="weights"):
        read_weights(file)
    assert not place.exists()


@pytest.mark.parametrize("content", [b"", b"not weights at all", b"\x80\x02}q\x00."])
def test_a_file_without_weights_is_refused_in_a_line(content, tmp_path):
    file = tmp_path / "weights.pth"
    file.write_bytes(content)
    with pytest.raises(DataError, match=r"weights\.pth: ") as error:
        read_weights(file)
    assert "\n" not in str(error.value)


def test_an_absent_file_and_two_origins_of_weights_are_errors():
    with pytest.raises(DataNotFoundError, match=r"encoder\.path=absent\.pth: no such file"):
        create_network(NAME, None, False, "absent.pth")
    with pytest.raises(ConfigError, match="leave one of them out"):
        create_network(NAME, None, True, "absent.pth")


def test_without_a_network_the_fix_is_in_the_line(monkeypatch, tmp_path):
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path))
    with pytest.raises(DataNotFoundError, match=r"give their file as encoder\.path=FILE") as error:
        create_network("test_vit.r160_in1k", None, True, None)
    assert "\n" not in str(error.value)


def test_weights_of_timm_are_taken(monkeypatch):
    from timm.models import _builder

    state = timm.create_model(NAME).state_dict()
    monkeypatch.setattr(_builder, "load_state_dict_from_hf", lambda *_, **__: dict(state))
    same(create_network("test_vit.r160_in1k", None, True, None), state)


def test_a_network_without_weights_says_so():
    with pytest.raises(ConfigError, match="timm has no weights of test_vit4: give"):
        create_network("test_vit4", None, True, None)


def test_on_the_meta_device_nothing_is_read_or_fetched(network, tmp_path):
    file = tmp_path / "weights.pth"
    file.write_bytes(b"nonsense")
    with torch.device("meta"):
        assert next(create_network(NAME, None, False, str(file)).parameters()).is_meta
        assert next(create_network("test_vit.r160_in1k", None, True, None).parameters()).is_meta
        assert TimmEncoder(NAME, path=str(file)).sensor_table is None
