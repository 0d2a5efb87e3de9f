# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equilibria at rest and in steady rotation about a fixed axis.

A body that rotates steadily has a constant twist ``xi`` in inertial axes; its nodes have the local
twists ``v = Ad(H^-1) xi``, which do not change with time, so that ``w = 0`` and the configuration
solves ``r(H, v(H), 0) + G^T lambda = 0`` with the tangent ``K + C ad_v`` (relative equilibrium;
Simo, Lewis, Marsden 1991). Rest is the rotation of speed zero.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.constraints.batch import Constraints
from flexfem.core.status import Status
from flexfem.la.direct import DirectSolver
from flexfem.lie import se3, so3
from flexfem.model.model import Model
from flexfem.solvers.modal.linearization import Linearization, Matrices
from flexfem.system.moving_apart import Moved, share_apart
from flexfem.system.system import System

__all__ = [
    "Rotation",
    "check_steadiness",
    "constraint_solver",
    "find_equilibrium",
    "hold",
    "improve_equilibrium",
    "solver_of",
]

#: Largest step (m, rad) after which the iteration has converged; quadratic convergence makes the
#: error far smaller.
_CONVERGED = 1e-8
#: Steps below this that no longer shrink are round-off.
_STAGNANT = 1e-5
_ITERATIONS = 30
#: The same with contacts, which open and close.
_TOUCHING = 100
_HALVINGS = 8
#: Change of a joint's coordinate (m, rad) under a rotation above which the joint prevents it.
_TURNED = 1e-6
#: Change of its stiffness and damping against motions of the model, relative, above which it does.
_UNEVEN = 1e-6
#: Rotations at which joints are checked, rad, not multiples of likely symmetries.
_TURNS = (0.7, 1.9)


@dataclass(frozen=True)
class Rotation:
    """A steady rotation.

    Attributes:
        spin: rad/s.
        axis: unit vector, inertial axes.
        centre: a point on the axis, m.
    """

    spin: float
    axis: FloatArray
    centre: FloatArray

    @property
    def unit_twist(self) -> FloatArray:
        """Twist (6,) in inertial axes of the rotation with 1 rad/s."""
        return np.concatenate([np.cross(self.centre, self.axis), self.axis])

    def at(self, fraction: float) -> "Rotation":
        """The same with a fraction of the spin."""
        return replace(self, spin=fraction * self.spin)

    def set(self, system: System) -> None:
        """Give the nodes the motion of the rotation in the present configuration (collective).

        Local twists are constant where axes turn with the nodes.
        """
        for part, twists in zip(system.parts, self.twists(system), strict=True):
            block, v = part.block, self.spin * twists
            block.velocity[:], block.acceleration[:] = v, 0.0
            if block.width == 3:  # positions alone have inertial axes, in which velocities turn
                block.acceleration[:, :3] = np.cross(v[:, 3:], v[:, :3])

    def twists(self, system: System) -> list[FloatArray]:
        """Local twists (n, 6) of the nodes of each part at 1 rad/s (collective)."""
        return [part.block.rigid_twists(self.unit_twist) for part in system.parts]

    def solve(self, linearization: Linearization, residual: FloatArray) -> PETSc.Vec | None:
        """Step of Newton's method for a residual; None if the matrix is singular (collective)."""
        return self.solver(linearization)(residual)

    def solver(self, linearization: Linearization) -> Callable[[FloatArray], PETSc.Vec | None]:
        """The same for any residual, at the state of the last evaluation (collective)."""
        matrix = _fixed(linearization, linearization.matrices(), self)
        return solver_of(linearization, matrix)


def hold(linearization: Linearization) -> bool:
    """Compute the multipliers at the present state (collective); False if the matrix is singular.

    ``[[M, G^T], [G, 0]] (w, dlambda) = -(r, 0)``: in an equilibrium w is zero and these are the
    joint forces; elsewhere they are those at the beginning of the motion.
    """
    system = linearization.system
    residual = linearization.evaluate(np.zeros(system.constraints.size))
    matrices = linearization.matrices()
    residual[linearization.unknowns :] = 0.0
    solution = constraint_solver(linearization, matrices, matrices.mass)(residual)
    if solution is None:
        return False
    linearization.evaluate(-linearization.rows_of(solution))
    return True


def constraint_solver(
    linearization: Linearization, matrices: Matrices, weight: PETSc.Mat | None
) -> Callable[[FloatArray], PETSc.Vec | None]:
    """Solver of ``[[W, G^T], [G, 0]] x = b``, which returns None if it is singular (collective).

    Args:
        linearization: numbering of the unknowns.
        matrices: matrices whose stiffness contains G.
        weight: W, None for the unit matrix.
    """
    nodes, rows, others = (linearization.vector() for _ in range(3))
    rigid = linearization.rigid_rows()
    index = np.zeros(linearization.size)
    index[: linearization.unknowns] = 1.0
    rows.setArray(rigid)
    nodes.setArray(index)
    others.setArray(1.0 - index - rigid)  # without rows with force laws
    matrix, upper = matrices.stiffness.copy(), matrices.stiffness.copy()
    matrix.diagonalScale(rows, None)
    upper.diagonalScale(nodes, rows)
    matrix.axpy(1.0, upper)
    matrix.setDiagonal(others, PETSc.InsertMode.ADD)
    if weight is None:
        matrix.setDiagonal(nodes, PETSc.InsertMode.ADD)
    else:
        matrix.axpy(1.0, weight)
        states = linearization.vector()
        states.getArray()[linearization.states_range] = 1.0
        matrix.setDiagonal(states, PETSc.InsertMode.ADD)
    return solver_of(linearization, matrix)


def solver_of(
    linearization: Linearization, matrix: PETSc.Mat
) -> Callable[[FloatArray], PETSc.Vec | None]:
    """Factorise once; the returned function solves, or returns None if the matrix is singular."""
    solver = DirectSolver(matrix, "equilibrium_")
    regular = solver.factor(matrix)

    def solve(rhs: FloatArray) -> PETSc.Vec | None:
        if not regular:
            return None
        b, x = linearization.vector(), linearization.vector()
        b.setArray(rhs)
        return x if solver.solve(b, x) and np.isfinite(x.norm()) else None

    return solve


def find_equilibrium(
    linearization: Linearization, rotation: Rotation, upright: Callable[[], bool]
) -> Status:
    """Move the system from its present state to the equilibrium (collective).

    The iteration starts from the present configuration with all loads, initial strains and the
    whole spin; if Newton's method fails, or an element is inverted, they grow in steps, each half
    as large as the last failed one.

    Args:
        linearization: of the system.
        rotation: the spin, zero at rest.
        upright: returns True if no element is inverted in the present state (collective).
    """
    system = linearization.system
    frames = [part.block.frames.copy() for part in system.parts]
    gravity, factors = system.gravity.copy(), system.factors.copy()
    multipliers: FloatArray | None = None
    reached, step = 0.0, 1.0
    status = Status.OK
    while reached < 1.0:
        goal = min(1.0, reached + step)
        system.gravity[:], system.factors[:] = goal * gravity, goal * factors
        system.set_initial_strains(goal)
        status, found = _newton(linearization, rotation.at(goal), multipliers)
        if status is Status.OK and not upright():
            status = Status.INSIDE_OUT
        if status is Status.OK:
            reached, multipliers = goal, found
            frames = [part.block.frames.copy() for part in system.parts]
            continue
        step *= 0.5
        for part, kept in zip(system.parts, frames, strict=True):
            part.block.frames[:] = kept
        if step < 0.5**_HALVINGS:
            break
    system.gravity[:], system.factors[:] = gravity, factors
    system.set_initial_strains()
    _accept(
        linearization, rotation,
        np.zeros(system.constraints.size) if multipliers is None else multipliers,
    )  # fmt: skip
    return status


def improve_equilibrium(linearization: Linearization, rotation: Rotation) -> bool:
    """Take one more step of Newton's method from an equilibrium that was found (collective).

    Returns:
        True if it was taken: the matrix is regular and the step finite.
    """
    done, multipliers = _step(linearization, rotation, linearization.multipliers)
    if done is None or not np.isfinite(done.largest):
        return False
    _accept(linearization, rotation, multipliers)
    return True


def _accept(linearization: Linearization, rotation: Rotation, multipliers: FloatArray) -> None:
    """Evaluate and accept the present state (collective)."""
    system = linearization.system
    rotation.set(system)
    linearization.evaluate(multipliers)
    for part in system.parts:
        part.block.frames0[:] = part.block.frames
    system.constraints.accept()
    system.constraints.forces[:] = linearization.multipliers


def _newton(
    linearization: Linearization, rotation: Rotation, multipliers: FloatArray | None
) -> tuple[Status, FloatArray | None]:
    """Newton's method from the present configuration; status and multipliers."""
    system = linearization.system
    previous = np.inf
    if multipliers is None:  # mechanisms are in equilibrium by the forces in their joints alone
        rotation.set(system)
        if not hold(linearization):
            return Status.SINGULAR, None
        multipliers = linearization.multipliers
    for _ in range(_TOUCHING if system.contacts else _ITERATIONS):
        done, multipliers = _step(linearization, rotation, multipliers)
        if done is None:
            return Status.SINGULAR, multipliers
        largest = done.largest
        if not np.isfinite(largest):
            return Status.DIVERGED, multipliers
        small = largest <= _CONVERGED or (largest <= _STAGNANT and largest > 0.5 * previous)
        if small and done.part == 1.0 and done.unsettled <= 1.0:
            return Status.OK, multipliers
        previous = largest
    return Status.NOT_CONVERGED, multipliers


def _step(
    linearization: Linearization, rotation: Rotation, multipliers: FloatArray
) -> tuple[Moved | None, FloatArray]:
    """One step of Newton's method (m, rad), None if singular, and new multipliers.

    It is cut where it would pass through a contact.
    """
    system = linearization.system
    rotation.set(system)
    residual = linearization.evaluate(multipliers)
    solution = rotation.solve(linearization, residual)
    if solution is None:
        return None, multipliers
    steps = [-s for s in linearization.split(solution.getArray())]
    mine = max((float(np.abs(s).max(initial=0.0)) for s in steps), default=0.0)
    largest = float(system.comm.allreduce(mine, op=MPI.MAX))
    if not np.isfinite(largest):
        return Moved(largest), multipliers
    frames = [part.block.frames.copy() for part in system.parts]

    def move(share: float) -> None:
        for part, kept in zip(system.parts, frames, strict=True):
            part.block.frames[:] = kept
        linearization.move([share * _limited(s, largest) for s in steps])

    share, unsettled = share_apart(system, move)
    moved = Moved(largest, share, unsettled)
    return moved, multipliers - share * linearization.rows_of(solution)


def _limited(step: FloatArray, largest: float) -> FloatArray:
    """A step, shortened so that no node rotates by more than about a radian."""
    return step if largest <= 1.0 else step / largest


def _fixed(
    linearization: Linearization, matrices: Matrices, rotation: Rotation
) -> PETSc.Mat:  # fmt: skip
    """The stiffness, made regular if the model may rotate about the axis or slide along it.

    Such a motion changes no force, so that a spring against it on one node, unstretched in the
    present state, picks one of the equal solutions and leaves the others' forces at zero.
    """
    matrix = matrices.stiffness
    slide = np.concatenate([rotation.axis, np.zeros(3)])
    motions = [rotation.unit_twist, slide] if rotation.spin != 0.0 else []
    free = [xi for xi in motions if _is_free(linearization, xi)]
    if not free:
        return matrix
    matrix = matrix.copy()
    diagonal = matrix.getDiagonal()
    size = diagonal.norm(PETSc.NormType.NORM_INFINITY) or 1.0
    if linearization.system.comm.rank == _first_rank(linearization):
        block = linearization.system.parts[0].block
        for xi in free:
            # the node farthest from the axis is moved the most
            t = block.rigid_twists(xi)[: block.owned, : block.width]
            node = int(np.argmax(np.linalg.norm(t[:, :3], axis=1)))
            n = t[node] / np.linalg.norm(t[node])
            at = matrix.getOwnershipRange()[0] + block.width * node + np.arange(block.width)
            matrix.setValues(
                at.astype(PETSc.IntType), at.astype(PETSc.IntType), size * np.outer(n, n),
                PETSc.InsertMode.ADD,
            )  # fmt: skip
    matrix.assemble()
    return matrix


def _first_rank(linearization: Linearization) -> int:
    """The first rank that has nodes of the first part."""
    comm = linearization.system.comm
    mine = comm.rank if linearization.system.parts[0].block.owned else comm.size
    first: int = comm.allreduce(mine, op=MPI.MIN)
    return first


def _is_free(linearization: Linearization, xi: FloatArray) -> bool:
    """True if no joint and no held edge prevents a rigid motion of the whole model."""
    system, rows = linearization.system, linearization.system.constraints
    rates = rows.changes(system.interface.rigid_twists(xi))
    largest = float(np.abs(rates).max(initial=0.0))
    for block in (part.block for part in system.parts):
        if block.dirichlet is not None:
            held = np.abs(block.rigid_twists(xi)[:, : block.width])[block.dirichlet]
            largest = max(largest, float(held.max(initial=0.0)))
    return bool(system.comm.allreduce(largest, op=MPI.MAX) < _TURNED)


def check_steadiness(model: Model, system: System, rotation: Rotation) -> None:
    """Raise if the model cannot rotate steadily about the axis (collective).

    Drives may prevent the rotation: they are assumed to rotate with it.

    Raises:
        InputError: gravity, a dead load or a joint to the ground is not the same after a rotation.
    """
    if model.gravity is not None and _across(model.gravity.acceleration, rotation.axis):
        raise InputError(f"{model!r}: gravity is not along {_line(rotation)}, no steady rotation")
    for load, factor in zip(model.loads, system.factors, strict=True):
        if factor != 0.0 and not load.follower and (
            not load.uniform or any(_across(vector, rotation.axis) for vector in load.wrench)
        ):  # fmt: skip
            owner = f'{type(load).__name__} "{load.name}"'
            raise InputError(f"{owner}: a dead load across {_line(rotation)}, no steady rotation")
    turned, uneven = _standing(system, rotation)
    if turned is not None:
        owner, change = turned
        raise InputError(
            f"{owner}: prevents rotation of the model about {_line(rotation)}, "
            f"which changes the joint by {change:.3g}"
        )
    if uneven is not None:
        owner, change = uneven
        raise InputError(
            f"{owner}: holds the model differently in directions across {_line(rotation)}, by "
            f"{change:.3g} of the whole, no steady rotation"
        )


def _across(vector: FloatArray, axis: FloatArray) -> bool:
    size = float(np.linalg.norm(vector))
    return size > 0.0 and float(np.linalg.norm(np.cross(vector, axis))) > 1e-9 * size


def _line(rotation: Rotation) -> str:
    """The axis as text."""
    axis, centre = (", ".join(f"{x:g}" for x in v) for v in (rotation.axis, rotation.centre))
    return f"the axis ({axis}) through ({centre})"


def _standing(
    system: System, rotation: Rotation
) -> tuple[tuple[str, float] | None, tuple[str, float] | None]:
    """Owners of the first joints that change as the whole model rotates (collective).

    The first one is of those whose coordinates change, the other one of those to the ground that
    hold the model otherwise than before, in axes that rotate with it.
    """
    rows = system.constraints
    frames = [part.block.frames.copy() for part in system.parts]
    rotation.at(0.0).set(system)
    values, held = [], []
    for turn in (0.0, *_TURNS):
        R = so3.exp(turn * rotation.axis)
        moved = se3.frame(rotation.centre - R @ rotation.centre, R)
        for part, kept in zip(system.parts, frames, strict=True):
            placed = ~part.block.amplitudes
            part.block.frames[placed] = se3.compose(moved, kept[placed])
        system.interface.update()
        rows.evaluate(np.array([1.0, 1.0]))
        # dampers and friction do not depend on positions
        values.append(rows.sums() * (rows.rigid | rows.pulling))
        held.append(_held(system))
    for part, kept in zip(system.parts, frames, strict=True):
        part.block.frames[:] = kept
    change = np.max([np.abs(v - values[0]) for v in values[1:]], axis=0, initial=0.0)
    worst = {
        joint.index: float(change[a:b].max(initial=0.0))
        for joint, a, b in zip(rows.joints, rows.start[:-1], rows.start[1:], strict=True)
        if not joint.joint.driven
    }
    uneven = {
        index: max(float(np.abs(other[index] - given).max(initial=0.0)) for other in held[1:])
        for index, given in held[0].items()
    }
    return _first_above(system, worst, _TURNED), _first_above(system, uneven, _UNEVEN)


def _first_above(
    system: System, sizes: dict[int, float], limit: float
) -> tuple[str, float] | None:  # fmt: skip
    """Owner and size of the first joint whose size is above a limit (collective)."""
    bad = sorted(index for index, size in sizes.items() if not size <= limit)
    first = system.comm.allreduce(bad[0] if bad else np.iinfo(np.int64).max, op=MPI.MIN)
    if first == np.iinfo(np.int64).max:
        return None
    owners = {joint.index: joint.joint.owner for joint in system.constraints.joints}
    owner = next(one for one in system.comm.allgather(owners.get(first)) if one is not None)
    return owner, float(system.comm.allreduce(sizes.get(first, 0.0), op=MPI.MAX))


def _held(system: System) -> dict[int, FloatArray]:
    """How joints to the ground hold their nodes at the last evaluation, by the first one's number.

    Joints of the same nodes count as one: springs along two directions may make an even support.

    Returns:
        (3, n, n) projection on the motions that they prevent, and stiffness and damping against the
        others, relative to their size; in the nodes' axes, which rotate with the model.
    """
    rows = system.constraints
    grounded = rows.row_of_term[np.any(rows.term_nodes < 0, axis=1)]
    groups: dict[tuple[int, ...], list[int]] = {}
    for k in np.unique(rows.joint_of_row[grounded]).tolist():
        terms = slice(*np.searchsorted(rows.row_of_term, rows.start[k : k + 2]).tolist())
        own = np.unique(rows.term_nodes[terms])
        if not rows.joints[k].joint.driven:
            groups.setdefault(tuple(own[own >= 0].tolist()), []).append(k)
    found = {}
    for nodes, members in groups.items():
        chosen = np.concatenate([np.arange(*rows.start[k : k + 2]) for k in members])
        gradients = _gradients(rows, chosen, nodes)
        rigid, soft = rows.rigid[chosen], rows.compliance[chosen]
        prevented = np.linalg.pinv(gradients[rigid]) @ gradients[rigid]
        free = gradients @ (np.eye(len(prevented)) - prevented)
        laws = []
        for slope in rows.slopes[chosen].T:
            hard = np.where(rigid, 0.0, slope / np.where(rigid, 1.0, soft))[:, np.newaxis]
            squares = np.abs(np.einsum("ri,ri->i", gradients, hard * gradients))
            # translations and rotations of each node by their own
            sizes = np.sqrt(squares.reshape(-1, 3).sum(axis=1)).repeat(3)
            sizes[sizes == 0.0] = 1.0
            laws.append(free.T @ (hard * free) / np.outer(sizes, sizes))
        found[rows.joints[members[0]].index] = np.array([prevented, *laws])
    return found


def _gradients(rows: Constraints, chosen: IntArray, nodes: tuple[int, ...]) -> FloatArray:
    """Gradients (r, 6 n) of rows by local twists of some interface nodes."""
    out = np.zeros((len(chosen), len(nodes), 6))
    for side in (0, 1):
        number = rows.term_nodes[:, side]
        terms = np.flatnonzero((number >= 0) & np.isin(rows.row_of_term, chosen))
        row = np.searchsorted(chosen, rows.row_of_term[terms])
        place = np.searchsorted(nodes, number[terms])
        np.add.at(out, (row, place), rows.force_jacobian[terms, side])
    return out.reshape(len(chosen), -1)
