"""A run goes on with its data in another place, and with no other data."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactileforge import cli
from tactileforge.runs.folder import read_config


def _videos(folder, frames=(30, 34), force=0.0):
    folder.mkdir()
    rng = np.random.default_rng(0)
    for number, count in enumerate(frames):
        still = rng.integers(60, 180, (8, 8, 3)).astype(np.uint8)
        (folder / f"press_{number}").mkdir()
        for i in range(count):
            shade = cv2.resize(still, (64, 64)) + np.uint8(i)
            cv2.imwrite(str(folder / f"press_{number}" / f"{i:04d}.png"), shade)
        rows = "".join(f"{i / 30},0,0,{i / 20 + force}\n" for i in range(count))
        (folder / f"press_{number}.csv").write_text("t,fx,fy,fz\n" + rows)
    keys = 'images: "*/*.png", each: sequence, sensor: digit, fps: 30, background: {first: 1}'
    keys += ", force: {file: '{stem}.csv', columns: [fx, fy, fz], times: t}"
    layout = f"layouts:\n  one: {{{keys}}}\n"
    (folder / "tactileforge.yaml").write_text(layout)


@pytest.mark.slow
def test_the_same_data_elsewhere_and_other_data(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _videos(tmp_path / "job_1")
    words = ["data=recordings", "data.val=0", "scale=demo", "encoder.image_size=32", "batch.size=4"]
    words += ["objective=[pixel]", "batch.workers=0", "hydra.run.dir=run", "trainer.max_steps=1"]
    assert cli.run(["train", "data.root=job_1", *words]) == 0
    shutil.move("job_1", "job_2")
    go_on = ["train", "resume=run", "trainer.max_steps=2"]
    assert cli.run(go_on) == 1
    assert "data.root" in capsys.readouterr().err
    assert cli.run([*go_on, "data.root=job_2"]) == 0
    assert read_config(tmp_path / "run")["data"]["root"] == str(tmp_path / "job_2")
    shutil.move("job_2", "job_4")
    assert cli.run(["report", "run"]) == 1
    assert cli.run(["report", "run", "data.root=job_4"]) == 0
    assert cli.run(["report", "run"]) == 1, "the command before it leaves nothing behind"
    shutil.move("job_4", "job_2")
    capsys.readouterr()
    _videos(tmp_path / "job_3", (30, 35))
    assert cli.run(["train", "resume=run", "trainer.max_steps=3", "data.root=job_3"]) == 1
    assert "the recordings are not those of the run" in capsys.readouterr().err
    assert cli.run(["train", "resume=run", "trainer.max_steps=3", "data.sources.a.root=job_2"]) == 1
    assert "no such key" in capsys.readouterr().err
    # the command before it leaves nothing behind in the process
    assert cli.run(["train", "resume=run", "trainer.max_steps=3"]) == 0
    assert "the labels of the recordings" not in _log()
    _videos(tmp_path / "job_5", force=0.1)
    assert cli.run(["train", "resume=run", "trainer.max_steps=4", "data.root=job_5"]) == 0
    assert "the labels of the recordings" in _log()


def _log():
    return Path("run/train.log").read_text()
