"""A headless Chromium, driven through its devtools websocket."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from websockets.sync.client import connect

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--enable-unsafe-swiftshader", "--remote-debugging-port=0",
)  # fmt: skip
_PLACE = """(() => {
  const found = [...document.querySelectorAll("button,[role=tab]")]
    .find((each) => each.offsetParent !== null && each.innerText.trim() === %s);
  if (!found) return null;
  found.scrollIntoView({ block: "nearest" });
  const box = found.getBoundingClientRect();
  return [box.x + box.width / 2, box.y + box.height / 2];
})()"""
_FIELD = """(() => {
  const visible = (each) => each.offsetParent !== null;
  const label = [...document.querySelectorAll("label")].filter(visible)
    .find((each) => each.innerText.trim() === %s);
  let place = label;
  while (place && !place.querySelector("input,textarea")) place = place.parentElement;
  const fields = [...(place || document).querySelectorAll("input:not([type=file]),textarea")];
  const field = fields.filter(visible)[0];
  if (field) { field.focus(); field.select(); }
  return !!field;
})()"""
CTRL = 2
"""The key held, as devtools count them."""


def chromium() -> str | None:
    """The program, where there is one."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next(filter(None, map(shutil.which, names)), None)


@contextmanager
def browser() -> Iterator[Callable[..., AbstractContextManager[Window]]]:
    """A browser with a new profile; opens windows on an address, of a size, for a while."""
    program = chromium()
    assert program is not None
    with TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(
            [program, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
            stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        try:
            assert process.stderr is not None
            line = next(each for each in process.stderr if "DevTools listening on" in each)
            port = line.split("127.0.0.1:")[1].split("/")[0]
            yield lambda address, size=(1000, 700): closing(Window(port, address, size))
        finally:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


class Window:
    """One page of the browser."""

    def __init__(self, port: str, address: str, size: tuple[int, int]) -> None:
        place = f"http://127.0.0.1:{port}/json/new?about:blank"
        with urllib.request.urlopen(urllib.request.Request(place, method="PUT")) as answer:
            self._socket = connect(json.load(answer)["webSocketDebuggerUrl"], max_size=None)
        self._number = 0
        self.requests: list[str] = []
        """Addresses that the page asked for."""
        self.errors: list[str] = []
        """Uncaught errors of its scripts."""
        for each in ("Page.enable", "Runtime.enable", "Network.enable"):
            self.call(each)
        width, height = size
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
            mobile=False,
        )  # fmt: skip
        self.call("Page.navigate", url=address)

    def close(self) -> None:
        """Close it, and all that its page holds open."""
        self.call("Page.close")
        self._socket.close()

    def call(self, method: str, **parameters: Any) -> Any:
        """Call a method of devtools, and return its result."""
        self._number += 1
        asked = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(asked))
        while (told := json.loads(self._socket.recv())).get("id") != self._number:
            self._hear(told)
        assert "error" not in told, told
        return told["result"]

    def run(self, script: str) -> Any:
        """The value of an expression of JavaScript."""
        found = self.call("Runtime.evaluate", expression=script, returnByValue=True)
        return found["result"].get("value")

    def text(self) -> str:
        """Text that a person can read."""
        return self.run("document.body ? document.body.innerText : ''") or ""

    def wait(self, happened: Callable[[], Any], seconds: float = 90.0) -> Any:
        """Wait until something holds. Raises TimeoutError with what can be read."""
        ends = time.monotonic() + seconds
        while not (value := happened()):
            if time.monotonic() > ends:
                raise TimeoutError(f"did not happen in {seconds:g} s: {self.text()!r}")
            time.sleep(0.05)
        return value

    def press(self, label: str) -> None:
        """Press the button, or the heading, of a label."""
        before, script = None, _PLACE % json.dumps(label)
        while (place := self.wait(lambda: self.run(script))) != before:
            before = place  # what is above it may be moving it
            time.sleep(0.1)
        self.click(*place)

    def write(self, label: str, text: str) -> None:
        """Type into the field of a label; without one into the first field that is visible."""
        script = _FIELD % json.dumps(label)
        self.wait(lambda: self.run(script))
        self.call("Input.insertText", text=text)

    def drop(self, *paths: Path, x: float = 300, y: float = 300) -> None:
        """Drop files and folders of this machine at a pixel."""
        data = {"items": [], "files": [str(each) for each in paths], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self.call("Input.dispatchDragEvent", type=kind, x=x, y=y, data=data)

    def touch(self, *moments: tuple[tuple[float, float], ...]) -> None:
        """Put down fingers at the points of the first moment, move them over the others, and lift
        them."""
        for kind, moment in zip(("touchStart", *["touchMove"] * len(moments)), moments):
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(moment)]
            self.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
            time.sleep(0.05)
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def click(self, x: float, y: float) -> None:
        """Click at a pixel."""
        for kind, held in (("mouseMoved", 0), ("mousePressed", 1), ("mouseReleased", 0)):
            self.call(
                "Input.dispatchMouseEvent", type=kind, x=x, y=y, clickCount=1, buttons=held,
                button="none" if kind == "mouseMoved" else "left",
            )  # fmt: skip

    def key(self, key: str, modifiers: int = 0) -> None:
        """Press a key of a letter, or Escape."""
        code = 27 if key == "Escape" else ord(key.upper())
        names = {"key": key, "code": f"Key{key.upper()}", "windowsVirtualKeyCode": code}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, modifiers=modifiers, **names)

    def _hear(self, told: dict[str, Any]) -> None:
        given = told.get("params", {})
        if told.get("method") == "Network.requestWillBeSent":
            self.requests.append(given["request"]["url"])
        elif told.get("method") == "Network.webSocketCreated":
            self.requests.append(given["url"])
        elif told.get("method") == "Runtime.exceptionThrown":
            details = given["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description", details["text"]))
