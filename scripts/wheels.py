"""Builds the wheels of the core and of all packages of plugins/, and checks each of them.

Checks: name and version; every file that a package declares (stubs, YAML, weights) is inside; every
entry point names a module of its wheel; what it needs of ours is among the wheels, in that version.

Run: python scripts/wheels.py [FOLDER]
"""

from __future__ import annotations

import argparse
import configparser
import re
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from email import message_from_string
from email.message import Message
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def projects(root: Path) -> list[Path]:
    """Folders of the core and of all packages, but for the example."""
    found = sorted(path.parent for path in (root / "plugins").glob("*/pyproject.toml"))
    return [root, *(path for path in found if path.name != "tactileforge-example")]


def build(folder: Path, out: Path) -> Path:
    """Builds one wheel without network, and returns it."""
    with tempfile.TemporaryDirectory() as fresh:
        command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps"]
        command += ["--ignore-requires-python"]  # the camera of LeRobot needs a newer one
        command += ["--no-build-isolation", "--wheel-dir", fresh, str(folder)]
        subprocess.run(command, check=True)
        (made,) = Path(fresh).glob("*.whl")
        kept = out / made.name
        kept.write_bytes(made.read_bytes())
        return kept


def faults(folder: Path, wheel: Path, versions: dict[str, str]) -> list[str]:
    """What is wrong with a wheel, a line each.

    Args:
        folder: Folder that it was built from.
        wheel: The wheel.
        versions: Version of each of our packages, by name.
    """
    project = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        about = _metadata(archive, "METADATA")
        entries = _entries(archive)
    found = []
    if (about["Name"], about["Version"]) != (project["name"], project["version"]):
        found.append(f"is {about['Name']} {about['Version']}, not {project['name']}")
    for kind, target in entries:
        module = target.partition(":")[0].strip().replace(".", "/")
        if not any(one.startswith(f"{module.partition('/')[0]}/") for one in names):
            continue  # of a dependency, as Lightning's callbacks
        if not {f"{module}.py", f"{module}/__init__.py"} & names:
            found.append(f"{kind} {target}: not in the wheel")
    for need in about.get_all("Requires-Dist") or []:
        name = re.match(r"[\w-]+", need)
        least = re.search(r">=([\d.]+)", need)
        if name and name[0].startswith("tactileforge"):
            if name[0] not in versions:
                found.append(f"needs {name[0]}, which is none of ours")
            elif least and _number(versions[name[0]]) < _number(least[1]):
                found.append(f"needs {need}, and {versions[name[0]]} is built")
    if not any(name.endswith(("LICENSE", "LICENSE.txt")) for name in names) and folder == ROOT:
        found.append("has no licence")
    return found


def size(wheel: Path) -> str:
    """Size of a wheel, and of the weights in it, which are most of the core's."""
    with zipfile.ZipFile(wheel) as archive:
        held = [one for one in archive.infolist() if one.filename.endswith(".safetensors")]
    said = f"{wheel.stat().st_size / 1e6:.1f} MB"
    weights = sum(one.file_size for one in held)
    return f"{said}, of which {weights / 1e6:.1f} MB of weights unpacked" if weights else said


def keep_constraints(out: Path) -> Path:
    """Puts the versions that the tests run with beside the wheels, for those without a clone."""
    kept = out / "constraints.txt"
    kept.write_bytes((ROOT / "constraints.txt").read_bytes())
    return kept


def _metadata(archive: zipfile.ZipFile, name: str) -> Message:
    (path,) = (one for one in archive.namelist() if one.endswith(f".dist-info/{name}"))
    return message_from_string(archive.read(path).decode("utf-8"))


def _entries(archive: zipfile.ZipFile) -> list[tuple[str, str]]:
    paths = [one for one in archive.namelist() if one.endswith("/entry_points.txt")]
    parser = configparser.ConfigParser(delimiters=("=",))
    for path in paths:
        parser.read_string(archive.read(path).decode("utf-8"))
    return [(kind, target) for kind in parser.sections() for _, target in parser.items(kind)]


def _number(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version))


def main() -> None:
    """Builds and checks all wheels; exits with 1 where one has a fault."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("folder", nargs="?", default="dist", help="folder of the wheels")
    out = Path(parser.parse_args().folder)
    out.mkdir(parents=True, exist_ok=True)
    folders = projects(ROOT)
    wheels = {}
    for number, folder in enumerate(folders, 1):
        wheels[folder] = build(folder, out)
        print(f"{number} of {len(folders)}: {wheels[folder].name}", flush=True)
    about = [tomllib.loads((one / "pyproject.toml").read_text("utf-8")) for one in folders]
    versions = {one["project"]["name"]: one["project"]["version"] for one in about}
    wrong = 0
    for folder, wheel in wheels.items():
        lines = faults(folder, wheel, versions)
        wrong += bool(lines)
        print(f"{wheel.name}: {'; '.join(lines) or 'ok'}, {size(wheel)}")
    kept = keep_constraints(out)
    print(
        f"{len(wheels)} wheels in {out}: pip install -c {kept} --find-links {out} {out}/NAME-*.whl"
    )
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
