"""Bars on a terminal, with a line of their own, and in a file, with a line a minute."""

import io
import logging
import sys
import warnings

import pytest

from tactileforge.util.bars import PAUSE, Bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_file_has_a_line_a_minute() -> None:
    file, now = io.StringIO(), [0.0]
    bar = Bar(total=600, desc="train", file=file)
    bar._time = lambda: now[0]
    bar.start_t = bar.last_print_t = now[0]
    for second in range(600):
        now[0] = float(second)
        bar.update()
    bar.close()
    lines = file.getvalue().splitlines()
    assert len(lines) == 1 + 599 // PAUSE + 1  # the start, every minute, the end
    assert "\r" not in file.getvalue()
    assert lines[0].startswith("train:   0%")
    assert " 600/600 " in lines[-1]
    bar.close()
    assert len(file.getvalue().splitlines()) == len(lines)


class Kernel(io.StringIO):
    """The stderr of a notebook, as ``ipykernel.iostream.OutStream``: no terminal, no file."""

    __module__ = "ipykernel.iostream"
    encoding = "UTF-8"

    def isatty(self) -> bool:
        return False


def test_a_notebook_has_one_line_that_is_redrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    file = Kernel()
    monkeypatch.setattr(sys, "stderr", file)
    for _ in Bar(range(600), desc="train", mininterval=0, miniters=1):
        pass
    said = file.getvalue()
    assert said.count("\r") > 600
    assert said.count("\n") == 1
    assert said.endswith("\n")
    assert said.rpartition("\r")[2].startswith("train: 100%|██████████| 600/600 ")
    with Bar(total=2, disable=None) as bar:  # a download
        bar.update()
    assert " 1/2 " in file.getvalue()


def test_a_download_has_no_bar_in_a_file() -> None:
    file = io.StringIO()
    with Bar(total=2, disable=None, file=file) as bar:
        bar.update()
    assert not file.getvalue()


def test_a_warning_has_a_line_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    handler = logging.StreamHandler(screen)
    root, before = logging.getLogger(), warnings.showwarning
    monkeypatch.setattr(root, "handlers", [handler])
    with Bar(total=9, desc="train") as bar:
        bar.update(4)
        logging.getLogger("x").warning("the light has changed")
        warnings.showwarning(UserWarning("odd"), UserWarning, "a.py", 7)
        bar.refresh()
    assert root.handlers == [handler]
    assert warnings.showwarning is before
    shown = [part.strip() for part in screen.getvalue().replace("\n", "\r").split("\r")]
    assert "the light has changed" in shown
    assert "a.py:7: UserWarning: odd" in shown
    assert not [part for part in shown if "train:" in part and ("light" in part or "odd" in part)]


def test_a_line_of_a_file_is_not_cut() -> None:
    file = io.StringIO()
    bar = Bar(total=1, desc="train", file=file)
    bar.set_postfix({f"objective_{i}": i for i in range(20)}, refresh=False)
    bar.update()
    bar.close()
    assert file.getvalue().rstrip().endswith("objective_19=19]")


def test_a_count_without_an_end_has_no_line_before_it_counts() -> None:
    file = io.StringIO()
    with pytest.raises(ValueError, match="bad"):
        for _ in Bar((int(word) for word in ["bad"]), desc="count", unit="recording", file=file):
            pass
    assert file.getvalue() == ""
    for _ in Bar(iter("abc"), desc="count", unit="recording", file=file):
        pass
    assert file.getvalue().startswith("count: 3 recording [")
    assert len(file.getvalue().splitlines()) == 1
