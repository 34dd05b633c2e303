"""A headless Chromium, driven through its DevTools protocol."""

import base64
import itertools
import json
import shutil
import signal
import subprocess
import time
import urllib.request
from pathlib import Path

from websockets.sync.client import connect

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--mute-audio",
    "--hide-scrollbars",
    # WebGL without a graphics card.
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
)


def chromium():
    """The program's path; None where it is not installed."""
    return next(filter(None, map(shutil.which, NAMES)), None)


SENT = 0.15
"""Seconds of the page's own clock after which it has sent what was done: viser sends at most every
0.05 s, and of what was done between only the last, whichever field or button that was."""


class Browser:
    """One page of a browser of its own, until it is left."""

    def __init__(self, profile: Path, width=1280, height=800):
        self._log = (profile / "browser.log").open("wb")
        self._process = subprocess.Popen(
            [chromium(), *FLAGS, f"--user-data-dir={profile}", f"--window-size={width},{height}",
             "about:blank"],
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )  # fmt: skip
        port = _wait(lambda: _lines(profile / "DevToolsActivePort"))[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
            pages = [each for each in json.load(answer) if each["type"] == "page"]
        self._socket = connect(pages[0]["webSocketDebuggerUrl"], max_size=None)
        self._numbers = itertools.count(1)
        self.said = []
        self.do("Runtime.enable")
        self.do(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(30.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()

    def do(self, method, **parameters):
        """Send a command; its result."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=600.0))
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]
            if message.get("method") in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled"):
                self.said.append(message)

    def open(self, url):
        self.do("Page.navigate", url=url)

    def run(self, script):
        """The value of a JavaScript expression, or of what it promises."""
        answer = self.do(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    @property
    def text(self):
        """All that is written on the page."""
        return self.run("document.body ? document.body.innerText : ''")

    def wait_for(self, *texts, timeout=600.0):
        """Wait until all of these are written on the page."""
        _wait(lambda: all(text in self.text for text in texts), timeout, lambda: self.text)

    def press(self, label):
        """Press the button of that name."""
        found = (
            "[...document.querySelectorAll('button')].find(b => b.innerText.trim() === "
            f"{json.dumps(label)})"
        )
        assert self.run(f"{found} !== undefined"), self.text
        self.run(f"{found}.click()")
        self._send()

    def unfold(self, title):
        """Open the folder of that name."""
        found = (
            "[...document.querySelectorAll('*')].findLast(e => e.innerText && "
            f"e.innerText.trim() === {json.dumps(title)})"
        )
        assert self.run(f"{found} !== undefined"), self.text
        self.run(f"{found}.click()")

    @property
    def fields(self):
        """What the fields that can be seen hold."""
        return self.run(
            "[...document.querySelectorAll('input')].filter(f => f.offsetParent).map(f => f.value)"
        )

    @property
    def errors(self):
        """Exceptions, and what the console has as an error."""
        return [
            message
            for message in self.said
            if message["method"] == "Runtime.exceptionThrown"
            or message["params"]["type"] == "error"
        ]

    def fill(self, before, after):
        """Give the field that holds one value another, and let the server know."""
        self.run(
            "(() => {const field = [...document.querySelectorAll('input')].find("
            f"f => f.value === {json.dumps(before)} && f.offsetParent);"
            "field.focus(); field.select(); return true})()"
        )
        self.do("Input.insertText", text=after)
        for kind in ("keyDown", "keyUp"):
            self.do("Input.dispatchKeyEvent", type=kind, key="Enter", windowsVirtualKeyCode=13)
        self._send()

    def _send(self):
        """Until all that was done has been sent, however long the page takes for it.

        Timers of a page come in the order in which they are due, the one that sends before this.
        """
        self.run(f"new Promise(sent => setTimeout(sent, {1e3 * SENT}))")

    def picture(self):
        """A PNG of the page."""
        return base64.b64decode(self.do("Page.captureScreenshot", format="png")["data"])


def _lines(path):
    return path.read_text().splitlines() if path.exists() else None


def _wait(what, timeout=600.0, said=lambda: ""):
    end = time.monotonic() + timeout
    while not (found := what()):
        assert time.monotonic() < end, f"waited in vain: {said()}"
        time.sleep(0.1)
    return found
