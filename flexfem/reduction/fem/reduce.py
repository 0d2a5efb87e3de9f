# SPDX-License-Identifier: LGPL-3.0-or-later
"""Component mode synthesis (Craig–Bampton and others) of a linear elastic body on a mesh."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.marker import line_points
from flexfem.reduction.damping import modal_damping
from flexfem.reduction.fem.body.blocks import multiply, projected, with_neighbours
from flexfem.reduction.fem.body.geometric import GeometricStiffness
from flexfem.reduction.fem.body.integrals import MassIntegrals
from flexfem.reduction.fem.body.linear_body import LinearBody
from flexfem.reduction.fem.body.lines import trace
from flexfem.reduction.fem.body.recovery import recover
from flexfem.reduction.fem.body.ties import TIES, tie
from flexfem.reduction.fem.modes.derivatives import NonlinearBasis
from flexfem.reduction.fem.modes.internal import BASES, LARGEST, internal_functions
from flexfem.reduction.fem.modes.spectrum import Choice
from flexfem.reduction.fem.prepare import prepare, without_rigid_forces
from flexfem.reduction.reduced_body import ReducedBody

__all__ = ["reduce_body"]


def reduce_body(
    body: LinearBody,
    interfaces: Mapping[str, Any] | None = None,
    *,
    modes: int | None = None,
    frequency: float | None = None,
    participation: float | None = None,
    basis: str = "craig_bampton",
    ties: Mapping[str, str] | None = None,
    positions: Mapping[str, Any] | None = None,
    damping_ratio: float = 0.0,
    stiffness_damping: float = 0.0,
    geometric_stiffness: bool = False,
    derivatives: int | None = None,
    recovery: bool = True,
    lines: Mapping[str, Any] | None = None,
) -> ReducedBody:
    """Reduce a body to the motion of its interfaces and some internal functions (collective).

    Args:
        body: the body.
        interfaces: regions by the names of the frames tied to them: (facet tags, tag), a function
            of points (3, q) that is True on the region, or a point for the nearest vertex of a body
            whose points have rotations. None: free modes only.
        modes: keep so many modes;
        frequency: or all up to this frequency, Hz;
        participation: or as few as move this part of the mass along each axis.
        basis: internal functions: "craig_bampton", modes with the interfaces at rest (Craig and
            Bampton 1968); "free_free", modes of the free body and the response to the inertia of
            rigid motions, in the same coordinates (Craig and Chang 1977); "full", all of the mesh.
        ties: "rigid" (the region moves as one) or "average" (the frame has the region's mean
            motion; with derivatives all but the first also hold its mean stretches) by names; rigid
            if not named.
        positions: (3,) of the frames at rest, body axes, by names; the region's centroid if not
            named.
        damping_ratio: of all elastic modes of the free reduced body.
        stiffness_damping: factor of the stiffness in the damping, s.
        geometric_stiffness: compute the geometric stiffness of stresses by acceleration and by
            interface motion.
        derivatives: keep so many static modal derivatives beside the modes, those that relieve most
            energy, and the elastic forces to third order in the coordinates (Wu and Tiso 2016); of
            bodies whose law is one of ``flexfem.laws`` (``solid_body``). The frame of the first
            interface is then that of the body. None: linear elasticity.
        recovery: compute the data for pictures.
        lines: points (p, 3) at rest along lines of the body, body axes, m, by the names of these:
            sliders on them follow a cubic spline through the points (``Carrier``). Take them closer
            than the mesh has nodes where the line bends.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: an argument is out of its range; a region is not there, overlaps another or
            cannot rotate; the body is in pieces, or its rigid motions cost energy; a line leaves
            it; derivatives of a body that is linear, or more than there are.
        NumericalError: the eigensolver did not find the modes (an ArithmeticError).
    """
    owner = "reduce_body"
    _checks.instance(owner, "body", body, LinearBody)
    owner = f'{owner} "{body.name}"'
    places, kinds, at = _names(owner, interfaces, ties, positions)
    along = _lines(owner, lines)
    choice = _choice(owner, body, basis, bool(places), (modes, frequency, participation))
    ratio = _checks.number(owner, "damping_ratio", damping_ratio, nonnegative=True)
    factor = _checks.number(owner, "stiffness_damping", stiffness_damping, nonnegative=True)
    if geometric_stiffness and body.prestress is None:
        raise ValueError(f"{owner}: geometric_stiffness needs the body's prestress")
    _check_derivatives(owner, body, derivatives)

    comm = body.space.mesh.comm
    integrals = MassIntegrals(body)
    ties_found = tie(owner, body, places, kinds, at, derivatives is not None)
    pieces = prepare(owner, body, integrals, ties_found)
    try:
        inner = internal_functions(owner, pieces, basis, choice)
    except ArithmeticError as error:
        raise _checks.NumericalError(f"{owner}: {error}") from None
    nonlinear, beside, loads = None, [], integrals.loads()
    if derivatives is not None:
        nonlinear = NonlinearBasis(owner, body, pieces, inner)
        nonlinear.add_derivatives(derivatives)
        inner, beside = nonlinear.inner, [nonlinear.turned]
    functions = np.hstack([pieces.static, inner])
    every = np.hstack([functions, *beside])
    moments, products = integrals.products(every, loads)
    polynomial = None
    if nonlinear is not None:
        polynomial = nonlinear.polynomial(every, loads, moments, products)
    own = 1 + functions.shape[1]
    moments, products = moments[:, :own], products[:, :, :own, :own]
    held = np.concatenate([ties_found.held, np.zeros(inner.shape[1], dtype=np.bool_)])

    stiffness = projected(comm, functions, multiply(pieces.stiffness, functions))
    stiffness = without_rigid_forces(
        0.5 * (stiffness + stiffness.T), ties_found.interfaces, ties_found.held
    )
    mass_matrix = np.einsum("aaij->ij", products[:, :, 1:, 1:])
    by_acceleration = by_interface = None
    if geometric_stiffness:
        geometric = GeometricStiffness(body)
        whole = with_neighbours(body.space, functions)
        by_acceleration = -geometric.of(pieces.response.respond(loads), whole)
        by_interface = geometric.of_interfaces(ties_found, pieces.static, whole)
    k = len(held) - inner.shape[1]
    rigid = pieces.rigid.shape[1] if places else 0
    squares = np.linalg.eigvalsh(stiffness[k:, k:]) if inner.shape[1] else np.zeros(0)
    return ReducedBody(
        ties_found.interfaces,
        integrals.mass(),
        moments,
        products,
        stiffness,
        modal_damping(mass_matrix, stiffness, held, ratio, rigid) + factor * stiffness,
        ties_found.held,
        np.sqrt(np.maximum(squares, 0.0)),
        by_acceleration,
        by_interface,
        recover(body, every, polynomial is not None) if recovery else None,
        {name: trace(owner, body, every, name, points) for name, points in along.items()},
        polynomial,
    )


def _check_derivatives(owner: str, body: LinearBody, derivatives: Any) -> None:
    """Check the number of derivatives, and that the body has them."""
    if derivatives is None:
        return
    _checks.count(owner, "derivatives", derivatives, 0)
    if body.energy is None:
        raise ValueError(
            f"{owner}: a linear body has no derivatives; give solid_body a law of flexfem.laws"
        )


def _lines(owner: str, lines: Mapping[str, Any] | None) -> dict[str, FloatArray]:
    """Checked points of lines by name."""
    if lines is not None and not isinstance(lines, Mapping):
        raise TypeError(f"{owner}: lines must be a dictionary, got {_checks.show(lines)}")
    return {
        _checks.text(owner, "name of a line", name): line_points(f'{owner}: line "{name}"', points)
        for name, points in (lines or {}).items()
    }


def _choice(
    owner: str, body: LinearBody, basis: str, tied: bool, given: tuple[Any, Any, Any]
) -> Choice:
    """Return the choice of modes, after checking that the basis can have them."""
    if basis not in BASES:
        raise ValueError(f"{owner}: basis must be one of {BASES}, got {_checks.show(basis)}")
    if basis != "full":
        choice = Choice.checked(owner, *given)
        if choice.participation is not None and (basis != "craig_bampton" or not tied):
            raise ValueError(
                f"{owner}: participation is that of modes with interfaces at rest: it needs "
                'interfaces and the basis "craig_bampton"'
            )
        return choice
    if any(value is not None for value in given):
        raise ValueError(f'{owner}: the basis "full" has all modes, none can be chosen')
    size = body.space.dofmap.index_map.size_global * body.space.dofmap.index_map_bs
    if size > LARGEST:
        raise ValueError(
            f'{owner}: "full" can have {LARGEST} unknowns at most, the mesh has {size}'
        )
    return Choice()


def _names(
    owner: str,
    interfaces: Mapping[str, Any] | None,
    ties: Mapping[str, str] | None,
    positions: Mapping[str, Any] | None,
) -> tuple[Mapping[str, Any], Mapping[str, str], Mapping[str, Any]]:
    """Check the tables by names of interfaces."""
    tables: list[Mapping[str, Any]] = []
    for what, table in (("interfaces", interfaces), ("ties", ties), ("positions", positions)):
        if table is not None and not isinstance(table, Mapping):
            raise TypeError(f"{owner}: {what} must be a dictionary, got {_checks.show(table)}")
        tables.append(table or {})
        for name in tables[-1]:
            if name not in tables[0]:
                raise ValueError(
                    f"{owner}: {what} has the name {_checks.show(name)}, which no interface has"
                )
    for name, kind in tables[1].items():
        if kind not in TIES:
            raise ValueError(
                f'{owner}: tie of "{name}" must be one of {TIES}, got {_checks.show(kind)}'
            )
    places, kinds, at = tables
    for name in places:
        _checks.text(owner, "name of an interface", name)
    return places, kinds, {k: _checks.vector(owner, f'position of "{k}"', v) for k, v in at.items()}
