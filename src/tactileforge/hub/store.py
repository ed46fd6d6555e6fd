"""Files of weights: location, download, import and verification.

A file gets its name by a rename, once its hash is known to be right: nothing that is cut short ever
lies where a model is looked for. It is hashed again on every load.
"""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from tactileforge.errors import ConfigError, DataError, DataNotFoundError, full
from tactileforge.hub import cards
from tactileforge.hub.cards import Card, Weight
from tactileforge.util import downloads, strict
from tactileforge.util.files import cache_folder, disk_errors_named, new_part, sha256
from tactileforge.util.untrusted import load_json

#: Names of the files in a folder of `Model.save_pretrained`, and on the model hub.
WEIGHTS, CARD = "model.safetensors", "README.md"
#: Seconds for which an import stays after another took its place.
_GRACE = 3600.0


@dataclass(frozen=True, kw_only=True)
class Import:
    """Record of an import, kept beside its file.

    Attributes:
        file: Name of the one-file checkpoint.
        sha256: Hash of that file.
        bytes: Size of that file.
        source: Name of the published file.
        source_sha256: Hash of the published file; "" for a folder.
    """

    file: str
    sha256: str
    bytes: int
    source: str
    source_sha256: str


def weights_folder() -> Path:
    """Folder of downloaded and imported weights: ``models`` in the cache."""
    return cache_folder() / "models"


def is_available(card: Card, weight: Weight) -> bool:
    """Whether a model can be loaded offline."""
    if weight.layout:
        return _record(card, weight).is_file()
    return _target(card, weight).is_file()


def fetch_weights(card: Card, weight: Weight) -> Path:
    """Path of the verified file of a model; downloads it if it is missing.

    Raises:
        DataError: The file's hash or size differs from the record.
        DataNotFoundError: It is not there, and cannot be had from here; says how to get it.
        ConfigError: The address is of an unknown kind, or needs a package.
    """
    if weight.layout:
        imported = read_import(card, weight)
        path = weights_folder() / imported.file
        fix = f"import it again: {_get(card, weight)}"
        if not path.is_file():
            raise DataNotFoundError(f"{path} is missing; {fix}")
        _verify(path, imported.sha256, imported.bytes, fix)
        return path
    path = _target(card, weight)
    if not path.is_file():
        if weight.file:
            raise DataNotFoundError(f"{path} is missing; install tactileforge again")
        _download(card, weight, path)
    fix = "install tactileforge again" if weight.file else "remove it, and load the model again"
    _verify(path, weight.sha256, weight.bytes, fix)
    return path


def read_import(card: Card, weight: Weight) -> Import:
    """Reads the record of an import.

    Raises:
        DataNotFoundError: Nothing was imported under that name; says how to do it.
        DataError: The record is damaged.
    """
    record = _record(card, weight)
    if not record.is_file():
        terms = " (its authors ask for terms to be accepted)" if weight.gated else ""
        raise DataNotFoundError(
            f"the weights of {card.name}.{weight.tag} are not ours to ship: download them from "
            f"{weight.source}{terms}, then: {_get(card, weight)}"
        )
    fix = f"import it again: {_get(card, weight)}"
    try:
        imported = strict.build(Import, str(record), load_json(record.read_text("utf-8")))
    except (ValueError, ConfigError) as error:
        raise DataError(f"{record}: damaged ({error}); {fix}") from error
    # a record names a file beside it, and no other place
    if Path(imported.file).name != imported.file:
        raise DataError(f"{record}: damaged (file {imported.file!r}); {fix}")
    return imported


def keep_import(card: Card, weight: Weight, part: Path, source: str, source_sha256: str) -> Path:
    """Moves an imported file into place and records it.

    Two imports at once end in the one that is recorded last; both files are whole.

    Args:
        card: Card of the model.
        weight: Its file of weights.
        part: The one-file checkpoint, in `weights_folder`.
        source: Name of the published file.
        source_sha256: Hash of the published file; "" for a folder.

    Returns:
        Where the file lies now.
    """
    digest = sha256(part)
    target = weights_folder() / f"{card.name}.{weight.tag}-{digest[:12]}.safetensors"
    kept = Import(
        file=target.name,
        sha256=digest,
        bytes=part.stat().st_size,
        source=source,
        source_sha256=source_sha256,
    )
    with disk_errors_named(target):
        part.replace(target)
        # after the file: a record never names one that is not there
        with new_part(_record(card, weight)) as record:
            record.write_text(json.dumps(asdict(kept), indent=2) + "\n", "utf-8")
            record.replace(_record(card, weight))
    _remove_old(card, weight, target)
    return target


def _remove_old(card: Card, weight: Weight, kept: Path) -> None:
    """Removes earlier imports, an hour after another took their place: somebody may load one."""
    name = f"{card.name}.{weight.tag}"
    for old in weights_folder().glob(f"{name}-{'[0-9a-f]' * 12}.safetensors"):
        mark = old.with_suffix(".old")
        with suppress(FileNotFoundError):  # another process may do the same
            if old == kept:
                mark.unlink(missing_ok=True)
            elif not mark.exists():
                mark.touch()
            elif time.time() - mark.stat().st_mtime > _GRACE:
                old.unlink()
                mark.unlink()


def _get(card: Card, weight: Weight) -> str:
    return f"tactileforge zoo get {card.name}.{weight.tag} --from FILE"


def _record(card: Card, weight: Weight) -> Path:
    return weights_folder() / f"{card.name}.{weight.tag}.json"


def _target(card: Card, weight: Weight) -> Path:
    if weight.file:
        return Path(str(cards.zoo_folder() / weight.file))
    return weights_folder() / f"{card.name}.{weight.tag}-{weight.sha256[:12]}.safetensors"


def _verify(path: Path, digest: str, size: int, fix: str) -> None:
    actual = path.stat().st_size
    if actual != size:
        raise DataError(f"{path}: {actual} bytes, expected {size}; {fix}")
    # after the size, which costs nothing to compare
    if (found_digest := sha256(path)) != digest:
        raise DataError(f"{path}: its sha256 is {found_digest}, expected {digest}; {fix}")


def _download(card: Card, weight: Weight, target: Path) -> None:
    """Downloads to a temporary file, renamed to the target only if its hash matches."""
    name = f"{card.name}.{weight.tag}"
    other = f"what {weight.url} serves is not what the card names; nothing was kept"
    url, headers = _address(name, weight.url)
    with disk_errors_named(target), new_part(target) as part:
        try:
            _fetch(name, url, headers, weight.bytes, part)
        except downloads.TooMuch as error:
            more = f"at least {weight.bytes + 1} bytes, expected {weight.bytes}"
            raise DataError(f"{name}: {more}; {other}") from error
        except OSError as error:
            # the network is not to blame
            if full(error):
                raise
            terms = "; its authors ask for terms to be accepted there" if weight.gated else ""
            raise DataNotFoundError(
                f"{name}: {weight.url} cannot be fetched ({error}){terms}. "
                f"Without a network: fetch it elsewhere, and put it at {target}"
            ) from error
        _verify(part, weight.sha256, weight.bytes, other)
        part.replace(target)


def _fetch(name: str, url: str, headers: Mapping[str, str], size: int, part: Path) -> None:
    from tactileforge.util.bars import Bar

    with (
        part.open("wb") as file,
        Bar(desc=name, total=size, unit="B", unit_scale=True, disable=None) as bar,
    ):
        downloads.copy(
            url,
            size,
            file,
            lambda: file.tell() == size,
            headers=headers,
            moved=lambda count: bar.update(count - bar.n),
        )
        file.flush()
        os.fsync(file.fileno())


def _address(name: str, url: str) -> tuple[str, dict[str, str]]:
    """Address of a file, and the headers to send there."""
    if not url.startswith("hf://"):
        if url.partition(":")[0] not in ("https", "http", "file"):
            raise ConfigError(f"{name}: {url}: use https://, http://, file:// or hf://")
        return url, {}
    # with a revision: the newest file may be another than the card names
    match = re.fullmatch(r"hf://([^/@]+/[^/@]+)/([^@]+)@([^@]+)", url)
    if not match:
        raise ConfigError(f"{url}: write hf://OWNER/REPO/FILE@REVISION")
    try:
        from huggingface_hub import get_token, hf_hub_url
    except ImportError as error:
        raise ConfigError(f"{url} needs: pip install huggingface_hub") from error
    repo, file, revision = match.groups()
    # that of the user's login, for models whose authors ask for terms to be accepted
    token = get_token()
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    return hf_hub_url(repo, file, revision=revision), headers
