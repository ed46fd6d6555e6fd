"""A class of one's own wherever a name is typed: trained, and shown by --help and --explain."""

import pytest
from lightning.pytorch.loggers import CSVLogger

from tactileforge import cli, compose
from tactileforge.errors import PluginError
from tactileforge.pages.curves import read_metrics
from tactileforge.runs.checkpoint_file import read_checkpoint
from tactileforge.training.loggers import own_logger
from tactileforge.verbs import words

MINE = '''
from pathlib import Path

import numpy as np
import torch
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.loggers.logger import Logger

from tactileforge.contracts import Frame, Recording, Sensor, SensorSpec
from tactileforge.data import ArrayFrames
from tactileforge.encoders import TactileViT
from tactileforge.heads import PixelHead
from tactileforge.objectives import Pixel


class Tiny(TactileViT):
    """A small one.

    Args:
        depth: Blocks, so many.
    """

    def __init__(self, depth: int = 1) -> None:
        super().__init__("tiny", depth=depth, image_size=32)
        print("tiny of", depth)


class Noise:
    """Noise as touch.

    Args:
        count: Touches, so many.
    """

    provides = frozenset({"force"})

    def __init__(self, count: int = 6) -> None:
        self.count, self.skipped = count, []
        print("noise of", count)

    def recordings(self, split):
        for i in range(self.count if split == "train" else 2):
            draw = np.random.default_rng(i)
            frames = ArrayFrames(draw.integers(0, 255, (12, 32, 32, 3), dtype=np.uint8))
            yield Recording(
                key=f"{split}{i}",
                sensor="digit",
                frames=frames,
                times=np.arange(12) / 30.0,
                no_contact=None,
                force=draw.normal(size=(12, 3)).astype(np.float32),
                source="made",
                licence="CC0-1.0",
            )

    def plot(self, recording):
        from matplotlib import pyplot

        return pyplot.figure()


class Own(PixelHead):
    """A head.

    Args:
        loud: How loud, so loud.
    """

    def __init__(self, encoder, loud: int = 1) -> None:
        super().__init__(encoder)
        print("head of", loud)


class Fill(Pixel):
    """Pixels by another head.

    Args:
        scale: Factor, so large.
    """

    head = Own

    def __init__(self, scale: float = 1.0) -> None:
        super().__init__()
        print("fill of", scale)


class Steps(torch.optim.SGD):
    """Plain steps.

    Args:
        lr: Length, so long.
        momentum: Share, so much.
    """

    def __init__(self, params, lr: float = 1e-3, momentum: float = 0.5) -> None:
        super().__init__(params, lr=lr, momentum=momentum)
        print("steps of", momentum)


class Counts(Callback):
    """Counts.

    Args:
        word: What it says, so loud.
    """

    def __init__(self, word: str = "step") -> None:
        self.word = word

    def on_train_batch_end(self, trainer, *rest) -> None:
        print(self.word, trainer.global_step)


class Lines(Logger):
    """Writes lines.

    Args:
        file: Where to, so named.
    """

    name, version = "lines", ""

    def __init__(self, file: str = "lines.txt") -> None:
        super().__init__()
        self.file = file

    def log_hyperparams(self, params, *rest) -> None:
        self._write("config", params["seed"])

    def log_metrics(self, metrics, step=None) -> None:
        self._write(step, *metrics)

    def _write(self, *words) -> None:
        with Path(self.file).open("a") as file:
            print(*words, file=file)


class Fades:
    """Changes a batch."""

    def __init__(self, by: int = 1) -> None:
        print("fades by", by)
        self.by = by

    def __call__(self, batch):
        print("faded", int(batch["frames"].float().mean() > 0))
        return {"frames": batch["frames"] // self.by}


class Finger(Sensor):
    """A grey gel.

    Args:
        grey: How grey, so grey.
    """

    spec = SensorSpec(
        name="finger", height=32, width=32, fps=30.0, area_mm=None, force_scale=(5.0, 5.0, 10.0)
    )

    def __init__(self, grey: int = 100) -> None:
        self.grey = grey

    def discover(self):
        return ["here"]

    def open(self) -> None:
        print("finger of", self.grey)

    def read(self, timeout: float = 1.0) -> Frame:
        import time

        time.sleep(0.01)
        return Frame(array=np.full((32, 32, 3), self.grey, np.uint8), time=time.monotonic())

    def close(self) -> None:
        pass


def flat(step: int, steps: int, warmup: int) -> float:
    """Half of the rate."""
    return 0.5
'''
SMALL = ["recipe=mae", "scale=tiny", "debug=steps", "batch.size=4", "batch.workers=0"]
#: Words that choose each, one of its options, and what the option means.
WORDS = {
    "encoder": ("encoder=./mine.py:Tiny", "encoder.depth=2", "Blocks, so many."),
    "data": ("data=mine:Noise", "data.count=16", "Touches, so many."),
    "objective": ("objective=[mine:Fill]", "objective.fill.scale=2.0", "Factor, so large."),
    "head": ("+head=[mine:Own]", "+head.own.loud=3", "How loud, so loud."),
    "optim": ("optim=./mine.py:Steps", "optim.momentum=0.25", "Share, so much."),
    "callbacks": (
        "callbacks=[mine:Counts]",
        "callbacks.counts.word=hear",
        "What it says, so loud.",
    ),
    "logger": ("logger=./mine.py:Lines", "logger.file=said.txt", "Where to, so named."),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """One folder for all: a process imports ``mine`` once."""
    made = tmp_path_factory.mktemp("own")
    (made / "mine.py").write_text(MINE)
    return made


@pytest.fixture
def folder(place, monkeypatch):
    monkeypatch.chdir(place)
    return place


@pytest.mark.slow
def test_all_of_them_train_together(folder, capsys):
    chosen = [word for key, row in WORDS.items() if key != "head" for word in row[:2]]
    chosen += ["optim.schedule=mine:flat", "head.fill.loud=3"]
    chosen += ["augment.also={fades: {name: mine:Fades, by: 2}}"]
    assert cli.run(["train", *SMALL, *chosen, "hydra.run.dir=run"]) == 0
    said = capsys.readouterr().out
    for word in ("tiny of 2", "noise of 16", "fill of 2.0", "head of 3", "steps of 0.25", "hear 2"):
        assert word in said
    assert said.count("fades by 2") == 1
    assert said.count("faded 1") == 2, "once a step"
    lines = (folder / "said.txt").read_text().splitlines()
    assert lines[0] == "config 0"
    assert "train/fill" in lines[1]
    curves = read_metrics(folder / "run")
    assert curves["train/fill"].steps.tolist()[-1] == 1
    rate = curves["lr"].values[-1]
    assert rate == pytest.approx(0.5e-3)


def test_changes_of_batches_may_be_listed(folder):
    config = compose("mae", ["data=mine:Noise", "augment.also=[mine:Fades]"])
    assert config["augment"]["also"] == {"fades": {"name": "mine:Fades"}}
    with pytest.raises(PluginError, match=r"augment\.also\.fads=mine:Fads.*'?Fades"):
        compose("mae", ["data=mine:Noise", "augment.also=[mine:Fads]"])


@pytest.mark.parametrize("group", WORDS)
def test_help_shows_the_options_with_their_meaning(group, folder, capsys):
    word, option, meaning = WORDS[group]
    assert cli.run(["train", word.lstrip("+"), "--help"]) == 0
    said = capsys.readouterr().out
    assert meaning in said
    assert f"  {option.partition('=')[0].rpartition('.')[2]}: " in said


@pytest.mark.slow
@pytest.mark.parametrize("group", [key for key in WORDS if key != "head"])
def test_explain_says_where_a_value_comes_from(group, folder, capsys):
    word, option, _ = WORDS[group]
    key, _, value = option.partition("=")
    assert cli.run(["train", *SMALL, word, option, "--explain", key]) == 0
    said = capsys.readouterr().out
    assert value in said
    assert "command line" in said or option in said
    key = key.rpartition(".")[0] + ".name"
    assert cli.run(["train", *SMALL, word, option, "--explain", key]) == 0
    assert word.partition("=")[2].strip("[]") in capsys.readouterr().out


@pytest.mark.slow
def test_a_sweep_and_two_processes_have_them_too(folder, warm):
    chosen = [*SMALL, "data=mine:Noise", "objective=[pixel,mine:Fill]", "encoder=./mine.py:Tiny"]
    swept = ["train", "-m", *chosen, "objective.fill.scale=1,2", "hydra.sweep.dir=swept"]
    assert warm.start(*swept).wait(300) == 0
    assert len([*(folder / "swept").glob("*/metrics.csv")]) == 2
    assert "mine:Fill" in (folder / "swept" / "1" / "config.yaml").read_text()
    two = ["trainer.devices=2", "trainer.accelerator=cpu", "data.count=32", "hydra.run.dir=two"]
    assert warm.start("train", *chosen, *two).wait(300) == 0
    assert read_metrics(folder / "two")["train/fill"].values[0] > 0
    assert read_checkpoint(folder / "two")["global_step"] == 2


@pytest.mark.slow
def test_a_sensor_records(folder, capsys):
    word = "sensor=./mine.py:Finger"
    assert cli.run(["record", word, "--help"]) == 0
    said = capsys.readouterr().out
    assert "How grey, so grey." in said
    assert cli.run(["record", word, "sensor.finger.grey=7", "--explain", "sensor.finger.grey"]) == 0
    assert "7" in capsys.readouterr().out
    more = ["sensor.finger.grey=7", "seconds=0.3", "background.seconds=0", "out=touches"]
    assert cli.run(["record", word, *more]) == 0, capsys.readouterr().err
    assert "finger of 7" in capsys.readouterr().out
    assert list((folder / "touches").rglob("*.tar"))


def test_a_logger_from_python_is_a_class_or_an_instance():
    for given, place in ((CSVLogger("kept"), "kept"), (CSVLogger, "typed")):
        (word,) = words([], {"logger": given})
        more = [] if place == "kept" else ["logger.save_dir=typed"]
        node = compose("anytouch2", ["scale=demo", "objective=[pixel]", word, *more])["logger"]
        assert own_logger(node).save_dir == place


@pytest.mark.slow
@pytest.mark.parametrize(
    ("slip", "told"),
    [
        (["logger.fil=x"], "logger.file"),
        (["logger.file=[1]"], "logger.file is [1]"),
        (["logger=mine:Noise"], "has no log_metrics, no log_hyperparams: derive it from Logger of"),
        (["logger=mine:Nope"], "Known: "),
        (["logger=tensorbord"], "tensorboard"),
    ],
)
def test_a_slip_with_a_logger_is_one_line(slip, told, folder, capsys):
    given = ["logger=./mine.py:Lines", *slip] if "." in slip[0].partition("=")[0] else slip
    assert cli.run(["train", *SMALL, "data=mine:Noise", "objective=[pixel]", *given]) == 1
    error = capsys.readouterr().err
    assert told in error
    assert "Traceback" not in error
