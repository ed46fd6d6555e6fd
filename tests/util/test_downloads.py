"""Reading from a URL, within limits."""

import importlib
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from email.message import Message
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from waiting import wait_until

from tactileforge.data.shards.fetch import ShardFolder
from tactileforge.errors import DataError
from tactileforge.util import downloads

Answer = Callable[[BaseHTTPRequestHandler], None]


def fetched(url: str, limit: int, **options: Any) -> bytes:
    out = BytesIO()
    downloads.copy(url, limit, out, **options)
    return out.getvalue()


@pytest.fixture
def serve() -> Iterator[Callable[[Answer], str]]:
    """Starts a server with given answers."""
    servers = []

    def start(answer: Answer) -> str:
        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                answer(self)

            def log_message(self, *args: object) -> None:
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
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
    assert len(fetched(url, 1000)) == 1000
    assert len(fetched(url, 2000)) == 1000
    with pytest.raises(downloads.TooMuch, match="more than the 999 bytes"):
        fetched(url, 999)


def test_silence_ends_in_an_error(
    serve: Callable[[Answer], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(downloads, "SILENCE", 0.3)
    release = threading.Event()

    def stall(request: BaseHTTPRequestHandler) -> None:
        request.send_response(200)
        request.send_header("Content-Length", "100")
        request.end_headers()
        request.wfile.write(b"a few")
        release.wait(60)

    folder = ShardFolder(serve(stall), tmp_path)
    with pytest.raises(DataError, match=r"cannot be fetched \(.*(timed out|sends less than)"):
        folder.get("train-000000.tar", 100, "0" * 64)
    release.set()


def test_retries_are_said(
    serve: Callable[[Answer], str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(downloads, "_PAUSE", 0.01)
    asked = []

    def late(request: BaseHTTPRequestHandler) -> None:
        asked.append(request.path)
        request.send_response(503 if len(asked) < 3 else 200)
        request.end_headers()
        request.wfile.write(b"here" if len(asked) >= 3 else b"")

    assert fetched(serve(late), 10) == b"here"
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
        fetched(serve(absent), 10)
    assert len(asked) == 1


def cut_off(times: int, body: bytes, asked: list[str]) -> Answer:
    """An answer with an early end, so many times."""

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
    monkeypatch.setattr(downloads, "_PAUSE", 0.01)
    body, asked = bytes(range(256)) * 1199 + bytes(255) + b"}", list[str]()
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
    monkeypatch.setattr(downloads, "_PAUSE", 0.01)
    asked: list[str] = []
    folder = ShardFolder(serve(cut_off(99, bytes(900), asked)), tmp_path)
    with pytest.raises(DataError, match=r"ended after 300 of 900 bytes, attempt 4"):
        folder.get("train-000000.tar", 900, "0" * 64)
    assert len(asked) == 4
    assert not list(tmp_path.rglob("*.part"))


def answered(
    request: BaseHTTPRequestHandler, body: bytes = b"", code: int = 200, **more: str
) -> None:
    """Sends an answer; names of headers have _ for -."""
    request.send_response_only(code)
    for name, value in more.items():
        request.send_header(name.replace("_", "-"), value)
    request.end_headers()
    request.wfile.write(body)


@pytest.fixture
def slept(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Requested pauses; none is made."""
    pauses: list[float] = []
    monkeypatch.setattr(downloads, "_sleep", pauses.append)
    return pauses


DRIPS: dict[str, tuple[bytes, bytes]] = {
    "its body": (b"HTTP/1.1 200 OK\r\nContent-Length: 90000\r\n\r\n", b"x"),
    "a body without a length": (b"HTTP/1.0 200 OK\r\n\r\n", b"x"),
    "chunks": (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", b"1\r\nx\r\n"),
    "the length of a chunk": (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", b"0"),
    "a header": (b"HTTP/1.1 200 OK\r\nX: ", b"x"),
    "headers": (b"HTTP/1.1 200 OK\r\n", b"X: x\r\n"),
    "a redirect": (b"HTTP/1.1 302 Found\r\nLocation: /b\r\nX: ", b"x"),
}


@pytest.mark.parametrize("what", DRIPS)
def test_a_server_that_drips_is_left(
    what: str, serve: Callable[[Answer], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However steadily; its connection is shut, and the thread that read it ends."""
    monkeypatch.setattr(downloads, "SILENCE", 0.1)
    start, drop = DRIPS[what]
    over = threading.Event()

    def drip(request: BaseHTTPRequestHandler) -> None:
        request.wfile.write(start)
        try:
            while True:
                request.wfile.write(drop)
                over.wait(0.005)
        except OSError:
            over.set()

    before = set(threading.enumerate())
    folder = ShardFolder(serve(drip), tmp_path)
    with pytest.raises(DataError, match=r"fetched \(it (sends less than 65536|does not answer)"):
        folder.get("train-000000.tar", 90_000, "0" * 64)
    assert over.wait(30)  # the server sees that nobody listens
    wait_until(lambda: not any("_read" in t.name for t in set(threading.enumerate()) - before))
    assert not list(tmp_path.rglob("*.part"))


def test_a_program_that_drips_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    """For webdataset, a program writing to a pipe."""
    monkeypatch.setattr(downloads, "SILENCE", 0.1)
    started = []

    class Pipe:
        def __init__(self) -> None:
            self.proc = subprocess.Popen(["sleep", "99"], stdout=subprocess.PIPE)
            started.append(self.proc)

        def read(self, size: int) -> bytes:
            assert self.proc.stdout is not None
            return self.proc.stdout.read(size)

        def close(self) -> None:
            assert self.proc.stdout is not None
            self.proc.stdout.close()
            self.proc.wait()

    opener = importlib.import_module("webdataset.gopen")
    monkeypatch.setattr(opener, "gopen", lambda url: Pipe())
    with pytest.raises(TimeoutError, match="sends less than"):
        fetched("gs://a/b", 100)
    [process] = started
    wait_until(lambda: process.poll() is not None)


def test_waiting_counts_and_writing_does_not() -> None:
    pace = downloads._Pace(1000.0)
    pace.sends()
    for _ in range(10):  # 2.2 kB/s is enough
        pace.took(29.0, 1 << 16)
        assert pace.waits() == 30.0
    pace.took(29.0, (1 << 16) - 1)
    assert pace.waits() == 1.0
    assert "sends less than 65536 bytes in 30 s" in str(pace.error())
    pace.took(0.0, 1)
    assert pace.waits() == 30.0
    for _ in range(22):
        pace.took(30.0, 1 << 16)
    assert pace.waits() == pytest.approx(1000 - 10 * 29 - 29 - 22 * 30)
    assert "longer than its size allows" in str(pace.error())
    both = downloads._Pace(downloads.SILENCE)
    both.sends()
    both.took(downloads.SILENCE, 0)
    assert "longer than its size allows" in str(both.error()), "at one time, that of all counts"


def test_time_in_all_is_bounded(serve: Callable[[Answer], str]) -> None:
    def endless(request: BaseHTTPRequestHandler) -> None:
        request.wfile.write(b"HTTP/1.0 200 OK\r\n\r\n")
        try:
            while True:
                request.wfile.write(bytes(1 << 12))
        except OSError:
            pass

    with pytest.raises(TimeoutError, match="takes longer than its size allows"):
        fetched(serve(endless), 1 << 40, seconds=0.2)


def retry_after(text: str, now: str = "") -> float | None:
    headers = Message()
    headers["Retry-After"] = text
    if now:
        headers["Date"] = now
    return downloads.retry_after(headers)


def test_what_a_server_asks_for() -> None:
    noon = "Thu, 01 Jan 2026 12:00:00 GMT"
    assert retry_after("17") == 17
    assert retry_after("Thu, 01 Jan 2026 12:01:30 GMT", noon) == 90
    assert retry_after("Thu, 01 Jan 2026 11:00:00 GMT", noon) == 0
    assert retry_after("Thursday, 01-Jan-26 12:00:05 GMT", noon) == 5
    assert retry_after("Thu, 01 Jan 2026 12:00:00 GMT") == 0  # long ago
    for odd in ("", "-3", "1.5", "soon", "nan", "1e9", "\u0663", "9" * 400, "Thu, 99 Foo 2026"):
        assert retry_after(odd, noon) is None, odd


@pytest.mark.parametrize("code", [429, 503, 500, 408])
@pytest.mark.parametrize(
    ("asked", "pause"),
    [("7", 7.0), ("Thu, 01 Jan 2026 12:00:07 GMT", 7.0), ("9999999999", 60.0), ("0", 0.5)],
)
def test_a_busy_server_is_asked_again_when_it_says(
    code: int,
    asked: str,
    pause: float,
    serve: Callable[[Answer], str],
    slept: list[float],
    capsys: pytest.CaptureFixture[str],
) -> None:
    hits = []

    def busy(request: BaseHTTPRequestHandler) -> None:
        hits.append(1)
        if len(hits) < 3:
            now = "Thu, 01 Jan 2026 12:00:00 GMT"
            answered(request, b"busy", code, Retry_After=asked, Date=now)
        else:
            answered(request, b"here")

    assert fetched(serve(busy), 10) == b"here"
    assert slept == [pause, max(pause, 1.0)]
    assert f"HTTP Error {code}" in capsys.readouterr().err


def test_a_pause_beyond_the_time_in_all_is_not_waited_for(
    serve: Callable[[Answer], str], slept: list[float]
) -> None:
    url = serve(lambda request: answered(request, code=429, Retry_After="50"))
    with pytest.raises(OSError, match=r"429.*no time for another"):
        fetched(url, 10, seconds=40.0)
    assert slept == []


def test_a_short_body_without_a_length_is_asked_for_again(
    serve: Callable[[Answer], str], tmp_path: Path, slept: list[float]
) -> None:
    body, hits = b"{" + bytes(5000) + b"}", []

    def cut(request: BaseHTTPRequestHandler) -> None:
        hits.append(1)
        answered(request, body if len(hits) % 2 == 0 else body[:-9])

    folder = ShardFolder(serve(cut), tmp_path)
    assert folder.get("a.tar", len(body), sha256(body).hexdigest()).read_bytes() == body
    assert folder.text("index.json") == body
    assert len(hits) == 4
    assert slept == [0.5, 0.5]


def test_what_is_always_short_is_judged_by_its_checksum(
    serve: Callable[[Answer], str], tmp_path: Path, slept: list[float]
) -> None:
    folder = ShardFolder(serve(lambda request: answered(request, b"short")), tmp_path)
    with pytest.raises(DataError, match=r"5 bytes with SHA-256 .* but the index says 9"):
        folder.get("a.tar", 9, "0" * 64)
    assert len(slept) == 3


@pytest.mark.parametrize("stated", ["-5", "a", "1e3", "9" * 5000])
def test_a_length_that_is_none_is_no_traceback(
    stated: str, serve: Callable[[Answer], str], slept: list[float]
) -> None:
    url = serve(lambda request: answered(request, b"body", Content_Length=stated))
    assert fetched(url, 10) == b"body"


def sends_to(place: str) -> Answer:
    return lambda request: answered(request, bytes(99), 302, Location=place)


def test_redirects_are_followed_within_limits(
    serve: Callable[[Answer], str], slept: list[float]
) -> None:
    hits: list[str] = []

    def hop(request: BaseHTTPRequestHandler) -> None:
        hits.append(request.path)
        number = int(request.path[1:])
        if number:
            sends_to(f"/{number - 1}")(request)
        else:
            answered(request, b"there")

    url = serve(hop)
    assert fetched(f"{url}/5", 10) == b"there"
    hits.clear()
    with pytest.raises(OSError, match="another place more than 5 times"):
        fetched(f"{url}/6", 10)
    assert len(hits) == 6
    for place in ("file:///etc/passwd", "ftp://a/b", "gopher://a"):
        with pytest.raises(OSError, match="only https is followed"):
            fetched(serve(sends_to(place)), 10)
    assert slept == []


def test_the_body_of_a_redirect_is_not_read(serve: Callable[[Answer], str]) -> None:
    """urllib reads it to its end, and it need not come."""
    sent = [0]

    def flood(request: BaseHTTPRequestHandler) -> None:
        if request.path == "/b":
            answered(request, b"there")
            return
        request.wfile.write(b"HTTP/1.0 302 Found\r\nLocation: /b\r\n\r\n")
        try:
            while sent[0] < 300_000_000:
                sent[0] += request.wfile.write(bytes(1 << 16))
        except OSError:
            pass

    assert fetched(serve(flood), 10) == b"there"
    assert sent[0] < 100_000_000


def test_other_servers_get_no_token(serve: Callable[[Answer], str]) -> None:
    got = {}

    def note(name: str, then: Answer) -> Answer:
        def answer(request: BaseHTTPRequestHandler) -> None:
            got[name] = request.headers.get("Authorization")
            then(request)

        return answer

    other = serve(note("other", lambda request: answered(request, b"x")))
    url = serve(note("own", sends_to(f"{other}/a")))
    assert fetched(url, 9, headers={"Authorization": "Bearer s"}) == b"x"
    assert got == {"own": "Bearer s", "other": None}


def test_bytes_that_are_written_are_told_and_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a b.bin"
    path.write_bytes(bytes(200_000))
    told: list[int] = []
    assert fetched(path.as_uri(), 300_000, moved=told.append) == bytes(200_000)
    assert told[-1] == 200_000
    assert told == sorted(told)
    with pytest.raises(OSError, match=r"No such file.*attempt 1"):
        fetched((tmp_path / "none").as_uri(), 10)


def test_an_address_that_is_none_is_named(slept: list[float]) -> None:
    for url in ("http://", "http://127.0.0.1:x/", "http://[::1/", "http://127.0.0.1:1/a b"):
        with pytest.raises(OSError, match=r"attempt 1$"):
            fetched(url, 10)
    assert slept == []
