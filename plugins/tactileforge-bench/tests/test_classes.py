"""A folder of images by class: one command, predictions, a confusion matrix, `model.classify`."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tactileforge_bench
import torch
from omegaconf import OmegaConf
from PIL import Image
from safetensors.torch import load_file, save_file
from tactileforge_bench.results.load import read_results
from tactileforge_bench.results.predictions import read_predictions
from tactileforge_bench.results.results import NotRun
from tactileforge_bench.results.scores import sentences
from tactileforge_bench.tasks.class_folders import class_task

import tactileforge
from tactileforge import cli
from tactileforge.data.labels.objects import object_class
from tactileforge.datasets import Recordings
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError
from tactileforge.heads.classify import ClassifyHead
from tactileforge.hub.classify import read_class_head
from tactileforge.hub.files import make_header, save_checkpoint
from tactileforge.pages import percent

NODE = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32}
NAMES = ("bar", "disc", "ring")


def image(name: str, number: int) -> np.ndarray:
    """A bar, a disc or a ring somewhere, lit as noise lets it."""
    rng = np.random.default_rng([NAMES.index(name), number])
    y, x = np.mgrid[:64, :64] - (32 + rng.integers(-8, 9, (2, 1, 1)))
    r = np.hypot(x, y)
    shape = {"bar": abs(x) < 4, "disc": r < 14, "ring": (r < 16) & (r > 10)}[name]
    grey = 90 + 90 * shape[..., None] + rng.normal(0, 6, (64, 64, 3))
    return grey.clip(0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a bench, run by the documented command."""
    folder = tmp_path_factory.mktemp("classes")
    for name in NAMES:
        (folder / "photos" / name).mkdir(parents=True)
        for number in range(16):
            ending = ("png", "PNG", "BMP", "tiff")[number % 4]  # of cameras and of programs
            photo = folder / "photos" / name / f"{number}.{ending}"
            Image.fromarray(image(name, number)).save(photo)
    torch.manual_seed(0)
    vit = TactileViT("tiny", frames=4, image_size=32)
    header = make_header(vit, NODE, licence="MIT", spacing=0.05, recipe={"encoder": NODE})
    save_checkpoint(folder / "mine.safetensors", vit, header)
    words = [f"classes.root={folder}/photos", "classes.sensor=digit", f"out={folder}/out"]
    words += [f"model=[file:{folder}/mine.safetensors,pixels]", f"cache={folder}/cache"]
    assert cli.run(["bench", "suite=classes", *words, "workers=0", "seeds=1"]) == 0
    return folder


def head_of(folder: Path) -> Path:
    (path,) = (folder / "out" / "heads").iterdir()
    return path


@pytest.mark.slow
def test_predictions_and_a_confusion_matrix_are_written(done: Path) -> None:
    mine, pixels = read_results(done / "out").cells
    assert mine.metrics["accuracy"] > 80, "chance is a third"
    assert pixels.model == "pixels"
    with (done / "out" / mine.predictions).with_suffix(".csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 48
    assert all(row["clip"].split("/")[1] == row["truth"] for row in rows)
    right = sum(row["truth"] == row["predicted"] for row in rows) / 48
    assert 100 * right == pytest.approx(mine.metrics["accuracy"], abs=1e-4)
    page = (done / "out" / "report.html").read_text()
    assert f"{round(48 * right)} of 48 right" in page
    assert 'id="confusions"' in page


@pytest.mark.slow
def test_probabilities_and_wrong_images_are_told(done: Path) -> None:
    """In the table, and on the page with both names and the confidence, the most certain first."""
    cell = next(cell for cell in read_results(done / "out").cells if cell.model == "pixels")
    with (done / "out" / cell.predictions).with_suffix(".csv").open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        shares = {name: float(row[f"probability of {name}"]) for name in NAMES}
        assert sum(shares.values()) == pytest.approx(1, abs=2e-4)
        assert shares[row["predicted"]] == float(row["probability"]) == max(shares.values())
    wrong = [row for row in rows if row["truth"] != row["predicted"]]
    surest = max(wrong, key=lambda row: float(row["probability"]))
    one = read_predictions(done / "out" / cell.predictions)
    assert one.clips[one.wrong[0]] == surest["clip"]
    assert len(one.wrong) == min(len(wrong), 24)
    name, number = surest["clip"].split("/")[1], int(surest["clip"].split("/")[2].split(".")[0])
    small = np.asarray(Image.fromarray(image(name, number)).resize((96, 96)))
    assert np.array_equal(one.pictures[0], small)
    page = (done / "out" / "report.html").read_text()
    assert f"{len(wrong)} of 48 wrong" in page
    said = percent(float(surest["probability"]))
    assert f"labelled {surest['truth']}, taken for {surest['predicted']}, {said}" in page


def folders(root: Path, **sides: int) -> Path:
    for side, count in sides.items():
        for name in NAMES:
            (root / side / name).mkdir(parents=True)
            for number in range(count):
                photo = root / side / name / f"{number}.png"
                Image.fromarray(image(name, number + 100 * len(side))).save(photo)
    return root


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sides", "tested"),
    [
        ({"train": 8, "val": 3}, "val"),
        ({"Train": 8, "test": 3}, "test"),
        ({"train": 8, "val": 3, "test": 4}, "test"),
    ],
)
def test_folders_of_train_and_val_are_taken_as_they_are(tmp_path, sides, tested):
    root = folders(tmp_path / "parts", **sides)
    words = [f"classes.root={root}", "classes.sensor=digit", "model=pixels", "workers=0"]
    words += [f"cache={tmp_path}/cache", f"out={tmp_path}/out"]
    assert cli.run(["bench", "suite=classes", *words]) == 0
    (cell,) = read_results(tmp_path / "out").cells
    with (tmp_path / "out" / cell.predictions).with_suffix(".csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * sides[tested]
    assert {row["clip"].split("/")[1] for row in rows} == {tested}
    assert all(row["clip"].split("/")[2] == row["truth"] for row in rows)
    words[-1] = f"out={tmp_path}/folds"
    assert cli.run(["bench", "suite=classes", "classes.folds=2", *words]) == 0
    (cell,) = read_results(tmp_path / "folds").cells
    assert len(read_predictions(tmp_path / "folds" / cell.predictions).truth) == 3 * sum(
        sides.values()
    )


def test_folders_of_train_and_val_become_layouts_that_a_folder_of_touches_reads(tmp_path):
    root = folders(tmp_path / "parts", train=2, val=1)
    path = Path(tactileforge_bench.__file__).parent / "conf/suite/classes.yaml"
    classes = {"root": str(root), "sensor": "digit", "images": ["*/*.png"], "folds": None}
    classes |= {"background": "none", "group": ["recording"]}
    suite = OmegaConf.merge(OmegaConf.load(path), {"classes": classes})
    given: Any = OmegaConf.to_container(suite, resolve=True)
    task = class_task(given["tasks"]["classes"], given["classes"])
    data = Recordings(root, layouts=task["data"]["layouts"], val=0.0)
    found = {side: [one.key for one in data.recordings(side)] for side in ("train", "val")}
    assert {key.split("/")[1] for key in found["train"]} == {"train"}
    assert {key.split("/")[1] for key in found["val"]} == {"val"}
    assert [len(keys) for keys in found.values()] == [2 * len(NAMES), len(NAMES)]


def test_a_folder_of_one_side_alone_and_keys_that_are_not_given_are_told(tmp_path, capsys):
    root = folders(tmp_path / "parts", train=1)
    words = ["bench", "suite=classes", "classes.sensor=digit", "model=pixels", f"out={tmp_path}/o"]
    assert cli.run([*words, f"classes.root={root}"]) == 1
    said = capsys.readouterr().err
    assert f"no folder val or test beside it: add it, or give classes.root={root}/train" in said
    assert cli.run(words) == 1
    assert "give classes.root=DIR" in capsys.readouterr().err
    assert cli.run(["bench", "suite=sim", f"classes.root={root}", "model=pixels"]) == 1
    assert "goes with suite=classes" in capsys.readouterr().err


@pytest.mark.slow
def test_every_file_has_the_permissions_of_the_umask(done: Path) -> None:
    (done / "plain").touch()
    usual = (done / "plain").stat().st_mode
    files = [path for path in (done / "out").rglob("*") if path.is_file()]
    assert head_of(done) in files
    assert {path.stat().st_mode for path in files} == {usual}
    assert (done / "mine.safetensors").stat().st_mode == usual


@pytest.mark.slow
def test_a_model_classifies_with_the_head(done: Path) -> None:
    model = tactileforge.load(done / "mine.safetensors")
    new = [(name, image(name, number)) for name in NAMES for number in range(100, 110)]
    clips = np.stack([np.stack([pixels] * 4) for _, pixels in new])
    found = model.classify(clips, "none", "digit", head=head_of(done))
    assert found.names == NAMES
    assert torch.allclose(found.probability.sum(1), torch.ones(30), atol=1e-5)
    right = [said == name for said, (name, _) in zip(found.name, new, strict=True)]
    assert np.mean(right) > 0.8
    still = model.classify(new[0][1], "none", "digit", head=read_class_head(head_of(done)))
    assert torch.allclose(still.probability, found.probability[0], atol=1e-5)
    assert still.name == found.name[0]
    stills = clips[:, 0]
    several = model.classify(stills[:, None], "none", "digit", head=head_of(done))
    assert torch.equal(several.probability, found.probability)
    with pytest.raises(
        DataError, match=r"30 frames in .* single images, one per clip.*X\[:, None\]"
    ):
        model.classify(stills, "none", "digit", head=head_of(done))
    rounded = tactileforge.load(done / "mine.safetensors", dtype="bfloat16")
    nearly = rounded.classify(clips, "none", "digit", head=head_of(done))
    assert torch.allclose(nearly.probability, found.probability, atol=0.05)


@pytest.mark.slow
def test_a_head_of_another_model_and_a_damaged_one_are_refused(done: Path, tmp_path: Path) -> None:
    model = tactileforge.load(done / "mine.safetensors")
    with torch.no_grad():
        next(model.encoder.parameters()).add_(1)
    with pytest.raises(ConfigError, match="fitted to another encoder"):
        model.classify(image("bar", 1), "none", "digit", head=head_of(done))
    model = tactileforge.load(done / "mine.safetensors")
    still = np.full((64, 64, 3), 90, np.uint8)
    with pytest.raises(ConfigError, match=r"without a background: background='none'"):
        model.classify(image("bar", 1), still, "digit", head=head_of(done))
    with pytest.raises(ConfigError, match="pictures of digit, not of gelsight"):
        model.classify(image("bar", 1), "none", "gelsight", head=head_of(done))
    with pytest.raises(ConfigError, match="is the image itself"):
        model.classify(image("bar", 1), "first", "digit", head=head_of(done))
    bad = tmp_path / "bad.safetensors"
    save_file(load_file(head_of(done)), bad)
    with pytest.raises(DataError, match="not a head of classes"):
        read_class_head(bad)
    bad.write_bytes(head_of(done).read_bytes()[:-4])
    with pytest.raises(DataError, match="not a head of classes"):
        read_class_head(bad)
    with pytest.raises(ConfigError, match="suite=classes"):
        model.classify(image("bar", 1), "none", "digit")


def test_the_head_of_a_run_chooses_among_names(tmp_path: Path) -> None:
    """Its logits at the rows of the objects, numbered by their names."""
    from tactileforge.data.labels.objects import object_id

    torch.manual_seed(1)
    vit = TactileViT("tiny", frames=4, image_size=32).eval()
    head = ClassifyHead(vit, classes=64)
    head.met[[object_id(name) % 64 for name in NAMES]] = True
    heads = {"classify": {"node": {"name": "classify", "classes": 64}}}
    header = make_header(vit, NODE, licence="MIT", spacing=0.05, heads=heads)
    save_checkpoint(tmp_path / "a.safetensors", vit, header, heads={"classify": head})
    heads["classify"]["names"] = list(NAMES)
    header = make_header(vit, NODE, licence="MIT", spacing=0.05, heads=heads)
    save_checkpoint(tmp_path / "named.safetensors", vit, header, heads={"classify": head})
    model = tactileforge.load(tmp_path / "a.safetensors")
    clip = np.stack([image("ring", 3)] * 4)
    found = model.classify(clip, "none", "digit", names=NAMES)
    vector = model.encode(clip, "none", "digit")
    logits = head.linear(vector)[[object_id(name) % 64 for name in NAMES]]
    assert torch.allclose(found.probability, logits.softmax(0), atol=1e-5)
    named = tactileforge.load(tmp_path / "named.safetensors").classify(clip, "none", "digit")
    assert (named.names, named.name) == (NAMES, found.name)
    assert torch.equal(named.probability, found.probability)
    with pytest.raises(ConfigError, match="names: give"):
        model.classify(clip, "none", "digit")
    with pytest.raises(ConfigError, match="share a class"):
        model.classify(clip, "none", "digit", names=["bar", "bar"])
    with pytest.raises(ConfigError, match="not trained on 'mug'; give names"):
        model.classify(clip, "none", "digit", names=["bar", "mug"])


def test_a_list_is_a_batch_of_images_of_any_size(tmp_path: Path) -> None:
    torch.manual_seed(1)
    vit = TactileViT("tiny", frames=4, image_size=32).eval()
    head = ClassifyHead(vit, classes=64)
    head.met[[object_class(name, 64) for name in NAMES]] = True
    heads = {"classify": {"node": {"name": "classify", "classes": 64}, "names": list(NAMES)}}
    header = make_header(vit, NODE, licence="MIT", spacing=0.05, heads=heads)
    save_checkpoint(tmp_path / "a.safetensors", vit, header, heads={"classify": head})
    model = tactileforge.load(tmp_path / "a.safetensors")
    stills = [image("ring", 3), image("bar", 1)[:48], image("ring", 4), image("bar", 2)]
    Image.fromarray(stills[0]).save(tmp_path / "a.png")
    given = [tmp_path / "a.png", Image.fromarray(stills[1]), stills[2], torch.tensor(stills[3])]
    found = model.classify(given, "none", "digit")
    alone = [model.classify(one, "none", "digit").probability for one in stills]
    assert torch.allclose(found.probability, torch.stack(alone), atol=1e-5)
    # a background and a sensor for each
    of_each = [np.full_like(one, 90) for one in stills]
    sensors = ["digit", "gelsight", "digit", "gelsight"]
    found = model.classify(stills, of_each, sensors)
    alone = [model.classify(*one).probability for one in zip(stills, of_each, sensors, strict=True)]
    assert torch.allclose(found.probability, torch.stack(alone), atol=1e-5)
    # clips, as arrays or lists
    clips = [np.stack([one] * 4) for one in stills]
    assert torch.allclose(
        model.classify(clips, of_each, sensors).probability, found.probability, atol=1e-5
    )
    with pytest.raises(DataError, match="an empty list; give images"):
        model.classify([], "none", "digit")
    for itself in (stills, given, given[0], given[1]):
        with pytest.raises(ConfigError, match="is the image itself"):
            model.classify(itself, "first", "digit")
    model.heads["classify"].met[:] = True
    with pytest.raises(ConfigError, match="kept 3 of the 64 names that it was trained on"):
        model.classify(stills, "none", "digit")


def test_images_that_are_absent_are_told_by_keys_of_this_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [f"classes.root={tmp_path}/photo", "classes.sensor=digit", "model=[pixels]"]
    words += [f"out={tmp_path}/out", f"cache={tmp_path}/cache", "workers=0"]
    assert cli.run(["bench", "suite=classes", *words]) == 1
    assert f"classes.root={tmp_path}/photo: no such folder; give one" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    (tmp_path / "photo" / "bar").mkdir(parents=True)
    assert cli.run(["bench", "suite=classes", *words, f"out={tmp_path}/other"]) == 3
    said = capsys.readouterr().out
    assert "no file matches" in said
    assert " data." not in said


def test_broken_images_are_all_named_together(tmp_path: Path, capsys) -> None:
    root = folders(tmp_path / "photos", train=4) / "train"
    images = sorted(root.rglob("*.png"))
    for path in images[:3]:
        path.write_bytes(path.read_bytes()[:100])  # the header is whole, the pixels are not
    for path in images[3:7]:
        path.write_bytes(b"no image")
    words = [f"classes.root={root}", "classes.sensor=digit", "model=[pixels]", "workers=0"]
    words += [f"out={tmp_path}/out", f"cache={tmp_path}/cache"]
    assert cli.run(["bench", "suite=classes", *words]) == 3
    said = " ".join(capsys.readouterr().out.split())
    assert "7 recordings cannot be read, and the benchmark skips none; mend or remove them" in said
    assert "; and 2 more" in said
    for path in images[3:7]:
        path.unlink()
    assert cli.run(["bench", "suite=classes", *words, f"out={tmp_path}/again"]) == 1
    said = capsys.readouterr().err
    assert "3 recordings cannot be read" in said
    assert all(path.name in said for path in images[:3])


def test_a_reason_starts_with_a_capital_and_a_path_stays_as_it_is() -> None:
    assert sentences(NotRun(reason="labels of one class")) == "Labels of one class."
    gone = NotRun(reason="photos: no such folder", fix="Download it from https://a.b.")
    assert sentences(gone) == "photos: no such folder. Download it from https://a.b."
