"""A Chromium without a window and without a network, driven through a pair of pipes.

Messages are those of the DevTools protocol, each ended by a NUL byte.
"""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

__all__ = ["Browser", "chromium"]

#: Nothing is resolved: a page that asks for anything from elsewhere has an error on its console.
_OPTIONS = (
    "--headless=new", "--no-first-run", "--disable-background-networking", "--disable-sync",
    "--disable-component-update", "--no-default-browser-check", "--disable-extensions",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars", "--mute-audio",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1", "--remote-debugging-pipe",
)  # fmt: skip


def chromium() -> str | None:
    """The program, if there is one; CHROMIUM names another place."""
    names = (os.environ.get("CHROMIUM", ""), "chromium", "chromium-browser", "google-chrome")
    return next((found for name in names if name and (found := shutil.which(name))), None)


class Browser:
    """One tab.

    Attributes:
        errors: what the console and the page itself reported as errors.
    """

    def __init__(self, size: tuple[int, int] = (1000, 700), options: Sequence[str] = ()) -> None:
        """Keep the size of the window."""
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._size, self._more = size, options
        self._number, self._session = 0, ""
        self._rest = b""

    def __enter__(self) -> Self:
        """Start the program."""
        program = chromium()
        assert program is not None
        self._home = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        there, self._to = os.pipe()
        self._from, back = os.pipe()
        width, height = self._size
        root = ["--no-sandbox"] if os.geteuid() == 0 else []

        def pipes() -> None:
            # duplicates first: the numbers of the pipes may be 3 or 4 already
            read, write = os.dup(there), os.dup(back)
            os.dup2(read, 3)
            os.dup2(write, 4)

        self._process = subprocess.Popen(
            [
                program, *_OPTIONS, *root, *self._more, f"--user-data-dir={self._home.name}",
                f"--window-size={width},{height}", "about:blank",
            ],
            preexec_fn=pipes,  # noqa: PLW1509 - there are no threads
            close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(there)
        os.close(back)
        tab = self.call("Target.createTarget", url="about:blank")
        attached = self.call("Target.attachToTarget", targetId=tab["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
            mobile=False,
        )  # fmt: skip
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the program."""
        self._process.kill()
        self._process.wait()
        os.close(self._to)
        os.close(self._from)
        self._home.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a message and return the answer."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                result: dict[str, Any] = answer["result"]
                return result

    def _next(self, patience: float = 60.0) -> dict[str, Any]:
        """The next message; events are kept."""
        end = time.monotonic() + patience
        while b"\0" not in self._rest:
            left = end - time.monotonic()
            if left <= 0 or not select.select([self._from], [], [], left)[0]:
                raise TimeoutError("the browser does not answer")
            chunk = os.read(self._from, 1 << 20)
            assert chunk, "the browser has ended"
            self._rest += chunk
        text, self._rest = self._rest.split(b"\0", 1)
        message: dict[str, Any] = json.loads(text)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, method: str, what: dict[str, Any]) -> None:
        if method == "Runtime.exceptionThrown":
            details = what["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Runtime.consoleAPICalled" and what["type"] in (
            "error",
            "warning",
            "assert",
        ):
            self.errors.append(
                " ".join(str(one.get("value", one.get("description"))) for one in what["args"])
            )
        elif method == "Log.entryAdded" and what["entry"]["level"] in ("error", "warning"):
            self.errors.append(what["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(what["request"]["url"])

    def open(
        self, page: Path | str, address: str = "", until: str = "window.flexfem !== undefined"
    ) -> float:
        """Open a file or an address and wait until an expression is true; returns the seconds."""
        begin = time.monotonic()
        url = page if isinstance(page, str) else page.resolve().as_uri()
        self.call("Page.navigate", url=url + address)
        while not self.ask(until):
            assert time.monotonic() - begin < 60.0, self.errors
            time.sleep(0.01)
        return time.monotonic() - begin

    def ask(self, expression: str) -> Any:
        """Value of an expression of JavaScript, waiting for a promise."""
        found = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def picture(self) -> bytes:
        """What the window shows, as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
