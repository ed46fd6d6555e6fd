"""The command line: a verb, and ``key=value`` for everything else. A verb is a file of this folder.

The first line of such a file is its line of ``tactileforge --help``; its ``COMMANDS`` are the
commands of the verb, by action (``pack`` of ``data pack``; "" for a verb without actions).
Installed packages add further verbs. Files with a leading ``_`` are shared by verbs: `_verbs` finds
verbs, `_command` defines a command, `_compose` composes configurations, `_finish` completes those
of training, `_run` runs a command and `_words` parses the command line.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from tactileforge.cli._verbs import commands, verbs
from tactileforge.errors import ConfigError, TactileForgeError, unknown
from tactileforge.util import lazy
from tactileforge.util.signals import interrupted_by_signals

if TYPE_CHECKING:
    from tactileforge.cli._verbs import Actions

__getattr__, __dir__, __all__ = lazy.attach(__name__)

#: End of ``tactileforge --help``.
_EXAMPLES = """\
  tactileforge train scale=demo                                   a small model on simulated touch
  tactileforge train scale=tiny data=recordings data.root=DIR     touch of your own
  tactileforge train -m seed=0,1 scale=demo                       two runs, one after the other
  tactileforge train resume=RUN                                   go on with a run that was stopped
"""

_HABITS = """\
Every verb takes key=value (--key value is the same), and
  --help              its keys, what each means, and the plugins that are installed
  --cfg job           what would be used, without doing it
  --explain KEY       where the value of a key comes from
  -m key=1,2          once for each value
  --config-dir DIR    options of your own, as DIR/GROUP/NAME.yaml; hydra.searchpath=[...] too
Completion, in bash: complete -o nospace -o default -C 'tactileforge --complete' tactileforge
"""


def main() -> None:
    """Entry point of ``tactileforge``; exits with 1 for an error and 130 when stopped."""
    from tactileforge.util.processes import end_with_parent

    end_with_parent()
    try:
        status = run(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # the reader closed the pipe early, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python flushes again
        status = 1
    opening = sys.modules.get("tactileforge.sensors.opening")  # not imported: no driver either
    if opening is not None and opening.is_driver_left():
        # Native code that still runs when the interpreter is taken down aborts the process
        # ("terminate called without an active exception"), and its exit status is then lost.
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


def run(argv: Sequence[str]) -> int:
    """Runs one command and gives its exit status."""
    with interrupted_by_signals():
        return _told(*(argv or ["--help"]))


def _told(verb: str, *rest: str) -> int:
    """Runs one command and reports errors and interruptions in one line."""
    try:
        if verb in ("-h", "--help", "help"):
            print(usage())
            return 0
        if verb == "--version":
            from tactileforge import __version__

            print(__version__)
            return 0
        if verb == "--complete":
            from tactileforge.cli._complete import complete

            print("\n".join(complete()))
            return 0
        return dispatch(verb, rest)
    except TactileForgeError as error:
        _end_bars()
        print(f"error: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        from tactileforge.util.files import unwritable

        if not (said := unwritable(error)):
            raise
        _end_bars()
        print(f"error: {said}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as stop:
        _end_bars()
        said = str(stop) or "stopped"
        again = "" if "go on with" in said else "; go on with: the same command again"
        with suppress(OSError):  # the terminal may be gone
            print(f"{said}{again}", file=sys.stderr)
        return 130


def _end_bars() -> None:
    """Closes progress bars left open by an error, to print its message on a line of its own."""
    if "tqdm" in sys.modules:
        from tqdm import tqdm

        for bar in list(getattr(tqdm, "_instances", ())):
            bar.close()


def dispatch(verb: str, rest: Sequence[str]) -> int:
    """Runs one command and gives its exit status.

    Raises:
        TactileForgeError: Something is wrong; says the fix.
    """
    from tactileforge.cli import _run

    known = commands(verb)
    action = ""
    if "" not in known:
        action, *rest = rest or ["--help"]
        if action in ("-h", "--help"):
            print(actions(verb, known))
            return 0
        if action not in known:
            from tactileforge.plugins.distributions import how_to_get

            if fix := how_to_get("verbs", f"{verb}.{action}"):
                raise ConfigError(f"{verb} {action} {fix}")
            raise ConfigError(unknown(f"action of tactileforge {verb}", action, known))
    elif rest[:1] and rest[0] in known:
        action, *rest = rest
    return _run.run(f"{verb} {action}".strip(), known[action], rest)


def actions(verb: str, known: Actions) -> str:
    """One line for each action of a verb."""
    rows = [f"  tactileforge {verb} {name:<10} {line}" for name, line in known.summaries().items()]
    return "\n".join([verbs()[verb], "", *rows, "", f"tactileforge {verb} ACTION --help: its keys"])


def usage() -> str:
    """One line for each verb, the flags shared by all verbs, and the installed plugins."""
    from tactileforge.plugins import registry

    rows = [f"  {name:<10} {about}" for name, about in verbs().items()]
    plugins = [f"  {kind:<10} {', '.join(registry.names(kind))}" for kind in registry.KINDS]
    return "\n".join(
        [
            "tactileforge: train, compare and run encoders of touch\n",
            "tactileforge VERB [key=value ...]\n",
            *rows,
            f"\n{_HABITS}\nInstalled plugins:",
            *plugins,
            f"\n{_EXAMPLES}",
        ]
    )
