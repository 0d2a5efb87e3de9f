# SPDX-License-Identifier: LGPL-3.0-or-later
"""A page with links to the pages of several result folders."""

from __future__ import annotations

import base64
import hashlib
import html
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import quote

from flexfem._files import read_bytes, replace_file
from flexfem.io.summary import read_summary

__all__ = ["write_gallery"]

#: Pictures of ``flexfem render`` that a card may show, the first one that is there.
_PICTURES = ("still.png", "motion.png")
#: Bytes of a picture at most, and those that it begins with.
_LARGEST, _PNG = 4_000_000, b"\x89PNG\r\n\x1a\n"
_STYLE = """\
:root { color-scheme: light dark; }
body { margin: 2rem; font: 14px/1.5 system-ui, sans-serif; }
main { display: grid; grid-template-columns: repeat(auto-fill, minmax(240px, 1fr)); gap: 1rem; }
a {
  display: block; padding: 1rem; border: 1px solid #8886; border-radius: 8px; color: inherit;
  text-decoration: none;
}
a:hover { border-color: #2166b0; }
h2 { margin: 0; font-size: 1rem; }
p { margin: 0; opacity: 0.75; overflow-wrap: anywhere; }
img { width: 100%; border-radius: 4px; background: #f6f8fb; }
"""


def write_gallery(output: Path, pages: Sequence[Path]) -> Path:
    """Write the page; returns its file.

    Args:
        output: the file. It finds the pages by their places relative to it, so that a folder with
            all of them may be moved and sent.
        pages: those of result folders, in which they lie.

    Raises:
        OSError: the file cannot be written.
    """
    nonce = hashlib.sha256(_STYLE.encode()).hexdigest()[:32]
    policy = f"default-src 'none'; style-src 'nonce-{nonce}'; img-src data:"
    head = (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>Results</title>\n<style nonce="{nonce}">\n{_STYLE}</style>\n'
        "</head>\n<body>\n<main>\n"
    )
    cards = (_card(page, output.parent) for page in pages)
    texts = [head, *cards, "</main>\n</body>\n</html>\n"]
    replace_file(output, (text.encode() for text in texts))
    return output


def _card(page: Path, start: Path) -> str:
    """A picture, if there is one, the name, and what the summary tells."""
    address = quote(os.path.relpath(page, start))
    title, lines = _words(page)
    text = "".join(f"<p>{html.escape(line)}</p>" for line in lines)
    return f'<a href="{address}">{_picture(page.parent)}<h2>{html.escape(title)}</h2>{text}</a>\n'


def _words(page: Path) -> tuple[str, Iterator[str]]:
    """Name of the case, and lines about the run."""
    try:
        summary = read_summary(page.parent / "summary.json")
    except (OSError, ValueError):
        summary = {}
    name = page.parent.resolve().name
    sizes = [f"{summary[key]} {key}" for key in ("unknowns", "steps") if key in summary]
    status = str(summary.get("status", ""))
    title = str(summary.get("case", name))
    words = ("" if name == title else name, ", ".join(sizes), "" if status == "ok" else status)
    return title, filter(None, (*words, _size(page)))


def _size(page: Path) -> str:
    return f"{page.stat().st_size / 1e6:.1f} MB"


def _picture(folder: Path) -> str:
    for name in _PICTURES:
        path = folder / name
        if path.is_file() and path.stat().st_size <= _LARGEST:
            data = read_bytes(f"picture '{path}'", path, _LARGEST)
            if data.startswith(_PNG):
                return f'<img alt="" src="data:image/png;base64,{base64.b64encode(data).decode()}">'
    return ""
