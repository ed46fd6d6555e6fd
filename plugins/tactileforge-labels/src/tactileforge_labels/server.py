"""Requests of the page, and their answers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactileforge.errors import TactileForgeError
from tactileforge.pages import PageAnswer, to_json
from tactileforge.plugins import load_json
from tactileforge_labels.session import ConflictError, LabelSession

_FILE = Path(__file__).with_name("page.html")
_NOT_FOUND = PageAnswer(b"no such thing\n", status=404)


class LabelAnswers:
    """Answers the page of a session.

    Args:
        session: Recordings to label.
    """

    def __init__(self, session: LabelSession) -> None:
        self.session = session

    def get(self, path: str, query: Mapping[str, str]) -> PageAnswer:
        """Answers a request: the page, the list, or marks, proposal and pictures of a recording.

        Args:
            path: Path below the token.
            query: Unused.
        """
        if path == "":
            return PageAnswer(_FILE.read_bytes(), "text/html; charset=utf-8")
        if path == "recordings":
            return _json(self.session.overview())
        what, *numbers = path.split("/")
        try:
            number, *frame = self._numbers(numbers)
            if what == "marks" and not frame:
                return _json(self.session.marks(number))
            if what == "proposal" and not frame:
                return _json(self.session.proposal(number))
            if what in ("frame", "difference") and frame:
                jpeg = self.session.picture(number, frame[0], what == "difference")
                return PageAnswer(jpeg, "image/jpeg") if jpeg else _NOT_FOUND
        except LookupError:
            return _NOT_FOUND
        except TactileForgeError as error:
            return _refused(422, error)
        return _NOT_FOUND

    def post(self, path: str, body: bytes) -> PageAnswer:
        """Writes the marks of a recording.

        Args:
            path: ``marks/NUMBER``.
            body: JSON; see `session.LabelSession.write`.
        """
        what, *numbers = path.split("/")
        try:
            (number,) = self._numbers(numbers)
            if what != "marks":
                return _NOT_FOUND
            return _json(self.session.write(number, load_json(body)))
        except ConflictError as error:
            return _refused(409, error)
        except (LookupError, TactileForgeError) as error:
            return _refused(400, error) if isinstance(error, TactileForgeError) else _NOT_FOUND
        except ValueError as error:  # no JSON
            return _refused(400, error)

    def _numbers(self, texts: list[str]) -> list[int]:
        """Number of a recording, and of one of its frames if given.

        Raises:
            LookupError: There is no such recording or frame.
        """
        if not 1 <= len(texts) <= 2 or not all(t.isascii() and t.isdecimal() for t in texts):
            raise LookupError(texts)
        numbers = [int(text[:12]) for text in texts]
        frames = len(self.session.entries[numbers[0]].recording.times)
        if len(numbers) == 2 and numbers[1] >= frames:
            raise LookupError(texts)
        return numbers


def _json(content: Mapping[str, Any]) -> PageAnswer:
    return PageAnswer(to_json(content).encode(), "application/json")


def _refused(status: int, error: Exception) -> PageAnswer:
    return PageAnswer(f"{error}\n".encode(), "text/plain; charset=utf-8", status)
