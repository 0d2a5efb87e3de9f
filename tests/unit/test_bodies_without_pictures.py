# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of a family without a series for ParaView move, and have no pictures."""

from pathlib import Path

import pytest

import flexfem as ff
from flexfem.families.ufl_body.family import UFLBodyFamily

pytestmark = pytest.mark.serial


class Unseen(UFLBodyFamily):
    """Bodies of energies without pictures."""

    series = None  # type: ignore[assignment]


class UnseenBody(ff.UFLBody):
    """A body of this family."""

    family = Unseen  # type: ignore[assignment]


def test_fields_are_written_without_them(tmp_path: Path) -> None:
    mesh = ff.ElementMesh([[0, 0, 0], [1, 0, 0]], [[0, 1]], "interval", nodes={"end": [0]})

    def bar(x, X, p):
        import ufl

        F = ufl.grad(x)
        return 50.0 * ((ufl.inner(F, F) - 1) / 2) ** 2

    model = ff.Model("one")
    model.add(
        UnseenBody("bar", mesh, bar, density=1.0),
        ff.Spherical("pin", ff.Ground(), ff.Marker("bar", "end")),
        ff.Gravity((0.0, 0.0, -9.81)),
    )
    options = ff.RunOptions(dt=1e-3, t_end=2e-3, quiet=True, output=tmp_path)
    assert ff.simulate(model, options).status == "ok"
    assert {path.name for path in tmp_path.glob("*.pvd")} == {"joints.pvd", "reactions.pvd"}
