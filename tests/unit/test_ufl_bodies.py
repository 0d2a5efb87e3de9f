# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies with an energy in UFL: derivatives, ranks, refusals; bars, membranes and solids."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import ufl

import flexfem as ff
from flexfem.families.ufl_body.family import UFLBodyFamily
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.build import build
from flexfem.system.system import MASS, Shifts

COMM = MPI.COMM_WORLD


def bar(x, X, p):
    """St. Venant-Kirchhoff bar: Green strain along the line, J/m."""
    F = ufl.grad(x)
    return p.EA / 2 * ((ufl.inner(F, F) - 1) / 2) ** 2


def membrane(x, X, p):
    """Incompressible neo-Hookean membrane, J/m^2."""
    F = ufl.grad(x)
    C = F.T * F
    square = (ufl.tr(C) ** 2 - ufl.inner(C, C)) / 2  # of the ratio of areas
    return p["mu"] * p["h"] / 2 * (ufl.tr(C) + 1 / square - 3)


def solid(x, X, p):
    """Compressible neo-Hookean solid, J/m^3."""
    F = ufl.grad(x)
    J = ufl.det(F)
    return p.mu / 2 * (ufl.inner(F, F) - 3 - 2 * ufl.ln(J)) + p.lam / 2 * ufl.ln(J) ** 2


def line(count: int = 6, degree: int = 1) -> ff.ElementMesh:
    """A straight line of two- or three-node cells along x, 1 m long."""
    points = np.zeros((count * degree + 1, 3))
    points[:, 0] = np.linspace(0.0, 1.0, len(points))
    first = degree * np.arange(count)
    nodes = [first, first + 1] if degree == 1 else [first, first + 2, first + 1]
    ends = {"start": [0], "end": [len(points) - 1]}
    return ff.ElementMesh(points, np.column_stack(nodes), "interval", degree=degree, nodes=ends)


def sheet() -> ff.ElementMesh:
    """A square of triangles, 1 m by 1 m."""
    ticks = np.linspace(0.0, 1.0, 5)
    return ff.ElementMesh.from_surface(
        ff.SurfaceMesh.grid("sheet", ticks, ticks, lambda p: np.column_stack([p, 0 * p[:, 0]]))
    )


def block() -> ff.ElementMesh:
    """Six tetrahedra of ten nodes that fill a cuboid."""
    corners = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)
    tets = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7],
                     [0, 5, 1, 7]])  # fmt: skip
    edges = [(2, 3), (1, 3), (1, 2), (0, 3), (0, 2), (0, 1)]
    middles: dict[tuple[int, ...], int] = {}
    rows = []
    for tet in tets:
        pairs = [tuple(sorted((tet[a], tet[b]))) for a, b in edges]
        rows.append([*tet, *(8 + middles.setdefault(pair, len(middles)) for pair in pairs)])
    points = np.concatenate([corners, [corners[list(pair)].mean(axis=0) for pair in middles]])
    base = np.flatnonzero(points[:, 2] == 0.0)
    scaled = points * [1.0, 0.7, 0.5]
    return ff.ElementMesh(scaled, rows, "tetrahedron", degree=2, nodes={"base": base})


BODIES = {
    "bar": (line, bar, {"EA": 50.0}),
    "curved bar": (lambda: line(3, 2), bar, {"EA": np.array([50.0, 60.0, 70.0])}),
    "membrane": (sheet, membrane, {"mu": 30.0, "h": 0.1}),
    "solid": (block, solid, {"mu": 20.0, "lam": 30.0}),
}


def system(name: str, **more) -> SimpleNamespace:
    """System of one body, its arrays addressed by nodes of the mesh."""
    make, energy, parameters = BODIES[name]
    model = ff.Model("test")
    mesh = make()
    model.add(ff.UFLBody("body", mesh, energy, density=2.0, parameters=parameters, **more))
    model.validate()
    found = build(NumberedModel(model), COMM, split_above=1)
    (part,) = found.parts
    return SimpleNamespace(mesh=mesh, part=part, block=part.block, elements=part.elements)


def deform(s: SimpleNamespace) -> None:
    """Move all nodes by a smooth large displacement."""
    X = s.block.start_frames[:, :3]
    s.block.frames[:, :3] = X + 0.2 * np.column_stack(
        [X[:, 1] + 0.5 * X[:, 0], np.sin(X[:, 0]), X[:, 0] * X[:, 0] - 0.3 * X[:, 2]]
    )


def everywhere(s: SimpleNamespace, values: np.ndarray) -> np.ndarray:
    """Rows of all nodes of the mesh, given those of the owned nodes."""
    out = np.zeros((len(s.mesh.points), values.shape[1]))
    out[s.block.node_ids[: s.block.owned]] = values[: s.block.owned]
    return COMM.allreduce(out)


def total(s: SimpleNamespace) -> float:
    """Strain energy of all ranks."""
    return COMM.allreduce(float(s.elements.energies(s.block.frames).sum()))


@pytest.mark.parametrize("name", BODIES)
def test_forces_and_matrices_are_derivatives_of_the_energy(name):
    """On any number of ranks, in axes of the nodes that are rotated."""
    s = system(name)
    deform(s)
    frames, gravity = s.block.frames.copy(), np.zeros(3)
    step = np.sin(1.0 + 3.0 * s.block.start_frames[:, :3] + np.arange(3))

    def residual(at: float) -> np.ndarray:
        s.block.frames[:, :3] = frames[:, :3] + at * step
        s.part.add_residual(gravity, np.zeros(0), 1.0)
        return everywhere(s, s.block.owned_residual).copy()

    force = residual(0.0)
    own = everywhere(s, step)
    energies = []
    for at in (-1e-5, 1e-5):
        s.block.frames[:, :3] = frames[:, :3] + at * step
        energies.append(total(s))
    work = (energies[1] - energies[0]) / 2e-5
    assert np.vdot(force, own) == pytest.approx(work, rel=1e-6)
    change = (residual(1e-5) - residual(-1e-5)) / 2e-5
    s.block.frames[:] = frames
    s.block.step[:, :3] = step
    s.block.residual[:] = 0.0
    shifts = Shifts(velocity=0.0, acceleration=0.0, scale=1.0)
    s.elements.add_action(s.block, gravity, shifts.array, 1.0)
    s.block.add_ghosts()
    action = everywhere(s, s.block.owned_residual)
    np.testing.assert_allclose(action, change, atol=1e-6 * abs(action).max())
    blocks = s.elements.values(s.block, gravity, shifts.array, 1.0).reshape(-1, 3, 3)
    ((rows, columns),) = s.elements.couplings
    s.block.residual[:] = 0.0
    products = np.einsum("kab,kb->ka", blocks, step[columns.ravel()])
    np.add.at(s.block.residual[:, :3], rows.ravel(), products)
    s.block.add_ghosts()
    np.testing.assert_allclose(everywhere(s, s.block.owned_residual), action, atol=1e-9)


@pytest.mark.three_ranks
@pytest.mark.parametrize("name", BODIES)
def test_a_rigid_motion_has_no_forces_and_its_momenta(name):
    """The axes of the nodes rotate with the body; masses are those of the shape."""
    s = system(name, angular_velocity=(0.3, -0.2, 0.5), velocity=(1.0, 0.0, 0.0))
    motion = np.zeros(11)
    s.elements.add_motion(s.block, np.ones(len(s.elements.body), dtype=bool), motion)
    motion = COMM.allreduce(motion)
    size = {"bar": 1.0, "curved bar": 1.0, "membrane": 1.0, "solid": 0.35}[name]
    assert motion[1] == pytest.approx(2.0 * size)
    centre = motion[2:5] / motion[1]
    mean = np.array([1.0, 0.0, 0.0]) + np.cross([0.3, -0.2, 0.5], centre)
    np.testing.assert_allclose(motion[5:8] / motion[1], mean)
    s.elements.values(s.block, np.zeros(3), MASS.array, 1.0)
    turn = ff_rotation((0.4, 1.1, -0.6))
    s.block.frames[:, :3] = s.block.frames[:, :3] @ turn.T + 1.0
    assert total(s) == pytest.approx(0.0, abs=1e-12)
    s.elements.accept(s.block)
    axes = s.block.frames[:, 3:].reshape(-1, 3, 3)
    if name in ("membrane", "solid"):
        np.testing.assert_allclose(axes, np.broadcast_to(turn, axes.shape), atol=1e-9)
    else:
        np.testing.assert_allclose(axes[:, :, 0], np.tile(turn[:, 0], (len(axes), 1)), atol=1e-9)


def ff_rotation(vector: tuple[float, float, float]) -> np.ndarray:
    """Matrix of a rotation vector."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()


PULL, WEIGHT = np.array([30.0, -20.0, 10.0]), np.array([1.0, 2.0, -9.81])


def held(joint: type, stiffness: float, **arguments) -> ff.Model:
    """A pulled solid whose nodes at the bottom are held, in the mean, at the origin."""
    mesh = block()
    x = mesh.points - mesh.points[mesh.nodes["base"]].mean(axis=0)
    top = np.flatnonzero(x[:, 2] == 0.5)
    sets = {"base": mesh.nodes["base"], "top": top, "corner": [7]}
    mesh = ff.ElementMesh(x, mesh.cells, "tetrahedron", degree=2, nodes=sets)
    law = {"mu": stiffness, "lam": 1.5 * stiffness}
    body, corner = ff.UFLBody("block", mesh, solid, density=2.0, parameters=law), [0.5, 0.35, 0.5]
    model = ff.Model("held")
    model.add(
        body, joint("hold", ff.Ground(), body.marker("base"), **arguments), ff.Gravity(WEIGHT),
        ff.PointForce("pull", ff.Marker("block", "corner"), PULL), ff.MomentumProbe("all"),
        ff.PositionProbe("corner", ff.Marker("block", corner)), ff.ReactionProbe("wall", "hold"),
    )  # fmt: skip
    return model


def moments(history: dict, mass: float) -> np.ndarray:
    """Moments (n, 3) of the pull and the weight about the origin."""
    corner, centre = (
        np.column_stack([history[f"{name}{axis}"] for axis in "xyz"])
        for name in ("corner_", "all_c")
    )
    return np.cross(corner, PULL) + np.cross(centre, mass * WEIGHT)


@pytest.mark.three_ranks
def test_a_solid_held_at_many_nodes_is_balanced_by_force_and_moment():
    """Where the solid has bent, by statics."""
    options = ff.StaticOptions(load_steps=2, tolerance=1e-10, split_above=1, quiet=True)
    history = ff.solve_static(held(ff.Rigid, 2e3), options).history
    if COMM.rank == 0:
        wall = np.array([history[f"wall_{part}{axis}"][-1] for part in "fm" for axis in "xyz"])
        loads = np.concatenate([PULL + 0.7 * WEIGHT, moments(history, 0.7)[-1]])
        # the tolerance; a couple that reaches the nodes with 99 % of its size is off by 0.1 N m
        np.testing.assert_allclose(wall, -loads, atol=1e-8)


@pytest.mark.three_ranks
def test_a_solid_swings_in_a_hinge_at_many_nodes():
    """With a rigid body on top that is fixed to many nodes as well, on any number of ranks."""
    model = held(ff.Revolute, 2e4, axis=(0.0, 1.0, 0.0))
    lid = ff.Marker("lid")
    model.add(
        ff.RigidBody("lid", mass=0.3, inertia=np.diag([0.02, 0.03, 0.04]), position=(0, 0, 0.5)),
        ff.Rigid("bond", model["block"].marker("top"), lid), ff.ReactionProbe("glue", "bond"),
        ff.PositionProbe("lid_at", lid),
        ff.PositionProbe("edge", ff.Marker("lid", offset=(0.5, 0.0, 0.0))),
    )  # fmt: skip
    options = ff.RunOptions(dt=2e-3, t_end=0.1, split_above=1, quiet=True)
    alone = ff.simulate(model, options, comm=MPI.COMM_SELF).history
    history = ff.simulate(model, options).history
    if COMM.rank == 0:
        for column, values in history.items():
            # round-off; a node that is not exchanged shows in the first digits
            atol = 1e-9 * max(1.0, np.abs(values).max())
            np.testing.assert_allclose(values, alone[column], atol=atol, err_msg=column)
        impulse = np.trapezoid(moments(history, 1.0)[:, 1], history["t"])
        # errors of the step, 1e-5; couples of the bond that are off by 1 % show as 1e-3
        assert history["all_ly"][-1] == pytest.approx(impulse, rel=1e-4)
        # round-off of 20 N m; a hinge that also holds the rotation about its axis has all of these
        np.testing.assert_allclose(history["wall_my"], 0.0, atol=1e-7)
        # the strains, 2e-3; a lid that does not turn with the solid is off by 0.1
        fall = history["edge_z"] - history["lid_at_z"]
        np.testing.assert_allclose(fall, -history["lid_at_x"], atol=5e-3)


class CableFamily(UFLBodyFamily):
    """A family of the user: that of the package with nodes of its own."""

    name = "cables"


class Cable(ff.UFLBody):
    """A body of that family."""

    family = CableFamily


@pytest.mark.three_ranks
def test_a_family_of_the_user_has_a_block_of_its_own():
    """It follows those of the package, and its bodies are joined and probed like theirs."""
    model = ff.Model("two")
    for kind, name in ((ff.UFLBody, "rope"), (Cable, "cable")):
        model.add(kind(name, line(), bar, density=1.0, parameters={"EA": 1e3}))
        start = ff.Marker(name, "start")
        model.add(ff.Spherical(f"{name} pin", ff.Ground(), start))
        model.add(ff.PositionProbe(f"{name}_end", ff.Marker(name, "end")))
    model.add(ff.EnergyProbe("energy", bodies=["cable"]), ff.Gravity((0.0, 0.0, -9.81)))
    model.validate()
    found = build(NumberedModel(model), COMM, split_above=1)
    assert [part.block.name for part in found.parts] == ["ufl_bodies", "cables"]
    history = ff.simulate(model, ff.RunOptions(dt=2e-3, t_end=0.02, quiet=True)).history
    if COMM.rank == 0:
        np.testing.assert_allclose(history["rope_end_z"], history["cable_end_z"], atol=1e-12)
        assert history["cable_end_z"][-1] < -1e-3


REFUSED = {
    "not zero": (lambda x, X, p: bar(x, X, p) + 1.0, {"EA": 1.0}, "where it must vanish"),
    "not finite": (lambda x, X, p: bar(x, X, p) / (x[2] * 0 + X[2]), {"EA": 1.0}, "not finite"),
    "missing": (bar, {}, 'the energy needs a parameter "EA"; given are none'),
    "idle": (bar, {"EA": 1.0, "GA": 2.0}, 'does not depend on the parameter "GA"'),
    "vector": (lambda x, X, p: x * p.EA, {"EA": 1.0}, "must return a scalar"),
    "fails": (lambda x, X, p: 1 / 0, {}, "energy fails: division by zero"),
    "linear": (
        lambda x, X, p: p.EA / 2 * (ufl.grad(x)[0, 0] - 1) ** 2, {"EA": 1.0},
        "changes by",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_energies_that_are_none_are_refused_in_one_line(name):
    """The same on all ranks."""
    energy, parameters, words = REFUSED[name]
    model = ff.Model("test")
    model.add(ff.UFLBody("rope", line(), energy, density=1.0, parameters=parameters))
    with pytest.raises(ValueError, match=words) as caught:
        build(NumberedModel(model), COMM, split_above=1)
    assert str(caught.value).startswith('UFLBody "rope": ')
    assert "\n" not in str(caught.value)


@pytest.mark.serial
def test_bad_meshes_and_bodies_are_refused():
    """Each message names the object and the value."""
    points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    with pytest.raises(ValueError, match=r"ElementMesh: cell must be one of .* got .hexagon."):
        ff.ElementMesh(points, [[0, 1]], "hexagon")
    with pytest.raises(ValueError, match="ElementMesh: cell 0 has a node twice"):
        ff.ElementMesh(points, [[1, 1], [0, 1]], "interval")
    with pytest.raises(ValueError, match="ElementMesh: node 1 belongs to no cell"):
        ff.ElementMesh([*points, [2, 0, 0]], [[0, 2]], "interval")
    with pytest.raises(ValueError, match=r'UFLBody "b": density must be .* got -1'):
        ff.UFLBody("b", line(), bar, density=-1.0)
    with pytest.raises(ValueError, match=r'UFLBody "b": parameters\["EA"\]'):
        ff.UFLBody("b", line(), bar, density=1.0, parameters={"EA": [1.0, 2.0]})
    with pytest.raises(ValueError, match="point must name a set of nodes"):
        ff.UFLBody("b", line(), bar, density=1.0, fixed={"middle": "x"})
