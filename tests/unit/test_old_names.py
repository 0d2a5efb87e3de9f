# SPDX-License-Identifier: LGPL-3.0-or-later
"""Names of version 0.1 that families of scripts use."""

from importlib import import_module
from types import SimpleNamespace
from typing import Any

import pytest

from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.layout.family import Family

pytestmark = pytest.mark.serial


@pytest.mark.parametrize(
    ("module", "name", "value"),
    [("system.family", "Family", Family), ("core.frame_block", "FrameBlock", FrameBlock)],
)
def test_old_modules_give_the_same_and_warn(module: str, name: str, value: type) -> None:
    old = import_module(f"flexfem.{module}")
    with pytest.warns(DeprecationWarning, match=f"flexfem.{module} is flexfem.* now"):
        assert getattr(old, name) is value
    with pytest.raises(AttributeError):
        _ = old.nothing


def test_families_that_offer_gauges_are_asked_for_them() -> None:
    class Old(Family):
        def gauge(self, probe: Any, part: Any) -> Any:
            return probe, part

    with pytest.warns(DeprecationWarning, match="Old.gauge is sensor now"):
        assert Old(SimpleNamespace(), 0).sensor("probe", "part") == ("probe", "part")
    assert Family(SimpleNamespace(), 0).sensor("probe", "part") is None
