"""A Chromium for tests of pages."""

import json
import os
import select
import shutil
import signal
import subprocess

BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chrome"))), None)


class Browser:
    """A Chromium without a window, controlled by its debugging pipe."""

    def __init__(self, profile):
        (read, self.out), (self.answers, write) = os.pipe(), os.pipe()
        # the shell puts the pipes where the browser looks for them
        command = [
            "bash", "-c", f'exec "$@" 3<&{read} 4>&{write}', "bash",
            BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
            f"--user-data-dir={profile}", "--remote-debugging-pipe", "about:blank",
        ]  # fmt: skip
        self.process = subprocess.Popen(
            command,
            pass_fds=(read, write),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(read)
        os.close(write)
        self.read = b""
        self.count = 0

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        os.close(self.out)
        os.close(self.answers)

    def __call__(self, method, session=None, **params):
        """The result of a method of the DevTools protocol."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        os.write(self.out, json.dumps(message).encode() + b"\0")
        while (answer := self.next()).get("id") != self.count:
            pass  # an event
        assert "error" not in answer, answer
        return answer["result"]

    def next(self):
        while b"\0" not in self.read:
            ready, _, _ = select.select([self.answers], [], [], 60)
            assert ready, "the browser says nothing"
            data = os.read(self.answers, 1 << 20)
            assert data, "the browser ended"
            self.read += data
        message, _, self.read = self.read.partition(b"\0")
        return json.loads(message)

    def show(self, url, width):
        """A function to evaluate an expression on the page; its ``session`` is that of the page."""
        target = self("Target.createTarget", url="about:blank")["targetId"]
        session = self("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self("Emulation.setDeviceMetricsOverride", session, **size)
        self("Page.navigate", session, url=url)

        def look(text):
            return self("Runtime.evaluate", session, expression=text)["result"].get("value")

        look.session = session
        return look

    def press(self, session, key, shift=False):
        """Presses a key of the keyboard on a page."""
        code = {"key": key, "modifiers": 8 if shift else 0}
        text = {"text": key} if len(key) == 1 else {}
        self("Input.dispatchKeyEvent", session, type="keyDown", **code, **text)
        self("Input.dispatchKeyEvent", session, type="keyUp", **code)
