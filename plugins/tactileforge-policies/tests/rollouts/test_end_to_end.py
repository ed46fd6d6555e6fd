"""The real task in miniature: demonstrations, policies trained on them, and their rollouts."""

import json

import pytest

from tactileforge import cli

SMALL = [
    "scale=demo",
    "init=null",
    "encoder.image_size=32",
    "encoder.depth=1",
    "trainer.max_epochs=1",
]
SMALL += ["head.denoise.channels=[8,8]", "head.denoise.step_width=8", "batch.size=16"]


@pytest.mark.slow
def test_demonstrations_training_and_rollouts_of_the_chip(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["task=chip", "size=32", "processes=1"]
    assert cli.run(["demos", *words, "n=2", "out=demos"]) == 0
    data = ["recipe=diffusion_policy", "data=demonstrations", "data.root=demos"]
    for name, touch, n in (("touch", "frames", 2), ("none", "none", 1)):
        trained = ["train", *data, *SMALL, f"data.touch={touch}", f"hydra.run.dir={name}"]
        assert cli.run(trained) == 0
        assert cli.run(["rollout", *words, f"policy={name}", f"n={n}", f"out=of-{name}"]) == 0
        rows = json.loads((tmp_path / f"of-{name}/results.json").read_text())["episodes"]
        assert [row["seed"] for row in rows] == list(range(n))
        assert all((tmp_path / f"of-{name}" / row["video"]).is_file() for row in rows)
        assert all(0 < row["steps"] <= 120 for row in rows)
    # Repeated rollouts of a policy are equal.
    first = json.loads((tmp_path / "of-touch/episodes/00000.json").read_text())["force"]
    assert cli.run(["rollout", *words, "policy=touch", "n=1", "out=again"]) == 0
    assert json.loads((tmp_path / "again/episodes/00000.json").read_text())["force"] == first
    # The error names a sensor outside of the policy's training.
    assert cli.run(["rollout", *words, "policy=touch", "sensor=gelsight_mini", "out=x"]) == 1
    assert "give sensor=digit, or cross_sensor=true" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [["demos", "task=chip"], ["rollout", "task=chip", "policy=expert"]],
    ids=["demos", "rollout"],
)
def test_a_verb_looks_at_its_place_before_it_works(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert cli.run([*words, "out=file/a"]) == 1
    assert "is a file, not a folder); give another out=" in capsys.readouterr().err
    assert [path.name for path in tmp_path.rglob("*")] == ["file"]
