# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints between shells, bodies and beams in motion, on any number of ranks."""

import math
from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

COMM = MPI.COMM_WORLD
SECTION = ff.ShellSection.isotropic(0.005, ff.Material(2e9, 0.3, 1000.0))


def _grid(name: str, x: float, cells: tuple[int, int], width: float = 0.4) -> ff.SurfaceMesh:
    """A strip of length one along x from a place on."""
    u, v = np.linspace(x, x + 1.0, cells[0] + 1), np.linspace(0.0, width, cells[1] + 1)
    return ff.SurfaceMesh.grid(name, u, v)


SEAM = ff.ShellLine("first", "first_right"), ff.ShellLine("second", "second_left")


def _two(
    cells: tuple[int, int], other: tuple[int, int], section: ff.ShellSection = SECTION
) -> ff.Model:
    """Two strips one after the other, the first one clamped on the left; nothing joins them."""
    mesh = ff.SurfaceMesh.join([_grid("first", 0.0, cells), _grid("second", 1.0, other)])
    model = ff.Model("strips", surface=mesh)
    model.add(
        ff.Shell("first", section, edges={"first_left": "clamped"}),
        ff.Shell("second", section),
        ff.PositionProbe("tip", ff.Marker("second", "second_top_right")),
        ff.PositionProbe("seam", ff.Marker("first", "first_bottom_right")),
        ff.EnergyProbe("energy"),
        ff.Gravity((0.0, 0.0, -9.81)),
    )
    return model


def _run(model: ff.Model, comm: MPI.Intracomm = COMM, **more):
    settings = {"dt": 5e-3, "t_end": 0.1, "tolerance": 1e-11, "quiet": True}
    return ff.simulate(model, ff.RunOptions(**(settings | more)), comm=comm)


def _largest_difference(one, other) -> float:
    """Of two histories, relative to the largest value of each vector."""
    errors = []
    for column, values in one.items():
        family = [v for k, v in one.items() if k.rpartition("_")[0] == column.rpartition("_")[0]]
        scale = max(np.abs(v).max() for v in family)
        errors.append(np.abs(values - other[column]).max() / scale)
    return float(max(errors))


def _drive(t: float) -> float:
    return 0.5 * math.pi * math.sin(0.5 * math.pi * min(t / 0.4, 1.0)) ** 2


def _chain() -> ff.Model:
    """Three strips, each turned against the one before it by a drive, in a revolute joint."""
    names = ("s0", "s1", "s2")
    mesh = ff.SurfaceMesh.join([_grid(name, float(k), (4, 2)) for k, name in enumerate(names)])
    model = ff.Model("chain", surface=mesh)
    model.add(
        ff.Shell("s0", SECTION, edges={"s0_left": "clamped"}),
        ff.Shell("s1", SECTION),
        ff.Shell("s2", SECTION),
    )
    for a, b in pairwise(names):
        ends = ff.Marker(a, f"{a}_bottom_right"), ff.Marker(b, f"{b}_bottom_left")
        model.add(
            ff.Revolute(f"{b}_hinge", *ends, axis=(0, 1, 0)),
            ff.PrescribedAngle(f"{b}_drive", *ends, axis=(0, 1, 0), angle=_drive),
            ff.ReactionProbe(f"{b}_force", f"{b}_hinge"),
        )
    model.add(ff.PositionProbe("tip", ff.Marker("s2", "s2_top_right")), ff.EnergyProbe("energy"))
    return model


@pytest.mark.three_ranks
def test_driven_chain_on_any_number_of_ranks():
    found, alone = _run(_chain()), _run(_chain(), MPI.COMM_SELF)
    assert found.status == alone.status == "ok"
    if COMM.rank == 0:
        # round-off; a force that misses a node of a triangle shows in the first digits
        assert _largest_difference(alone.history, found.history) < 1e-9
        # the error of the step; the drives do 0.1 J and more of work
        h = found.history
        assert np.abs(h["energy_balance"]).max() < 0.01 * np.abs(h["energy_work"]).max()


def test_hinge_line_is_a_line_of_shared_nodes():
    """Shells that share the nodes of a line need no joint: an independent way to the same hinge."""
    joined = _two((4, 2), (4, 2))
    joined.add(ff.HingeLine("hinge", *SEAM))
    apart = joined.surface
    number = np.arange(len(apart.points))
    number[apart.line_nodes("second_left")] = apart.line_nodes("first_right")
    kept, number = np.unique(number, return_inverse=True)
    mesh = ff.SurfaceMesh(
        apart.points[kept],
        number[apart.triangles],
        apart.bodies,
        {name: number[pairs] for name, pairs in apart.lines.items()},
        {name: int(number[node]) for name, node in apart.nodes.items()},
    )
    shared = ff.Model("shared", surface=mesh)
    shared.add(*joined.shells, *joined.probes, joined.gravity)
    one, other = _run(joined), _run(shared)
    assert one.status == other.status == "ok"
    if COMM.rank == 0:
        assert one.history["tip_z"][-1] < -0.03
        # what the iterations leave; a hinge that resists, or a node off it, is in the first digits
        assert _largest_difference(one.history, other.history) < 1e-7


def _apart(a: ff.MarkerState, b: ff.MarkerState) -> float:
    return float(np.linalg.norm(a.position - b.position))


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize("cells", [(3, 5), (5, 3)])
def test_lines_of_different_meshes(cells):
    """The hinge stays closed, and the strip swings as with matching nodes."""
    tips = []
    for first, second in ((4, 4), cells):
        model = _two((4, first), (4, second))
        model.add(ff.HingeLine("hinge", *SEAM))
        ends = [ff.Marker("first", "first_top_right"), ff.Marker("second", "second_top_left")]
        model.add(
            ff.Probe(
                "gap", ends, ("gap",), lambda t, a, b: [np.linalg.norm(a.position - b.position)]
            )
        )
        found = _run(model)
        assert found.status == "ok"
        if COMM.rank == 0:
            assert found.history["gap"].max() < 1e-12
            tips.append(found.history["tip_z"])
    if COMM.rank == 0:
        # difference of meshes; a line that is held at some nodes only sags by more
        np.testing.assert_allclose(tips[1], tips[0], atol=0.01 * np.abs(tips[0]).max())


def _cantilever(cells: tuple[int, int], clamped: bool, ratio: float) -> float:
    """Deflection of a strip under its weight: in two parts, or in one."""
    section = ff.ShellSection.isotropic(0.005, ff.Material(2e9, ratio, 1000.0))
    if not clamped:
        mesh = ff.SurfaceMesh.rectangle("second", (2.0, 0.4), (2 * cells[0], cells[1]))
        model = ff.Model("strip", surface=mesh)
        model.add(
            ff.Shell("second", section, edges={"second_left": "clamped"}),
            ff.PositionProbe("tip", ff.Marker("second", "second_top_right")),
        )
    else:
        model = _two(cells, cells, section=section)
        model.add(ff.ClampedLine("clamp", *SEAM))
    model.gravity = ff.Gravity((0.0, 0.0, -0.5))
    found = ff.solve_static(model, ff.StaticOptions(quiet=True))
    assert found.status == "ok"
    return float(found.history["tip_z"][-1]) if COMM.rank == 0 else 0.0


@pytest.mark.serial
@pytest.mark.parametrize(
    ("cells", "ratio", "limit"),
    # without Poisson's ratio the same but for third powers of angles; with it, what the seam's
    # curvature along the line adds. Triangles that do not bend at the seam: 4 %; slopes beside the
    # middle of a segment: 0.3 %, and 1.3 % with 20x2 cells
    [((5, 2), 0.0, 2e-5), ((5, 2), 0.3, 5e-3), ((20, 2), 0.3, 1.5e-3)],
)
def test_clamped_line(cells, ratio, limit):
    """Two strips clamped together bend as one with the same mesh."""
    one, parts = (_cantilever(cells, clamped, ratio) for clamped in (False, True))
    assert abs(parts / one - 1.0) < limit


@pytest.mark.three_ranks
def test_clamped_line_of_different_meshes_on_any_number_of_ranks():
    model = _two((3, 2), (3, 3))
    model.add(ff.ClampedLine("clamp", *SEAM), ff.ReactionProbe("seam_force", "clamp"))
    found, alone = _run(model, t_end=0.05), _run(model, MPI.COMM_SELF, t_end=0.05)
    assert found.status == alone.status == "ok"
    if COMM.rank == 0:
        h = found.history
        # round-off; a triangle beside the seam that another rank lacks shows in the first digits
        assert _largest_difference(alone.history, h) < 1e-9
        # the error of the step; the seam's elastic energy is a tenth of all
        assert np.abs(h["energy_balance"]).max() < 0.01 * np.abs(h["energy_kinetic"]).max()


@pytest.mark.slow_on_ranks
def test_revolute_in_a_triangle():
    """A body on a pin inside a triangle turns with it: its axis stays in the triangle's axes."""
    model = ff.Model("pin", surface=_grid("first", 0.0, (2, 2)))
    nodes, weights = (4, 5, 8), (0.3, 0.5, 0.2)
    x = np.array(weights) @ model.surface.points[list(nodes)]
    axis = np.array([0.6, -0.3, 0.8]) / math.sqrt(1.09)
    corners = [ff.Marker("first", tuple(model.surface.points[n].tolist())) for n in nodes]
    hub = ff.Marker("hub")
    model.add(
        ff.Shell("first", SECTION, angular_velocity=(3, 1, 0)),
        ff.RigidBody("hub", 0.5, (0.01, 0.02, 0.03), position=x),
        ff.Revolute("pin", ff.SurfaceMarker("first", nodes, weights), hub, axis=axis),
        ff.Probe(
            "frames", [*corners, hub], ("gap", "cosine"),
            lambda t, a, b, c, h: _on_triangle(np.array(weights), axis, x, (a, b, c), h),
        ),
        ff.EnergyProbe("energy"),
    )  # fmt: skip
    found = _run(model, dt=2e-3, t_end=0.2)
    assert found.status == "ok"
    if COMM.rank == 0:
        h = found.history
        # what the iterations leave; another triangle's axes turn by 0.1 and more against these
        assert h["gap"].max() < 1e-9
        np.testing.assert_allclose(h["cosine"], 1.0, atol=1e-10)
        assert np.abs(h["energy_balance"]).max() < 0.01 * h["energy_kinetic"].max()


def _on_triangle(weights, axis, start, corners, hub) -> list[float]:
    """Gap to a place in a triangle of the plane z = 0, and cosine to an axis in its axes."""
    a, b, c = (corner.position for corner in corners)
    e1, n = (b - a) / np.linalg.norm(b - a), np.cross(b - a, c - a)
    n /= np.linalg.norm(n)
    turned = np.stack([e1, np.cross(n, e1), n], axis=1) @ axis  # e1 is along x at the start
    gap = np.linalg.norm(weights @ np.array([a, b, c]) - hub.position)
    return [float(gap), float(turned @ hub.rotation @ axis)]


def test_hinge_at_a_held_line():
    """A strip hangs down from the fixed edge of another one."""
    mesh = ff.SurfaceMesh.join([_grid("first", 0.0, (2, 2)), _grid("second", 1.0, (4, 2))])
    model = ff.Model("fixed edge", surface=mesh)
    model.add(
        ff.Shell("first", SECTION, edges={"first_right": "hinged"}, fixed={"first_left": "xyz"}),
        ff.Shell("second", SECTION),
        ff.HingeLine("hinge", *SEAM),
        ff.PositionProbe("edge", ff.Marker("first", "first_top_right")),
        ff.PositionProbe("root", ff.Marker("second", "second_top_left")),
        ff.PositionProbe("tip", ff.Marker("second", "second_top_right")),
        ff.Gravity((0.0, 0.0, -9.81)),
    )
    found = _run(model)
    assert found.status == "ok"
    if COMM.rank == 0:
        h = found.history
        assert h["tip_z"][-1] < -0.05
        # the joint pulls at what does not move: with a force on it the edge would fall
        np.testing.assert_array_equal(h["edge_z"], 0.0)
        np.testing.assert_allclose(h["root_z"], 0.0, atol=1e-10)


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "joint", [ff.HingeLine, pytest.param(ff.ClampedLine, marks=pytest.mark.serial)]
)
def test_lines_on_a_body(joint):
    """A strip on a rigid arm that turns: nodes, and slopes where clamped, go along."""
    model = ff.Model("flap", surface=_grid("first", 0.0, (4, 3)))
    arm = 0.3
    pin = ff.Revolute(
        "pin", ff.Ground((-arm, 0, 0)), ff.Marker("hub", offset=(-arm, 0, 0)), axis=(0, 1, 0)
    )
    model.add(
        ff.RigidBody("hub", 1.0, (1.0, 1.0, 1.0)),
        ff.Shell("first", SECTION),
        pin,
        ff.PrescribedAngle("turn", pin.a, pin.b, axis=(0, 1, 0), angle=lambda t: 20.0 * t * t),
        joint("line", ff.ShellLine("first", "first_left"), ff.Marker("hub")),
        ff.ReactionProbe("force", "line"),
        ff.MomentumProbe("momentum", bodies=["first"]),
        ff.PositionProbe("root", ff.Marker("first", "first_top_left")),
        ff.PositionProbe("beside", ff.Marker("first", (0.25, 0.4, 0.0))),
    )
    found = _run(model, t_end=0.2, dt=2e-3)
    assert found.status == "ok"
    if COMM.rank == 0:
        h, angle = found.history, 20.0 * 0.2**2
        expected = [arm * (math.cos(angle) - 1.0), 0.4, -arm * math.sin(angle)]
        # what the iterations leave; a node that is left behind is off by centimetres
        np.testing.assert_allclose([h[f"root_{c}"][-1] for c in "xyz"], expected, atol=1e-8)
        # the force on the body is the opposite of what changes the shell's momentum
        change = np.gradient(h["momentum_pz"], h["t"])
        np.testing.assert_allclose(
            h["force_fz"][5:-5], -change[5:-5], atol=0.05 * np.abs(change).max()
        )
        x, z = (h[f"beside_{c}"][-1] - h[f"root_{c}"][-1] for c in "xz")
        # with 32x4 cells clamped and with 16x4 hinged; triangles that do not bend at a clamp lag
        # behind by 0.2, a moment in a hinge by less than 1
        behind = {ff.ClampedLine: 0.430, ff.HingeLine: 1.072}[joint]
        assert angle - math.atan2(-z, x) == pytest.approx(behind, abs=0.02)


SLIDERS = 6


def _grommets(formulation: str) -> ff.Model:
    """A sheet that hangs on a wire in sliders at its upper nodes, and flies along it."""
    x, elements, length = np.linspace(0.1, 1.1, SLIDERS), 12, 1.5
    surface = ff.SurfaceMesh.grid(
        "sheet", x, (-0.2, 0.0), lambda u: np.stack([u[:, 0], 0.0 * u[:, 0], u[:, 1]], axis=1)
    )
    mesh, curve = None, ff.NurbsCurve.line((0, 0, 0), (length, 0, 0), degree=2, elements=elements)
    if formulation == "se3":
        points = np.linspace(0.0, length, elements + 1)[:, np.newaxis] * np.eye(3)[0]
        first = np.arange(elements)
        mesh = ff.LineMesh(points, np.stack([first, first + 1], axis=1), {"wire": first})
        curve = None
    model = ff.Model("grommets", mesh=mesh, surface=surface)
    section = ff.Section.circle(4e-3, ff.Material(2e9, 0.3, 2000.0))
    model.add(
        ff.Beam("wire", section, curve=curve, orientation=(0, 0, 1)),
        ff.Shell(
            "sheet",
            ff.ShellSection.isotropic(1e-3, ff.Material(1e9, 0.3, 1000.0)),
            velocity=(1, 0, 0),
        ),
        ff.Spherical("left", ff.Ground(), ff.Marker("wire", "start")),
        ff.Spherical("right", ff.Ground((length, 0, 0)), ff.Marker("wire", "end")),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.EnergyProbe("energy"),
        ff.PositionProbe("corner", ff.Marker("sheet", "sheet_bottom_right")),
    )
    for k in range(SLIDERS):
        slide = ff.Sliding(f"grommet_{k}", ff.Carrier("wire"), ff.Marker("sheet", (x[k], 0, 0)))
        place = ff.SlidingMarker(slide.name)
        model.add(
            slide,
            ff.JointFriction(f"friction_{k}", slide, coefficient=0.1, velocity=0.05),
            ff.Probe(f"path_{k}", [place], (f"arc_{k}",), lambda t, s: [s.arc]),
        )
    return model


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "formulation",
    [
        "nurbs",
        pytest.param("se3", marks=pytest.mark.serial),
    ],
)
def test_grommets(formulation):
    """Many sliders on one wire, in pieces on the ranks, that pass from element to element."""
    settings = {"dt": 4e-3, "t_end": 0.08, "split_above": 4}
    found = _run(_grommets(formulation), **settings)
    alone = _run(_grommets(formulation), MPI.COMM_SELF, **settings)
    assert found.status == alone.status == "ok"
    if COMM.rank == 0:
        h = found.history
        # round-off; a slider whose element is not passed on shows in the first digits
        assert _largest_difference(alone.history, h) < 1e-9
        passed = [np.diff(np.floor(h[f"arc_{k}"] / 0.125)).sum() for k in range(SLIDERS)]
        assert sum(passed) >= 3
        # the error of the step, of 0.1 J; an impulse at a change of element would add to it
        assert np.abs(h["energy_balance"]).max() < 1e-3
