"""Fixtures of several packages: a ``conftest.py`` imports those it offers."""

import gc
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import bytecode  # noqa: F401
import numpy as np
import pytest
import torch
import torch.fx.config
from opened import Opened
from PIL import Image
from spared import compose_once, is_looked_at, register_once, simulate_once, undraw
from waiting import wait_until
from warm import Warm, shared_commands, warm_commands

from tactileforge.cli._verbs import summary
from tactileforge.contracts import Batch, Frame, Frames, SensorSpec
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import TactileForgeError
from tactileforge.plugins import local, metadata
from tactileforge.util import processes

#: What a ``conftest.py`` of the core or of a package imports as it is.
__all__ = [
    "_cache",
    "_collected_seldom",
    "_composed_once",
    "_in_turn_with_others",
    "_names_of_its_own",
    "_no_thread_is_left",
    "_one_process",
    "_scheduling",
    "_seeded",
    "_undrawn",
    "_untraced",
    "batch",
    "encoded",
    "encoder",
    "installed",
    "levels",
    "realdata",
    "scripted",
    "warm",
]


#: The commands of the warm process, once a test has asked for them.
_WARM: list[Warm] = []


@pytest.fixture(autouse=True, scope="session")
def _cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Touches simulated by a test are kept for the other tests, and thrown away after them.

    Processes that test side by side have folders of their own in one folder, and share this one.
    """
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = tmp_path_factory.getbasetemp().parent / "cache"
    else:
        folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTILEFORGE_CACHE", str(folder))
        if "PYTEST_XDIST_WORKER" in os.environ:
            simulate_once(patch)
        yield


@pytest.fixture(autouse=True, scope="session")
def _one_process() -> Iterator[None]:
    """Processes side by side start no others by themselves: all cores are busy."""
    with pytest.MonkeyPatch.context() as patch:
        if "PYTEST_XDIST_WORKER" in os.environ:
            patch.setattr(processes, "cpus", lambda: 1)
        yield


@pytest.fixture(autouse=True)
def _undrawn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if not is_looked_at(str(request.path)):
        undraw(monkeypatch)


@pytest.fixture(autouse=True, scope="session")
def _composed_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        compose_once(patch)
        yield


@pytest.fixture(autouse=True, scope="session")
def _collected_seldom() -> Iterator[None]:
    """Freezes all imports before the first test: they are no garbage."""
    if gc.get_freeze_count():  # each conftest.py has this fixture
        yield
        return
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    yield
    gc.unfreeze()


@pytest.fixture(autouse=True, scope="session")
def _untraced() -> Iterator[None]:
    """Graphs are traced without a line of code per node, in a fifth of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(torch.fx.config, "do_not_emit_stack_traces", True, raising=False)
        register_once(patch)
        yield


@pytest.fixture(autouse=True, scope="session")
def _scheduling() -> tuple[int, int] | None:
    """Policy and priority of this process before its tests; None on systems without them."""
    if not hasattr(os, "sched_setscheduler"):
        return None
    return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority


@pytest.fixture(autouse=True)
def _in_turn_with_others(_scheduling: tuple[int, int] | None) -> Iterator[None]:
    """Undoes the real-time priority of the AV1 encoder, taken as root."""
    yield
    if _scheduling is not None and os.sched_getscheduler(0) != _scheduling[0]:
        os.sched_setscheduler(0, _scheduling[0], os.sched_param(_scheduling[1]))


@pytest.fixture(autouse=True)
def _names_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test registers by ``tactileforge.register`` has no name in the tests after it."""
    monkeypatch.setattr(metadata, "registered", dict(metadata.registered))
    monkeypatch.setattr(local, "_known", dict(local._known))


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)


@pytest.fixture
def levels() -> Callable[[Frames | None], list[int]]:
    """Reads frames and returns the numbers in them."""

    def read(frames: Frames | None) -> list[int]:
        assert frames is not None
        return [round(float(frame.mean()) / 7) for frame in frames.read(range(len(frames)))]

    return read


@pytest.fixture(scope="session")
def realdata() -> Path:
    """The folder of public recordings; tests that ask for it are skipped where it is absent."""
    beside = Path(__file__).parents[2] / ".." / "shared" / "realdata"
    folder = Path(os.environ.get("TACTILEFORGE_REALDATA", beside)).resolve()
    if not folder.is_dir():
        pytest.skip("no real recordings here: set TACTILEFORGE_REALDATA")
    return folder


@pytest.fixture(scope="session")
def warm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Warm]:
    """Commands with a fast start, each in a process of its own."""
    if _WARM:  # each conftest.py has this fixture
        yield _WARM[0]
        return
    if "PYTEST_XDIST_WORKER" in os.environ:
        kept = shared_commands(tmp_path_factory.getbasetemp().parent / "warm")
    else:
        kept = warm_commands(tmp_path_factory.mktemp("warm"))
    with kept as commands:
        _WARM.append(commands)
        yield commands
        _WARM.clear()


@pytest.fixture
def encoder() -> TactileViT:
    return TactileViT("tiny", frames=4, image_size=32)


@pytest.fixture
def batch() -> Batch:
    """Eight clips: four objects, each by two sensors in one group; half have force."""
    rng = torch.Generator().manual_seed(1)
    return {
        "frames": torch.randint(0, 256, (8, 4, 3, 32, 32), dtype=torch.uint8, generator=rng),
        "background": torch.randint(90, 160, (8, 3, 32, 32), dtype=torch.uint8, generator=rng),
        "sensor": ["digit", "gelsight"] * 4,
        "force": torch.randn(8, 4, 3, generator=rng),
        "force_valid": torch.tensor([[True] * 3, [False] * 3] * 4),
        "force_scale": torch.tensor([[5.25, 10.61, 14.14], [6.84, 9.87, 8.52]] * 4),
        "action": torch.tensor([0, 0, 1, 1, 2, 2, -1, -1]),
        "object": torch.tensor([0, 0, 1, 1, 2, 2, 3, 3]),
        "text": ["a ball", "a ball", "", "a bar", "", "a ring", "a cross", "a nut"],
        "image": torch.randint(0, 256, (8, 3, 96, 96), dtype=torch.uint8, generator=rng),
        "image_valid": torch.tensor([True, True, False, True, True, False, True, True]),
        "surface": torch.randint(1, 256, (8, 4, 3, 32, 32), dtype=torch.uint8, generator=rng),
        "surface_valid": torch.tensor([True, False] * 4),
        "group": torch.tensor([0, 0, 1, 1, 2, 2, 3, 3]),
        "aspect": torch.ones(8),
        "upright": torch.zeros(8, dtype=torch.bool),
        "skipped": {},
    }


@pytest.fixture
def encoded() -> Callable[..., bytes]:
    """A PNG with room to spare, of grey level 7 i, or of a colour."""

    def make(i: int, size: tuple[int, int] = (24, 32), colour: Any = None) -> bytes:
        image = np.full((*size, 3), min(7 * i, 255) if colour is None else colour, np.uint8)
        buffer = BytesIO()
        Image.fromarray(image).save(buffer, "PNG")
        return buffer.getvalue() + bytes(300)  # readers of images stop at the end of the PNG

    return make


@pytest.fixture
def installed(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., None]]:
    """Makes a folder look like an installed distribution with entry points."""

    def install(name: str, entry_points: str, modules: dict[str, str]) -> None:
        site = tmp_path_factory.mktemp("site")
        metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
        info = f"{name.replace('-', '_')}-1.0.dist-info"
        files = {f"{info}/METADATA": metadata, f"{info}/entry_points.txt": entry_points, **modules}
        for path, text in files.items():
            (site / path).parent.mkdir(parents=True, exist_ok=True)
            (site / path).write_text(text)
        monkeypatch.syspath_prepend(site)
        clear()

    def clear() -> None:
        metadata.entries.cache_clear()
        summary.cache_clear()  # other tests have other modules of the same name

    yield install
    clear()


class Scripted(Opened):
    """A scripted sensor in real time; its picture shows the number of the frame.

    Args:
        fps: Frames a second.
        limit: Frames until its source is over.
        events: What happens instead of a frame, by its number: an exception, or a function that
            changes the frame.
        type: Name of its spec.
        address: Which device it is.
        moves: Whether its picture changes much from frame to frame.
    """

    def __init__(
        self, fps=50.0, limit=None, events=None, type="digit", address="", moves=False, kind="image"
    ):
        self.shape = (32, 24) if type == "digit" else (24, 32)  # a digit stands upright
        height, width = (0, 0) if kind == "wrench" else self.shape
        self.spec = SensorSpec(
            name=type,
            height=height,
            width=width,
            fps=fps,
            area_mm=None,
            force_scale=(1.0, 1.0, 1.0),
            kind=kind,
        )
        self.limit, self.events, self.address = limit, dict(events or {}), address
        self.moves = moves
        self.count, self.opened = 0, 0
        self.times = []
        self.is_open = False
        self.refuse = deque()

    def discover(self):
        return []

    def open(self):
        if self.refuse:
            raise self.refuse.popleft()
        self.is_open = True
        self.opened += 1
        self.start, self.first = time.monotonic(), self.count

    def read(self, timeout=1.0):
        if not self.is_open:
            raise TactileForgeError("not open")
        number, self.count = self.count, self.count + 1
        if self.limit is not None and number >= self.limit:
            raise EOFError
        due = self.start + (number - self.first) / self.spec.fps
        time.sleep(max(0.0, due - time.monotonic()))
        frame = Frame(array=self.picture(number), time=due, raw=self.raw(number, due))
        event = self.events.pop(number, None)
        if isinstance(event, Exception):
            raise event
        frame = event(frame) if event else frame
        self.times.append(frame.time)
        return frame

    def picture(self, number):
        """Numbers up to 255 as brightness in steps of one, with noise below."""
        if self.spec.kind == "wrench":
            return np.zeros((0, 0, 3), np.uint8)
        rng = np.random.default_rng(number)
        base = number % 200 + 30 if self.moves else 120
        return rng.integers(base, base + 3, (*self.shape, 3)).astype(np.uint8)

    def raw(self, number, due):
        if self.spec.kind == "image":
            return None
        if self.spec.kind == "wrench":
            return np.array([due % 1000.0, 0, 1, 0, 0, 0], np.float32)
        return np.full((4, 1), number, np.float32)

    def close(self):
        self.is_open = False


@pytest.fixture
def scripted():
    return Scripted


@pytest.fixture(autouse=True)
def _no_thread_is_left():
    yield

    def left() -> list[str]:
        names = [thread.name for thread in threading.enumerate()]
        return [name for name in names if name.startswith(("capture", "encode"))]

    if running := left():
        wait_until(lambda: not left(), 5, f"threads are left, of {running}")
