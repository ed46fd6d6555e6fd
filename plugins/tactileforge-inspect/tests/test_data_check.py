"""The command data check: lines, exit codes, JSON, a baseline, and keys that are written."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactileforge import cli
from tactileforge.checks import made_touch
from tactileforge.checks.made import press, resting


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two mirrored touches of a DIGIT; one pulls."""
    root = tmp_path / "touches"
    for seed in range(2):
        one = made_touch(seed, still=resting(seed)[:, ::-1])
        (root / str(seed)).mkdir(parents=True)
        for number, frame in enumerate(one.frames.read(range(0, 90, 3))):
            cv2.imwrite(str(root / str(seed) / f"{number:03d}.png"), frame[..., ::-1])
        assert one.force is not None
        rows = one.force[::3] * (1, 1, 1 if seed else -1)
        lines = ["fx,fy,fz", *(",".join(f"{axis:.4f}" for axis in row) for row in rows)]
        (root / f"{seed}.csv").write_text("\n".join(lines) + "\n")
    layout = '{images: "*/*.png", each: sequence, fps: 10, sensor: digit, background: {first: 2}, '
    layout += 'force: {file: "{stem}.csv", columns: [fx, fy, fz]}}'
    (root / "tactileforge.yaml").write_text(f"layouts:\n  mine: {layout}\n")
    return root


def run(folder: Path, *words: str) -> int:
    options = ["data=recordings", f"data.root={folder}", "data.val=0"]
    return cli.run(["data", "check", *options, *words])


def test_lines_codes_and_the_exit(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder) == 1
    out = capsys.readouterr().out
    assert "mine/0: TF202 down to -" in out
    assert out.count("TF308 mirrored, left and right exchanged (mirror: x") == 2
    assert (
        out.splitlines()[-1] == "2 recordings checked, 0 of them held out: 3 findings in 2 places"
    )
    assert run(folder, "select=[TF2]", "ignore=[pulling_force]") == 0
    assert capsys.readouterr().out == "2 recordings checked, 0 of them held out: nothing found\n"
    assert run(folder, "frames=false") == 1
    assert "TF308" not in capsys.readouterr().out
    assert run(folder, "select=[TF999]") == 1
    assert "unknown check 'TF999'" in capsys.readouterr().err


def test_json_and_a_baseline(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder, "json=true", "select=[TF202]") == 1
    plain = json.loads(capsys.readouterr().out)
    (one,) = plain["findings"]
    assert (one["where"], one["code"], one["level"]) == ("mine/0", "TF202", "error")
    known = folder / "known.json"
    assert run(folder, f"baseline={known}") == 0
    assert json.loads(known.read_text())["findings"][0] == "mine/0: TF202"
    rows = (folder / "1.csv").read_text().splitlines()
    turned = [",".join([*row.split(",")[:2], f"-{row.split(',')[2]}"]) for row in rows[1:]]
    (folder / "1.csv").write_text("\n".join([rows[0], *turned]).replace("--", "") + "\n")
    capsys.readouterr()
    assert run(folder, f"baseline={known}") == 1
    assert "mine/1: TF202" in capsys.readouterr().out
    known.write_text("[]")
    assert run(folder, f"baseline={known}") != 0
    assert "no baseline of data check" in capsys.readouterr().err


def test_keys_are_written_where_all_agree(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "tactileforge.yaml").read_text()
    assert run(folder, "fix=true", "select=[TF308]") == 1
    assert "layout mine: wrote mirror: x" in capsys.readouterr().out
    assert (folder / "tactileforge.yaml.before").read_text() == before
    assert run(folder, "select=[TF308]") == 0
    upright = made_touch(1).frames.read(range(0, 90, 3))
    for number, frame in enumerate(upright):
        cv2.imwrite(str(folder / "1" / f"{number:03d}.png"), np.ascontiguousarray(frame[..., ::-1]))
    (folder / "tactileforge.yaml").write_text(before)
    assert run(folder, "fix=true", "select=[TF308]") == 1
    assert (folder / "tactileforge.yaml").read_text() == before, "it would break the other"


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("0.csv", "unreadable: labels: 0.csv is left out: byte 9 is not UTF-8"),
        ("0.xls", "unreadable: labels: 0.xls and 1 more are left out: a spreadsheet"),
    ],
)
def test_forces_that_a_guess_leaves_out_are_a_fault(
    folder: Path, capsys: pytest.CaptureFixture[str], name: str, told: str
) -> None:
    (folder / "tactileforge.yaml").unlink()
    whole = folder.with_name("whole")
    shutil.copytree(folder, whole)
    for number in range(2):
        (folder / f"{number}.csv").rename(folder / f"{number}{Path(name).suffix}")
    (folder / name).write_bytes(b"fx,fy,fz\n\xff\xfe\x00")
    assert cli.run(["data", "check", str(folder), "select=[TF4]"]) == 1
    assert told in capsys.readouterr().out
    assert cli.run(["data", "check", str(whole), "select=[TF4]"]) == 0
    assert "unreadable" not in capsys.readouterr().out


def test_a_guess_of_a_path_says_how_to_correct_it(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "tactileforge.yaml").unlink()
    cli.run(["data", "check", str(folder), "frames=false"])
    how = "correct one by its key (data.layouts.guessed.sensor=NAME), or in tactileforge.yaml"
    assert how in capsys.readouterr().out
    cli.run(["data", "check", str(folder), "frames=false", "data.layouts.guessed.sensor=digi"])
    assert "unknown sensor 'digi'" in capsys.readouterr().err


@pytest.mark.slow
def test_the_lag_of_the_first_recordings_is_estimated_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By .43 s of 3: near the end of all lags, and far better than none."""
    root = tmp_path / "late"
    for seed in range(8):
        depth = np.concatenate([press(45), 0.6 * press(45)])
        one = made_touch(seed, depth=depth)
        (root / str(seed)).mkdir(parents=True)
        for number, frame in enumerate(one.frames.read(range(90))):
            cv2.imwrite(str(root / str(seed) / f"{number:03d}.jpg"), frame[..., ::-1])
        assert one.force is not None
        rows = np.roll(one.force, 13, axis=0)
        lines = ["fx,fy,fz", *(",".join(f"{axis:.4f}" for axis in row) for row in rows)]
        (root / f"{seed}.csv").write_text("\n".join(lines) + "\n")
    layout = '{images: "*/*.jpg", each: sequence, fps: 30, sensor: digit, background: {first: 2}, '
    layout += 'force: {file: "{stem}.csv", columns: [fx, fy, fz]}}'
    (root / "tactileforge.yaml").write_text(f"layouts:\n  mine: {layout}\n")
    for words, count in ([], 6), (["lag=true"], 8), (["select=[TF2]"], 0), (["ignore=[lag]"], 0):
        run(root, *words)
        assert capsys.readouterr().out.count("TF104 images come 0.43 s before forces") == count
