"""A real Chromium without a screen, driven by its DevTools protocol; and `s3le view` to look at."""

import base64
import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome")
PATH = next((shutil.which(name) for name in NAMES if shutil.which(name)), None)
FLAGS = [  # no screen, no GPU, no network of its own
    "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--no-first-run", "--disable-dev-shm-usage", "--remote-debugging-port=0",
]  # fmt: skip
PATIENCE = 60.0  # [s]


class Page:
    """One page of it: what it was asked, what it complained of, and hands to click with."""

    def __init__(self, socket) -> None:
        self._socket, self._id = socket, 0
        self.wrong: list[str] = []
        self.asked: list[str] = []
        for part in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{part}.enable")

    def call(self, method: str, **params):
        self._id += 1
        self._socket.send(json.dumps({"id": self._id, "method": method, "params": params}))
        while True:
            said = json.loads(self._socket.recv(timeout=PATIENCE))
            if said.get("id") == self._id:
                assert "error" not in said, said
                return said["result"]
            self._note(said["method"], said["params"])

    def _note(self, method: str, params: dict) -> None:
        if method == "Runtime.consoleAPICalled" and params["type"] in ("error", "assert"):
            self.wrong.append(str(params["args"])[:500])
        elif method == "Runtime.exceptionThrown":
            self.wrong.append(str(params["exceptionDetails"])[:500])
        elif method == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.wrong.append(params["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.asked.append(params["request"]["url"])

    def run(self, script: str):
        said = self.call("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in said, said
        return said["result"].get("value")

    def wait(self, script: str) -> None:
        """Until a script says something true."""
        end = time.monotonic() + PATIENCE
        while not self.run(script):
            assert time.monotonic() < end, f"never true: {script}\n{self.run(TEXT)}"
            time.sleep(0.1)

    def says(self, pattern: str) -> None:
        """Wait for words on the page."""
        self.wait(f"RegExp({json.dumps(pattern)}).test({TEXT})")

    def click(self, tag: str, words: str) -> None:
        """A button, or the box that a label is of."""
        nodes = f"[...document.querySelectorAll('{tag}')]"
        found = f"{nodes}.find(e => e.innerText.trim() == '{words}')"
        self.wait(f"!!{found}")
        box = f"document.getElementById({found}.htmlFor)" if tag == "label" else found
        self.run(f"{box}.click()")

    def press(self, key: str, code: int) -> None:
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code
            )

    def screenshot(self, **clip: float) -> bytes:
        said = self.call("Page.captureScreenshot", clip=clip | {"scale": 1})
        return base64.b64decode(said["data"])


TEXT = "(document.body ? document.body.innerText : '')"


@contextlib.contextmanager
def opened(folder, width: int, height: int):
    """A page, empty at first; the browser ends with the block."""
    from websockets.sync.client import connect

    browser = subprocess.Popen(
        [PATH, *FLAGS, f"--user-data-dir={folder}", f"--window-size={width},{height}",
         "about:blank"],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        found = None
        for line in browser.stderr:
            if found := re.search(r"ws://(127\.0\.0\.1:\d+)/", line):
                break
        assert found, "the browser did not start"
        # Whatever else it has to say must not fill the pipe.
        threading.Thread(target=browser.stderr.read, daemon=True).start()
        with urllib.request.urlopen(f"http://{found[1]}/json/list", timeout=PATIENCE) as said:
            page = next(p for p in json.load(said) if p["type"] == "page")
        with connect(page["webSocketDebuggerUrl"], max_size=None) as socket:
            yield Page(socket)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(browser.pid, signal.SIGKILL)
        browser.wait()
        browser.stderr.close()


@contextlib.contextmanager
def serving(*words):
    """`s3le view` with these words in a process of its own, and the address that it says."""
    viewer = subprocess.Popen(
        [sys.executable, "-m", "s3le.cli", "view", *map(str, words), "--port", "0"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
    )  # fmt: skip
    try:
        said = viewer.stdout.readline()
        found = re.match(r"(http://127\.0\.0\.1:\d+) ", said)
        assert found, said + viewer.stderr.read()
        yield viewer, found[1]
    finally:
        viewer.kill()
        viewer.communicate()
