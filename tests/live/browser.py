"""A headless Chromium that is told what to do over its debugging socket."""

from __future__ import annotations

import base64
import itertools
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


class Browser:
    """One page of a browser, or the browser itself if it has no session."""

    def __init__(self, socket: Any, session: str = "", count: Iterator[int] | None = None) -> None:
        self._socket, self._session = socket, session
        self._count = count or itertools.count(1)

    def page(self) -> Browser:
        """Another page, in a window of its own: one in the background plays no video."""
        target = self.tell("Target.createTarget", url="about:blank", newWindow=True)["targetId"]
        attached = self.tell("Target.attachToTarget", targetId=target, flatten=True)
        return Browser(self._socket, attached["sessionId"], self._count)

    def close(self) -> None:
        """Close the page."""
        self.tell("Page.close")

    def before(self, script: str) -> None:
        """JavaScript that runs in every document before the document's own."""
        self.tell("Page.enable")
        self.tell("Page.addScriptToEvaluateOnNewDocument", source=script)

    def tell(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command of the debugging protocol and its answer."""
        number = next(self._count)
        message = {"id": number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=60.0))
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return dict(answer["result"])

    def open(self, url: str, width: int, height: int) -> None:
        """A page in a window of so many pixels."""
        self.resize(width, height)
        self.tell("Page.navigate", url=url)

    def resize(self, width: int, height: int) -> None:
        """A window of so many pixels, a narrow one as a phone has it."""
        self.tell(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )

    def prefer(self, scheme: str) -> None:
        """``light`` or ``dark``."""
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.tell("Emulation.setEmulatedMedia", features=features)

    def value(self, expression: str) -> Any:
        """What an expression of JavaScript gives."""
        found = self.tell("Runtime.evaluate", expression=expression, returnByValue=True)
        return found["result"].get("value")

    def until(self, expression: str, seconds: float) -> bool:
        """Whether an expression becomes true in that time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self.value(expression):
                return True
            time.sleep(0.1)
        return False

    def screenshot(self, path: Path) -> None:
        """The page as PNG."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(base64.b64decode(self.tell("Page.captureScreenshot", format="png")["data"]))


@contextmanager
def browser(video: Path) -> Iterator[Browser]:
    """A browser whose camera plays a file of JPEGs (``.mjpeg``); `Browser.page` opens its pages."""
    from websockets.sync.client import connect

    assert CHROMIUM is not None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        command = [
            CHROMIUM,
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--enable-unsafe-swiftshader",  # WebGL by the processor, which newer ones refuse else
            "--ignore-certificate-errors",
            "--use-fake-ui-for-media-stream",
            "--use-fake-device-for-media-stream",
            f"--use-file-for-fake-video-capture={video}",
            "--disable-backgrounding-occluded-windows",
            "--disable-renderer-backgrounding",
            f"--user-data-dir={folder}",
            "--remote-debugging-port=0",
            "about:blank",
        ]
        process = subprocess.Popen(
            command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, start_new_session=True
        )
        try:
            assert process.stderr is not None
            line = next(text for text in process.stderr if "DevTools listening on" in text)
            with connect(line.split()[-1], max_size=None) as socket:
                yield Browser(socket)
        finally:
            process.terminate()
            process.wait()
            with suppress(ProcessLookupError):  # its helper processes write to the profile for a moment more
                os.killpg(process.pid, signal.SIGKILL)
            if process.stderr is not None:
                process.stderr.close()
