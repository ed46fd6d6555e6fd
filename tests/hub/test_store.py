"""Files of weights are verified on every load, and never lie half written at their place."""

import builtins
import contextlib
import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from waiting import wait_until

import tactileforge
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.hub import cards, store
from tactileforge.util import downloads
from tactileforge.util.files import new_part

AddCard = Callable[..., None]


@pytest.fixture
def server(checkpoint: Path) -> Iterator[SimpleNamespace]:
    """Serves ``data``; after ``pause_at`` bytes it waits until the test is over."""
    state = SimpleNamespace(data=checkpoint.read_bytes(), pause_at=None, hits=0, status=200)
    state.tokens = []
    over = threading.Event()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            state.hits += 1
            state.tokens.append(self.headers.get("Authorization"))
            self.send_response(state.status)
            self.end_headers()
            with contextlib.suppress(ConnectionError):  # who has enough hangs up
                self.wfile.write(state.data[: state.pause_at])
                self.wfile.flush()
            if state.pause_at:
                over.wait(60)

        def log_message(self, *args: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as httpd:
        httpd.daemon_threads = True
        state.url = f"http://127.0.0.1:{httpd.server_port}/thing.safetensors"
        thread = threading.Thread(target=httpd.serve_forever)
        thread.start()
        yield state
        over.set()
        httpd.shutdown()
        thread.join()


def files_in_cache() -> list[str]:
    return sorted(path.name for path in store.weights_folder().glob("*"))


def test_downloads_once_and_works_without_network_afterwards(
    add_card: AddCard, weight: dict[str, Any], server: SimpleNamespace, vit: torch.nn.Module
) -> None:
    add_card("thing", weights=[weight | {"url": server.url}])
    model = tactileforge.load("thing")
    assert torch.equal(model.encoder.class_token, vit.class_token)
    assert files_in_cache() == [f"thing.tiny-{weight['sha256'][:12]}.safetensors"]
    server.status = 500
    tactileforge.load("thing.tiny")
    assert server.hits == 1
    assert model.card is cards.read_card("thing")


def test_shipped_weights_are_verified_too(
    add_card: AddCard, weight: dict[str, Any], checkpoint: Path, tmp_path: Path
) -> None:
    shipped = tmp_path / "zoo" / "weights" / "thing.tiny.safetensors"
    shipped.parent.mkdir()
    checkpoint.rename(shipped)
    add_card("thing", weights=[weight | {"file": "weights/thing.tiny.safetensors"}])
    assert tactileforge.list_models(weights=True) == ["thing.tiny"]
    assert tactileforge.load("thing").header.name == "thing.tiny"
    data = bytearray(shipped.read_bytes())
    data[-1] ^= 1
    shipped.write_bytes(data)
    with pytest.raises(DataError, match=r"its sha256 is .*install tactileforge again"):
        tactileforge.load("thing")
    shipped.unlink()
    with pytest.raises(DataNotFoundError, match="install tactileforge again"):
        tactileforge.load("thing")


@pytest.mark.parametrize("where", ["served", "cached"])
def test_one_wrong_bit_is_an_error(
    where: str, add_card: AddCard, weight: dict[str, Any], server: SimpleNamespace
) -> None:
    add_card("thing", weights=[weight | {"url": server.url}])
    if where == "cached":
        tactileforge.load("thing")
        [path] = store.weights_folder().glob("*")
        data = bytearray(path.read_bytes())
    else:
        data = bytearray(server.data)
    data[len(data) // 2] ^= 1
    if where == "cached":
        path.write_bytes(data)
        with pytest.raises(DataError, match="remove it, and load the model again"):
            tactileforge.load("thing")
        path.unlink()
    else:
        good, server.data = server.data, bytes(data)
        with pytest.raises(DataError, match=f"expected {weight['sha256']}.*nothing was kept"):
            tactileforge.load("thing")
        assert files_in_cache() == []
        server.data = good
    tactileforge.load("thing")


def test_files_of_another_length(
    add_card: AddCard,
    weight: dict[str, Any],
    server: SimpleNamespace,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(downloads, "_sleep", lambda seconds: None)
    add_card("thing", weights=[weight | {"url": server.url}])
    good = server.data
    server.data = good[:-7]
    with pytest.raises(DataError, match=f"{len(good) - 7} bytes, expected {len(good)}"):
        tactileforge.load("thing")
    server.data = good * 3  # no more is taken than tells that it is another file
    with pytest.raises(DataError, match=f"{len(good) + 1} bytes, expected {len(good)}"):
        tactileforge.load("thing")
    assert files_in_cache() == []


def test_a_server_that_stalls_is_left(
    add_card: AddCard,
    weight: dict[str, Any],
    server: SimpleNamespace,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(downloads, "SILENCE", 0.1)
    add_card("thing", weights=[weight | {"url": server.url}])
    server.pause_at = 1000
    with pytest.raises(DataNotFoundError, match=r"cannot be fetched \(it sends less than 65536"):
        tactileforge.load("thing")
    assert files_in_cache() == []


def test_offline_says_what_to_fetch_and_where_to_put_it(
    add_card: AddCard, weight: dict[str, Any], checkpoint: Path, server: SimpleNamespace
) -> None:
    add_card("thing", weights=[weight | {"url": server.url, "gated": True}])
    server.status = 403
    target = store.weights_folder() / f"thing.tiny-{weight['sha256'][:12]}.safetensors"
    with pytest.raises(DataNotFoundError, match="terms to be accepted") as caught:
        tactileforge.load("thing")
    assert server.url in str(caught.value)
    assert str(target) in str(caught.value)
    checkpoint.rename(target)  # what the error says
    assert tactileforge.load("thing").header.name == "thing.tiny"


def test_addresses(
    add_card: AddCard,
    weight: dict[str, Any],
    checkpoint: Path,
    server: SimpleNamespace,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    add_card("local", weights=[weight | {"url": checkpoint.as_uri()}])
    assert tactileforge.load("local").header.name == "thing.tiny"
    add_card("old", weights=[weight | {"url": "ftp://example.org/a"}])
    with pytest.raises(ConfigError, match="use https://"):
        tactileforge.load("old")
    add_card("loose", weights=[weight | {"url": "hf://owner/repo/file"}])
    with pytest.raises(ConfigError, match="hf://OWNER/REPO/FILE@REVISION"):
        tactileforge.load("loose")
    asked = []

    def address(repo: str, file: str, *, revision: str) -> str:
        asked.append((repo, file, revision))
        return server.url

    client = SimpleNamespace(hf_hub_url=address, get_token=lambda: "secret")
    monkeypatch.setitem(sys.modules, "huggingface_hub", client)
    add_card("hub", weights=[weight | {"url": "hf://owner/repo/sub/file.safetensors@abc123"}])
    assert tactileforge.load("hub").header.name == "thing.tiny"
    assert asked == [("owner/repo", "sub/file.safetensors", "abc123")]
    assert server.tokens == ["Bearer secret"]
    assert all(name.endswith(".safetensors") for name in files_in_cache())


def test_the_hub_client_is_an_extra(
    add_card: AddCard, weight: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def absent(name: str, *args: Any) -> Any:
        if name == "huggingface_hub":
            raise ImportError(name)
        return real(name, *args)

    monkeypatch.setattr(builtins, "__import__", absent)
    add_card("hub", weights=[weight | {"url": "hf://owner/repo/file@main"}])
    with pytest.raises(ConfigError, match="pip install huggingface_hub"):
        tactileforge.load("hub")


def test_a_kill_during_a_download_leaves_nothing_broken(
    add_card: AddCard,
    weight: dict[str, Any],
    server: SimpleNamespace,
    tmp_path: Path,
) -> None:
    add_card("thing", weights=[weight | {"url": server.url}])
    server.pause_at = len(server.data) // 2
    code = (
        "import sys, pathlib; from tactileforge.hub import cards\n"
        "folder = pathlib.Path(sys.argv[1]); cards.zoo_folder = lambda: folder\n"
        "import tactileforge; tactileforge.load('thing')\n"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "zoo")]) as process:

        def is_half_there() -> bool:
            assert process.poll() is None
            return any(path.stat().st_size for path in store.weights_folder().glob(".*.part"))

        wait_until(is_half_there, 60)
        process.send_signal(signal.SIGKILL)
    parts = list(store.weights_folder().glob(".*.part"))
    assert [path for path in store.weights_folder().iterdir() if path not in parts] == []
    assert 0 < parts[0].stat().st_size < len(server.data)
    server.pause_at = None
    assert tactileforge.load("thing").header.name == "thing.tiny"


def test_two_processes_do_not_share_a_part(tmp_path: Path) -> None:
    target = tmp_path / "a.safetensors"
    with new_part(target) as one, new_part(target) as other:
        assert one != other
        one.write_text("one")
        other.write_text("other")
        one.replace(target)
        other.replace(target)
    assert target.read_text() == "other"


def test_a_damaged_record_of_an_import(add_card: AddCard) -> None:
    row = {"tag": "base", "licence": "MIT", "layout": "thing", "source": "https://example.org"}
    add_card("thing", weights=[row])
    with pytest.raises(
        DataNotFoundError, match=r"example.org, then: tactileforge zoo get thing.base"
    ):
        tactileforge.load("thing")
    record = store.weights_folder() / "thing.base.json"
    record.parent.mkdir(parents=True)
    good = {"file": "a", "sha256": "", "bytes": 1, "source": "", "source_sha256": ""}
    for text, message in (
        ("{", "damaged"),
        (json.dumps(good | {"bytes": "1"}), "bytes is '1'"),
        (json.dumps(good | {"file": "../../a"}), "damaged"),
        (json.dumps(good), "a is missing; import it again"),
    ):
        record.write_text(text)
        with pytest.raises(DataError, match=message):
            tactileforge.load("thing")
