# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads on director shells: resultants, tangents by differences, closed forms."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.families.shells.family import ShellFamily
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3, so3
from flexfem.system.system import System
from tests.contract.loaded_shells import disturb, load_forces, loaded, sums

SECTION = ff.ShellSection.isotropic(0.01, ff.Material(1e6, 0.0, 10.0))


def bowl(p: np.ndarray) -> np.ndarray:
    """A curved surface whose edges are curved as well."""
    x, y = p.T
    return np.column_stack([x, y, 0.3 * x * x - 0.2 * y * y])


def curved() -> ff.SurfaceMesh:
    return ff.SurfaceMesh.grid("shell", [0.0, 0.4, 1.0], [0.0, 0.5, 0.8], bowl)


def _system(
    mesh: ff.SurfaceMesh, load: object, comm: MPI.Intracomm = MPI.COMM_WORLD, **options: object
) -> System:
    return loaded(ff.Shell("shell", SECTION, element="director", **options), mesh, load, comm)


def _sums(system: System) -> np.ndarray:
    """Resultant and moment about the inertial origin of forces without moments (collective)."""
    assert not load_forces(system)[:, 3:].any()
    return sums(system)


def _places(system: System) -> np.ndarray:
    """Present positions (n, 3) of all nodes (collective)."""
    block = system.parts[0].block
    points = np.zeros((block.size_global, 3))
    points[block.node_ids[: block.owned]] = block.frames[: block.owned, :3]
    return system.comm.allreduce(points)


@pytest.mark.slow
@pytest.mark.three_ranks
def test_pressure_depends_on_the_rim_alone(rng):
    """Gauss: ``p/2`` times the integral of x x dx along the quadratic edges of the boundary."""
    system = _system(curved(), ff.Pressure("load", "shell", 7.0))
    disturb(system, rng, 0.1)
    points = _places(system)
    (rim,) = curved().boundary_lines("shell")
    serial = NumberedModel(_model_of(curved())).family(ShellFamily).surface
    middles = serial.directors.nodes[:, 3:].ravel()
    ends = np.stack([np.roll(serial.mesh.triangles, -k, 1).ravel() for k in (1, 2)], 1)
    pairs = [tuple(sorted(pair)) for pair in ends.tolist()]
    middle_of = dict(zip(pairs, middles.tolist(), strict=True))
    total = np.zeros(3)
    for a, b in zip(rim[:-1].tolist(), rim[1:].tolist(), strict=True):
        x, y, m = points[a], points[b], points[middle_of[tuple(sorted((a, b)))]]
        # the parabola's own area besides that of its chord
        total += np.cross(x, y) / 2 + np.cross(m - (x + y) / 2, y - x) * 2 / 3
    # round-off; flat triangles between the corners are off by tens of per cents
    np.testing.assert_allclose(_sums(system)[:3], 7.0 * total, atol=1e-12)


def _model_of(mesh: ff.SurfaceMesh) -> ff.Model:
    model = ff.Model("test", surface=mesh)
    model.add(ff.Shell("shell", SECTION, element="director"))
    model.validate()
    return model


@pytest.mark.serial
def test_tangent_and_action_of_pressure_by_differences(rng):
    mesh = ff.SurfaceMesh.grid("shell", [0.0, 0.6], [0.0, 0.5], bowl)
    system = _system(mesh, ff.Pressure("load", "shell", 7.0), MPI.COMM_SELF)
    disturb(system, rng, 0.1)
    (part,) = system.parts
    (inside,) = part.line_forces
    block, eps = part.block, 1e-6
    frames, count = block.frames.copy(), len(block.frames)
    columns = []
    for unknown in range(6 * count):
        sides, twist = [], np.zeros((count, 6))
        twist.ravel()[unknown] = eps
        for sign in (1.0, -1.0):
            turns = se3.rotation(frames)
            moved = frames[:, :3] + np.einsum("nij,nj->ni", turns, sign * twist[:, :3])
            block.frames[:] = se3.frame(moved, turns @ so3.exp(sign * twist[:, 3:]))
            sides.append(-load_forces(system, 0.4).ravel())
        columns.append((sides[0] - sides[1]) / (2.0 * eps))
    block.frames[:] = frames
    full = np.zeros((count, 6, count, 6))
    for nodes, K in zip(inside.nodes, inside.tangent(block, system.factors, 0.4), strict=True):
        for i in range(6):
            for j in range(6):
                full[nodes[i], :, nodes[j]] += K[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
    full = full.reshape(6 * count, 6 * count)
    # differences are good to 1e-9; rotating axes that are left out are of order one
    np.testing.assert_allclose(full, np.stack(columns, axis=1), atol=1e-8)
    block.step[:] = rng.normal(size=block.step.shape)
    block.residual[:] = 0.0
    inside.add_action(block, system.factors, 0.4)
    action = block.residual.ravel()
    np.testing.assert_allclose(action, full @ block.step.ravel(), atol=1e-12)


@pytest.mark.three_ranks
@pytest.mark.parametrize("line", ["shell_top", None])
def test_dead_loads_count_curved_lengths_and_areas(line, rng):
    force = np.array([1.0, -2.0, 3.0])
    load = ff.SurfaceLoad("load", "shell", force)
    if line is not None:
        load = ff.EdgeLoad("load", "shell", line, force)
    system = _system(curved(), load)
    s, w = np.polynomial.legendre.leggauss(20)
    x, wx = 0.5 * (s + 1.0), 0.5 * w
    if line is not None:
        points = bowl(np.column_stack([x, np.full(20, 0.8)]))
        sizes = wx * np.sqrt(1.0 + (0.6 * x) ** 2)
    else:
        X, Y = np.meshgrid(x, 0.8 * x)
        points = bowl(np.column_stack([X.ravel(), Y.ravel()]))
        sizes = (0.8 * np.outer(wx, wx) * np.sqrt(1 + (0.6 * X) ** 2 + (0.4 * Y) ** 2)).ravel()
    forces = sizes[:, None] * force
    expected = np.concatenate([forces.sum(0), np.cross(points, forces).sum(0)])
    # midpoints are found from tangent planes, to 2e-3; those on chords miss 1e-2, equal shares more
    np.testing.assert_allclose(_sums(system), expected, rtol=4e-3, atol=4e-3)
    before = _sums(system)[:3]
    disturb(system, rng, 0.1)
    np.testing.assert_allclose(_sums(system)[:3], before, atol=1e-12)


def test_ring_under_pressure():
    """A quarter: n = E h (l^2 - 1) / 2 is p R for the stretch l, as the pressure grows with it."""

    def ring(p: np.ndarray) -> np.ndarray:
        return np.column_stack([np.cos(p[:, 0]), np.sin(p[:, 0]), p[:, 1]])

    mesh = ff.SurfaceMesh.grid("shell", np.linspace(0.0, np.pi / 2, 7), [0.0, 0.3], ring)
    edges = {"shell_left": "symmetric y", "shell_right": "symmetric x"}
    model = ff.Model("ring", surface=mesh)
    model.add(
        ff.Shell("shell", SECTION, element="director", edges=edges, fixed={"shell_bottom": "z"}),
        ff.Pressure("inside", "shell", 1000.0),
        ff.PositionProbe("point", ff.Marker("shell", "shell_bottom_left")),
    )
    outcome = ff.solve_static(model, ff.StaticOptions(load_steps=2, split_above=4, quiet=True))
    assert outcome.status == "ok"
    if outcome.history:
        # bending is 1e-5, the polygon of parabolas 1e-4; a dead pressure gives 1.089
        assert outcome.history["point_x"][-1] == pytest.approx(np.sqrt(1.2), rel=5e-4)


@pytest.mark.slow
def test_work_of_pressure_is_counted():
    """A free sheet that rotates in its plane, pushed along its normal: momentum, closed balance."""
    stiff = ff.ShellSection.isotropic(0.1, ff.Material(1e6, 0.3, 10.0))
    model = ff.Model("pushed", surface=ff.SurfaceMesh.rectangle("shell", (2.0, 1.0), (2, 1)))
    model.add(
        ff.Shell("shell", stiff, element="director", angular_velocity=(0.0, 0.0, 1.0)),
        ff.Pressure("push", "shell", 5.0, amplitude=lambda t: 1.0 + t),
        ff.EnergyProbe(),
        ff.MomentumProbe("all"),
    )
    history = ff.simulate(model, ff.RunOptions(dt=2e-3, t_end=0.1, rho_inf=1.0)).history
    if history:
        # the integral of the force, 10 N at the start; centrifugal strains are 1e-5
        assert history["all_pz"][-1] == pytest.approx(10.0 * (0.1 + 0.005), rel=1e-4)
        # trapezoidal rule: second order in the step; work left out is all of the energy
        assert abs(history["energy_balance"]).max() <= 2e-3 * history["energy_work"][-1]
        assert history["energy_work"][-1] > 0.1
