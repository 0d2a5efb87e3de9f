# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometry of the cases of contact, and what they refuse."""

from itertools import pairwise

import numpy as np
import pytest

from flexfem._types import FloatArray
from flexfem.case import load_case
from flexfem.model.model import Model

pytestmark = pytest.mark.serial


def built(name: str, **given: object) -> Model:
    case = load_case(name)
    values = case.values(given)
    return case.build(**{option.name: values[option.name] for option in case.options})


def crossings(points: FloatArray) -> list[tuple[float, float, bool]]:
    """Crossings of a polyline seen along Z: places along it, and True if the first is above."""
    found = []
    for i, (a, b) in enumerate(pairwise(points)):
        for j, (c, d) in enumerate(pairwise(points[: max(i - 1, 0)])):
            matrix = np.column_stack([(b - a)[:2], (c - d)[:2]])
            if abs(np.linalg.det(matrix)) < 1e-15:
                continue
            s, t = np.linalg.solve(matrix, (c - a)[:2])
            if 0.0 <= s < 1.0 and 0.0 <= t < 1.0:
                found.append((i + s, j + t, (a + s * (b - a))[2] > (c + t * (d - c))[2]))
    return found


def test_rope_is_knotted() -> None:
    points = built("knot", elements=60, apart=3.0).mesh.points
    met = crossings(points)
    # three crossings, above and below in turn along the rope: that is a trefoil, while a loop that
    # falls open has two of one kind one after the other
    assert len(met) == 3
    along = sorted([(s, up) for s, _, up in met] + [(t, not up) for _, t, up in met])
    assert all(up != after for (_, up), (_, after) in pairwise(along))
    with pytest.raises(ValueError, match=r"apart must be above 1.05 diameters, got 1.02"):
        built("knot", apart=1.02)


def test_ropes_that_may_overlap_are_refused() -> None:
    with pytest.raises(ValueError, match=r"spacing must be above 0.045.* 2 degrees .* got 0.1 and"):
        built("rope_heap", tilt=2.0, spacing=0.04)
