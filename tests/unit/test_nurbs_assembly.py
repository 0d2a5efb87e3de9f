# SPDX-License-Identifier: LGPL-3.0-or-later
"""NURBS elements against an assembly by DOLFINx on a broken space, with Bezier extraction.

The reference uses neither the forms nor the loops of the element: strain energy and kinetic energy
are written as functionals of fields in a space that is discontinuous from one element to the next
(homogeneous coordinates, polynomials of the elements' degree), differentiated by UFL and assembled
by DOLFINx. A matrix M takes the nodes' local twists to those fields.
"""

from types import SimpleNamespace

import numpy as np
import pytest

import flexfem as ff
from flexfem.forms import lie
from flexfem.lie import se3, so3
from tests.unit.references import QUICKLY

dolfinx = pytest.importorskip("dolfinx")

from mpi4py import MPI  # noqa: E402
from petsc4py import PETSc  # noqa: E402

import ufl  # noqa: E402
from dolfinx.fem.petsc import assemble_matrix, assemble_vector  # noqa: E402

pytestmark = pytest.mark.serial

STIFFNESS = np.diag([50.0, 40.0, 30.0, 8.0, 7.0, 5.0])
STIFFNESS[0, 4] = STIFFNESS[4, 0] = 3.0
MASS = 1.7
SECTION = ff.Section.general(STIFFNESS, (MASS, MASS, MASS, 0.0, 0.0, 0.0))
COUNT = 3


@pytest.fixture
def beam(one_nurbs, rng):
    """A curved rational beam of cubic elements in a deformed state at rest."""
    degree = 3
    n = COUNT * degree + 1
    s = np.linspace(0.0, 2.0, n)
    points = np.stack([np.sin(s), 1.0 - np.cos(s), 0.3 * s**2], axis=1)
    turns = 0.1 + s[:, np.newaxis] * [0.2, 0.3, 0.5]
    beam = one_nurbs(points, degree, SECTION, weights=1.0 + 0.4 * rng.random(n), turns=turns)
    beam.disturb(rng)
    for values in (beam.block.velocity, beam.block.acceleration, beam.block.increment):
        values[:] = 0.0
    return beam


def _left(q: np.ndarray) -> np.ndarray:
    """Matrix (4, 4) of ``q o ``."""
    w, v = q[0], q[1:, np.newaxis]
    return np.block([[w, -v.T], [v, w * np.eye(3) + so3.skew(v[:, 0])]])


def _right(q: np.ndarray) -> np.ndarray:
    """Matrix (4, 4) of `` o q``."""
    w, v = q[0], q[1:, np.newaxis]
    return np.block([[w, -v.T], [v, w * np.eye(3) - so3.skew(v[:, 0])]])


def _places(frames: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Interpolated values (k, 7) of an element: places and quaternions from its reference node."""
    x, R = se3.position(frames[nodes]), se3.rotation(frames[nodes])
    r = len(nodes) // 2
    theta = so3.log(R[r].T @ R)
    half = 0.5 * np.linalg.norm(theta, axis=1)[:, np.newaxis]
    vector = 0.5 * np.sinc(half / np.pi) * theta
    return np.concatenate([(x - x[r]) @ R[r], np.cos(half), vector], axis=1)


def _motion(frames: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Change of the places (k, 7) along the nodes' local twists (k, 6)."""
    k, r = len(nodes), len(nodes) // 2
    places, R = _places(frames, nodes), se3.rotation(frames[nodes])
    A = np.zeros((k, 7, k, 6))
    for i in set(range(k)) - {r}:
        y, q = places[i, :3], places[i, 3:]
        A[i, :3, i, :3] = R[r].T @ R[i]
        A[i, :3, r, :3], A[i, :3, r, 3:] = -np.eye(3), so3.skew(y)
        A[i, 3:, i, 3:] = 0.5 * _left(q)[:, 1:]
        A[i, 3:, r, 3:] = -0.5 * _right(q)[:, 1:]
    return A


def _geometric(frames: np.ndarray, nodes: np.ndarray, dual: np.ndarray) -> np.ndarray:
    """Change (6 k, 6 k) of ``A^T dual`` at fixed dual forces (k, 7) of the places."""
    k, r = len(nodes), len(nodes) // 2
    R, A = se3.rotation(frames[nodes]), _motion(frames, nodes)
    G = np.zeros((k, 6, k, 6))
    for i in set(range(k)) - {r}:
        Q, f, m = R[r].T @ R[i], dual[i, :3], dual[i, 3:]
        # Q turns by theta_i - Q^T theta_r
        G[i, :3, i, 3:] += so3.skew(Q.T @ f)
        G[i, :3, r, 3:] -= so3.skew(Q.T @ f) @ Q.T
        for at in (i, r):
            # A is linear in the quaternion
            for j, dq in enumerate(A[i, 3:, at, 3:].T):
                G[i, 3:, at, 3 + j] += 0.5 * (_left(dq).T @ m)[1:]
                G[r, 3:, at, 3 + j] -= 0.5 * (_right(dq).T @ m)[1:]
            # the moment y x f of the force on the reference node
            G[r, 3:, at] += so3.skew(f) @ A[i, :3, at]
    return G.reshape(6 * k, 6 * k)


def _form(form):
    return dolfinx.fem.form(form, jit_options=QUICKLY)


class _Broken:
    """Fields on a broken space over one unit interval per element, and the extraction to it."""

    def __init__(self, beam) -> None:
        self.beam, p = beam, beam.degree
        self.mesh = dolfinx.mesh.create_interval(MPI.COMM_SELF, COUNT, [0.0, float(COUNT)])
        self.space = dolfinx.fem.functionspace(self.mesh, ("DG", p, (7,)))
        self.scalar = dolfinx.fem.functionspace(self.mesh, ("DG", p))
        dofs, data = self.scalar.dofmap.list, beam.beams.groups[0].data
        xi = self.scalar.tabulate_dof_coordinates()[:, 0]
        self.elements = np.floor(xi[dofs].mean(axis=1)).astype(int)
        self.nodes = data.nodes[self.elements]
        powers = (xi[dofs] - self.elements[:, np.newaxis])[..., np.newaxis] ** np.arange(p + 1)
        # weighted shape functions at the places of the degrees of freedom
        self.extraction = np.einsum("cqj,cij->cqi", powers, data.shape[self.elements])
        self.dofs = dofs

    def field(self, places) -> np.ndarray:
        """Values of the broken fields from the elements' places (c, k, ...)."""
        shape = np.shape(places)[2:]
        out = np.zeros((self.dofs.size, *shape))
        out[self.dofs] = np.einsum("cqi,ci...->cq...", self.extraction, places)
        return out

    def function(self, space, values) -> "dolfinx.fem.Function":
        made = dolfinx.fem.Function(space)
        made.x.array[:] = np.ravel(values)
        return made

    def matrix(self) -> PETSc.Mat:
        """M: broken fields (7 per degree of freedom) along local twists of the nodes."""
        frames = self.beam.block.frames
        M = PETSc.Mat().createAIJ((7 * self.dofs.size, 6 * len(frames)), comm=MPI.COMM_SELF)
        M.setUp()
        for dofs, nodes, B in zip(self.dofs, self.nodes, self.extraction, strict=True):
            values = np.einsum("qi,iajb->qajb", B, _motion(frames, nodes))
            rows, columns = (
                (size * at[:, np.newaxis] + np.arange(size)).ravel().astype(np.int32)
                for size, at in ((7, dofs), (6, nodes))
            )
            M.setValues(rows, columns, values.reshape(len(rows), len(columns)))
        M.assemble()
        return M


def _strain(q, weight, speed) -> object:
    """Strains from the broken fields: the homogeneous coordinates over the weight."""
    rational = q / weight
    y, q = (ufl.as_vector([rational[i] for i in at]) for at in (range(3), range(3, 7)))
    q /= ufl.sqrt(ufl.dot(q, q))
    v = lie.skew(ufl.as_vector([q[1], q[2], q[3]]))
    R = ufl.Identity(3) + 2 * q[0] * v + 2 * v * v
    gamma, turned = R.T * y.dx(0) / speed, R.T * R.dx(0) / speed
    kappa = turned[2, 1], turned[0, 2], turned[1, 0]
    return ufl.as_vector([*(gamma[i] for i in range(3)), *kappa])


@pytest.fixture
def broken(beam) -> SimpleNamespace:
    """The broken spaces with the fields of the start."""
    fields, block = _Broken(beam), beam.block
    ones = np.ones((COUNT, beam.degree + 1))
    start = np.array([_places(block.start_frames, nodes) for nodes in fields.nodes])
    weight = fields.function(fields.scalar, fields.field(ones))
    first = fields.function(fields.space, fields.field(start))
    slope = (first / weight).dx(0)
    speed = ufl.sqrt(sum(slope[i] ** 2 for i in range(3)))
    return SimpleNamespace(fields=fields, weight=weight, start=first, speed=speed)


def test_internal_forces_and_their_derivatives(beam, broken):
    """``r = M^T r_e`` and ``K = M^T K_e M`` and what ``M`` itself changes by."""
    fields, frames = broken.fields, beam.block.frames
    q = fields.function(
        fields.space, fields.field(np.array([_places(frames, nodes) for nodes in fields.nodes]))
    )
    strain = _strain(q, broken.weight, broken.speed)
    strain -= _strain(broken.start, broken.weight, broken.speed)
    points = ufl.dx(fields.mesh, metadata={"quadrature_degree": 2 * beam.degree - 1})
    D = ufl.as_matrix(STIFFNESS.tolist())
    stored = 0.5 * ufl.dot(strain, D * strain) * broken.speed * points
    force = ufl.derivative(stored, q)
    energy = dolfinx.fem.assemble_scalar(_form(stored))
    # the same quadrature: round-off, against any slip in strains, weights or tables
    assert beam.energy() == pytest.approx(energy, rel=1e-12)
    r_e = assemble_vector(_form(force))
    K_e = assemble_matrix(_form(ufl.derivative(force, q)))
    K_e.assemble()
    M = fields.matrix()
    expected = M.createVecRight()
    M.multTranspose(r_e, expected)
    found = beam.residual().ravel()
    np.testing.assert_allclose(found, expected.array, atol=1e-12 * np.abs(found).max())
    K = K_e.ptap(M)
    dense = K.getDenseArray() if K.getType() == "seqdense" else K.convert("dense").getDenseArray()
    dense = dense.copy()
    forces = r_e.array.reshape(-1, 7)
    for dofs, nodes, B in zip(fields.dofs, fields.nodes, fields.extraction, strict=True):
        at = (6 * nodes[:, np.newaxis] + np.arange(6)).ravel()
        dense[np.ix_(at, at)] += _geometric(frames, nodes, B.T @ forces[dofs])
    matrix = beam.matrix(np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(matrix, dense, atol=1e-12 * np.abs(matrix).max())


def test_consistent_masses(beam, broken):
    """``m = M^T m_e M`` with the scalar extraction, rotated into the axes of the nodes."""
    fields, n = broken.fields, len(beam.block.frames)
    u, v = ufl.TrialFunction(fields.scalar), ufl.TestFunction(fields.scalar)
    points = ufl.dx(fields.mesh, metadata={"quadrature_degree": 31})
    form = MASS * u * v / broken.weight**2 * broken.speed * points
    m_e = assemble_matrix(_form(form))
    m_e.assemble()
    M = PETSc.Mat().createAIJ((fields.dofs.size, n), comm=MPI.COMM_SELF)
    M.setUp()
    for dofs, nodes, B in zip(fields.dofs, fields.nodes, fields.extraction, strict=True):
        M.setValues(dofs.astype(np.int32), nodes.astype(np.int32), B)
    M.assemble()
    masses = m_e.ptap(M)
    masses = masses.convert("dense").getDenseArray().copy()
    R = se3.rotation(beam.block.frames)
    expected = np.einsum("ij,iab,jac->ibjc", masses, R, R)
    found = beam.matrix(np.array([0.0, 1.0, 0.0])).reshape(n, 6, n, 6)
    # a lumped or local mass matrix is off by percents
    np.testing.assert_allclose(found[:, :3, :, :3], expected, atol=1e-12 * np.abs(expected).max())
