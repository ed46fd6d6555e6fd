"""Progress bars: on a terminal drawn over and over, in a file a line a minute."""

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
    """A `tqdm` whose line is shared with no warning.

    Args:
        *args: See `tqdm.tqdm`.
        **kwargs: Alike; ``file`` is stderr unless given.
    """

    _open: ClassVar[int] = 0
    _apart: ClassVar[ExitStack] = ExitStack()

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        file = kwargs.get("file") or sys.stderr
        self._is_drawn = bool(getattr(file, "isatty", lambda: False)())
        if not self._is_drawn:
            kwargs |= {"mininterval": PAUSE, "maxinterval": PAUSE, "miniters": 1}
        self._counts = False
        super().__init__(*args, **kwargs)
        if not self._is_drawn:
            self.ncols = None  # a line of a file is as long as it is
        if self._is_drawn and not self.disable:
            self._counts = True
            Bar._open += 1
            if Bar._open == 1:
                Bar._apart.enter_context(_apart())

    @staticmethod
    def status_printer(file: Any) -> Callable[[str], None]:
        """What writes the bar: over the line before on a terminal, else as a line of its own."""
        if getattr(file, "isatty", lambda: False)():
            return tqdm.status_printer(file)

        def write(line: str) -> None:
            if line.strip():
                file.write(f"{line.strip()}\n")
                file.flush()

        return write

    def close(self) -> None:
        """Ends the bar, and its last line."""
        if not self._is_drawn and not self.disable:
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


@contextmanager
def _apart() -> Iterator[None]:
    """Writes what is logged or warned of above the bars."""
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
