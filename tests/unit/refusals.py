# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of refusals of mistakes."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

import flexfem

#: The guide's page on messages; what changes in them is written as "…" there.
PAGE = Path(flexfem.__file__).parent / "docs" / "guide" / "errors.md"
#: Words that messages may end with besides what the page says: advice, and where to read on.
_MORE = r"(; .*)?( \(see .* --help\))?"


@cache
def rows_of_page() -> tuple[str, ...]:
    """The messages on the page as they are written there."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    return tuple(re.findall(r"`([^`]*)`", line)[0] for line in lines if line.startswith("| `"))


def pattern_of(row: str) -> str:
    """Regular expression of a message on the page."""
    return ".*".join(map(re.escape, row.split("…"))) + _MORE


def assert_on_page(text: str) -> None:
    """The page names this message."""
    assert any(re.fullmatch(pattern_of(row), text) for row in rows_of_page()), text


def assert_refused(make: Callable[[], object], message: str) -> None:
    """One line that begins with what the thing named "j" is and holds the message."""
    with pytest.raises((ValueError, TypeError), match=message) as raised:
        make()
    text = str(raised.value)
    assert "\n" not in text
    assert text.split(":")[0].endswith('"j"')
    assert_on_page(text)
