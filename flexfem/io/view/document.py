# SPDX-License-Identifier: LGPL-3.0-or-later
"""The HTML file of a page, with its program and three.js inside: it needs no network.

Names in result files must not become markup or code: they are in JSON only, in an element whose
text cannot end it, and the program makes text of them. Besides, the policy in the page's head
allows no code but the page's own, and no connections.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from flexfem import launch
from flexfem.io.atomic import replace_file
from flexfem.io.view.content import Content, gather
from flexfem.io.view.reading import Choice

__all__ = ["NAME", "View", "page", "scene_text", "view", "write_view"]

NAME = "view.html"
_WEB = Path(__file__).with_name("web")
#: Bytes of an element with data: browsers limit texts.
_PIECE = 24_000_000
#: Bytes of a page that a notebook should not hold.
_LARGEST_CELL = 30_000_000
_POLICY = (
    "default-src 'none'; script-src 'nonce-{nonce}' blob:; style-src 'nonce-{nonce}'; "
    "img-src blob: data:; connect-src {connect}; base-uri 'none'; form-action 'none'"
)


@dataclass(frozen=True)
class View:
    """The page of a result folder; the last line of a cell of a notebook shows it.

    Attributes:
        path: the file.
        notes: what it leaves out, and how to choose.
        height: of the frame in a notebook, in pixels.
    """

    path: Path
    notes: tuple[str, ...] = ()
    height: int = 620

    def _repr_html_(self) -> str:
        """The page in a frame, inside the notebook, which shows it elsewhere as well."""
        size = self.path.stat().st_size
        if size > _LARGEST_CELL:
            where = html.escape(str(self.path))
            return f"<p>{where} has {size / 1e6:.0f} MB: open it in a browser</p>"
        text = html.escape(self.path.read_text(encoding="utf-8"), quote=True)
        style = f"width:100%;height:{self.height}px;border:0"
        return f'<iframe title="flexfem" style="{style}" srcdoc="{text}"></iframe>'


def view(
    folder: str | Path, *, frames: int | None = None, fields: Sequence[str] | None = None,
    output: str | Path | None = None, height: int = 620,
) -> View:  # fmt: skip
    """Make one HTML file that shows a result, as ``flexfem view`` does.

    Args:
        folder: of the results.
        frames: number of instants at most; by default up to 600, fewer of large models.
        fields: names of the fields that colours can show, ``["all"]`` or ``["none"]``; the usual
            ones by default.
        output: the file; ``view.html`` in the folder by default.
        height: of the frame in a notebook, in pixels.

    Raises:
        ValueError: the folder has nothing to show, or a file is damaged; nothing is written.
        OSError: the file cannot be written.
    """
    choice = Choice(frames, None if fields is None else tuple(fields))
    source, target = Path(folder), None if output is None else Path(output)
    if launch.rank() > 0:  # the first one makes it
        return View(target or source / NAME, (), height)
    path, notes = write_view(source, choice, target)
    return View(path, tuple(notes), height)


def write_view(folder: Path, choice: Choice, output: Path | None = None) -> tuple[Path, list[str]]:
    """Make the page of a result folder; returns its file and notes about what is left out.

    Args:
        folder: of the results.
        choice: what it shall show.
        output: the file; ``view.html`` in the folder by default.

    Raises:
        InputError: the folder has nothing to show, or a file is damaged; nothing is written.
        OSError: the file cannot be written.
    """
    content = gather(folder, choice)
    target = output or folder / NAME
    replace_file(target, (text.encode() for text in page(content)))
    return target, list(content.notes)


def page(content: Content, *, live: bool = False) -> Iterator[str]:
    """The text of a page, in parts.

    Args:
        content: what it shows.
        live: True for a page that asks its server for later states.
    """
    nonce = hashlib.sha256(content.data).hexdigest()[:32]
    policy = _POLICY.format(nonce=nonce, connect="'self'" if live else "'none'")
    parts = {
        "NONCE": lambda: iter([nonce]),
        "POLICY": lambda: iter([policy]),
        "SOURCE": lambda: iter(["live" if live else "file"]),
        "TITLE": lambda: iter([html.escape(content.title)]),
        "STYLE": lambda: iter([_text("viewer.css")]),
        "BOOT": lambda: iter([_text("boot.js")]),
        "LIBRARY": lambda: iter([_library()]),
        "MODULES": _modules,
        "SCENE": lambda: iter([scene_text(content)]),
        "DATA": lambda: _data(content.data),
    }
    for number, piece in enumerate(_text("viewer.html").split("@@")):
        yield from parts[piece]() if number % 2 else iter([piece])


@cache
def _text(name: str) -> str:
    return (_WEB / name).read_text(encoding="utf-8")


@cache
def _library() -> str:
    return base64.b64encode(zlib.compress((_WEB / "three.module.min.js").read_bytes(), 9)).decode()


def _modules() -> Iterator[str]:
    for file in sorted(_WEB.glob("*.js")):
        if file.name != "boot.js" and not file.name.startswith("three."):
            yield f'<script type="text/plain" data-module="view/{file.name}">\n'
            yield f"{_text(file.name)}</script>\n"


def scene_text(content: Content) -> str:
    """The scene as JSON whose text cannot end its element, nor begin a comment."""
    text = json.dumps(content.scene, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _data(data: bytes) -> Iterator[str]:
    for start in range(0, len(data), _PIECE):
        text = base64.b64encode(data[start : start + _PIECE]).decode()
        yield f'<script type="text/plain" data-arrays>{text}</script>\n'
