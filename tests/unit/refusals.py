# SPDX-License-Identifier: LGPL-3.0-or-later
"""How mistakes are refused."""

from collections.abc import Callable

import pytest


def assert_refused(make: Callable[[], object], message: str) -> None:
    """One line that begins with what the thing named "j" is and holds the message."""
    with pytest.raises((ValueError, TypeError), match=message) as raised:
        make()
    text = str(raised.value)
    assert "\n" not in text
    assert text.split(":")[0].endswith('"j"')
