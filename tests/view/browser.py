"""Headless Chromium that opens a page and takes pictures of it as time passes."""

import base64
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest
from PIL import Image
from websockets.sync.client import connect

SIZE = (800, 600)
"""Width and height of the page in pixels."""


class Page:
    """A page that Chromium shows, driven by its debugging protocol."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._calls = 0

    def picture(self) -> np.ndarray:
        """The page as it is now: (h, w, 3) uint8."""
        data = self._call("Page.captureScreenshot")["data"]
        return np.asarray(Image.open(BytesIO(base64.b64decode(data))).convert("RGB"))

    def _call(self, method: str) -> Any:
        self._calls += 1
        self._socket.send(json.dumps({"id": self._calls, "method": method}))
        while True:
            answer = json.loads(self._socket.recv(timeout=60))
            if answer.get("id") == self._calls:
                return answer["result"]


@contextmanager
def opened(address: str, profile: Path) -> Iterator[Page]:
    """Open a page; the test is skipped where Chromium is not installed."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("Chromium is not installed")
    command = [
        browser, "--headless", "--no-sandbox", "--no-first-run", "--disable-sync", "--hide-scrollbars",
        "--disable-background-networking", "--disable-component-update", "--disable-quic",
        "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--remote-debugging-port=0",
        f"--window-size={SIZE[0]},{SIZE[1]}", f"--user-data-dir={profile}", address,
    ]  # fmt: skip
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stderr is not None
            found = next(filter(None, (re.search(r"ws://([^/]+)/", line) for line in process.stderr)))
            with urlopen(f"http://{found[1]}/json", timeout=60) as answer:
                pages = [each for each in json.load(answer) if each["type"] == "page"]
            with connect(pages[0]["webSocketDebuggerUrl"], max_size=None) as socket:
                yield Page(socket)
        finally:
            process.terminate()
