"""Progress bars: redrawn in place on a terminal and in a notebook, one line a minute in a file."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, ClassVar, TextIO

from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

#: Seconds between two lines of a bar in a file.
PAUSE = 60.0


class Bar(tqdm):  # type: ignore[type-arg]
    """A `tqdm` bar with a line of its own: warnings and logs are written above it.

    Args:
        *args: Positional arguments of `tqdm.tqdm`.
        **kwargs: Keyword arguments of `tqdm.tqdm`; ``file`` is stderr unless given.
    """

    _open: ClassVar[int] = 0
    _apart: ClassVar[ExitStack] = ExitStack()

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        file = kwargs.get("file") or sys.stderr
        self._is_drawn = _redraws(file)
        if kwargs.get("disable", False) is None:  # tqdm's: no bar but on a terminal
            kwargs["disable"] = not self._is_drawn
        if not self._is_drawn:
            kwargs |= {"mininterval": PAUSE, "maxinterval": PAUSE, "miniters": 1}
        self._counts = False
        source = args[0] if args else kwargs.get("iterable")
        self._is_open_ended = kwargs.get("total") is None and not hasattr(source, "__len__")
        if self._is_open_ended:
            kwargs["unit"] = (
                f" {kwargs.get('unit', 'it')}"  # "24 recording" where no total is known
            )
            if not self._is_drawn:
                kwargs["delay"] = PAUSE / 1000  # nothing is known yet: no line
        super().__init__(*args, **kwargs)
        if not self._is_drawn:
            self.ncols = None  # lines of a file are not cut to the width of a terminal
        if self._is_drawn and not self.disable:
            self._counts = True
            Bar._open += 1
            if Bar._open == 1:
                Bar._apart.enter_context(_apart())

    @staticmethod
    def status_printer(file: Any) -> Callable[[str], None]:
        """Writer of the bar: over its last line if it can, else as a new line."""
        if _redraws(file):
            return tqdm.status_printer(file)

        def write(line: str) -> None:
            if line.strip():
                file.write(f"{line.strip()}\n")
                file.flush()

        return write

    def close(self) -> None:
        """Closes the bar, after its last line."""
        if not self._is_drawn and not self.disable:
            # tqdm's own close would add an empty line, because each line here has its line break
            if self.n or not self._is_open_ended:  # nothing was met: an error speaks for itself
                self.sp(str(self))
            self.disable = True
            type(self)._instances.discard(self)  # type: ignore[attr-defined]
            return
        super().close()
        if self._counts:
            self._counts = False
            Bar._open -= 1
            if not Bar._open:
                Bar._apart.close()


def _redraws(file: Any) -> bool:
    """Whether a carriage return starts a line anew: on a terminal, and below a notebook's cell.

    The stream of a notebook's kernel says that it is no terminal, but the page minds it.
    """
    is_terminal = bool(getattr(file, "isatty", lambda: False)())
    own = getattr(file, "_wrapped", file)  # within what tqdm wraps around it
    return is_terminal or type(own).__module__.startswith("ipykernel.")


@contextmanager
def _apart() -> Iterator[None]:
    """Writes logs and warnings above the bars."""
    # warnings are not logs: Python writes them by this function, over the bar
    before = warnings.showwarning

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        text = warnings.formatwarning(message, category, filename, lineno)
        Bar.write(text.rstrip("\n"), file=sys.stderr)

    warnings.showwarning = show
    try:
        with logging_redirect_tqdm(tqdm_class=Bar):
            yield
    finally:
        warnings.showwarning = before
