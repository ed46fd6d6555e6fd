"""A ``tactileforge`` with a fast start, for tests: commands are forked from a warm process.

It has imported their modules already, which takes 10 s of CPU time (a server, torch 2.13)
and would be taken again by each plain ``python -m tactileforge``. It is a process of its own
(``python warm.py SOCKET PID``), without tests and threads.
"""

import atexit
import gc
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import pytest
from filelock import FileLock
from spared import compose_once, simulate_once, undraw
from waiting import wait_until

_MODULES = (
    *("tactileforge.cli._hydra", "tactileforge.api", "tactileforge.training.trainer"),
    *("tactileforge.report.run", "tactileforge_sim.dataset", "tactileforge_bench.run"),
    *("tactileforge_sim.play", "kornia.augmentation"),
    *("torch.distributed.fsdp", "torch.distributed.checkpoint"),
)
#: Commands whose YAML is read, and what they have in common composed, before they are asked for.
_COMPOSED = (["optim.lr=0.1"], ["debug=steps"], ["recipe=anytouch2"], ["recipe=mae", "debug=steps"])
_COMPOSED += (["debug=steps", "objective=[pixel]"], ["debug=steps", "objective=[pixel,force]"])
#: Read when torch is imported, so a command cannot change it; and by the processes that it starts.
_ONE_THREAD = {"OMP_NUM_THREADS": "1"}
#: The commands in `Warm.bin`. `SCRIPT` runs a file, as ``python FILE`` does.
_PROGRAMS = ("tactileforge", "pytest", SCRIPT := "warm-python")
#: Plugins of pytest that are imported by the warm process are not rewritten.
_REWRITTEN = "pytest.PytestAssertRewriteWarning"
#: A command that tests call: it hands over its name and words, folder, variables and streams.
_CLIENT = """\
#!{python} -SE
import json, os, socket, sys
with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as server:
    server.connect({address!r})
    words = [os.path.basename(sys.argv[0]), *sys.argv[1:]]
    words = json.dumps([words, os.getcwd(), dict(os.environ), False]).encode()
    socket.send_fds(server, [words], [0, 1, 2])
    server.recv(16)
    status = int(server.recv(16) or 1)
sys.exit(status if status >= 0 else 128 - status)
"""


class Started:
    """A running command, in a session of its own; as `subprocess.Popen`."""

    def __init__(self, server: socket.socket) -> None:
        self._server, self._status = server, None
        self.pid = int(server.recv(16))

    def wait(self, timeout: float | None = None) -> int:
        """Its exit status, or minus the signal of its end; TimeoutError after so long."""
        if self._status is None:
            self._server.settimeout(timeout)
            self._status = int(self._server.recv(16))
            self._server.close()
        return self._status

    def poll(self) -> int | None:
        """Its exit status, if it has ended."""
        try:
            return self.wait(0)
        except BlockingIOError:
            return None


class Warm:
    """Commands with a fast start, with one thread each.

    Args:
        folder: For the socket, and for a folder for PATH, ``bin``: ``tactileforge``, ``pytest``
            and ``warm-python FILE``, which take PYTHONPATH into account.
    """

    def __init__(self, folder: Path) -> None:
        self.bin = folder / "bin"
        self.address = str(folder / "socket")
        if self.bin.exists():
            return
        self.bin.mkdir(parents=True)
        for name in _PROGRAMS:
            command = self.bin / name
            command.write_text(_CLIENT.format(python=sys.executable, address=self.address))
            command.chmod(0o755)

    def start(self, *words: str) -> Started:
        """Starts ``tactileforge WORDS`` here."""
        server = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        server.connect(self.address)
        named = ["tactileforge", *words]
        request = json.dumps([named, os.getcwd(), os.environ | _ONE_THREAD, True]).encode()
        socket.send_fds(server, [request], [0, 1, 2])
        return Started(server)


def _server(warm: Warm, keeper: int) -> "subprocess.Popen[bytes]":
    """Starts a process for commands; it ends after another process."""
    command = [sys.executable, __file__, warm.address, str(keeper)]
    server = subprocess.Popen(command, env=os.environ | _ONE_THREAD)
    wait_until(Path(warm.address).exists, 600, "the process for commands does not start")
    return server


@contextmanager
def warm_commands(folder: Path) -> Iterator[Warm]:
    """Keeps the parent process of forked commands."""
    warm = Warm(folder)
    server = _server(warm, os.getpid())
    try:
        yield warm
    finally:
        server.terminate()
        server.wait()


@contextmanager
def shared_commands(folder: Path) -> Iterator[Warm]:
    """Commands of one process for all workers of pytest.

    The first that needs it starts it, and it ends after the process that has started them.
    """
    with FileLock(folder.with_suffix(".lock")):
        warm = Warm(folder)
        if not Path(warm.address).exists():
            server = _server(warm, os.getppid())
            server.returncode = 0  # nobody here waits for it
    yield warm


def _reap(*_: object) -> None:
    """Waits for ended processes, so as to count their CPU time as this one's."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def serve(address: str, keeper: int) -> list[str]:
    """Answers while a process lives; returns in a new process for each, with name and words."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(f"{address}.new")
    listener.listen()
    os.rename(f"{address}.new", address)  # a socket that is bound is there before it listens
    listener.settimeout(1.0)
    signal.signal(signal.SIGCHLD, _reap)
    gc.freeze()
    while _lives(keeper):
        try:
            asked, _ = listener.accept()
        except TimeoutError:
            continue
        if os.fork():
            asked.close()
            continue
        listener.close()
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        request, streams, _, _ = socket.recv_fds(asked, 1 << 20, 3)
        words, folder, variables, alone = json.loads(request)
        if (child := os.fork()) == 0:
            asked.close()
            if alone:
                os.setsid()
            for number, stream in enumerate(streams):
                os.dup2(stream, number)
                os.close(stream)
            os.chdir(folder)
            os.environ.clear()
            os.environ.update(variables)
            return words
        asked.send(str(child).encode())
        if asked in select.select([asked, os.pidfd_open(child)], [], [])[0]:
            os.kill(child, signal.SIGKILL)  # whoever asked is gone, and it goes, too
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        with suppress(OSError):
            asked.send(str(status).encode())
        os._exit(0)
    sys.exit()


def _forget_packages() -> None:
    """Forgets the installed packages."""
    for name, module in [*sys.modules.items()]:
        if name.startswith("tactileforge"):
            for value in [*vars(module).values()]:
                getattr(value, "cache_clear", int)()


def _ended(run: Callable[[], object]) -> None:
    """Runs, and ends the process at once instead of in order.

    Python would take apart all that the warm process has imported: half a second.
    """
    try:
        run()
    except SystemExit as ending:
        if isinstance(ending.code, int | None):
            threading._shutdown()
            atexit._run_exitfuncs()
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(ending.code or 0)
        raise


def _prepare() -> None:
    """Imports and reads the common parts of all commands.

    Modules, metadata of packages, the grammar of Hydra, and the code of the simulator.
    """
    core = import_module("tactileforge").__path__
    whole = [found.name for found in walk_packages(core, "tactileforge.")]
    for module in (*_MODULES, *(name for name in whole if "example" not in name.lower())):
        if not module.endswith("__main__"):
            import_module(module)
    composed = import_module("tactileforge.cli._compose").composed
    for words in _COMPOSED:
        composed("train", ["scale=demo", *words])
    import_module("tactileforge.plugins.registry").list_plugins()
    import_module("tactileforge_sim.config")._code()


if __name__ == "__main__":
    for spared in (undraw, compose_once, simulate_once):  # tests of pages draw in their own process
        spared(pytest.MonkeyPatch())
    _prepare()
    if "PYTEST_XDIST_WORKER" in os.environ:
        import_module("tactileforge.util.processes").cpus = lambda: 1  # the others are busy
    program, *words = serve(sys.argv[1], int(sys.argv[2]))
    places = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    if places := [place for place in places if place and place not in sys.path]:
        sys.path[:0] = places
        _forget_packages()
    if program == SCRIPT:
        sys.argv = words
        sys.path.insert(0, str(Path(words[0]).resolve().parent))
        _ended(partial(runpy.run_path, words[0], run_name="__main__"))
    else:
        if program == "pytest":
            words = ["-W", f"ignore:Module already imported:{_REWRITTEN}", *words]
        # what Lightning sets from the variables when it is imported
        import_module("lightning.fabric.utilities.rank_zero").rank_zero_only.rank = int(
            os.environ.get("LOCAL_RANK", "0")
        )
        # the command in `Warm.bin`, which Lightning repeats for its other processes
        sys.argv = [str(Path(sys.argv[1]).with_name("bin") / program), *words]
        _ended(partial(runpy.run_module, program, run_name="__main__"))
