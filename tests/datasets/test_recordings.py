import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from omegaconf import OmegaConf
from PIL import Image

from tactileforge.contracts import ACTIONS, Dataset, Frames, Recording
from tactileforge.data.frames import video
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError, DataError, DataNotFoundError

MakeFile = Callable[..., Path]
VIDEO = {"videos": "*.avi", "sensor": "digit", "background": {"first": 3}}
IMAGES = {"images": "*.png", "each": "touch", "sensor": "digit", "background": "none"}


def read(root: Path, split: str = "train", **layout: Any) -> list[Recording]:
    """The recordings of one layout, none held out."""
    return list(Recordings(str(root), {"a": layout}, val=0).recordings(split))


def levels(frames: Frames | None) -> list[int]:
    """Numbers in the frames."""
    assert frames is not None
    shown: NDArray[np.uint8] = frames.read(range(len(frames)))
    return [round(float(frame.mean()) / 7) for frame in shown]


def test_videos(tmp_path: Path, make_video: MakeFile) -> None:
    for name in ("b/10.avi", "b/9.avi", "a.avi"):
        make_video(name, count=12, fps=20)
    more = {"source": "us", "licence": "MIT", "tier": 4, "videos": "**/*.avi"}
    recordings = read(tmp_path, **VIDEO | more)
    assert [recording.key for recording in recordings] == ["a/a.avi", "a/b/9.avi", "a/b/10.avi"], (
        "natural order"
    )
    recording = recordings[0]
    assert (recording.sensor, recording.source, recording.licence, recording.tier) == (
        "digit",
        "us",
        "MIT",
        4,
    )
    assert (len(recording.frames), recording.frames.shape) == (12, (32, 48))
    np.testing.assert_allclose(recording.times, np.arange(12) / 20)
    assert levels(recording.frames) == list(range(12))
    assert levels(recording.no_contact) == [0, 1, 2]
    assert (
        recording.force
        is recording.action
        is recording.object
        is recording.text
        is recording.image
        is None
    )
    assert levels(pickle.loads(pickle.dumps(recording)).frames) == list(range(12))


def test_fps_overrides_a_video(tmp_path: Path, make_video: MakeFile) -> None:
    make_video("a.avi", count=4, fps=30)
    np.testing.assert_allclose(read(tmp_path, **VIDEO | {"fps": 10})[0].times, [0, 0.1, 0.2, 0.3])


def test_images_that_are_touches(tmp_path: Path, make_image: MakeFile) -> None:
    for i in (10, 2, 1):
        make_image(f"{i}.png", i)
    make_image("still.png", 30)
    recordings = read(tmp_path, **IMAGES | {"background": {"file": "still.png"}})
    assert [recording.key for recording in recordings] == ["a/1.png", "a/2.png", "a/10.png"]
    assert [levels(recording.frames) for recording in recordings] == [[1], [2], [10]]
    assert levels(recordings[0].no_contact) == [30], "the background itself is not a touch"
    assert recordings[0].times.tolist() == [0]


def test_image_sequences(tmp_path: Path, make_image: MakeFile) -> None:
    for folder in ("x", "y"):
        for i in range(11):
            make_image(f"{folder}/f{i}.png", i)
        make_image(f"{folder}/f3/0.png", 0)
    layout = IMAGES | {"images": "**/*.png", "each": "sequence", "fps": 25}
    by_key = {recording.key: recording for recording in read(tmp_path, **layout)}
    assert sorted(by_key) == ["a/x", "a/x/f3", "a/y", "a/y/f3"]
    assert levels(by_key["a/x"].frames) == list(range(11))
    np.testing.assert_allclose(by_key["a/x"].times, np.arange(11) / 25)


@pytest.mark.parametrize(
    ("background", "want"),
    [
        ({"first": 2}, [0, 1]),
        ({"last": 2}, [27, 28]),
        ({"median": True}, list(range(0, 29, 2))),
        ({"file": "still.png"}, [33]),
        ({"file": "other/b.avi", "last": 3}, [6, 7, 8]),
    ],
)
def test_backgrounds(
    tmp_path: Path,
    make_video: MakeFile,
    make_image: MakeFile,
    background: dict[str, Any],
    want: list[int],
) -> None:
    make_video("a.avi", count=29)
    make_video("other/b.avi", count=9)
    make_image("still.png", 33)
    assert levels(read(tmp_path, **VIDEO | {"background": background})[0].no_contact) == want


def test_no_background_is_said_and_then_nothing_is_subtracted(
    tmp_path: Path, make_video: MakeFile
) -> None:
    make_video("a.avi")
    assert read(tmp_path, **VIDEO | {"background": "none"})[0].no_contact is None


def test_a_background_that_does_not_fit(
    tmp_path: Path, make_video: MakeFile, make_image: MakeFile
) -> None:
    make_video("a.avi")
    make_image("still.png", size=(30, 48))
    with pytest.raises(DataError, match=r"still\.png: the background has 48x30 .*a\.avi 48x32"):
        read(tmp_path, **VIDEO | {"background": {"file": "still.png"}})
    with pytest.raises(DataNotFoundError, match=r"gone\.png: no such file"):
        read(tmp_path, **VIDEO | {"background": {"file": "gone.png"}})
    make_video("b.mov.avi", count=3)
    with pytest.raises(DataError, match=r"b\.mov\.avi: a video as background: say which frames"):
        read(tmp_path, **VIDEO | {"background": {"file": "b.mov.avi"}})


@pytest.mark.parametrize("key", ["background", "camera"])
def test_a_touch_whose_other_files_are_damaged_is_left_out(
    tmp_path: Path, make_image: MakeFile, key: str
) -> None:
    for i in range(3):
        make_image(f"{i}.png", i)
        make_image(f"more/{i}.png", i)
    (tmp_path / "more/1.png").write_bytes(b"half a png")
    more = {"background": {"file": "more/{stem}.png"}, "camera": "more/{stem}.png"}
    data = Recordings(str(tmp_path), {"a": {**IMAGES, key: more[key]}}, val=0)
    keys = [recording.key for recording in data.recordings("train")]
    assert keys == ["a/0.png", "a/2.png"]
    (line,) = data.skipped
    assert "more/1.png: not a readable image" in line


@pytest.mark.parametrize("pattern", ["**.png", "/tmp/*.png"])
@pytest.mark.parametrize("key", ["images", "camera"])
def test_a_pattern_that_is_none_is_named(
    tmp_path: Path, make_image: MakeFile, key: str, pattern: str
) -> None:
    make_image("0.png")
    with pytest.raises(ConfigError, match=r"layout 'a': pattern .*give a path from .*on, with"):
        read(tmp_path, **IMAGES | {key: pattern})


def test_a_background_for_each_file(tmp_path: Path, make_image: MakeFile) -> None:
    for i in (1, 2):
        make_image(f"{i}/touch.png", i)
        make_image(f"{i}/still.png", 10 * i)
    layout = {"images": "*/touch.png", "background": {"file": "{folder}/still.png"}}
    recordings = read(tmp_path, **IMAGES | layout)
    assert [levels(recording.no_contact) for recording in recordings] == [[10], [20]]
    everything = read(tmp_path, **IMAGES | layout | {"images": "*/*.png"})
    assert [recording.key for recording in everything] == ["a/1/touch.png", "a/2/touch.png"]
    sequences = {"images": "*/*.png", "each": "sequence", "fps": 30}
    sequences["background"] = {"file": "{stem}/still.png"}
    in_order = read(tmp_path, **IMAGES | sequences)
    assert [levels(recording.frames) for recording in in_order] == [[1], [2]]
    assert [levels(recording.no_contact) for recording in in_order] == [[10], [20]]


def test_crops_are_recordings_of_their_own(
    tmp_path: Path, make_video: MakeFile, make_image: MakeFile
) -> None:
    make_video("a.avi", count=5)
    make_image("still.png", 9)
    crops = {
        "left": {"box": [0, 0, 20, 32], "sensor": "gelsight"},
        "right": {"box": [20, 2, 28, 30]},
    }
    layout = VIDEO | {"crops": crops, "object": "cup", "background": {"file": "still.png"}}
    left, right = read(tmp_path, **layout)
    assert (left.key, left.sensor, left.frames.shape) == ("a/a.avi#left", "gelsight", (32, 20))
    assert (right.key, right.sensor, right.frames.shape) == ("a/a.avi#right", "digit", (30, 28))
    assert left.object == right.object == "cup"
    assert right.no_contact is not None
    assert right.no_contact.shape == right.frames.shape


def test_labels(tmp_path: Path, make_video: MakeFile, write: MakeFile) -> None:
    for name in ("a.avi", "b.avi", "c.avi"):
        make_video(name, count=4)
    write(
        "labels.csv",
        "file,thing,hard,rough,with,do\na.avi,red_cup,2,0.5,gelsight,press\nb.avi,ball,,,digit,\n",
    )
    layout = VIDEO | {
        "labels": {"file": "labels.csv"},
        "words": {"hard": {2: "hard"}},
        "object": "{thing}",
        "text": ["{action} a {thing}", "{hard}"],
        "sensor": "digit",
        "action": "{do}",
    }
    a, b, c = read(tmp_path, **layout)
    assert (a.object, b.object, c.object) == ("red_cup", "ball", None)
    assert (a.text, b.text, c.text) == ("{action} a red cup, hard", "{action} a ball", None)
    assert a.labels["hard"] == 2
    assert a.labels["rough"] == 0.5
    assert a.labels["thing"] == "red_cup"
    assert b.labels == {"file": "b.avi", "thing": "ball", "with": "digit"}
    assert a.action is not None
    assert b.action is not None
    assert a.action.tolist() == [ACTIONS.index("press")] * 4
    assert b.action.tolist() == [-1] * 4


def test_the_sensor_may_be_a_column(tmp_path: Path, make_video: MakeFile, write: MakeFile) -> None:
    for name in ("a.avi", "b.avi"):
        make_video(name, count=4)
    labels = VIDEO | {"labels": {"file": "l.csv"}, "sensor": "{with}"}
    write("l.csv", "file,with\na.avi,gelsight\nb.avi,digit\n")
    assert [recording.sensor for recording in read(tmp_path, **labels)] == ["gelsight", "digit"]
    write("l.csv", "file,with\na.avi,gelsight\nb.avi,digitt\n")
    with pytest.raises(ConfigError, match=r"l\.csv, row 3: unknown sensor 'digitt'.*'digit'"):
        read(tmp_path, **labels)
    write("l.csv", "file,with\na.avi,gelsight\nb.avi,\n")
    with pytest.raises(DataError, match=r"l\.csv, row 3: no sensor; fill in"):
        read(tmp_path, **labels)


def test_a_row_that_names_no_file(tmp_path: Path, make_video: MakeFile, write: MakeFile) -> None:
    make_video("a.avi", count=4)
    write("l.csv", "file,kind\na.avi,cup\nb.avi,ball\n")
    with pytest.raises(DataError, match=r"l\.csv, row 3: 'b\.avi' names no file in .*'a\.avi'"):
        read(tmp_path, **VIDEO | {"labels": {"file": "l.csv"}})


FORCE = {"file": "{stem}.csv", "columns": ["x", "y", "z"], "sign": [1, 1, -1]}


def test_force_and_its_actions(tmp_path: Path, make_video: MakeFile, write: MakeFile) -> None:
    make_video("a.avi", count=60)
    write("a.csv", "x,y,z\n" + "".join(f"0,0,{-0.1 * i}\n" for i in range(60)))
    (recording,) = read(tmp_path, **VIDEO | {"force": FORCE})
    assert recording.force is not None
    assert recording.action is not None
    np.testing.assert_allclose(recording.force[:, 2], 0.1 * np.arange(60), rtol=1e-6)
    assert set(recording.action[10:]) == {ACTIONS.index("press")}
    (silent,) = read(tmp_path, **VIDEO | {"force": FORCE, "action": "none"})
    assert silent.action is None
    with pytest.raises(DataNotFoundError, match=r"gone\.csv: no such CSV"):
        read(tmp_path, **VIDEO | {"force": FORCE | {"file": "gone.csv"}})


def test_nan_is_no_label_and_an_infinite_force_an_error(
    tmp_path: Path, make_video: MakeFile, write: MakeFile
) -> None:
    make_video("a.avi", count=4)
    write("a.csv", "x,y,z\n0,0,1\n0,nan,1\n0,0,1\n0,0,1\n")
    (recording,) = read(tmp_path, **VIDEO | {"force": FORCE})
    assert recording.force is not None
    np.testing.assert_array_equal(recording.force, [[0, 0, -1], [0, np.nan, -1], *[[0, 0, -1]] * 2])
    write("a.csv", "x,y,z\n0,0,1\n0,inf,1\n0,0,1\n0,0,1\n")
    with pytest.raises(DataError, match=r"a\.csv, row 3, column 'y': 'inf' is not a finite number"):
        read(tmp_path, **VIDEO | {"force": FORCE})


def test_actions(tmp_path: Path, make_video: MakeFile, write: MakeFile) -> None:
    make_video("a.avi", count=5)
    press, leave = ACTIONS.index("press"), ACTIONS.index("leave")

    def actions(given: object) -> list[int]:
        (recording,) = read(tmp_path, **VIDEO | {"action": given})
        assert recording.action is not None
        return recording.action.tolist()

    assert actions("press") == [press] * 5
    ranges = [{"frames": [0, 2], "action": "press"}, {"frames": [4, 5], "action": "leave"}]
    assert actions(ranges) == [press, press, -1, -1, leave]
    write("a.csv", "frame,what\n3,leave\n")
    per_frame = {"file": "{stem}.csv", "frame": "frame", "column": "what"}
    assert actions(per_frame) == [-1, -1, -1, leave, -1]
    with pytest.raises(DataError, match=r"a\.avi: it has 5 frames, .* to \[4, 9\]"):
        actions([{"frames": [4, 9], "action": "press"}])


def test_camera_views(tmp_path: Path, make_video: MakeFile, make_image: MakeFile) -> None:
    make_video("a.avi", count=4)
    make_image("a.png", 7, size=(20, 20))
    make_video("cam/a.avi", count=9, size=(16, 24))
    for i in range(3):
        make_image(f"a/{i}.png", i)
    for pattern, want in (("{stem}.png", [7]), ("cam/{stem}.avi", list(range(9)))):
        assert levels(read(tmp_path, **VIDEO | {"camera": pattern})[0].image) == want
    assert levels(read(tmp_path, **VIDEO | {"camera": "{stem}/*.png"})[0].image) == [0, 1, 2]
    with pytest.raises(DataNotFoundError, match=r"no camera view of a\.avi matches 'a\.jpg'"):
        read(tmp_path, **VIDEO | {"camera": "{stem}.jpg"})


def test_a_corrupt_recording_is_left_out_and_listed(tmp_path: Path, make_video: MakeFile) -> None:
    for i in range(3):
        make_video(f"{i}.avi")
    path = tmp_path / "1.avi"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    data = Recordings(str(tmp_path), {"a": VIDEO}, val=0)
    for _ in range(2):
        assert [recording.key for recording in data.recordings("train")] == ["a/0.avi", "a/2.avi"]
    (line,) = data.skipped
    assert "1.avi" in line
    assert "truncated" in line


def test_a_recording_that_is_all_background_is_left_out(
    tmp_path: Path, make_video: MakeFile
) -> None:
    make_video("a.avi", count=3)
    make_video("b.avi", count=4)
    data = Recordings(str(tmp_path), {"a": VIDEO}, val=0)
    assert [recording.key for recording in data.recordings("train")] == ["a/b.avi"]
    assert "a.avi: 3 frames, all of them background" in data.skipped[0]


def test_sizes_that_differ_inside_a_sequence(tmp_path: Path, make_image: MakeFile) -> None:
    for i in range(3):
        make_image(f"x/{i}.png")
        make_image(f"y/{i}.png")
    make_image("y/2.png", size=(30, 48))
    layout = IMAGES | {"images": "*/*.png", "each": "sequence", "fps": 25}
    data = Recordings(str(tmp_path), {"a": layout}, val=0)
    assert [recording.key for recording in data.recordings("train")] == ["a/x"]
    assert "one size" in data.skipped[0]


def test_nothing_but_corrupt_recordings(tmp_path: Path) -> None:
    for i in range(3):
        (tmp_path / f"{i}.avi").write_bytes(b"no video")
    with pytest.raises(DataError, match=r"not one of 3 recordings can be opened; .*0\.avi: not a"):
        read(tmp_path, **VIDEO)


def test_missing_data_names_the_folder_and_the_fix(tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError, match=r"gone/sub: no such folder; set data\.root"):
        read(tmp_path / "gone", **VIDEO | {"path": "sub"})
    with pytest.raises(DataNotFoundError, match=r"no file matches '\*\.avi'; set data\.root"):
        read(tmp_path, **VIDEO)
    with pytest.raises(DataNotFoundError, match=r"gone: no such folder; set data\.root"):
        list(Recordings(str(tmp_path / "gone")).recordings("train"))


def test_without_a_layout_the_error_shows_one_that_works(
    tmp_path: Path, make_video: MakeFile
) -> None:
    make_video("a.mp4.avi")
    data = Recordings(str(tmp_path), guess=False)
    assert data.provides == frozenset()
    with pytest.raises(DataNotFoundError, match=r"tactileforge\.yaml: no such file") as caught:
        list(data.recordings("train"))
    shown = str(caught.value).split("for example:\n")[1]
    (tmp_path / "tactileforge.yaml").write_text(shown.replace("*.mp4", "*.avi"))
    assert len(list(Recordings(str(tmp_path), val=0).recordings("train"))) == 1


def test_a_layout_that_ships_with_the_data(
    tmp_path: Path, make_video: MakeFile, write: MakeFile
) -> None:
    make_video("a.avi")
    write(
        "tactileforge.yaml",
        'layouts: {x: {videos: "*.avi", sensor: digit, object: cup, background: {first: 1}}}',
    )
    data = Recordings(str(tmp_path), val=0)
    assert data.provides == {"object"}
    assert [recording.key for recording in data.recordings("train")] == ["x/a.avi"]
    write("tactileforge.yaml", "layout: {}")
    with pytest.raises(ConfigError, match=r"tactileforge\.yaml 'layout'; did you mean 'layouts'"):
        list(Recordings(str(tmp_path)).recordings("train"))
    write("tactileforge.yaml", "{}")
    with pytest.raises(ConfigError, match=r"tactileforge\.yaml: 'layouts' is missing; for example"):
        list(Recordings(str(tmp_path)).recordings("train"))
    write("tactileforge.yaml", "layouts:\n\tx: 1\n")
    with pytest.raises(
        ConfigError, match=r"tactileforge\.yaml: not YAML: line 2, column 1:"
    ) as told:
        list(Recordings(str(tmp_path)).recordings("train"))
    assert "\n" not in str(told.value)
    write("tactileforge.yaml", "")
    with pytest.raises(ConfigError, match="expected names and values, found nothing"):
        list(Recordings(str(tmp_path)).recordings("train"))
    (tmp_path / "tactileforge.yaml").rename(tmp_path / "tactileforge.yml")
    with pytest.raises(DataNotFoundError, match=r"rename tactileforge\.yml to tactileforge\.yaml$"):
        list(Recordings(str(tmp_path)).recordings("train"))
    with pytest.raises(DataNotFoundError, match="a file, and no folder"):
        list(Recordings(str(tmp_path / "tactileforge.yml")).recordings("train"))


def test_a_file_that_came_with_the_data_is_not_interpolated(
    tmp_path: Path, make_video: MakeFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a secret of this machine is packed into published shards."""
    monkeypatch.setenv("SECRET", "hunter2")
    make_video("a.avi", count=4)
    layout = "{videos: '*.avi', sensor: digit, background: none, source: '${oc.env:SECRET}'}"
    (tmp_path / "tactileforge.yaml").write_text(f"layouts: {{a: {layout}}}")
    (recording,) = Recordings(str(tmp_path), val=0).recordings("train")
    assert recording.source == "${oc.env:SECRET}"


def test_a_layout_of_aliases_without_end_is_an_error(tmp_path: Path) -> None:
    lines = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 30)]
    (tmp_path / "tactileforge.yaml").write_text("\n".join(["a0: &a0 [x]", *lines]))
    with pytest.raises(ConfigError, match=r"tactileforge\.yaml: more than 100000 values"):
        list(Recordings(str(tmp_path)).recordings("train"))


@pytest.mark.parametrize("force", ["1e39", "0,0,-2e3", "-1e6"])
def test_impossible_forces_are_named_by_file_and_row(
    tmp_path: Path, make_video: MakeFile, write: MakeFile, force: str
) -> None:
    make_video("a.avi", count=4)
    cells = force if "," in force else f"0,{force},0"
    write("a.csv", f"x,y,z\n0,0,1\n{cells}\n0,0,2\n0,0,3\n")
    layout = VIDEO | {"background": "none", "force": {"file": "{stem}.csv", "columns": list("xyz")}}
    with pytest.raises(DataError, match=r"a\.csv, row 3: a force of .* N, where digit can feel"):
        read(tmp_path, **layout)
    write("a.csv", "x,y,z\n0,0,1\n0,0,-1400\n0,0,2\n0,0,3\n")
    assert read(tmp_path, **layout)[0].force[1, 2] == -1400


def test_what_matches_and_is_no_file_is_counted(tmp_path: Path, make_video: MakeFile) -> None:
    make_video("a.avi", count=4)
    (tmp_path / "b.avi").symlink_to("nothing")
    os.mkfifo(tmp_path / "c.avi")
    (tmp_path / "d.avi").mkdir()
    data = Recordings(str(tmp_path), {"a": VIDEO | {"background": "none"}}, val=0)
    assert [one.key for one in data.recordings("train")] == ["a/a.avi"]
    assert [line.split("/")[-1] for line in data.skipped] == [
        "b.avi: no file but a link to nothing; left out",
        "c.avi: no file but a pipe, socket or device; left out",
        "d.avi: no file but a folder; left out",
    ]
    list(data.recordings("val"))
    assert len(data.skipped) == 3


def test_configurations_of_hydra(tmp_path: Path, make_video: MakeFile) -> None:
    make_video("a.avi")
    config = OmegaConf.create({"layouts": {"x": VIDEO, "off": None}})
    for layouts in (config.layouts, {"x": config.layouts.x, "off": None}):
        data = Recordings(str(tmp_path), layouts, val=0)
        assert [layout.name for layout in data.layouts] == ["x"]
        assert len(list(data.recordings("train"))) == 1


def test_constructing_reads_nothing_and_checks_what_it_can(tmp_path: Path) -> None:
    data = Recordings(str(tmp_path / "gone"), {"a": VIDEO | {"object": "cup"}})
    assert isinstance(data, Dataset)
    assert data.provides == {"object"}
    with pytest.raises(ConfigError, match="layout 'a', key sensor: unknown sensor 'digits'"):
        Recordings(str(tmp_path / "gone"), {"a": VIDEO | {"sensor": "digits"}})
    with pytest.raises(ConfigError, match="val is 1"):
        Recordings(str(tmp_path), val=1)
    with pytest.raises(ConfigError, match="unknown split 'test'"):
        list(data.recordings("test"))


def test_videos_are_indexed_without_decoding_a_frame(
    tmp_path: Path, make_video: MakeFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = make_video("0.avi", count=40).read_bytes()
    for i in range(1, 20):
        (tmp_path / f"{i}.avi").write_bytes(data)
    monkeypatch.setattr(video._OpenCvCursor, "frame", lambda *_: pytest.fail("a frame was decoded"))
    assert [len(recording.times) for recording in read(tmp_path, **VIDEO)] == [40] * 20


def test_conformance(tmp_path: Path, make_video: MakeFile) -> None:
    from tactileforge.testing import check

    for i in range(8):
        make_video(f"{i}.avi", count=60)
    layouts = {"a": VIDEO | {"hold_out": "time", "object": "cup"}}
    results = check("dataset", "recordings", root=str(tmp_path), layouts=layouts)
    assert {result.name: result.detail for result in results if result.status != "ran"} == {}


SEQUENCE = IMAGES | {"images": "*/*.png", "each": "sequence", "fps": 10}


def test_files_that_a_computer_puts_beside_pictures_are_no_frames(
    tmp_path: Path, make_image: MakeFile, write: MakeFile
) -> None:
    for i in range(3):
        make_image(f"a/{i}.png", i)
        write(f"a/._{i}.png", "\0\5\x16\7 Mac OS X")
    for name in ("Thumbs.db", "desktop.ini", ".DS_Store"):
        write(f"a/{name}", "x")
    make_image("__MACOSX/a/0.png", 9)
    make_image(".trash/0.png", 9)
    for pattern in ("*/*.png", "*/*", "**/*.png"):
        (only,) = read(tmp_path, **SEQUENCE | {"images": pattern})
        assert (only.key, levels(only.frames)) == ("a/a", [0, 1, 2])
    (asked,) = read(tmp_path, **SEQUENCE | {"images": ".trash/*.png"})
    assert levels(asked.frames) == [9], "a hidden folder that is named"


def test_an_ending_counts_in_any_case(tmp_path: Path, make_image: MakeFile) -> None:
    for i, name in enumerate(("0.png", "1.PNG", "2.Png")):
        make_image(f"a/{name}", i)
    assert levels(read(tmp_path, **SEQUENCE)[0].frames) == [0, 1, 2]
    make_image("a/1.png", 1)
    with pytest.raises(DataError, match=r"1\.(png|PNG) lies beside it, of the same name"):
        read(tmp_path, **SEQUENCE)


def test_two_spellings_of_an_ending_are_one(tmp_path: Path, make_image: MakeFile) -> None:
    both = SEQUENCE | {"images": ["*/*.jpg", "*/*.jpeg"]}
    for i, name in enumerate(("0.jpg", "1.jpeg")):
        make_image(f"a/{name}", i)
    assert len(read(tmp_path, **both)[0].frames) == 2
    make_image("a/1.jpg", 1)
    with pytest.raises(DataError, match=r"1\.(jpg|jpeg) lies beside it, of the same name"):
        read(tmp_path, **both)


def test_files_one_folder_deeper_are_pointed_at(tmp_path: Path, make_image: MakeFile) -> None:
    make_image("train/bolt/0.png")
    make_image("test/bolt/0.png")
    layout = IMAGES | {"images": "*/*.png", "object": "{folder}"}
    with pytest.raises(DataNotFoundError, match=r"one folder deeper, in test and train, .*bolt/0"):
        read(tmp_path, **layout)


def test_blue_first_and_lying_on_its_side(tmp_path: Path) -> None:
    pixels = np.zeros((4, 6, 3), np.uint8)
    pixels[0, 0] = (10, 20, 30)
    Image.fromarray(pixels).save(tmp_path / "0.png")
    layout = IMAGES | {"background": {"file": "still.png"}}
    Image.fromarray(pixels).save(tmp_path / "still.png")
    for turn, corner in ((90, (0, 3)), (180, (3, 5)), (270, (5, 0))):
        (one,) = read(tmp_path, **layout | {"channels": "bgr", "rotate": turn})
        assert one.no_contact is not None
        for frames in (one.frames, one.no_contact):
            assert frames.shape == ((4, 6) if turn == 180 else (6, 4))
            assert frames.read([0])[0][corner].tolist() == [30, 20, 10]
    for wrong, words in (
        ({"channels": "rbg"}, "unknown channels 'rbg'"),
        ({"rotate": 45}, "rotate is 45; give the degrees, clockwise"),
    ):
        with pytest.raises(ConfigError, match=words):
            read(tmp_path, **layout | wrong)


def test_mirrored_before_it_is_turned(tmp_path: Path) -> None:
    pixels = np.zeros((4, 6, 3), np.uint8)
    pixels[0, 0] = (10, 20, 30)
    for name in ("0.png", "still.png"):
        Image.fromarray(pixels).save(tmp_path / name)
    layout = IMAGES | {"background": {"file": "still.png"}}
    for mirror, turn, corner in (("x", 0, (0, 5)), ("y", 0, (3, 0)), ("x", 90, (5, 3))):
        (one,) = read(tmp_path, **layout | {"mirror": mirror, "rotate": turn})
        assert one.no_contact is not None
        for frames in (one.frames, one.no_contact):
            assert frames.read([0])[0][corner].tolist() == [10, 20, 30]
    for wrong, words in (
        ({"mirror": "z"}, "mirror is 'z'; give x"),
        ({"every": 0.5}, "every is 0.5; give the stored frames"),
        ({"background": {"frames": [3, 3]}}, "frames are .3, 3.; give the first"),
        ({"background": {"frames": [1, 2], "first": 2}}, "must be one of"),
    ):
        with pytest.raises(ConfigError, match=words):
            read(tmp_path, **layout | wrong)


def test_some_frames_as_background_and_one_of_each_that_was_stored_twice(
    tmp_path: Path, make_image: MakeFile
) -> None:
    for number in range(12):
        make_image(f"a/{number:02d}.png", number)
    layout = IMAGES | {"images": "*/*.png", "each": "sequence", "fps": 10}
    (whole,) = read(tmp_path, **layout | {"background": {"frames": [3, 6]}})
    assert whole.no_contact is not None
    films = whole.frames.read(range(12))
    assert np.array_equal(whole.no_contact.read(range(3)), films[3:6])
    (one,) = read(tmp_path, **layout | {"background": {"frames": [3, 6]}, "every": 2})
    assert np.array_equal(one.frames.read(range(6)), films[1::2])
    assert one.times == pytest.approx(whole.times[1::2])
    assert one.no_contact is not None
    assert np.array_equal(one.no_contact.read(range(3)), films[3:6])
    with pytest.raises(DataError, match="12 frames, all of them background"):
        read(tmp_path, **layout | {"background": {"frames": [12, 15]}})


def test_a_layout_of_the_data_is_left_out_by_null(
    tmp_path: Path, make_image: MakeFile, write: MakeFile
) -> None:
    make_image("0.png")
    one = "{images: '*.png', each: touch, sensor: digit, background: none}"
    write("tactileforge.yaml", f"layouts:\n  a: {one}\n  b: {one}\n")
    data = Recordings(str(tmp_path), {"a": None}, val=0)
    assert [recording.key for recording in data.recordings("train")] == ["b/0.png"]
    with pytest.raises(ConfigError, match=r"unknown layout in data\.layouts 'c'"):
        list(Recordings(str(tmp_path), {"c": None}).recordings("train"))
    with pytest.raises(ConfigError, match="every layout is null"):
        list(Recordings(str(tmp_path), {"a": None, "b": None}).recordings("train"))
