# SPDX-License-Identifier: LGPL-3.0-or-later
"""Names of version 0.1 that scripts use."""

from importlib import import_module
from types import SimpleNamespace
from typing import Any

import pytest

from flexfem._fields import Renamed
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.inspection.body_facts import BodyFacts
from flexfem.inspection.mobility import Mobility
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


def test_renamed_attributes_give_the_present_ones_and_warn() -> None:
    class Counts:
        def __init__(self) -> None:
            self.fixed = 3

        held = Renamed("fixed")

    assert isinstance(Counts.held, Renamed)
    with pytest.warns(DeprecationWarning, match="Counts.held is fixed now"):
        assert Counts().held == 3


@pytest.mark.parametrize("kind", [Mobility, BodyFacts])
def test_counts_of_summaries_have_their_former_names(kind: type) -> None:
    assert isinstance(kind.held, Renamed)
    assert isinstance(kind.freedoms, Renamed)
