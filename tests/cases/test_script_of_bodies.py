# SPDX-License-Identifier: LGPL-3.0-or-later
"""A script outside the package with bodies of an energy in UFL.

A truss with a swinging bar, and a membrane that falls on a plane.
"""

from pathlib import Path

import numpy as np
import pytest

from flexfem.io import read_history
from tests.cases.conftest import Run

pytestmark = pytest.mark.serial

SCRIPT = '''"""Bars of two nodes and a membrane of triangles."""

import numpy as np
import ufl
import flexfem as ff


def bar(x, X, p):
    F = ufl.grad(x)
    return p.EA / 2 * ((ufl.inner(F, F) - 1) / 2) ** 2


def membrane(x, X, p):
    F = ufl.grad(x)
    C = F.T * F
    square = (ufl.tr(C) ** 2 - ufl.inner(C, C)) / 2
    return p.mu * p.h / 2 * (ufl.tr(C) + 1 / square - 3)


def model():
    """Two bars that carry a ball; a membrane that falls on a plane and pulls at a body."""
    m = ff.Model("truss")
    points = [[0, 0, 0], [1, 0, 0], [1, 0, -1]]
    ends = {"a": [0], "b": [1], "c": [2]}
    truss = ff.ElementMesh(points, [[0, 1], [1, 2]], "interval", nodes=ends)
    m.add(ff.UFLBody("bars", truss, bar, density=0.5, parameters={"EA": 2e3}))
    m.add(ff.Spherical("pin", ff.Ground((0, 0, 0)), ff.Marker("bars", "a")))
    m.add(ff.RigidBody("ball", mass=1.0, inertia=np.eye(3) * 0.1, position=(1, 0, -1.2)))
    m.add(ff.Spherical("tie", ff.Marker("bars", "c"), ff.Marker("ball", offset=(0, 0, 0.2))))
    ticks = np.linspace(0, 0.5, 5)
    flat = ff.SurfaceMesh.grid(
        "sheet", ticks, ticks, lambda p: np.column_stack([p[:, 0] + 2, p[:, 1], 0 * p[:, 0]])
    )
    mesh = ff.ElementMesh.from_surface(flat)
    edge = np.flatnonzero(np.isclose(mesh.points[:, 0], 2.0))
    mesh = ff.ElementMesh(mesh.points, mesh.cells, "triangle", nodes={"edge": edge})
    sheet = m.add(ff.UFLBody(
        "sheet", mesh, membrane, density=0.2, parameters={"mu": 1e4, "h": 1e-2}, thickness=1e-2
    ))
    m.add(ff.Spherical("mean", ff.Ground((2, 0.25, 0)), sheet.marker("edge")))
    m.add(ff.PointForce("push", ff.Marker("sheet", (2.5, 0.5, 0.0)), (0.0, 0.1, 0.0)))
    plane = ff.RigidPlane(ff.Ground((0, 0, -0.05)))
    m.add(ff.Contact("floor", "sheet", surfaces=plane, stiffness=1e5))
    m.add(ff.Gravity((0, 0, -9.81)))
    m.add(ff.PositionProbe("b", ff.Marker("bars", "b")))
    m.add(ff.PositionProbe("bob", ff.Marker("ball")))
    m.add(ff.PositionProbe("corner", ff.Marker("sheet", (2.5, 0.5, 0.0))))
    m.add(ff.ReactionProbe("pin_force", "pin"))
    m.add(ff.EnergyProbe("energy"))
    m.add(ff.MomentumProbe("momentum", bodies=["bars", "ball"]))
    m.add(ff.ContactProbe("touch", "floor"))
    return m


CASE = ff.Case(
    name="truss", summary="bars, a ball and a membrane", description=__doc__, build=model,
    dt=2e-3, t_end=0.24, smoke={"t_end": 4e-3},
)
'''


@pytest.mark.slow
def test_a_script_of_the_user_runs_on_all_ranks_and_from_checkpoints(
    tmp_path: Path, run: Run
) -> None:
    """Joints, loads, probes, contact, restart on another number of ranks, and pictures."""
    (tmp_path / "truss.py").write_text(SCRIPT)

    def history(ranks: int, name: str, *options: object) -> dict[str, np.ndarray]:
        more = ("--split-above", 1) if ranks > 1 else ()
        program = ("-m", "flexfem", "run", "truss.py", "--output", name)
        ended = run(ranks, *program, *options, *more, cwd=tmp_path)
        assert ended.returncode == 0, ended.stderr
        return dict(read_history(tmp_path / name / "history.csv"))

    whole = history(1, "one", "--checkpoint-every", 60)
    assert whole["touch_closed"].max() > 3.0
    assert abs(whole["energy_balance"]).max() <= 0.01
    checkpoint = min((tmp_path / "one").rglob("*.h5"))
    table = history(2, "two", "--restart", checkpoint)
    count = len(table["t"])
    assert count == len(whole["t"]) - 60
    for column, values in whole.items():
        scale = max(abs(values).max(), 1.0)
        np.testing.assert_allclose(
            table[column], values[-count:], atol=1e-9 * scale, err_msg=column
        )
    for name in ("energy_lines", "energy_triangles"):
        assert (tmp_path / "one" / f"{name}.pvd").is_file()
        texts = [file.read_bytes() for file in (tmp_path / "two" / name).glob("*.vtu")]
        assert all(b'Name="energy"' in text for text in texts)
        assert texts
