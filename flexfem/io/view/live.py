# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages of runs that go on: a small server for browsers on this computer.

The server reads what the run has written, and nothing when nobody asks. It takes at most a fixed
share of one core. It can be reached from this computer only, or through a tunnel
(``ssh -L``), by an address with a key, which other users of the computer do not know; questions
for other hosts, with which pages from elsewhere could try to reach it, are refused.
"""

from __future__ import annotations

import json
import secrets
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock
from typing import Any

from flexfem._checks import InputError
from flexfem.io.tables.history_files import FILES
from flexfem.io.view.content import Content, gather
from flexfem.io.view.document import page, scene_text
from flexfem.io.view.reading import Choice

__all__ = ["Watched", "serve", "server"]

#: Share of one core that reading may take while the run goes on.
_SHARE = 0.02
#: Seconds between looks at a folder where there is nothing yet.
_PAUSE = 0.5
#: Instants by default: fewer than in a file, as all are read for each state.
_FRAMES = 200
_HOSTS = {"127.0.0.1", "localhost", "[::1]"}


class Watched:
    """A result folder, and the last state of it that was read.

    Attributes:
        content: that state.
        version: number of it.
    """

    def __init__(self, folder: Path, choice: Choice) -> None:
        """Read the first state.

        Raises:
            InputError: there is nothing to show yet, or a file is damaged.
        """
        self._folder = folder
        self._choice = choice if choice.frames else replace(choice, frames=_FRAMES)
        self._lock = Lock()
        self._seen: tuple[int, ...] = ()
        self.version = 0
        self._next = 0.0  # time from which the next state may be read
        self._read()

    def refresh(self) -> None:
        """Read a new state if there is one, and if the last reading was long enough ago.

        A folder that is not whole, because a new run begins in it, keeps its last state.
        """
        with self._lock:
            if time.monotonic() < self._next or self._stamp() == self._seen:
                return
            try:
                self._read()
            except (InputError, OSError, ValueError):
                self._next = time.monotonic() + _PAUSE

    def _read(self) -> None:
        begin, used, seen = time.monotonic(), time.thread_time(), self._stamp()
        content = gather(self._folder, self._choice)
        self.version += 1
        running = not (self._folder / "summary.json").exists()
        scene = {**content.scene, "version": self.version}
        if running:
            scene["status"] = "running"
        self.content = replace(content, scene=scene)
        self._seen = seen
        self._next = begin + (time.thread_time() - used) / _SHARE

    def _stamp(self) -> tuple[int, ...]:
        """Times at which indices, table and summary were last changed."""
        names = [*FILES.values(), "summary.json"]
        files = [*sorted(self._folder.glob("*.pvd")), *(self._folder / name for name in names)]
        return tuple(file.stat().st_mtime_ns if file.exists() else 0 for file in files)


class _Handler(BaseHTTPRequestHandler):
    """Answers of the server."""

    server_version, sys_version = "flexfem", ""
    #: Seconds that a browser may take for a question.
    timeout = 30

    def __init__(self, watched: Watched, key: str, *arguments: Any) -> None:
        """Answer for a folder, under a key."""
        self._answers: dict[str, Callable[[], tuple[str, bytes]]] = {
            f"/{key}/": partial(_page, watched),
            f"/{key}/state": partial(_state, watched),
            f"/{key}/content": partial(_content, watched),
        }
        super().__init__(*arguments)

    def do_GET(self) -> None:
        """Answer one question."""
        host = self.headers.get("Host", "").rpartition(":")[0] or self.headers.get("Host", "")
        answer = self._answers.get(self.path.partition("?")[0])
        if host not in _HOSTS or answer is None:
            self.send_error(404)
            return
        kind, body = answer()
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Print nothing."""


def _page(watched: Watched) -> tuple[str, bytes]:
    watched.refresh()
    return "text/html; charset=utf-8", "".join(page(watched.content, live=True)).encode()


def _state(watched: Watched) -> tuple[str, bytes]:
    watched.refresh()
    return "application/json", json.dumps({"version": watched.version}).encode()


def _content(watched: Watched) -> tuple[str, bytes]:
    """The size of the scene (4 bytes), the scene, and its arrays."""
    content: Content = watched.content
    text = scene_text(content).encode()
    size = len(text).to_bytes(4, "little")
    return "application/octet-stream", b"".join([size, text, content.data])


def server(watched: Watched, port: int) -> tuple[ThreadingHTTPServer, str]:
    """A server of a folder, and its address.

    Args:
        watched: the folder.
        port: of this computer; 0 for any that is free.

    Raises:
        OSError: the port is taken.
    """
    key = secrets.token_urlsafe(12)
    made = ThreadingHTTPServer(("127.0.0.1", port), partial(_Handler, watched, key))
    made.daemon_threads = True
    return made, f"http://127.0.0.1:{made.server_address[1]}/{key}/"


def serve(folder: Path, choice: Choice, port: int, say: Callable[[str], object]) -> None:
    """Show a folder until Ctrl-C, from when there is something to show.

    Args:
        folder: of the results.
        choice: what is shown.
        port: of this computer; 0 for any that is free.
        say: prints a line.

    Raises:
        InputError: a file is damaged.
        OSError: the port is taken.
    """
    try:
        if not any(folder.glob("*.pvd")):
            say(f"waiting for the first results in {folder}")
        while not any(folder.glob("*.pvd")):
            time.sleep(_PAUSE)
        made, address = server(_first(folder, choice), port)
        with made:
            say(f"open {address} (Ctrl-C ends)")
            made.serve_forever()
    except KeyboardInterrupt:
        pass


def _first(folder: Path, choice: Choice) -> Watched:
    """The first state that can be read: a run writes its series one after the other."""
    for attempt in range(10):
        try:
            return Watched(folder, choice)
        except InputError:
            if attempt == 9:
                raise
            time.sleep(_PAUSE)
    raise AssertionError
