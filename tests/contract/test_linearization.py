# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices of the linearised equations against differences of the residual."""

from types import SimpleNamespace

import numpy as np
import pytest

import flexfem as ff


def _model(damping: float) -> ff.Model:
    """A bent beam and two bodies with every kind of row, springs, dampers, gravity, follower."""
    from flexfem.mesh.line_mesh import LineMesh

    points = np.array([[0, 0, 0], [0.4, 0.1, 0], [0.7, 0.3, 0.2], [0.9, 0.6, 0.2]], dtype=float)
    mesh = LineMesh(points, [[0, 1], [1, 2], [2, 3]], {"beam": [0, 1, 2]})
    section = ff.Section.general((50, 40, 30, 4, 3, 2), (1.2, 1.2, 1.2, 0.3, 0.2, 0.1))
    model = ff.Model("mixed", mesh=mesh)
    end, ground = ff.Marker("beam", "end", offset=(0.05, 0.1, 0)), ff.Ground((0.3, -0.5, 0.4))
    crank = ff.Marker("crank", offset=(0.2, 0, 0))
    model.add(
        ff.Gravity((0.5, -3.0, 1.0)),
        ff.Beam("beam", section, damping=damping),
        ff.RigidBody(
            "crank", 2.0, (0.3, 0.4, 0.5), position=(1.2, 0.5, 0.1), centre=(0.1, 0, 0.05)
        ),
        ff.RigidBody("rod", 1.0, (0.1, 0.2, 0.2), position=(1.5, 0.2, 0.3)),
        ff.Revolute("hinge", end, ff.Marker("crank", offset=(-0.2, 0, 0.1)), axis=(0, 0.6, 0.8)),
        ff.PointOnLine("slide", crank, ff.Marker("rod"), axis=(0, 1, 0)),
        ff.SpringDamper("spring", ground, crank, 7.0, 2.0, rest_length=0.8),
        ff.SpringDamper("dashpot", crank, ff.Marker("beam", "start"), 0.0, 1.5),
        ff.TorsionalSpringDamper(
            "twist", end, ff.Marker("rod"), axis=(1, 0, 0), stiffness=3.0, damping=0.7
        ),
        ff.PointForce("push", end, (1.0, 2.0, -1.0), follower=True),
    )
    return model


def _setup(damping: float, rng: np.random.Generator) -> SimpleNamespace:
    from mpi4py import MPI

    from flexfem.layout.numbered_model import NumberedModel
    from flexfem.lie import se3
    from flexfem.solvers.modal.linearization import Linearization
    from flexfem.solvers.modal.steady_rotation import Rotation
    from flexfem.system.build import build

    model = _model(damping)
    model.validate()
    system = build(NumberedModel(model), MPI.COMM_WORLD, split_above=1)
    system.set_time(0.0)

    def random(size: float) -> list[np.ndarray]:
        fields = [size * rng.normal(size=(p.block.size_global, 6)) for p in system.parts]
        return [f[p.block.node_ids] for f, p in zip(fields, system.parts, strict=True)]

    for part, step in zip(system.parts, random(0.1), strict=True):
        part.block.frames[:] = se3.retract(part.block.frames, step)
    axis = np.array([0.48, 0.6, 0.64])
    Rotation(2.5, axis, np.array([0.1, -0.2, 0.3])).set(system)
    linearization = Linearization(system)
    forces = rng.normal(size=1000)[system.constraints.numbers]
    return SimpleNamespace(system=system, linear=linearization, random=random, forces=forces)


def _perturbed(s: SimpleNamespace, eps: float, u: list, rate: list, second: list) -> np.ndarray:
    """Residual at the state reached with the twists ``eps u`` that change with time."""
    from flexfem.lie import se3, so3

    kept = [(p.block.frames.copy(), p.block.velocity.copy()) for p in s.system.parts]
    for k, part in enumerate(s.system.parts):
        block, v = part.block, kept[k][1]

        def ad(x: np.ndarray, v: np.ndarray = v) -> np.ndarray:
            turn, speed = so3.skew(v[:, 3:]), so3.skew(v[:, :3])
            return np.concatenate([
                np.einsum("nij,nj->ni", turn, x[:, :3]) + np.einsum("nij,nj->ni", speed, x[:, 3:]),
                np.einsum("nij,nj->ni", turn, x[:, 3:]),
            ], axis=1)  # fmt: skip

        block.frames[:] = se3.retract(kept[k][0], eps * u[k])
        block.velocity[:] = v + eps * (rate[k] + ad(u[k]))
        block.acceleration[:] = eps * (second[k] + ad(rate[k]))
    residual = s.linear.evaluate(s.forces)
    for part, (frames, velocity) in zip(s.system.parts, kept, strict=True):
        part.block.frames[:], part.block.velocity[:] = frames, velocity
        part.block.acceleration[:] = 0.0
    return residual


@pytest.mark.three_ranks
@pytest.mark.parametrize("damping", [pytest.param(0.0, marks=pytest.mark.slow), 0.3])
def test_matrices_are_the_derivatives_of_the_residual(damping, rng):
    s = _setup(damping, rng)
    u, rate, second = s.random(1.0), s.random(1.0), s.random(1.0)
    eps = 1e-5
    nothing = [0.0 * x for x in u]
    cases = {
        "mass": (nothing, nothing, second),
        "damping": (nothing, rate, nothing),
        "stiffness": (u, nothing, nothing),
    }
    for name, directions in cases.items():
        ends = [_perturbed(s, sign * eps, *directions) for sign in (1.0, -1.0)]
        expected = (ends[0] - ends[1]) / (2.0 * eps)
        s.linear.evaluate(s.forces)
        matrices = s.linear.matrices()
        x, y = s.linear.vector(), s.linear.vector()
        direction = {"mass": second, "damping": rate, "stiffness": u}[name]
        owned = [d[: p.block.owned].ravel() for d, p in zip(direction, s.system.parts, strict=True)]
        x.getArray()[: s.linear.unknowns] = np.concatenate(owned)
        matrix = getattr(matrices, name)
        matrix.mult(x, y)
        found = y.getArray() * s.linear.rigid_rows()
        shape = np.concatenate(owned)[np.newaxis]
        laws = None if name == "mass" else matrices.stiffness
        found[: s.linear.unknowns] = s.linear.multiply(matrix, shape, laws=laws)[0].real
        error = np.abs(found - expected).max(initial=0.0)
        size = s.system.comm.allreduce(np.abs(expected).max(initial=0.0), op=_largest())
        # central differences: eps^2 and round-off/eps, 1e-9 of the size. Without ad_v the error is
        # of order one, without the terms of joint forces, dampers or rotated ends 1e-3 at least
        assert s.system.comm.allreduce(error, op=_largest()) <= 3e-8 * size, name


def _largest() -> object:
    from mpi4py import MPI

    return MPI.MAX


def test_forces_of_joints_enter_by_the_transpose(rng):
    """The matrix is symmetric in the blocks of the constraints and empty between multipliers."""
    from flexfem.la.dense import gather_rows

    s = _setup(0.0, rng)
    s.linear.evaluate(s.forces)
    K = gather_rows(s.linear.matrices().stiffness)
    kinds = s.linear.rigid_rows()
    kinds[: s.linear.unknowns] = -1.0
    kinds = np.concatenate(s.system.comm.allgather(kinds))
    nodes, held = kinds < 0.0, kinds > 0.0
    assert held.sum() == 7
    np.testing.assert_allclose(K[np.ix_(held, nodes)], K[np.ix_(nodes, held)].T, atol=1e-14)
    assert not K[np.ix_(held, ~nodes)].any()
    assert not K[np.ix_(~nodes, held)].any()


def _damped(kind: str, damping: float) -> ff.Model:
    """A free body with damping in proportion to its stiffness."""
    if kind in ("se3", "nurbs"):
        model = ff.Model(mesh=ff.LineMesh.straight({"body": [(0, 0, 0), (1, 0.2, 0.1)]}, 4))
        section = ff.Section.rectangle(0.02, 0.03, ff.Material(2e9, 0.3, 1e3))
        model.add(ff.Beam("body", section, damping=damping, formulation=kind))
        return model
    if kind == "net":
        points = np.array([(0, 0, 0), (1, 0, 0), (0, 0.6, 0), (0, 0, 0.4)], dtype=float)
        pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
        mesh, model = ff.ElementMesh(points, pairs, "interval"), ff.Model()
        given = {"mass_per_length": 1.0, "damping": damping, "tension_only": False}
        model.add(ff.CableNet("body", mesh, 1e4, **given))
        return model
    model = ff.Model(surface=ff.SurfaceMesh.rectangle("body", (1.0, 0.6), (3, 2)))
    section = ff.ShellSection.isotropic(0.01, ff.Material(2e9, 0.3, 7800.0))
    model.add(ff.Shell("body", section, element=kind, damping=damping))
    return model


@pytest.mark.parametrize("kind", ["se3", "nurbs", "net", "rotation_free", "director"])
def test_deformations_that_rotate_steadily_are_not_damped(kind: str) -> None:
    """Strains are constant: stiffness in rotating axes is that without damping.

    Without the change of strain rates by the rotation of triangles that of shells was off by 0.9 of
    damping times spin.
    """
    from flexfem.analyses.modes import ModeOptions
    from flexfem.simulation.equilibria.operating_point import OperatingPoint

    spin, found = 3.0, []
    options = ModeOptions(spin=spin, axis="1,0.5,0.7", quiet=True, split_above=1)
    for damping in (0.0, 1e-2):
        point = OperatingPoint(_damped(kind, damping), options)
        point.rotation(spin).set(point.system)
        point.linearization.evaluate(np.zeros(point.system.constraints.size))
        matrices = point.linearization.matrices()
        found.append((matrices.damping.copy(), matrices.stiffness.copy()))
    (C, K), (damped, stiffness) = found
    damped.axpy(-1.0, C)
    stiffness.axpy(-1.0, K)
    assert damped.norm() > 0.0
    # differences by steps of 1e-3 of a function that is of second degree in places
    assert stiffness.norm() < 1e-11 * spin * damped.norm()
