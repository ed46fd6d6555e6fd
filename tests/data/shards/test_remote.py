"""Reading from a URL, within limits."""

import threading
import time
from collections.abc import Callable, Iterator
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from tactileforge.data.shards import remote
from tactileforge.data.shards.fetch import ShardFolder
from tactileforge.errors import DataError

Answer = Callable[[BaseHTTPRequestHandler], None]


@pytest.fixture
def serve() -> Iterator[Callable[[Answer], str]]:
    """Starts a server that answers as it is told."""
    servers = []

    def start(answer: Answer) -> str:
        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                answer(self)

            def log_message(self, *args: object) -> None:
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


def test_what_sends_more_than_was_stated_is_stopped(
    serve: Callable[[Answer], str], tmp_path: Path
) -> None:
    sent = [0]

    def flood(request: BaseHTTPRequestHandler) -> None:
        request.send_response(200)
        request.end_headers()
        try:
            while sent[0] < 600_000_000:
                sent[0] += request.wfile.write(bytes(1 << 16))
        except OSError:
            pass

    folder = ShardFolder(serve(flood), tmp_path)
    with pytest.raises(DataError, match="it sends more than the 307000 bytes that are stated"):
        folder.get("train-000000.tar", 307_000, "0" * 64)
    assert not list(tmp_path.rglob("*.part"))
    time.sleep(0.2)
    assert sent[0] < 60_000_000  # what the system holds for a socket


def test_not_one_byte_more_is_taken(serve: Callable[[Answer], str]) -> None:
    def answer(request: BaseHTTPRequestHandler) -> None:
        request.send_response(200)
        request.end_headers()
        request.wfile.write(bytes(1000))

    url = serve(answer)
    assert sum(map(len, remote.chunks(url, 1000))) == 1000
    assert sum(map(len, remote.chunks(url, 2000))) == 1000
    with pytest.raises(OSError, match="more than the 999 bytes"):
        list(remote.chunks(url, 999))


def test_silence_ends_in_an_error(
    serve: Callable[[Answer], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "_SILENCE", 0.3)
    release = threading.Event()

    def stall(request: BaseHTTPRequestHandler) -> None:
        request.send_response(200)
        request.send_header("Content-Length", "100")
        request.end_headers()
        request.wfile.write(b"a few")
        release.wait(20)

    folder = ShardFolder(serve(stall), tmp_path)
    with pytest.raises(DataError, match=r"cannot be fetched \(.*(timed out|sends less than)"):
        folder.get("train-000000.tar", 100, "0" * 64)
    release.set()


def test_retries_are_said(
    serve: Callable[[Answer], str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(remote, "_PAUSE", 0.01)
    asked = []

    def late(request: BaseHTTPRequestHandler) -> None:
        asked.append(request.path)
        request.send_response(503 if len(asked) < 3 else 200)
        request.end_headers()
        request.wfile.write(b"here" if len(asked) >= 3 else b"")

    assert b"".join(remote.chunks(serve(late), 10)) == b"here"
    said = capsys.readouterr().err
    assert "Service Unavailable; attempt 2 of 4" in said
    assert "attempt 3 of 4" in said
    assert len(asked) == 3


def test_what_is_not_there_is_not_asked_for_again(serve: Callable[[Answer], str]) -> None:
    asked = []

    def absent(request: BaseHTTPRequestHandler) -> None:
        asked.append(request.path)
        request.send_error(404)

    with pytest.raises(OSError, match="404"):
        list(remote.chunks(serve(absent), 10))
    assert len(asked) == 1


def cut_off(times: int, body: bytes, asked: list[str]) -> Answer:
    """An answer that ends early, so many times."""

    def answer(request: BaseHTTPRequestHandler) -> None:
        asked.append(request.path)
        request.send_response(200)
        request.send_header("Content-Length", str(len(body)))
        request.end_headers()
        request.wfile.write(body[: len(body) // 3] if len(asked) <= times else body)

    return answer


@pytest.mark.parametrize("times", [1, 3])
def test_a_connection_that_drops_is_opened_again(
    times: int,
    serve: Callable[[Answer], str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(remote, "_PAUSE", 0.01)
    body, asked = bytes(range(256)) * 1200, list[str]()
    folder = ShardFolder(serve(cut_off(times, body, asked)), tmp_path)
    path = folder.get("train-000000.tar", len(body), sha256(body).hexdigest())
    assert path.read_bytes() == body
    assert len(asked) == times + 1
    said = capsys.readouterr().err
    assert f"ended after 102400 of 307200 bytes; attempt {times + 1} of 4" in said
    asked.clear()
    assert folder.text("index.json") == body


def test_a_connection_that_always_drops_is_an_error(
    serve: Callable[[Answer], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "_PAUSE", 0.01)
    asked: list[str] = []
    folder = ShardFolder(serve(cut_off(99, bytes(900), asked)), tmp_path)
    with pytest.raises(DataError, match=r"ended after 300 of 900 bytes, attempt 4"):
        folder.get("train-000000.tar", 900, "0" * 64)
    assert len(asked) == 4
    assert not list(tmp_path.rglob("*.part"))
