"""The page of ``live``: access, content, and appearance in a browser."""

import json
import threading
import urllib.error
import urllib.request
from http.client import HTTPConnection

import cv2
import numpy as np
import pytest
from browser import BROWSER, Browser
from tactileforge_live.server import LivePage
from tactileforge_live.session import LiveOptions, LiveSession, ShowBackground, run_session
from waiting import wait_until

from tactileforge.contracts import Frame
from tactileforge.errors import ConfigError
from tactileforge.pages.page_images import difference_image, page_jpeg


def press(frame):
    array = frame.array.copy()
    array[10:22, 8:16] = 220  # within the gel: at the border it would be light that leaks in
    return Frame(array=array, time=frame.time)


@pytest.fixture
def page(scripted):
    """A page of a sensor, pressed from its hundredth frame on."""
    sensor = scripted(fps=50.0, events=dict.fromkeys(range(50, 10_000), press))
    stop = threading.Event()
    options = LiveOptions(background=ShowBackground(seconds=0.0))
    with LiveSession({"left": sensor}, None, options) as view, LivePage(view) as page:
        thread = threading.Thread(target=run_session, args=(view, [], stop, lambda line: None))
        thread.start()
        yield page
        stop.set()
        thread.join()


def get(url, **headers):
    with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=20) as answer:
        return answer.read(), answer.headers


def refused(url, **headers):
    with pytest.raises(urllib.error.HTTPError) as caught:
        get(url, **headers)
    caught.value.close()
    return caught.value.code


def test_only_who_has_the_token_may_look(page):
    base = page.url.removesuffix(f"{page.token}/")
    assert base.startswith("http://127.0.0.1:")
    assert len(page.token) >= 22
    for path in ("", "state", page.token[:-1], page.token[:-1] + "/state", "%00/"):
        assert refused(base + path) == 403
    assert refused(page.url, Host="evil.example") == 403
    assert refused(page.url + "state", Host="127.0.0.1") == 403
    for path in ("nothing", "frame/right", "frame/../../etc/passwd"):
        assert refused(page.url + path) == 404
    body, headers = get(page.url)
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert b"NONCE" not in body
    assert b"http://" not in body.replace(b"http://www.w3.org", b"")
    assert "Access-Control-Allow-Origin" not in headers


def test_the_state_is_that_of_the_sensor(page):
    first = json.loads(get(page.url + "state")[0])["sensors"]["left"]
    while len(first["readings"]) < 3:
        first = json.loads(get(page.url + "state")[0])["sensors"]["left"]
    time, force, contact, slip, _, deepest, motion = first["readings"][-1]
    assert (force, slip, deepest, motion) == (None, None, None, None)
    assert contact in (False, True)
    later = json.loads(get(f"{page.url}state?left={time}")[0])["sensors"]["left"]
    assert all(reading[0] > time for reading in later["readings"])
    assert json.loads(get(page.url + "state?left=x")[0])["sensors"].keys() == {"left"}


def test_readings_of_a_sensor_do_not_hide_those_of_one_that_is_later(page):
    seen = json.loads(get(page.url + "state?right=9999999999")[0])["sensors"]["left"]
    while not seen["readings"]:
        seen = json.loads(get(page.url + "state?right=9999999999")[0])["sensors"]["left"]
    assert "state?after" not in get(page.url)[0].decode()


def test_pictures_are_those_of_the_sensor(page):
    while not json.loads(get(page.url + "state")[0])["sensors"]["left"]["picture"]:
        pass
    data, headers = get(page.url + "frame/left?t=1")
    assert headers["Content-Type"] == "image/jpeg"
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (224, 168, 3)  # of 32 x 24, whole pixels enlarged
    assert 110 < np.median(picture) < 225


def test_the_difference_is_doubled_around_grey():
    still = np.full((4, 4, 3), 100, np.uint8)
    assert difference_image(still + np.uint8(10), still)[0, 0, 0] == 148
    assert difference_image(still - np.uint8(90), still)[0, 0, 0] == 0
    assert len(page_jpeg(np.zeros((1000, 2000, 3), np.uint8))) > 100


def test_a_port_that_is_taken(page, scripted):
    port = int(page.url.split(":")[2].split("/")[0])
    with pytest.raises(ConfigError, match=f"port={port}: .*; give another, or 0"):
        LivePage(LiveSession({"left": scripted()}), port)


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is here")
@pytest.mark.slow
@pytest.mark.parametrize("width", [400, 1120])
def test_a_browser_shows_it(page, tmp_path, width):
    with Browser(tmp_path / "profile") as browser:
        look = browser.show(page.url, width)
        page_text = "document.documentElement?.outerHTML ?? ''"
        wait_until(lambda: '<span class="chip on">contact</span>' in look(page_text), 120)
        dom = look(page_text)
        assert "<h2>left (digit)</h2>" in dom
        assert '<span class="chip on">contact</span>' in dom
        assert "no model" in dom
        loaded = "[...document.images].filter(one => one.naturalWidth > 0).length"
        wait_until(lambda: look(loaded) >= 2, 120)
        assert look(loaded) == 2
        assert "no frame yet" not in look("document.body.innerText")
        assert look("longest([[0], [0.02], [0.04], [3]])") == 0.5
        assert look("longest([[0], [1], [2], [3]])") == 3  # one reading a second is one line
        captions = "[...document.querySelectorAll('figcaption')].map(it => it.textContent).join()"
        assert look(captions) == "frame,difference from the background, doubled"
        empty = "build('right', Object.assign({}, {type: 'digit'})).root.innerText"
        assert look(empty).count("no frame yet") == 2
        assert look("[...cards.right.root.querySelectorAll('img')].every(it => !it.offsetWidth)")
        assert look("document.documentElement.scrollWidth") <= width


def test_answers_do_not_wait_for_one_another(page):
    """A head and a body are two writes, and each goes out at once."""
    from tactileforge.pages.local_page import _Handler

    assert _Handler.disable_nagle_algorithm
    host, port = page.url.split("/")[2].split(":")
    connection = HTTPConnection(host, int(port), timeout=20)
    for _ in range(3):  # on one connection
        connection.request("GET", f"/{page.token}/state")
        assert json.loads(connection.getresponse().read())["sensors"].keys() == {"left"}
    connection.close()
