# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mistakes in families of bodies that a script brings along are refused in one line."""

from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem.layout.family import Family
from tests.unit.refusals import assert_refused

pytestmark = pytest.mark.serial
MESH = ff.ElementMesh([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0, 1]], "interval")


class Bare(Family):
    """Knows where its nodes are."""

    frames = velocities = property(lambda self: np.zeros((2, 12)))  # type: ignore[assignment]


@pytest.mark.parametrize(
    ("family", "message"),
    [
        (Bare, "its family Bare must define body_of_node, node, costs, block"),
        (int, "family must be a class derived from Family, got <class 'int'>"),
        ("flexfem.nowhere:Bare", "its family cannot be loaded: No module named"),
        ("flexfem.layout.family:Bare", "its family cannot be loaded: .* has no attribute 'Bare'"),
        ("flexfem", "its family cannot be loaded: "),
    ],
)
def test_families_that_are_none_are_named(family: Any, message: str) -> None:
    kind = type("Own", (ff.UFLBody,), {"family": family})
    model = ff.Model("one")
    model.add(kind("j", MESH, lambda x, X, p: 0.0, density=1.0))
    options = ff.RunOptions(dt=1e-3, t_end=1e-3, quiet=True)
    assert_refused(lambda: ff.simulate(model, options), message)
