# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sheets that come to rest on something: what holds them, where steps end, what touches."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.unit.contact_motion import sheet

COMM = MPI.COMM_WORLD
ELEMENTS = pytest.mark.parametrize("element", ["rotation_free", "director"])
SIZE, THICKNESS, STIFFNESS = 0.4, 2e-3, 1e9
GAP = 0.1
PLASTIC = ff.ShellSection.isotropic(THICKNESS, ff.Material(2e9, 0.3, 1200.0))
#: Newtons per square metre, newtons.
PRESSURE = 1200.0 * THICKNESS * 9.81
WEIGHT = PRESSURE * SIZE**2


def lying(element: str, gap: float, *, cells: int = 4, ball: float = 0.0, pinned: bool = False):
    """A sheet above a plane, or a ball of a given radius; pinned, its middle moves along z only."""
    down = -gap - THICKNESS / 2
    plane = ff.RigidPlane(ff.Ground((0.0, 0.0, down)))
    surface = ff.RigidSphere(ff.Ground((0.0, 0.0, down - ball)), ball) if ball else plane
    middle = ff.Marker("sheet", (0.0, 0.0, 0.0))
    model = ff.Model("lying", surface=sheet("sheet", cells + 1, SIZE, (0.0, 0.0, 0.0)))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell("sheet", PLASTIC, element=element),
        ff.Contact("floor", "sheet", surfaces=surface, stiffness=STIFFNESS),
        ff.ContactProbe("touch", "floor"),
        ff.PositionProbe("middle", middle),
        ff.PositionProbe("corner", ff.Marker("sheet", (SIZE / 2, SIZE / 2, 0.0))),
    )
    if pinned:
        model.add(ff.PointOnLine("pin", ff.Ground(), middle, axis=(0.0, 0.0, 1.0)))
    return model


def rest(model: ff.Model, comm: MPI.Intracomm = COMM, **more) -> ff.Outcome:
    settings = {"load_steps": 2, "stabilise": True, "quiet": True} | more
    return ff.solve_static(model, ff.StaticOptions(**settings), comm=comm)


def same(one: dict, other: dict) -> None:
    """Compare histories of different ranks: rounding; a contact left out changes 1e-1."""
    for name, values in one.items():
        vector = [np.abs(v).max() for k, v in one.items() if k[:-1] == name[:-1]]
        scale = max(*vector, 1e-3)
        np.testing.assert_allclose(other[name], values, rtol=0.0, atol=1e-9 * scale, err_msg=name)


@pytest.mark.parametrize(
    "element", ["rotation_free", pytest.param("director", marks=pytest.mark.three_ranks)]
)
def test_free_sheet_sinks_onto_a_plane(element):
    found, alone = (rest(lying(element, 1e-3), comm) for comm in (COMM, MPI.COMM_SELF))
    assert found.status == alone.status == "ok"
    # a dozen in all: steps that pass the plane and come back would be some hundred
    assert alone.summary["newton_iterations"] < 25
    if COMM.rank == 0:
        same(alone.history, found.history)
        h = alone.history
        # what the iteration leaves; 1 if gravity did not grow with t, or nothing touched
        np.testing.assert_allclose(h["touch_fz"], h["t"] * WEIGHT, rtol=1e-6, atol=1e-9 * WEIGHT)
        # nodes of directors have a bit more than their areas' share of the mass, or less; a sheet
        # held by stabilisation stays above
        depth = -h["middle_z"][-1] - 1e-3
        assert depth == pytest.approx(PRESSURE / STIFFNESS, rel=0.5)
        assert h["corner_z"][-1] == pytest.approx(h["middle_z"][-1], abs=1e-9)


@ELEMENTS
@pytest.mark.parametrize("gravity", ["proportional", "constant"])
@pytest.mark.parametrize("gap", [1e-3, 0.0])
def test_free_sheet_is_refused_by_name(element, gravity, gap):
    """Nothing holds it at the start, also if gravity acts there."""
    with pytest.raises(ValueError, match='Shell "sheet": can move without any stiffness'):
        rest(lying(element, gap), gravity_load=gravity, stabilise=False)


@ELEMENTS
def test_sheet_hangs_over_a_ball(element):
    """It touches with the node at its middle, the smallest of contacts."""
    found = rest(lying(element, 1e-4, ball=0.1, pinned=True), gravity_load="constant")
    h = found.history
    # 8 and 10; directors take 52 where steps do not end at what begins to touch
    assert found.summary["newton_iterations"] < 25
    if COMM.rank == 0:
        # equilibrium, to the tolerance of the iteration
        assert h["touch_fz"][-1] == pytest.approx(WEIGHT, rel=1e-5)
        assert h["middle_z"][-1] == pytest.approx(-1e-4, abs=1e-4)
        assert h["corner_z"][-1] < -3e-3


@pytest.mark.serial
def test_no_equilibrium_is_held_by_stabilisation():
    """On top of a ball a sheet that nothing pins slides: its weight decides, small steps do not."""
    found = rest(lying("rotation_free", 0.0, ball=0.1), load_steps=4, max_iterations=12)
    h = found.history
    # forces of stabilisation are left out; those that make steps small carry two thirds
    np.testing.assert_allclose(h["touch_fz"], h["t"] * WEIGHT, rtol=1e-4, atol=1e-9)


def onto(what: str, element: str = "rotation_free", way: float = 0.0) -> ff.Model:
    """A sheet above a table of triangles, farther than candidates for contact are looked for.

    It does not move in its plane; corners are driven down by a given way.
    """
    # no node is right above an edge, where rounding would choose between sides
    place = (0.013, 0.007, -GAP - THICKNESS)
    above, table = sheet("sheet", 5, SIZE, (0.0, 0.0, 0.0)), sheet("table", 4, 1.5 * SIZE, place)
    whole = ff.SurfaceMesh.join([above, table]) if what == "shell" else above
    model, axis = ff.Model(what, surface=whole), (0.0, 0.0, 1.0)
    fixed = {"sheet_bottom_left": "xy", "sheet_bottom_right": "y"}
    edges = {f"table_{side}": "clamped" for side in ("left", "right", "top", "bottom")}
    if what == "shell":
        model.add(ff.Shell("table", PLASTIC, element=element, edges=edges))
        model.add(ff.Contact("floor", "sheet", "table", stiffness=STIFFNESS))
    else:
        surface = ff.RigidMesh(ff.Ground(), mesh=table, two_sided=True)
        model.add(ff.Contact("floor", "sheet", surfaces=surface, stiffness=STIFFNESS))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell("sheet", PLASTIC, element=element, fixed=fixed),
        ff.ContactProbe("touch", "floor"),
        ff.PositionProbe("middle", ff.Marker("sheet", (0.0, 0.0, 0.0))),
    )
    for name in ("bottom_left", "bottom_right", "top_left") if way else ():
        node = f"sheet_{name}"
        start, end = ff.Ground(tuple(whole.points[whole.nodes[node]])), ff.Marker("sheet", node)
        model.add(ff.PrescribedTranslation(name, start, end, lambda t: -way * t, axis))
    return model


@pytest.mark.parametrize(
    ("what", "element"),
    [
        ("shell", "rotation_free"),
        ("mesh", "rotation_free"),
        pytest.param("mesh", "director", marks=pytest.mark.serial),
    ],
)
def test_sheet_sinks_onto_triangles(what, element):
    """They are looked for while it sinks, and it does not jump through."""
    settings = {"load_steps": 1, "max_iterations": 60}
    found, alone = (rest(onto(what, element), comm, **settings) for comm in (COMM, MPI.COMM_SELF))
    assert found.status == alone.status == "ok"
    if COMM.rank == 0:
        same(alone.history, found.history)
        h = alone.history
        # what the iteration leaves; without contact it would fall for ever
        assert h["touch_fz"][-1] == pytest.approx(WEIGHT, rel=1e-5)
        # the shell below bends by 1e-3 m; where it touches at no distance, it would be 1e-3 m lower
        assert h["middle_z"][-1] == pytest.approx(-GAP - THICKNESS / 2, abs=1.5e-3)


@pytest.mark.serial
def test_driven_sheet_finds_triangles_on_its_way():
    """Accepted load steps renew the candidates for contact; the first ones are out of reach."""
    model = onto("mesh", way=GAP - 2e-3)
    h = rest(model, stabilise=False, load_steps=20).history
    # the sheet hangs through between its corners, by 1e-2 m if nothing were there
    assert h["middle_z"][-1] == pytest.approx(-GAP - THICKNESS / 2, abs=1e-4)
    assert 0.1 * WEIGHT < h["touch_fz"][-1] < WEIGHT
