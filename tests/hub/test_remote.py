"""The model hub: huggingface_hub's own client against a server on this machine."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hub_server import COMMIT, HubServer

import tactileforge
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.hub import remote
from tactileforge.hub.cards import list_cards
from tactileforge.hub.creating import create
from tactileforge.hub.model import Model
from tactileforge.plugins import registry

pytest.importorskip("huggingface_hub")
REST = np.full((64, 64, 3), 110, np.uint8)


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[HubServer]:
    one = HubServer()
    constants = import_module("huggingface_hub.constants")
    monkeypatch.setattr(constants, "ENDPOINT", one.url)
    template = one.url + "/{repo_id}/resolve/{revision}/{filename}"
    monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hf"))
    monkeypatch.setattr(constants, "HF_HUB_DISABLE_XET", True)
    monkeypatch.setattr(constants, "DOWNLOAD_CHUNK_SIZE", 1 << 14)
    monkeypatch.setattr(constants, "HF_TOKEN_PATH", str(tmp_path / "token"))
    monkeypatch.delenv("HF_TOKEN", raising=False)
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "cache"))
    yield one
    one.close()


@pytest.fixture(scope="module")
def model() -> Model:
    torch.manual_seed(0)
    return create("tactile_vit", size="tiny", depth=1, image_size=32, patch=16, frames=2)


@pytest.fixture
def put(server: HubServer, model: Model, tmp_path: Path) -> bytes:
    model.save_pretrained(tmp_path / "folder", name="mine.tiny", licence="MIT")
    body = (tmp_path / "folder" / "model.safetensors").read_bytes()
    server.repos["me/touch"] = {"main": {"model.safetensors": body}}
    return body


def _vector(model: Model) -> torch.Tensor:
    return model.encode(np.stack([REST] * model.frames), REST, "digit")


def test_a_model_of_the_hub_is_the_one_that_was_saved(
    server: HubServer, put: bytes, model: Model
) -> None:
    found = tactileforge.load("hf:me/touch")
    assert torch.equal(_vector(found), _vector(model))
    assert any(path.startswith("/blob/") for _, path, _ in server.asked), "a redirect was followed"


def test_a_revision_is_another_file(server: HubServer, put: bytes, tmp_path: Path) -> None:
    other = create("tactile_vit", size="tiny", depth=1, image_size=32, patch=16, frames=2)
    other.save(tmp_path / "other.safetensors")
    server.repos["me/touch"]["v2"] = {
        "model.safetensors": (tmp_path / "other.safetensors").read_bytes()
    }
    assert torch.equal(_vector(tactileforge.load("hf:me/touch@v2")), _vector(other))


def test_a_file_that_changed_under_its_commit_is_refused(
    server: HubServer, put: bytes, tmp_path: Path
) -> None:
    path = remote.fetch_file("me/touch", "model.safetensors", "main")
    server.repos["me/touch"]["main"]["model.safetensors"] = b"x" + put[1:]
    for cached in (path, path.resolve()):
        cached.unlink()
    with pytest.raises(DataError, match="at the first download: somebody changed it"):
        tactileforge.load("hf:me/touch")


def test_a_download_that_was_cut_off_goes_on(server: HubServer, put: bytes) -> None:
    server.cut = len(put) // 2
    path = remote.fetch_file("me/touch", "model.safetensors", "main")
    assert path.read_bytes() == put
    assert any(wanted.startswith("bytes=") for _, path_, wanted in server.asked if "blob" in path_)


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("hf:me/none", "no such repository, or a private one.*hf auth login"),
        ("hf:me/touch@v9", "no such revision"),
        ("hf:me/empty", "has no model.safetensors: it was not written by model.push_to_hub"),
        ("hf:me/gated", "its authors ask for terms to be accepted"),
    ],
)
def test_what_cannot_be_had_says_what_to_do(
    server: HubServer, put: bytes, place: str, said: str
) -> None:
    server.repos |= {"me/empty": {"main": {}}, "me/gated": {"main": {}}}
    server.gated.add("me/gated")
    with pytest.raises(DataNotFoundError, match=said):
        tactileforge.load(place)


@pytest.mark.parametrize("place", ["hf:touch", "hf:../x", "hf:a/b/c", "hf:me/touch@", "hf:"])
def test_other_forms_of_a_place_are_refused(place: str) -> None:
    with pytest.raises(ConfigError, match="write hf:OWNER/NAME"):
        tactileforge.load(place)


def test_a_hub_that_is_away(
    server: HubServer,
    put: bytes,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first = tactileforge.load("hf:me/touch")
    server.close()
    assert torch.equal(_vector(tactileforge.load("hf:me/touch")), _vector(first)), "from the cache"
    naps: list[float] = []
    monkeypatch.setattr(time, "sleep", naps.append)
    with pytest.raises(DataNotFoundError, match=r"^hf:me/other: the hub cannot be reached, .*\Z"):
        tactileforge.load("hf:me/other")
    with pytest.raises(DataNotFoundError, match=r"^hf:me/mine: .* cannot be reached; try again\Z"):
        first.push_to_hub("me/mine")
    assert not naps, "the client's own six tries wait for each other"
    said = capsys.readouterr()
    assert "etry" not in said.err + said.out + caplog.text


def test_a_model_is_pushed_and_loaded_elsewhere(
    server: HubServer, model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DataNotFoundError, match="hf auth login"):
        model.push_to_hub("me/mine")
    monkeypatch.setenv("HF_TOKEN", "secret")
    assert model.push_to_hub("me/mine", licence="MIT").endswith(COMMIT)
    files = server.repos["me/mine"]["main"]
    assert "license: mit" in files["README.md"].decode()
    assert 'load("hf:me/mine")' in files["README.md"].decode()
    assert torch.equal(_vector(tactileforge.load("hf:me/mine")), _vector(model))


def test_published_weights_need_their_licence_and_come_from_their_authors(
    server: HubServer, put: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The importer is a stand-in here: it keeps what it is given."""
    given: list[tuple[str, bytes]] = []

    def importer(name: str, source: Path) -> Path:
        given.append((name, source.read_bytes()))
        path = tmp_path / "imported.safetensors"
        path.write_bytes(put)
        return path

    load = registry.load

    def loaded(kind: str, name: str) -> Any:
        return importer if kind == "importers" else load(kind, name)

    monkeypatch.setattr(registry, "load", loaded)
    with pytest.raises(ConfigError, match=r'under CC-BY-NC-4.0.*accept="CC-BY-NC-4.0"'):
        tactileforge.load("sparsh/ijepa-base")
    with pytest.raises(ConfigError, match=r"accept='MIT'.*are under CC-BY-NC-4.0"):
        tactileforge.load("sparsh/ijepa-base", accept="MIT")
    with pytest.raises(DataNotFoundError, match="hf:facebook/sparsh-ijepa-base: no such repo"):
        tactileforge.load("sparsh/ijepa-base", accept="CC-BY-NC-4.0")
    assert not given
    server.repos["facebook/sparsh-ijepa-base"] = {"main": {"ijepa_vitbase.ckpt": b"weights"}}
    tactileforge.load("sparsh/ijepa-base", accept="CC-BY-NC-4.0")
    assert given == [("ijepa.base", b"weights")]


def test_every_published_place_is_one() -> None:
    """A place is that of the page on the card, and its revision is a branch or a whole commit."""
    places = [(card, row) for _, card, row in list_cards() if row and row.published]
    assert len(places) >= 20
    for _, row in places:
        place, _, revision = row.published.partition("@")
        repo = "/".join(place.split("/")[: 3 if place.startswith("datasets/") else 2])
        assert f"https://huggingface.co/{repo}" in row.source
        assert re.fullmatch("main|[0-9a-f]{40}", revision)
        assert row.licence, "what is to be accepted"


def test_without_the_package_one_line_says_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(ConfigError, match="pip install huggingface_hub"):
        tactileforge.load("hf:me/touch")


@pytest.mark.slow
def test_a_first_load_imports_no_compiler() -> None:
    """`sympy` and `torch._dynamo` take seconds."""
    code = (
        "import sys, tactileforge; tactileforge.load('anytouch2.tiny'); "
        "sys.exit(' '.join({'sympy', 'torch._dynamo'} & set(sys.modules)) or 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_client_is_whole_in_a_fresh_process() -> None:
    """Its submodules come only with an import of their own."""
    code = "from tactileforge.hub.remote import client; c = client(); "
    code += "print(c.constants.ENDPOINT, c.errors.HfHubHTTPError.__name__, c.HfApi.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.split()[1:] == ["HfHubHTTPError", "HfApi"], done.stderr
