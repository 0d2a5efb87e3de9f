# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of beams with the sections of the package."""

from itertools import product
from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, mesh

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.forms.linear_beam import beam_axes, beam_strain, second_order_work
from flexfem.materials.section import Section
from flexfem.reduction.fem.body.linear_body import LinearBody, MassField, rigid_displacement

__all__ = ["beam_body", "mass_points", "rigid_motion"]

#: Part of the inertia that counts as round-off.
_ROUND_OFF = 1e-10


def beam_body(
    line: mesh.Mesh | npt.ArrayLike,
    section: Section,
    *,
    orientation: npt.ArrayLike | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    name: str = "beam",
) -> LinearBody:
    """Shear-deformable beams with rotary inertia and any coupling that a section may have.

    Cubic displacements with quadratic rotations contain the exact static solutions of uniform
    beams under end loads, however slender: there is no locking, and one cell is enough for these.

    Args:
        line: mesh of intervals in space, body axes, m, branches and corners included; or nodes
            (n, 3) that cells join one after the other.
        section: linear section of all cells.
        orientation: (3,) approximate direction of the section's e2; None for horizontal, along
            ez x e1, and ey where a cell is vertical.
        comm: communicator of the mesh that is made of nodes.
        name: for messages.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: the mesh is not of intervals in space, there are fewer than two nodes or equal
            ones, the section has a law of its own, no mass, or an inertia that masses cannot have,
            or the orientation is zero.
    """
    owner = f'beam_body "{name}"'
    _checks.instance(owner, "section", section, Section)
    if section.stiffness is None:
        raise ValueError(f"{owner}: the section must be linear, not have a law of its own")
    points = mass_points(owner, section.inertia)
    direction = None
    if orientation is not None:
        direction = _checks.vector(owner, "orientation", orientation, nonzero=True)
    domain = line if isinstance(line, mesh.Mesh) else _polyline(owner, line, comm)
    if domain.topology.dim != 1 or domain.geometry.dim != 3:
        raise ValueError(f"{owner}: the mesh must be of intervals in three dimensions")
    cell = domain.basix_cell()
    space = fem.functionspace(
        domain,
        basix.ufl.mixed_element([
            basix.ufl.element("Lagrange", cell, 3, shape=(3,)),
            basix.ufl.element("Lagrange", cell, 2, shape=(3,)),
        ]),
    )  # fmt: skip
    axes = beam_axes(
        domain, None if direction is None else fem.Constant(domain, np.array(direction))
    )
    stiffness = fem.Constant(domain, np.array(section.stiffness))
    x = ufl.SpatialCoordinate(domain)
    dx = ufl.dx(domain)

    def strain(w: Any) -> Any:
        u, theta = ufl.split(w)
        return beam_strain(u, theta, axes)

    def at(place: Any) -> MassField:
        def moved(w: Any) -> Any:
            u, theta = ufl.split(w)
            return u + ufl.cross(theta, place)

        return MassField(section.mass_per_length / len(points), x + place, moved)

    return LinearBody(
        space,
        lambda w, v: ufl.inner(ufl.dot(stiffness, strain(w)), strain(v)) * dx,
        [at(ufl.dot(axes, fem.Constant(domain, point))) for point in points],
        rigid=lambda shift, turn: rigid_motion(space, shift, turn),
        displacement=lambda w: ufl.split(w)[0],
        rotation=lambda w: ufl.split(w)[1],
        prestress=lambda w0, w, v: (
            second_order_work(ufl.dot(stiffness, strain(w0)), ufl.split(w), ufl.split(v), axes) * dx
        ),
        name=name,
    )


def rigid_motion(space: fem.FunctionSpace, shift: FloatArray, turn: FloatArray) -> fem.Function:
    """Rigid motion of displacements and rotations."""
    function = fem.Function(space)
    rigid_displacement(function.sub(0), shift, turn)
    function.sub(1).interpolate(lambda x: np.repeat(turn[:, np.newaxis], x.shape[1], axis=1))
    function.x.scatter_forward()
    return function


def _polyline(owner: str, nodes: npt.ArrayLike, comm: MPI.Intracomm) -> mesh.Mesh:
    """Mesh of straight cells that join nodes one after the other."""
    x = _checks.array(owner, "nodes", nodes, (-1, 3))
    if len(x) < 2 or not (np.linalg.norm(np.diff(x, axis=0), axis=1) > 0.0).all():
        raise ValueError(f"{owner}: nodes must be at least two, neighbours at different places")
    count = len(x) - 1
    # each rank brings its share of the cells and nodes
    mine = np.array_split(np.arange(count, dtype=np.int64), comm.size)[comm.rank]
    cells = np.stack([mine, mine + 1], axis=1)
    own = np.array_split(np.arange(len(x)), comm.size)[comm.rank]
    element: Any = basix.ufl.element("Lagrange", "interval", 1, shape=(3,))
    return mesh.create_mesh(comm, cells, element, np.array(x[own]))


def mass_points(owner: str, inertia: FloatArray) -> FloatArray:
    """Places in section axes of equal masses that have the inertia of a section (p, 3).

    Raises:
        ValueError: there are none: no mass, or moments of inertia that break the triangle
            inequality.
    """
    mass = float(inertia[0, 0])
    if mass <= 0.0:
        raise ValueError(f"{owner}: the section must have mass, got {mass:g}")
    # S = skew(m c) is the lower left block
    s = inertia[3:, :3] / mass
    centre = np.array([s[2, 1], s[0, 2], s[1, 0]])
    rotary = inertia[3:, 3:] - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    second = (0.5 * np.trace(rotary) * np.eye(3) - rotary) / mass
    values, directions = np.linalg.eigh(second)
    size = float(np.abs(np.diagonal(inertia)[3:]).max()) / mass
    if values[0] < -_ROUND_OFF * size:
        raise ValueError(
            f"{owner}: no masses have the section's rotary inertia: one of its principal moments "
            "is greater than the sum of the others"
        )
    arms = [
        np.sqrt(value) * direction
        for value, direction in zip(values, directions.T, strict=True)
        if value > _ROUND_OFF * size
    ]
    signs = product((-1.0, 1.0), repeat=len(arms))
    places = [centre + sum((s * arm for s, arm in zip(sign, arms, strict=True)), np.zeros(3))
              for sign in signs]  # fmt: skip
    return np.array(places)
