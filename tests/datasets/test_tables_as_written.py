"""Forces in tables as other programs write them: read with no key typed, to the bit."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tactileforge.datasets.recordings import Recordings
from tactileforge.reading.guessing.layout import guess_layout

COUNT, FPS = 12, 30
TIMES = [round(n / FPS, 6) for n in range(COUNT)]
FORCES = [[round(0.1 * n, 3), round(-0.05 * n, 3), round(0.25 * n, 3)] for n in range(COUNT)]
WRENCHES = [[*force, 0.01, 0.02, 0.03] for force in FORCES]

Write = Callable[[Path], None]


def text(name: str, *above: str, mark: str = ",", rows: list[list[str]] | None = None) -> Write:
    """Writes a text of lines and of rows; those of times and forces without others."""
    rows = rows or [[str(t), *map(str, force)] for t, force in zip(TIMES, FORCES, strict=True)]
    lines = "\n".join([*above, *(mark.join(row) for row in rows)]) + "\n"

    def write(folder: Path) -> None:
        (folder / name).write_text(lines)

    return write


def cells(shape: str) -> list[list[str]]:
    """Times, and forces in one cell each."""
    return [[str(t), shape.format(*wrench)] for t, wrench in zip(TIMES, WRENCHES, strict=True)]


COMMAS = [
    [str(one).replace(".", ",") for one in (t, *force)]
    for t, force in zip(TIMES, FORCES, strict=True)
]
IN_MN = [
    [str(t), *(str(round(1000 * one)) for one in force)]
    for t, force in zip(TIMES, FORCES, strict=True)
]
COLUMNS = {"time": TIMES, **dict(zip(("fx", "fy", "fz"), zip(*FORCES, strict=True), strict=True))}


def npz(folder: Path) -> None:
    np.savez(folder / "ft.npz", force=np.array(FORCES, np.float32), timestamps=TIMES)


def mat(folder: Path) -> None:
    io = pytest.importorskip("scipy.io")
    io.savemat(folder / "ft.mat", {"time": TIMES, "F": np.array(FORCES), "who": "me"})


def mat_struct(folder: Path) -> None:
    io = pytest.importorskip("scipy.io")
    columns = {name: np.array(values)[:, None] for name, values in COLUMNS.items()}
    io.savemat(folder / "ft.mat", {"data": columns})


def mat_73(folder: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "ft.mat", "w", userblock_size=512) as file:
        # MATLAB writes columns first
        for name, values in {"time": np.array([TIMES]), "force": np.array(FORCES).T}.items():
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with (folder / "ft.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


def xlsx(folder: Path) -> None:
    book = pytest.importorskip("openpyxl").Workbook()
    book.active.append(["Nano17"])
    book.active.append(["Time (s)", "Fx", "Fy", "Fz"])
    for t, force in zip(TIMES, FORCES, strict=True):
        book.active.append([t, *force])
    book.create_sheet("notes").append(["none"])
    book.save(folder / "forces.xlsx")


def parquet(folder: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    pytest.importorskip("pyarrow.parquet").write_table(
        arrow.table(COLUMNS), folder / "forces.parquet"
    )


def feather(folder: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    pytest.importorskip("pyarrow.feather").write_feather(
        arrow.table(COLUMNS), str(folder / "forces.feather")
    )


def savetxt(folder: Path) -> None:
    rows = np.column_stack([TIMES, FORCES])
    np.savetxt(folder / "forces.txt", rows, header="time fx fy fz", fmt="%.6f")


def json_columns(folder: Path) -> None:
    (folder / "ft.json").write_text(json.dumps({"force": FORCES, "timestamps": TIMES}))


TABLES: dict[str, Write] = {
    "no names": text("forces.csv"),
    "no names, a wrench": text(
        "ft.csv", rows=[[str(t), *map(str, one)] for t, one in zip(TIMES, WRENCHES, strict=True)]
    ),
    "no names, a row per frame": text(
        "force.txt", mark=" ", rows=[[*map(str, force)] for force in FORCES]
    ),
    "no names, numbered": text(
        "ft.csv", rows=[[str(n), *map(str, force)] for n, force in enumerate(FORCES)]
    ),
    "a list in a cell": text("ft.csv", "timestamp,force_torque", rows=cells('"[{}, {}, {}, {}]"')),
    "a tuple in a cell": text("ft.csv", "t,wrench", rows=cells('"({}, {}, {}, {}, {}, {})"')),
    "blanks in a cell": text("ft.csv", "t,force", rows=cells("{} {} {}")),
    "semicolons, commas": text("forces.csv", "time;Fx;Fy;Fz", mark=";", rows=COMMAS),
    "semicolons, no names": text("forces.csv", mark=";", rows=COMMAS),
    "semicolons": text("forces.csv", "time;Fx;Fy;Fz", mark=";"),
    "tabs": text("forces.tsv", "time\tFx\tFy\tFz", mark="\t"),
    "blanks": text("forces.txt", "time Fx Fy Fz", mark=" "),
    "a title": text("forces.csv", "Nano17, FT123", "Rate: 30 Hz", "", "Time (s),Fx,Fy,Fz"),
    "a line of units": text("forces.csv", "Time,Fx,Fy,Fz", "s,N,N,N"),
    "a line of other units": text("forces.csv", "Time,Fx,Fy,Fz", "[s],[mN],[mN],[mN]", rows=IN_MN),
    "a line of groups": text("forces.csv", ",Force,,", "Time,x,y,z"),
    "groups as empty columns": text(
        "wrench.csv",
        "rosbagTimestamp,header,seq,wrench,force,x,y,z,torque,x,y,z",
        rows=[
            [str(t), "", str(n), "", "", *map(str, one[:3]), "", *map(str, one[3:])]
            for n, (t, one) in enumerate(zip(TIMES, WRENCHES, strict=True))
        ],
    ),
    "units in names": text("forces.csv", "time [s],Fx [mN],Fy [mN],Fz [mN]", rows=IN_MN),
    "milliseconds": text(
        "ft.csv",
        "timestamp_ms,fx,fy,fz",
        rows=[[str(1000 * t), *map(str, f)] for t, f in zip(TIMES, FORCES, strict=True)],
    ),
    "nanoseconds": text(
        "ft.csv",
        "t_ns,fx,fy,fz",
        rows=[[str(round(1e9 * t)), *map(str, f)] for t, f in zip(TIMES, FORCES, strict=True)],
    ),
    "savetxt": savetxt,
    "json": json_columns,
    "npz": npz,
    "mat": mat,
    "mat, a struct": mat_struct,
    "mat 7.3": mat_73,
    "xlsx": xlsx,
    "parquet": parquet,
    "feather": feather,
}


@pytest.mark.parametrize("write", TABLES.values(), ids=TABLES)
def test_forces_of_a_table(write: Write, tmp_path: Path) -> None:
    for trial in range(2):
        folder = tmp_path / f"trial_{trial}"
        (folder / "images").mkdir(parents=True)
        for n in range(COUNT):
            level = np.full((12, 16, 3), 90 + 3 * n + trial, np.uint8)
            Image.fromarray(level).save(folder / "images" / f"{n:04d}.png")
        write(folder)
    guess = guess_layout(tmp_path)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert len(found) == 2
    assert not data.skipped
    for one in found:
        np.testing.assert_array_equal(one.force, np.array(FORCES, np.float32))
        np.testing.assert_allclose(one.times, TIMES, atol=1e-5)


def test_columns_that_may_be_forces_are_asked_for(tmp_path: Path) -> None:
    for trial in range(2):
        folder = tmp_path / f"trial_{trial}"
        folder.mkdir()
        for n in range(COUNT):
            level = np.full((12, 16, 3), 90 + 3 * n + trial, np.uint8)
            Image.fromarray(level).save(folder / f"{n:04d}.png")
        text("log.csv")(folder)
    guess = guess_layout(tmp_path)
    assert guess is not None
    assert "force" not in guess.options["layouts"]["guessed"]
    doubt = next(line for line in guess.doubts if line.startswith("force:"))
    assert "{file: '{file}/log.csv', times: '0', columns: ['1', '2', '3']}" in doubt
