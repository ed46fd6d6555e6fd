"""Origin of a distribution, and the installation of its extras; imports nothing."""

from __future__ import annotations

import json
import re
import shlex
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit


def origin(package: str = "tactileforge") -> dict[str, Any]:
    """Origin of a distribution (PEP 610); {} if pip did not note it."""
    try:
        noted = distribution(package).read_text("direct_url.json")
    except PackageNotFoundError:
        return {}
    return dict(json.loads(noted)) if noted else {}


def local(url: str) -> Path:
    """Path of a ``file:`` address."""
    return Path(unquote(urlsplit(url).path))


def clone(package: str) -> Path | None:
    """The clone with the folder of a package; None for an installation of another kind."""
    places = [Path(__file__).parents[3]]  # run from its sources
    if "dir_info" in (noted := origin()):
        places.insert(0, local(noted["url"]))
    project = folder(package) / "pyproject.toml"
    return next((place for place in places if (place / project).is_file()), None)


def folder(package: str) -> Path:
    """Folder of one of our packages in a clone."""
    return Path() if package == "tactileforge" else Path("plugins") / package


def typed(clone: Path, package: str) -> str:
    """Folder of a package in a clone, from here, as pip takes it; not quoted."""
    start = "." if Path.cwd() == clone else str(clone)
    return start if package == "tactileforge" else f"{start}/{folder(package).as_posix()}"


def install_extra(extra: str, of: str = "tactileforge") -> str:
    """Shell command for an extra of one of our installed packages.

    From a clone, its folder with the extra; elsewhere what the extra requires of others, since our
    packages are on no index.

    Args:
        extra: Name of the extra.
        of: The package.

    Example:
        >>> install_extra("av").partition(" ")[0]
        'pip'
    """
    place = clone(of)
    if place is not None:
        is_editable = origin(of).get("dir_info", {}).get("editable")
        edit = "-e " if is_editable else ""
        return f"pip install {edit}{shlex.quote(f'{typed(place, of)}[{extra}]')}"
    needed = distribution(of).requires or []
    mark = re.compile(rf"""^(.+?)\s*;.*\bextra == ["']{re.escape(extra)}["']""")
    found = [match[1].strip("() ") for need in needed if (match := mark.match(need))]
    return f"pip install {' '.join(map(shlex.quote, found))}"
