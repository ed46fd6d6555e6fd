"""A ``tactileforge`` for tests that starts at once: commands are forked from a process that has
imported what they import, which takes seconds of each of them otherwise.

It is a process of its own (``python warm.py SOCKET``), which tests nothing and starts no threads.
"""

import gc
import json
import os
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

from waiting import wait_until

_MODULES = ("cli._hydra", "train", "trainer", "report.run", "datasets.sim", "bench.run", "sim.play")
#: The command that tests call: it hands over its words, folder, variables and streams.
_CLIENT = """\
#!{python} -SE
import json, os, socket, sys
with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as server:
    server.connect({address!r})
    words = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
    socket.send_fds(server, [words], [0, 1, 2])
    status = server.recv(16)
sys.exit(int(status or 1))
"""


@contextmanager
def warm_commands(folder: Path) -> Iterator[Path]:
    """A folder for PATH with a ``tactileforge`` that starts at once, for as long as this lasts."""
    address = folder / "socket"
    command = folder / "bin" / "tactileforge"
    command.parent.mkdir()
    command.write_text(_CLIENT.format(python=sys.executable, address=str(address)))
    command.chmod(0o755)
    server = subprocess.Popen([sys.executable, __file__, str(address)])
    try:
        wait_until(address.exists, 120, shlex.join(map(str, server.args)))
        yield command.parent
    finally:
        server.terminate()
        server.wait()


def serve(address: str) -> list[str]:
    """Answers commands for ever; returns in a new process for each, with its words."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(address)
    listener.listen()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those that wait
    gc.freeze()
    while True:
        asked, _ = listener.accept()
        if os.fork():
            asked.close()
            continue
        listener.close()
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        request, streams, _, _ = socket.recv_fds(asked, 1 << 20, 3)
        if (child := os.fork()) == 0:
            asked.close()
            words, folder, variables = json.loads(request)
            for number, stream in enumerate(streams):
                os.dup2(stream, number)
                os.close(stream)
            os.chdir(folder)
            os.environ.clear()
            os.environ.update(variables)
            return words
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        asked.send(str(status if status >= 0 else 128 - status).encode())
        os._exit(0)


if __name__ == "__main__":
    for module in _MODULES:
        import_module(f"tactileforge.{module}")
    from tactileforge.cli import main

    # as the installed command is called, which Lightning repeats for its other processes
    sys.argv = [str(Path(sys.executable).with_name("tactileforge")), *serve(sys.argv[1])]
    main()
