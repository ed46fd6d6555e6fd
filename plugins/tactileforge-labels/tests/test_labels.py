"""Labels by hand: proposals, CSVs, requests, bad input, and the page in a browser."""

import base64
import json
import subprocess
import sys
import urllib.error
import urllib.request

import cv2
import numpy as np
import pytest
from browser import BROWSER, Browser
from tactileforge_labels.label import COMMANDS
from tactileforge_labels.marks import Marks, no_marks, parse_marks, read_marks, write_marks
from tactileforge_labels.propose import SlipMotion, imprint, propose
from tactileforge_labels.server import LabelAnswers
from tactileforge_labels.session import ConflictError, LabelSession, csv_path
from waiting import wait_until

from tactileforge.plugin import (
    ArrayFrames,
    ConfigError,
    ContactOptions,
    DataError,
    LocalPage,
    Recording,
    build,
    locked,
)
from tactileforge.testing import check

FPS, COUNT = 30, 60
#: First frame of contact, of slip, after slip, and after contact.
PRESSED, SLIPS, STOPS, LIFTED = 10, 25, 40, 52


def film():
    """A dot is pressed, slides by 2 pixels a frame, and is lifted; uint8 (60, 96, 128, 3)."""
    rows, columns = np.mgrid[0:96, 0:128]
    frames = np.full((COUNT, 96, 128, 3), 100, np.uint8)
    for i in range(PRESSED, LIFTED):
        place = 40 + 2 * (np.clip(i, SLIPS, STOPS) - SLIPS)
        frames[i][(rows - 48) ** 2 + (columns - place) ** 2 < 14**2] = 180
    return frames


def recording(frames, key="a", background=True):
    return Recording(
        key=key,
        sensor="digit",
        frames=ArrayFrames(frames),
        times=np.arange(len(frames)) / FPS,
        no_contact=ArrayFrames(frames[:3]) if background else None,
    )


@pytest.fixture(scope="session")
def still_frames():
    return film()


@pytest.fixture
def touches(tmp_path, still_frames):
    """A folder of two sequences of images, and the options of its data set."""
    for name in ("one", "two"):
        folder = tmp_path / "touches" / name
        folder.mkdir(parents=True)
        for i, frame in enumerate(still_frames):
            cv2.imwrite(str(folder / f"{i}.png"), frame)
    layout = {"images": "*/*.png", "each": "sequence", "fps": FPS, "sensor": "digit"}
    layout["background"] = {"first": 3}
    options = {"root": str(tmp_path / "touches"), "layouts": {"mine": layout}, "val": 0}
    return {"name": "recordings", **options}


@pytest.fixture
def session(touches, tmp_path):
    folder = tmp_path / "touches" / "labels"
    return LabelSession(build("datasets", touches), folder, ContactOptions(), SlipMotion())


@pytest.fixture
def page(session):
    answers = LabelAnswers(session)
    with LocalPage(answers.get, answers.post) as page:
        yield page


def ask(url, body=None, **headers):
    """Status and body of a request."""
    data = None if body is None else json.dumps(body).encode()
    try:
        with urllib.request.urlopen(
            urllib.request.Request(url, data, headers), timeout=20
        ) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()


def got(url):
    status, body = ask(url)
    assert status == 200, body
    return json.loads(body)


STATES = [
    [0, PRESSED, "free"],
    [PRESSED, SLIPS, "contact"],
    [SLIPS, STOPS, "slip"],
    [STOPS, LIFTED, "contact"],
    [LIFTED, COUNT, "free"],
]


def test_a_made_touch_is_proposed_as_it_was_made(still_frames):
    made = recording(still_frames)
    seen = imprint(made, made.background(), 8.0)
    # the dot covers pi 14^2 of 96 x 128 pixels, and some more squares at its rim
    share = np.pi * 14**2 / (96 * 128)
    assert share <= seen.area[PRESSED] <= 1.7 * share
    assert seen.area[0] == 0
    assert np.isnan(seen.center[0]).all()
    # its place in shorter sides, to a pixel
    np.testing.assert_allclose(seen.center[PRESSED], [40 / 96, 48 / 96], atol=1 / 96)
    np.testing.assert_allclose(seen.center[STOPS], [70 / 96, 48 / 96], atol=1 / 96)
    state = propose(seen, made.times, ContactOptions(), SlipMotion())
    assert np.flatnonzero(state > 0).tolist() == [*range(PRESSED, LIFTED)]
    slips = np.flatnonzero(state == 2)
    assert abs(slips[0] - SLIPS) <= 2  # the window reaches a frame and a half
    assert abs(slips[-1] - STOPS) <= 2
    assert len(slips) == slips[-1] - slips[0] + 1
    # 2 pixels of 96 at 30 frames a second are .625 shorter sides per second
    slow = propose(seen, made.times, ContactOptions(), SlipMotion(speed=0.8))
    assert 2 not in slow


def test_an_imprint_that_grows_is_no_slip():
    rows, columns = np.mgrid[0:96, 0:128]
    frames = np.full((20, 96, 128, 3), 100, np.uint8)
    for i in range(5, 20):  # it grows to one side, so its centre moves
        frames[i][(np.abs(rows - 48) < 20) & (columns > 20) & (columns < 30 + 6 * (i - 5))] = 180
    made = recording(frames)
    seen = imprint(made, made.background(), 8.0)
    strict = propose(seen, made.times, ContactOptions(), SlipMotion(area=0.05))
    assert 2 not in strict
    assert (strict[5:] == 1).all()


def test_single_frames_and_low_rates_have_proposals():
    made = recording(film()[[0, 20]])
    seen = imprint(made, np.full((96, 128, 3), 100, np.uint8), 8.0)
    times = np.array([0.0, 10.0])
    assert propose(seen, times, ContactOptions(), SlipMotion()).tolist() == [0, 1]
    with pytest.raises(ConfigError, match="slip: give speed, window and area above 0"):
        SlipMotion(speed=0)


def test_what_is_written_is_read_back(tmp_path):
    state = np.array([-1, 0, 1, 2, 2], np.int8)
    marks = Marks(state, np.array([False, True, False, False, True]))
    write_marks(tmp_path / "x" / "a.csv", marks, np.arange(5) / 30)
    rows = (tmp_path / "x" / "a.csv").read_text().splitlines()
    assert rows[0] == "frame,time,contact,slip,bad"
    assert rows[1:] == [
        "0,0.000000,,,0",
        "1,0.033333,0,0,1",
        "2,0.066667,1,0,0",
        "3,0.100000,1,1,0",
        "4,0.133333,1,1,1",
    ]
    again = read_marks(tmp_path / "x" / "a.csv", 5)
    assert again.message() == marks.message()
    assert [path.name for path in (tmp_path / "x").iterdir()] == ["a.csv"]  # no part is left
    assert parse_marks(marks.message(), 5).message() == marks.message()


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("7,0,0,0", "frame '7' does not exist, the recording has 0 to 4"),
        ("-1,0,0,0", "frame '-1' does not exist"),
        ("0,0,0,0\n0,0,0,0", "frame 0 has a row already"),
        ("0,0,1,0", "no slip without contact"),
        ("0,yes,0,0", "'yes'"),
        ("0,1,0,2", "'2'"),
        ("0,1,0,0,0", "more cells"),
    ],
)
def test_a_csv_that_is_damaged_names_its_row(row, said, tmp_path):
    (tmp_path / "a.csv").write_text(f"frame,contact,slip,bad\n{row}\n")
    with pytest.raises(DataError, match=said) as caught:
        read_marks(tmp_path / "a.csv", 5)
    assert "a.csv, row" in str(caught.value)


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ({"states": [[0, 6, "slip"]], "bad": []}, "lies outside the recording, which has 5 frames"),
        ({"states": [[-1, 2, "slip"]], "bad": []}, "outside"),
        ({"states": [[2, 2, "slip"]], "bad": []}, "outside"),
        ({"states": [], "bad": [[4, 9]]}, "outside"),
        ({"states": [[0, 2, "slips"]], "bad": []}, "did you mean 'slip'"),
        ({"states": [[0, 3, "slip"], [2, 4, "free"]], "bad": []}, "overlaps"),
        ({"states": [[0, 1.5, "slip"]], "bad": []}, "an interval is"),
        ({"states": [[True, 2, "slip"]], "bad": []}, "an interval is"),
        ({"states": "slip", "bad": []}, "a list"),
        ({"states": [[0, 1, ["slip"]]], "bad": []}, "state"),
        ({"bad": []}, "no states"),
        ([1], "no states"),
    ],
)
def test_intervals_that_do_not_fit_are_refused(message, said):
    with pytest.raises(DataError, match=said):
        parse_marks(message, 5)


def test_the_page_and_its_pictures(page):
    status, body = ask(page.url)
    assert status == 200
    assert b"NONCE" not in body
    assert b"http" not in body
    listed = got(page.url + "recordings")
    assert [one["key"] for one in listed["recordings"]] == ["mine/one", "mine/two"]
    assert {one["frames"] for one in listed["recordings"]} == {COUNT}
    for what, level in (("frame/0/20", 180), ("difference/0/20", 128 + 2 * 80)):
        picture = cv2.imdecode(np.frombuffer(ask(page.url + what)[1], np.uint8), cv2.IMREAD_COLOR)
        middle = picture[picture.shape[0] // 2, picture.shape[1] * 40 // 128]
        assert abs(int(middle[0]) - min(level, 255)) <= 4
    for path in (
        "frame/0/60",
        "frame/9/0",
        "frame/0",
        "marks/9",
        "marks/x",
        "other",
        "marks/0/1/2",
    ):
        assert ask(page.url + path)[0] == 404


def test_only_who_has_the_token_may_write(page, tmp_path):
    body = {"revision": 0, "states": [], "bad": []}
    base = page.url.removesuffix(f"{page.token}/")
    assert ask(base + "marks/0", body)[0] == 403
    assert ask(page.url + "marks/0", body, Host="evil.example")[0] == 403
    assert ask(page.url + "marks/0", body, Origin="http://evil.example")[0] == 403
    assert not (tmp_path / "touches" / "labels" / "mine").exists()
    assert ask(page.url + "marks/7", body)[0] == 404
    assert ask(page.url + "frame/0", body)[0] == 404
    request = urllib.request.Request(page.url + "marks/0", b"{", {})
    with pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(request, timeout=20)
    caught.value.close()
    assert caught.value.code == 400


def test_marks_become_tracks_of_the_layout(page, touches, tmp_path):
    proposed = got(page.url + "proposal/0")
    assert [name for _, _, name in proposed["states"]] == [name for _, _, name in STATES]
    assert len(proposed["change"]) == COUNT
    status, body = ask(page.url + "marks/0", {"revision": 0, "states": STATES, "bad": [[30, 32]]})
    assert status == 200, body
    file = tmp_path / "touches" / "labels" / "mine" / "one.csv"
    assert json.loads(body) == {"revision": 1, "labeled": 1.0, "file": str(file)}
    touches["layouts"]["mine"]["tracks"] = {
        "file": "labels/mine/{file}{crop}.csv",
        "frame": "frame",
        "columns": ["contact", "slip"],
        "drop": "bad",
    }
    data = build("datasets", touches)
    one, two = data.recordings("train")
    kept = [i for i in range(COUNT) if i not in (30, 31)]
    np.testing.assert_allclose(one.times, np.array(kept) / FPS)
    contact = [float(PRESSED <= i < LIFTED) for i in kept]
    assert one.tracks["contact"].tolist() == contact
    assert one.tracks["slip"].tolist() == [float(SLIPS <= i < STOPS) for i in kept]
    assert dict(two.tracks) == {}
    # a second look continues where the first ended, with the frames that are left out
    again = LabelSession(
        build("datasets", {**touches, "tracks": False}),
        tmp_path / "touches" / "labels",
        ContactOptions(),
        SlipMotion(),
    )
    assert again.marks(0)["states"] == STATES
    assert again.marks(0)["bad"] == [[30, 32]]
    assert len(again.marks(0)["times"]) == COUNT


def test_two_windows_do_not_overwrite_each_other(page):
    first = {"revision": 0, "states": [[0, 5, "free"]], "bad": []}
    assert ask(page.url + "marks/0", first)[0] == 200
    status, body = ask(page.url + "marks/0", {**first, "states": []})
    assert status == 409
    assert b"another window has written its marks" in body
    assert got(page.url + "marks/0")["states"] == [[0, 5, "free"]]
    status, body = ask(page.url + "marks/0", {**first, "revision": 1, "states": [[0, 99, "free"]]})
    assert status == 400
    assert b"outside the recording" in body
    assert got(page.url + "marks/0")["states"] == [[0, 5, "free"]]


def test_a_damaged_csv_is_named_and_left_as_it_is(touches, tmp_path):
    file = tmp_path / "labels" / "mine" / "one.csv"
    file.parent.mkdir(parents=True)
    file.write_text("frame,contact,slip,bad\n99,1,0,0\n")
    made = LabelSession(
        build("datasets", touches), tmp_path / "labels", ContactOptions(), SlipMotion()
    )
    problem = made.overview()["recordings"][0]["problem"]
    assert "one.csv, row 2: frame '99' does not exist" in problem
    with pytest.raises(DataError, match="frame '99'"):
        made.write(0, {"revision": 0, "states": [], "bad": []})
    assert file.read_text().endswith("99,1,0,0\n")
    assert made.overview()["recordings"][1]["problem"] == ""


class Given:
    """A data set of given recordings."""

    provides = frozenset()

    def __init__(self, *recordings):
        self.given, self.skipped = recordings, ["cut.mp4: no frame can be decoded"]

    def recordings(self, split):
        return self.given if split == "train" else ()


def test_recordings_that_cannot_be_labelled_are_named(tmp_path, still_frames):
    keys = ["a", "../b", "/c", "a", "d[0:5]", "e\n"]
    data = Given(*(recording(still_frames[:5], key) for key in keys))
    made = LabelSession(data, tmp_path, ContactOptions(), SlipMotion())
    assert [one.recording.key for one in made.entries] == ["a"]
    assert len(made.skipped) == 6
    assert made.skipped[-1] == "cut.mp4: no frame can be decoded"
    assert "'../b': its key is not a name of a file" in made.skipped[0]
    assert csv_path(tmp_path, "a\\..\\b") is None
    with pytest.raises(ConfigError, match=r"no recording to label: cut\.mp4"):
        LabelSession(Given(), tmp_path, ContactOptions(), SlipMotion())


def test_without_a_background_nothing_is_proposed(tmp_path, still_frames):
    data = Given(recording(still_frames[:5], background=False))
    made = LabelSession(data, tmp_path, ContactOptions(), SlipMotion())
    proposal = made.proposal(0)
    assert proposal["states"] == []
    assert "nothing is proposed" in proposal["none"]
    assert made.picture(0, 1, difference=True) is None


class Torn(ArrayFrames):
    def read(self, indices):
        raise DataError("a.mp4: frame 3 cannot be decoded")


def test_a_frame_that_cannot_be_decoded_is_said_on_the_page(tmp_path, still_frames):
    torn = recording(still_frames[:5])
    object.__setattr__(torn, "frames", Torn(still_frames[:5]))
    answers = LabelAnswers(LabelSession(Given(torn), tmp_path, ContactOptions(), SlipMotion()))
    for path in ("frame/0/3", "proposal/0"):
        answer = answers.get(path, {})
        assert (answer.status, answer.body) == (422, b"a.mp4: frame 3 cannot be decoded\n")
    assert answers.post("marks/0", b'{"revision": 0, "states": [], "bad": [[3, 4]]}').status == 200


def run(*words):
    command = [sys.executable, "-m", "tactileforge", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def test_the_verb_passes_the_checks_of_verbs():
    results = check("verb", "label")
    assert not [result for result in results if result.status == "failed"]
    assert COMMANDS[""].about.startswith("Marks contact, slip and bad frames by hand")


@pytest.mark.slow
def test_the_command_serves_a_page_and_ends(touches, tmp_path):
    (tmp_path / "touches" / "tactileforge.yaml").write_text(
        json.dumps({"layouts": touches["layouts"]})
    )
    words = ("label", "data=recordings", f"data.root={touches['root']}", "seconds=0.1")
    done = run(*words)
    assert done.returncode == 0, done.stderr
    lines = [one for one in done.stdout.splitlines() if not one.startswith("note: ")]
    folder = f"{touches['root']}/labels"
    assert lines[0] == f"2 recordings, CSVs in {folder}"
    assert lines[1].startswith("page: http://127.0.0.1:")
    assert lines[2] == f"0 of 2 recordings have a CSV in {folder}"
    assert "  label " in run("--help").stdout
    with locked(tmp_path / "touches" / "labels" / ".lock", "held by {holder}"):
        second = run(*words)
    assert second.returncode == 1
    assert second.stderr.startswith(f"error: {folder} is labeled by process")
    assert second.stderr.count("\n") == 1
    (tmp_path / "file").write_text("")
    refused = run(*words, f"out={tmp_path / 'file' / 'labels'}")
    assert refused.returncode == 1
    assert "cannot be written" in refused.stderr
    assert refused.stderr.count("\n") == 1
    without = run("label", "data=sim", "seconds=0.1")
    assert without.stderr == "error: give out=FOLDER for the CSVs: this data has no root\n"


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is here")
@pytest.mark.slow
def test_a_recording_is_labelled_with_keys_alone(page, tmp_path):
    file = tmp_path / "touches" / "labels" / "mine" / "one.csv"
    with Browser(tmp_path / "profile") as browser:
        look = browser.show(page.url, 1280)

        def until(text):
            wait_until(lambda: look(f"!!({text})"), 120, f"not on the page: {text}")
            assert look(f"!!({text})"), look("document.body.innerText")

        def keys(*names, shift=False):
            for name in names:
                browser.press(look.session, name, shift)

        until("now && now.proposed && !busy")
        keys("ArrowRight", shift=True)  # to frame 10
        keys("ArrowLeft", "n")  # 0 to 9 are free, and the next interval begins at 10
        assert look("now.here") == look("now.mark") == PRESSED
        keys("ArrowRight", "c", "u")
        marks = "JSON.stringify(message(now).states)"
        assert json.loads(look(marks)) == [[0, PRESSED, "free"]]
        keys("p")
        assert json.loads(look(marks)) == got(page.url + "proposal/0")["states"]
        keys("End", "m", "b")
        assert "1 unsaved" in look("find('top').textContent")
        leave = "new Event('beforeunload', {cancelable: true})"
        assert not look(f"window.dispatchEvent({leave})")
        keys("w")
        until("!unsaved().length")
        assert look(f"window.dispatchEvent({leave})")
        marks = read_marks(file, COUNT)
        assert (marks.state >= 0).all()
        assert np.flatnonzero(marks.bad).tolist() == [COUNT - 1]
        keys("ArrowDown")
        until("now && now.number === 1 && now.proposed && !busy")
        assert look("find('name').textContent") == "mine/two (digit)"
        assert look("document.documentElement.scrollWidth") <= 1280
        picture = browser("Page.captureScreenshot", look.session)["data"]
        assert len(base64.b64decode(picture)) > 10_000


MARKED = {"states": [[0, 2, "contact"]], "bad": []}


def test_a_row_edited_by_another_program_is_a_conflict(session):
    assert session.write(0, {**MARKED, "revision": 0})["revision"] == 1
    file = session.entries[0].path
    edited = file.read_text().replace("\n5,0.166667,,,0", "\n5,0.166667,1,1,1")
    file.write_text(edited)
    mine = {"states": [[0, 3, "contact"]], "bad": [[7, 9]], "revision": 1}
    with pytest.raises(ConflictError, match=r"another program has changed .*reload\. Your marks"):
        session.write(0, mine)
    assert file.read_text() == edited, "what was edited stays"
    kept = read_marks(file.with_name(f"{file.name}.conflict"), COUNT)
    assert kept.message() == {"states": [[0, 3, "contact"]], "bad": [[7, 9]]}, "and so do marks"
    after = session.marks(0)
    assert after["revision"] == 2
    assert [5, 6, "slip"] in after["states"], "a page that is loaded again shows the edit"
    assert session.write(0, {**MARKED, "revision": 2})["revision"] == 3


@pytest.mark.parametrize("change", ["made", "removed", "damaged"])
def test_a_file_that_comes_goes_or_breaks_meanwhile_is_a_conflict(session, change):
    file = session.entries[0].path
    if change != "made":
        session.write(0, {**MARKED, "revision": 0})
    revision = session.entries[0].revision
    if change == "removed":
        file.unlink()
    else:
        file.parent.mkdir(parents=True, exist_ok=True)
        row = "0,0,9,0,0" if change == "damaged" else "0,0,1,0,0"
        file.write_text(f"frame,time,contact,slip,bad\n{row}\n")
    with pytest.raises(ConflictError):
        session.write(0, {**MARKED, "revision": revision})
    assert file.is_file() == (change != "removed")
    if change == "damaged":
        with pytest.raises(DataError, match="give 0 or 1"):
            session.write(0, {**MARKED, "revision": revision + 1})
    else:
        assert session.write(0, {**MARKED, "revision": revision + 1})["labeled"] > 0


def test_marks_that_lost_their_end_are_named(tmp_path):
    path = tmp_path / "marks.csv"
    write_marks(path, no_marks(4), np.arange(4) / 10)
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.rindex(b",,,0")])
    with pytest.raises(DataError, match="row 5: no end of the line"):
        read_marks(path, 4)
    path.write_bytes(whole)
    assert (read_marks(path, 4).state == -1).all()
