"""Files of the model hub, by huggingface_hub's own client: fetched, verified, uploaded."""

from __future__ import annotations

import json
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import getproxies

from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.hub.store import WEIGHTS, weights_folder
from tactileforge.util.files import new_part, sha256
from tactileforge.util.untrusted import load_json

#: Seconds in which the hub takes a connection.
_ANSWERS = 5.0
_NAME = r"[A-Za-z0-9][A-Za-z0-9._-]*"
_PLACE = re.compile(rf"({_NAME}/{_NAME})(?:@([A-Za-z0-9][A-Za-z0-9._/-]*))?")


def client() -> Any:
    """The package huggingface_hub.

    Raises:
        ConfigError: It is not installed.
    """
    try:
        import huggingface_hub
        import huggingface_hub.constants
        import huggingface_hub.errors
    except ImportError as error:
        raise ConfigError("the model hub needs: pip install huggingface_hub") from error
    return huggingface_hub


def parse_place(place: str) -> tuple[str, str]:
    """Repository and revision of ``OWNER/NAME`` or ``OWNER/NAME@REVISION``.

    Raises:
        ConfigError: It is neither.
    """
    match = _PLACE.fullmatch(place)
    if not match or ".." in place:
        raise ConfigError(f"hf:{place}: write hf:OWNER/NAME, or hf:OWNER/NAME@REVISION")
    return match[1], match[2] or "main"


def fetch_model(place: str) -> Path:
    """The weights of a repository that was written by `Model.push_to_hub`.

    Args:
        place: Name of a repository, with a revision or none.

    Raises:
        ConfigError: No such form of a place, or huggingface_hub is not installed.
        DataNotFoundError: It cannot be fetched; says what to do.
        DataError: The file of a fixed revision has changed since it was first fetched.
    """
    repo, revision = parse_place(place)
    return fetch_file(repo, WEIGHTS, revision)


def fetch_file(repo: str, file: str, revision: str, *, kind: str = "model") -> Path:
    """A file of a repository, whose hash is that of its first download.

    A branch may move on: its hash is kept by the commit that it stood for.

    Raises:
        ConfigError: huggingface_hub is not installed.
        DataNotFoundError: It cannot be fetched; says what to do.
        DataError: The file is not what was fetched first.
    """
    hub = client()
    with _errors_named(repo, file, revision):
        try:
            got = hub.hf_hub_download(
                repo, file, revision=revision, repo_type=kind, local_files_only=_is_away(hub)
            )
        except getattr(hub.errors, "HTTPError", OSError) as error:
            if isinstance(error, hub.errors.HfHubHTTPError):
                raise
            # no answer at all: what was fetched before will do
            got = hub.hf_hub_download(
                repo, file, revision=revision, repo_type=kind, local_files_only=True
            )
        path = Path(got)
    # .../snapshots/COMMIT/FILE: the commit, of a branch too
    commit = path.parts[-1 - len(Path(file).parts)]
    check_first(f"{repo}/{file}@{commit}", path)
    return path


def _is_away(hub: Any) -> bool:
    """Whether the hub does not answer: its client would try six times, with a warning each."""
    if hub.constants.HF_HUB_OFFLINE or getproxies():  # a proxy may reach what this machine cannot
        return False
    url = urlsplit(hub.constants.ENDPOINT)
    port = url.port or (80 if url.scheme == "http" else 443)
    try:
        socket.create_connection((str(url.hostname), port), timeout=_ANSWERS).close()
    except OSError:
        return True
    return False


def fetch_folder(repo: str, folder: str, revision: str, *, kind: str = "model") -> Path:
    """The ``.pth`` files of a folder of a repository, each checked as by `fetch_file`."""
    hub = client()
    with _errors_named(repo, folder, revision):
        path = hub.snapshot_download(
            repo,
            revision=revision,
            repo_type=kind,
            allow_patterns=[f"{folder}*.pth"],
            local_files_only=_is_away(hub),
        )
    root = Path(path)
    files = sorted((root / folder).rglob("*.pth"))
    if not files:
        raise DataNotFoundError(f"hf:{repo} has no {folder}; its authors may have moved it")
    for file in files:
        check_first(f"{repo}/{file.relative_to(root).as_posix()}@{root.name}", file)
    return root / folder


def check_first(key: str, path: Path) -> None:
    """Compares a file's hash with that of its first download, or keeps it.

    Raises:
        DataError: It differs, or the record is damaged.
    """
    record = weights_folder() / "first" / f"{re.sub(r'[^A-Za-z0-9._-]', '+', key)}.json"
    digest = sha256(path)
    if not record.is_file():
        record.parent.mkdir(parents=True, exist_ok=True)
        with new_part(record) as part:
            part.write_text(json.dumps({"key": key, "sha256": digest}) + "\n", "utf-8")
            part.replace(record)
        return
    try:
        first = str(load_json(record.read_text("utf-8"))["sha256"])
    except (ValueError, KeyError, TypeError) as error:
        raise DataError(f"{record}: damaged ({error}); remove it, and load again") from error
    if first != digest:
        raise DataError(
            f"{key}: its sha256 is {digest}, and was {first} at the first download: somebody "
            f"changed it; remove {path} to fetch it again, and {record} if you trust the new file"
        )


def upload(folder: Path, repo: str, *, private: bool, message: str) -> str:
    """Creates a repository if there is none, and commits the files of a folder to it.

    Returns:
        The address of the commit.

    Raises:
        ConfigError: No such form of a name, or huggingface_hub is not installed.
        DataNotFoundError: The hub refused; says what to do.
    """
    name, revision = parse_place(repo.removeprefix("hf:"))
    hub = client()
    if _is_away(hub):
        raise DataNotFoundError(f"hf:{name}: {hub.constants.ENDPOINT} cannot be reached; try again")
    api = hub.HfApi()
    with _errors_named(name, "", revision):
        api.create_repo(name, private=private, exist_ok=True)
        info = api.upload_folder(
            repo_id=name, folder_path=folder, revision=revision, commit_message=message
        )
    return str(info.commit_url)


@contextmanager
def _errors_named(repo: str, file: str, revision: str) -> Iterator[None]:
    """Errors of the hub's client as one line that says what to do."""
    errors = client().errors
    place = f"hf:{repo}" + (f"@{revision}" if revision != "main" else "")
    login = "log in with: hf auth login (or set HF_TOKEN)"
    try:
        yield
    except errors.GatedRepoError as error:
        raise DataNotFoundError(
            f"{place}: its authors ask for terms to be accepted: do so on its page, then {login}"
        ) from error
    except errors.RevisionNotFoundError as error:
        raise DataNotFoundError(
            f"{place}: no such revision; give a branch, tag or commit"
        ) from error
    except errors.RepositoryNotFoundError as error:
        raise DataNotFoundError(
            f"{place}: no such repository, or a private one; correct the name, or {login}"
        ) from error
    except errors.LocalEntryNotFoundError as error:
        raise DataNotFoundError(
            f"{place}: the hub cannot be reached, and {file} was not fetched before; load it once "
            "with a network, or unset HF_HUB_OFFLINE"
        ) from error
    except errors.EntryNotFoundError as error:
        raise DataNotFoundError(
            f"{place} has no {file}: it was not written by model.push_to_hub; for published "
            "weights see tactileforge zoo list"
        ) from error
    except errors.OfflineModeIsEnabled as error:
        raise DataNotFoundError(f"{place}: HF_HUB_OFFLINE is set; unset it") from error
    # the client's own errors of transport are no OSError since its version 2
    except (errors.HfHubHTTPError, getattr(errors, "HTTPError", OSError), OSError) as error:
        status = getattr(getattr(error, "response", None), "status_code", None)
        if status in (401, 403):
            raise DataNotFoundError(f"{place}: the hub refused ({status}); {login}") from error
        reason = str(error).strip().splitlines()[0] if str(error).strip() else repr(error)
        raise DataNotFoundError(f"{place}: cannot be reached ({reason}); try again") from error
