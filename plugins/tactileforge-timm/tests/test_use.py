"""A network of timm trained, resumed, packed, loaded, benched, exported and distilled to."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import timm
import torch
from safetensors.torch import load_file, save_file
from tactileforge_bench.fit.models import model_entry
from timm.data import resolve_model_data_config

import tactileforge
from tactileforge import compose, train
from tactileforge.errors import ConfigError, DataNotFoundError
from tactileforge.hub import pack
from tactileforge.runs.checkpoint_file import read_checkpoint
from tactileforge.runs.folder import read_config

SMALL = ["scale=demo", "debug=steps", "data.scenes=3", "data.val=1", "batch.size=4"]
SIZE = ["encoder=timm", "encoder.image_size=64"]


def run(folder, *words):
    train(compose("anytouch2", [*SMALL, *SIZE, *words]), folder=folder)
    return folder


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """Weights of timm's small network, in a file as timm publishes them."""
    torch.manual_seed(3)
    file = tmp_path_factory.mktemp("weights") / "test_vit.safetensors"
    network = timm.create_model("test_vit", num_classes=10)
    save_file(network.state_dict(), file)
    return file


@pytest.fixture(scope="module")
def trained(weights, tmp_path_factory):
    """A run started from a file, removed afterwards; no step changes a weight."""
    folder = tmp_path_factory.mktemp("trained")
    file = shutil.copy(weights, folder / "weights.safetensors")
    words = ["encoder.name=test_vit", f"encoder.path={file}", "encoder.sensor_tokens=2"]
    run(folder / "run", *words, "objective=[pixel,diff]", "optim.lr=0")
    Path(file).unlink()
    return folder / "run"


@pytest.fixture(scope="module")
def packed(trained):
    return pack.pack_run(trained)


@pytest.mark.parametrize("place", ["encoder", "image_encoder"])
def test_name_is_that_of_the_network(place):
    plugin = {"encoder": "timm", "image_encoder": "timm_image"}[place]
    config = compose("anytouch2", [f"{place}={plugin}", f"{place}.name=resnet18"])
    assert (config[place].name, config[place].model) == (plugin, "resnet18")
    config = compose("anytouch2", [f"{place}={plugin}", f"{place}.model=resnet18"])
    assert (config[place].name, config[place].model) == (plugin, "resnet18")


@pytest.mark.slow
def test_a_run_starts_from_the_weights_of_a_file(trained, weights):
    state = read_checkpoint(trained)["state_dict"]
    network = timm.create_model("test_vit", num_classes=0, img_size=64)
    from tactileforge_timm.networks import load_weights

    load_weights(network, weights)
    for key, value in network.state_dict().items():
        assert torch.equal(state[f"encoder.network.{key}"], value), key


@pytest.mark.slow
def test_a_run_is_resumed_without_the_file(trained, tmp_path):
    folder = shutil.copytree(trained, tmp_path / "run")
    config = read_config(folder) | {"resume": str(folder)}
    config["trainer"]["max_steps"] = read_checkpoint(folder)["global_step"] + 1
    train(config, folder=folder)
    assert read_checkpoint(folder)["global_step"] == config["trainer"]["max_steps"]
    assert read_config(folder)["encoder"]["path"].endswith("weights.safetensors")


@pytest.mark.slow
@torch.no_grad()
def test_a_packed_file_needs_no_other_file(packed, trained):
    model = tactileforge.load(packed)
    node = model.header.encoder
    assert not {"path", "pretrained"} & node.keys()
    assert (node["model"], node["image_size"]) == ("test_vit", [64, 64])
    assert node["preprocess"]["mean"] == list(
        resolve_model_data_config(model.encoder.network)["mean"]
    )
    state = read_checkpoint(trained)["state_dict"]
    for key, value in model.encoder.state_dict().items():
        assert torch.equal(value, state[f"encoder.{key}"]), key
    frames = np.random.default_rng(0).integers(0, 256, (4, 64, 64, 3), dtype=np.uint8)
    x = torch.from_numpy(frames).movedim(-1, 1)[None]
    want = model.encoder(x, x[:, 0], model.encoder.sensor_ids(["digit"]))[1]
    got = model.features(frames, sensor="digit", tap="projected")
    torch.testing.assert_close(got, want[0])
    with pytest.warns(UserWarning, match="positions were interpolated to"):
        larger = tactileforge.load(packed, image_size=96, frames=3)
    assert larger.encode(np.zeros((3, 96, 96, 3), np.uint8), sensor="digit").isfinite().all()


@pytest.mark.slow
def test_a_downloaded_file_causes_no_download(packed, tmp_path, monkeypatch):
    from tactileforge.hub.files import save_checkpoint
    from tactileforge.hub.header import read_header

    model = tactileforge.load(packed)
    header = read_header(packed)
    header.encoder["pretrained"] = True
    save_checkpoint(tmp_path / "other.safetensors", model.encoder, header, heads=model.heads)
    assert json.loads(read_header(tmp_path / "other.safetensors").metadata()["tactileforge"])[
        "encoder"
    ]["pretrained"]
    make = timm.create_model

    def no_download(*words, **options):
        assert not options["pretrained"]
        return make(*words, **options)

    monkeypatch.setattr(timm, "create_model", no_download)
    again = tactileforge.load(tmp_path / "other.safetensors")
    assert again.fingerprint == model.fingerprint


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["encoder.model=test_resnet", "objective=[pixel,diff]", "encoder.join=mean"],
        ["encoder.model=test_vit", "encoder.lora=2", "objective=[pixel]"],
        [
            *["encoder.model=test_vit", "objective=[force]", "freeze=true", "curriculum=constant"],
        ],
        [
            *["encoder.model=test_vit", "objective=[distill]", "image_encoder=timm_image"],
            *["image_encoder.model=test_resnet", "image_encoder.image_size=64"],
        ],
    ],
    ids=["convolutions", "lora", "frozen", "distilled"],
)
def test_training_changes_what_it_should(words, tmp_path):
    folder = run(tmp_path / "run", *words)
    state = read_checkpoint(folder)["state_dict"]
    torch.manual_seed(read_config(folder)["seed"])
    before = tactileforge.api.TouchModule.from_config(read_config(folder), {"image"}).state_dict()
    moved = {key for key, x in state.items() if not torch.equal(x, before[key])}
    of_network = {key for key in moved if key.startswith("encoder.network.")}
    assert bool(of_network) is ("freeze=true" not in words)
    if "lora" in words[1]:
        assert all("lora_" in key for key in of_network)
    assert not {key for key in moved if ".teacher." in key}
    assert not {key for key in of_network if "running" in key}  # fixed_norms


@pytest.mark.slow
@torch.no_grad()
def test_it_is_benched_by_its_name(weights, monkeypatch):
    frozen = model_entry(f"timm:test_vit:{weights}").open[0]()
    network = timm.create_model("test_vit", num_classes=10)
    network.load_state_dict(load_file(weights))
    own = frozen.encoder.network.state_dict()
    assert all(torch.equal(own[k], x) for k, x in network.state_dict().items() if k in own)
    assert frozen.frames == frozen.encoder.frames
    assert frozen.header.encoder["model"] == "test_vit"
    assert len(model_entry("untrained:timm:test_vit").open) == 3
    drawn = [
        entry().encoder.network.blocks[0].attn.qkv.weight
        for entry in model_entry("untrained:timm:test_vit").open
    ]
    assert not torch.equal(drawn[0], drawn[1])
    with pytest.raises(ConfigError, match="did you mean 'test_vit'"):
        model_entry("timm:tset_vit")
    with pytest.raises(DataNotFoundError, match="no such file"):
        model_entry("timm:test_vit:absent.pth")


@pytest.mark.slow
@pytest.mark.parametrize("model", ["test_vit", "test_resnet"])
def test_it_is_exported(model, tmp_path):
    pytest.importorskip("onnxruntime")
    from tactileforge_export.write import export
    from tactileforge_timm.encoder import TimmEncoder

    from tactileforge.hub.files import make_header, save_checkpoint

    node = {"model": model, "image_size": 64, "sensor_tokens": 2 if model == "test_vit" else 0}
    encoder = TimmEncoder(**node).eval()
    header = make_header(encoder, {"name": "timm", **node}, licence="MIT", spacing=0.05)
    save_checkpoint(tmp_path / "model.safetensors", encoder, header)
    done = export(f"file:{tmp_path}/model.safetensors", tmp_path / "model.onnx", size=[48, 64])
    assert done.error < 1e-4


@pytest.fixture
def hub(tmp_path, monkeypatch):
    """A hub on this machine, asked by huggingface_hub's own client."""
    constants = pytest.importorskip("huggingface_hub.constants")
    helpers = Path(__file__).parents[3] / "tests/helpers"
    if not helpers.is_dir():
        pytest.skip("the tests run without the repository")
    monkeypatch.syspath_prepend(str(helpers))
    from hub_server import HubServer

    server = HubServer()
    monkeypatch.setattr(constants, "ENDPOINT", server.url)
    template = server.url + "/{repo_id}/resolve/{revision}/{filename}"
    monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hf"))
    monkeypatch.setattr(constants, "HF_HUB_DISABLE_XET", True)
    monkeypatch.setattr(constants, "HF_TOKEN_PATH", str(tmp_path / "token"))
    monkeypatch.setenv("HF_TOKEN", "secret")
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "cache"))
    yield server
    server.close()


def test_the_loop_of_the_page_runs(tmp_path, monkeypatch, capsys, hub):
    """Fine-tuned, saved, loaded, pushed; without a network its first weights are random here."""
    page = Path(__file__).parents[3] / "docs/timm.md"
    code = re.findall(r"^```python\n(.*?)^```$", page.read_text(), re.M | re.S)[0]
    assert len(code.splitlines()) <= 20
    make, asked = timm.create_model, []

    def made(name, **options):
        asked.append(options["pretrained"])
        return make(name, **{**options, "pretrained": False})

    monkeypatch.setattr(timm, "create_model", made)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(page), "exec"), names := {"__name__": "__main__"})
    assert asked == [True, False]  # fetched once, and not where the file is loaded
    shape, address = capsys.readouterr().out.splitlines()
    assert shape == "torch.Size([2560])"  # the summary, as of a model trained here
    assert address.startswith(f"{hub.url}/me/resnet-of-touch")
    frames = names["frames"][0]
    shared = tactileforge.load("hf:me/resnet-of-touch")
    assert shared.heads["classify"].linear.out_features == 5
    assert torch.equal(shared.encode(frames, frames[0]), names["again"].encode(frames, frames[0]))
