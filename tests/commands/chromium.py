"""A headless Chromium, driven over its debugging protocol."""

import base64
import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.request import urlopen

PROGRAM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

FLAGS = (
    *("--headless=new", "--no-sandbox", "--remote-debugging-port=0", "--no-first-run", "--mute-audio"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars"),
)
SECONDS = 120.0
"""Longest wait for a page, on a machine without a graphics card."""


class Chromium:
    """One page of a browser. errors: what its console has said in red. pid: of the program."""

    def __init__(self, folder: Path, flags: tuple[str, ...] = ()) -> None:
        """Start it, with a profile in a folder and flags beside FLAGS."""
        from websockets.sync.client import connect

        assert PROGRAM is not None
        self.errors: list[str] = []
        self._count = 0
        profile = folder / "profile"
        self._process = subprocess.Popen(
            [PROGRAM, *FLAGS, *flags, f"--user-data-dir={profile}", "about:blank"],
            stderr=subprocess.DEVNULL,
            env=os.environ | {"HOME": str(folder)},
        )
        self.pid = self._process.pid
        port_file = profile / "DevToolsActivePort"
        _wait(lambda: port_file.exists() and len(port_file.read_text().split()) > 1)
        port = port_file.read_text().split()[0]
        with urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
            pages = [each for each in json.load(answer) if each["type"] == "page"]
        self._socket = connect(pages[0]["webSocketDebuggerUrl"], max_size=2**28)
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()
        self._process.terminate()
        self._process.wait(20)

    def call(self, method: str, **values: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self._count += 1
        self._socket.send(json.dumps({"id": self._count, "method": method, "params": values}))
        while True:
            message = json.loads(self._socket.recv(timeout=SECONDS))
            if message.get("id") == self._count:
                assert "error" not in message, message["error"]
                return dict(message["result"])
            self._note(message)

    def open(self, address: str) -> None:
        """Go to a page, for which nothing in red has been said yet."""
        self.errors.clear()
        self.call("Page.navigate", url=address)

    def value(self, expression: str) -> Any:
        """The value of an expression in the page, a promise's included."""
        result = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait_for(self, expression: str, seconds: float = SECONDS) -> None:
        """Wait until an expression is true."""
        _wait(lambda: bool(self.value(expression)), seconds, lambda: f"{expression}; {self.errors}")

    def picture(self, path: Path) -> None:
        """Write what is shown as a PNG."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def _note(self, message: dict[str, Any]) -> None:
        values = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(values["exceptionDetails"]))
        if message.get("method") == "Log.entryAdded" and values["entry"]["level"] == "error":
            self.errors.append(f"{values['entry']['text']} {values['entry'].get('url', '')}")


def _wait(is_done: Any, seconds: float = SECONDS, describe: Any = lambda: "Chromium") -> None:
    end = time.monotonic() + seconds
    while not is_done():
        if time.monotonic() > end:
            raise TimeoutError(describe())
        time.sleep(0.1)
