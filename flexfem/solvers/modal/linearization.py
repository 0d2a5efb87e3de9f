# SPDX-License-Identifier: LGPL-3.0-or-later
"""The equations of motion linearised about a state whose local twists are constant.

Perturbations are local twists, ``H = H_0 exp(u)``, so that ``dv = u' + ad_v u`` and, with constant
v, ``dw = u'' + ad_v u'`` (Bruls, Cardona, Arnold 2012, section 2; the commutation of variation and
time derivative on a Lie group). With ``M = dr/dw``, ``C = dr/dv`` and ``K`` the derivative of all
forces, those of the constraints included, at fixed local v and w:

``M u'' + (C + M ad_v) u' + (K + C ad_v) u + G^T dlambda = 0,   G u = 0``.

Nodes with positions alone have inertial axes, in which steady velocities turn: ``dw = u'' + 2 ad_v
u' + ad_v^2 u`` of theirs adds ``M ad_v u' + M ad_v^2 u``.

Rows with force laws (springs, dampers, stops, friction) have equations of their own,
``dF = F_x g u + F_v d(rate)``, linearised at the state; friction that depends on joint forces is
taken with these constant.

Dampers of modes are unknowns p of their own behind the multipliers: with gradients g of the modes'
amplitudes and factors c, ``sqrt(c) g u' - p = 0`` and the forces ``sqrt(c) g p``. Matrices stay
sparse.
"""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.la.nest import CoordinateMatrix, block_indices
from flexfem.layout.elements import TurningElements
from flexfem.lie import se3, so3
from flexfem.solvers.linear.tangent import JointPattern, part_pattern, part_values
from flexfem.solvers.modal.state_unknowns import StateUnknowns
from flexfem.system.system import BlockPart, Shifts, System

__all__ = ["Linearization", "Matrices"]

_STIFFNESS = Shifts(velocity=0.0, acceleration=0.0, scale=1.0, local=True)
_VELOCITY = Shifts(velocity=1.0, acceleration=0.0, scale=1.0, stiffness=0.0)
_MASS = Shifts(velocity=0.0, acceleration=1.0, scale=1.0, stiffness=0.0)
#: Factors with which force laws are not scaled.
_UNIT = np.array([1.0, 1.0])
#: Largest number of evaluations for the force of friction.
_SWEEPS = 25


@dataclass(frozen=True)
class Matrices:
    """Square matrices of all unknowns and multipliers, see :class:`Linearization`.

    Attributes:
        mass: M, zero for multipliers.
        damping: C + M ad_v; rows with force laws have the slopes by rate.
        stiffness: ``[[K + C ad_v, G^T], [G, 0]]``; rows with force laws have slopes and compliance.
    """

    mass: PETSc.Mat
    damping: PETSc.Mat
    stiffness: PETSc.Mat


class Linearization:
    """Matrices and residual of a system in one numbering.

    Every rank owns a contiguous range: the unknowns of each of its nodes, part by part, the states
    of its force elements, then its multipliers; behind these on the first rank the forces of
    dampers of modes.

    Attributes:
        system: the system.
        states: the states of force elements.
        unknowns: number of this rank's unknowns that belong to nodes, and of these states.
        size: size of this rank's range; ``sizes`` local and global.
        multipliers: (r,) forces of all rows of this rank after :meth:`evaluate`, N or N m.
    """

    def __init__(self, system: System) -> None:
        """Number the unknowns and create the pattern (collective)."""
        self.system = system
        for contacts in system.contacts:
            contacts.prepare(0.0)
        rows, comm = system.constraints, system.comm
        self.states = StateUnknowns(system)
        nodal = sum(p.block.sizes[0] for p in system.parts)
        self.unknowns = nodal + self.states.count
        self._dampers = system.modal_dampers
        modes = 0 if self._dampers is None else len(self._dampers.factors)
        self._modes = modes if comm.rank == 0 else 0  # those that this rank owns
        self.size = self.unknowns + rows.owned_count + self._modes
        end = comm.scan(self.size)
        self.sizes = (self.size, int(comm.allreduce(self.size)))
        self._number(end - self.size)
        self._couplings = JointPattern(system)
        pattern = self._pattern()
        self._mats = [CoordinateMatrix(comm, self.sizes, self.sizes, *pattern) for _ in range(3)]
        self._ad = CoordinateMatrix(comm, self.sizes, self.sizes, *self._ad_pattern())
        self.multipliers = np.zeros(rows.size)
        self._rubbing = bool(rows.frictional.any())
        index = PETSc.IS().createGeneral(
            self._row_number(rows.numbers).astype(PETSc.IntType), comm=PETSc.COMM_SELF
        )
        self._here = PETSc.Vec().createSeq(rows.size)
        self._scatter = PETSc.Scatter().create(self.vector(), index, self._here, None)

    def _number(self, first: int) -> None:
        """First numbers of every rank's parts and rows, and the starts of their own numbering."""
        starts, own, at = [], [], first
        for part in self.system.parts:
            starts.append(at)
            own.append(part.block.offset)
            at += part.block.sizes[0]
        self._first_state = at
        at += self.states.count
        rows = self.system.constraints
        count = rows.owned_count
        starts.append(at)
        own.append(self.system.comm.scan(count) - count)
        table = np.array(self.system.comm.allgather((starts, own)), dtype=np.int64)
        self._starts, self._own = table[:, 0], table[:, 1]

    def _unknown(self, part: int, index: IndexArray) -> IntArray:
        """Numbers of unknowns of a part given by its own global numbers."""
        width = self.system.parts[part].block.width
        node = index // width
        rank = np.searchsorted(self._own[:, part], node, side="right") - 1
        found: IntArray = self._starts[rank, part] + index - width * self._own[rank, part]
        return found

    def _row_number(self, number: IntArray) -> IntArray:
        """Numbers of multipliers given by their own global numbers."""
        rank = np.searchsorted(self._own[:, -1], number, side="right") - 1
        found: IntArray = self._starts[rank, -1] + number - self._own[rank, -1]
        return found

    def _pattern(self) -> tuple[IntArray, IntArray]:
        """Entries of all matrices: own ones of the parts, joints, gradients, compliances."""
        parts, i, j = self.system.parts, [], []
        for a, part in enumerate(parts):
            row, column = part_pattern(part)
            i.append(self._unknown(a, row))
            j.append(self._unknown(a, column))
        for a in range(len(parts)):
            for b in range(len(parts)):
                row, column = self._couplings.pattern(a, b)
                i.append(self._unknown(a, row))
                j.append(self._unknown(b, column))
        for a in range(len(parts)):
            unknown, multiplier = self._couplings.gradient(a)
            pair = self._unknown(a, unknown), self._row_number(multiplier)
            i += pair
            j += pair[::-1]
        rows = self.system.constraints
        own = self._row_number(rows.numbers[rows.owned_rows])
        row, column = self.states.pattern(self._first_state, self._unknown, self._row_number)
        unknown, damper = self._damper_pattern()
        return (
            np.concatenate([*i, own, row, unknown, damper, self._own_dampers()]),
            np.concatenate([*j, own, column, damper, unknown, self._own_dampers()]),
        )

    def _own_dampers(self) -> IntArray:
        """Numbers of the dampers of modes that this rank owns."""
        count = self.system.constraints.owned_count
        return np.asarray(self._starts[self.system.comm.rank, -1] + count + np.arange(self._modes))

    def _damper_pattern(self) -> tuple[IntArray, IntArray]:
        """Numbers of this rank's unknowns and of the dampers that act on them."""
        nothing = np.empty(0, dtype=np.int64)
        if self._dampers is None:
            return nothing, nothing
        dampers = self.system.comm.bcast(self._own_dampers())
        starts = self._starts[self.system.comm.rank]
        own = [
            starts[k] + np.arange(self.system.parts[k].block.sizes[0]) for k in self._dampers.parts
        ]
        unknowns = np.concatenate([nothing, *own])
        return np.tile(unknowns, len(dampers)), np.repeat(dampers, len(unknowns))

    def _damper_values(self) -> FloatArray:
        """Gradients of the modes' amplitudes by these unknowns at the state (collective)."""
        if self._dampers is None:
            return np.empty(0)
        rows = [
            np.sqrt(factor) * own.forces(i).ravel()
            for i, factor in enumerate(self._dampers.factors)
            for own in self._dampers.parts.values()
        ]
        return np.concatenate([np.empty(0), *rows])

    def _ad_pattern(self) -> tuple[IntArray, IntArray]:
        entries = []
        for part, first in zip(
            self.system.parts, self._starts[self.system.comm.rank], strict=False
        ):
            nodes, width = np.arange(part.block.owned)[:, np.newaxis], part.block.width
            entries.append(first + np.stack(block_indices(nodes, nodes, (width, width))))
        row, column = np.concatenate([np.empty((2, 0), dtype=np.int64), *entries], axis=1)
        return row, column

    @property
    def states_range(self) -> slice:
        """Places of the states in this rank's range."""
        return slice(self.unknowns - self.states.count, self.unknowns)

    def vector(self) -> PETSc.Vec:
        """A new vector of all unknowns (collective)."""
        return PETSc.Vec().createMPI(self.sizes, comm=self.system.comm)

    def evaluate(self, multipliers: FloatArray) -> FloatArray:
        """Residual of this rank's range at the trial state (collective).

        Args:
            multipliers: (r,) of the rigid rows of this rank, N or N m; others are not used.
        """
        system, rows = self.system, self.system.constraints
        rigid = rows.rigid
        rows.multipliers[:] = np.where(rigid, multipliers, 0.0)
        for part in system.parts:
            part.add_residual(system.gravity, system.factors, 1.0)
        system.interface.update()
        for _ in range(_SWEEPS if self._rubbing else 1):
            rows.evaluate(_UNIT)
            if rows.has_elements:
                rows.elements.settle(rows, still=False)
                rows.evaluate(_UNIT)
            force = rows.multipliers.copy()
            force[~rigid] += rows.values[~rigid] / rows.compliance[~rigid]
            settled = np.allclose(force, rows.multipliers, rtol=1e-13, atol=0.0)
            if settled or not self._rubbing:
                break
            rows.multipliers[:] = force
        self.multipliers = force
        system.add_constraint_forces(self.multipliers)
        pieces = [p.block.owned_residual.ravel() for p in system.parts]
        pieces.append(np.zeros(self.states.count))  # they are steady
        gaps = np.where(rigid, rows.values, 0.0)[rows.owned_rows]
        return np.concatenate([*pieces, gaps, np.zeros(self._modes)])

    def matrices(self) -> Matrices:
        """Matrices at the state of the last evaluation (collective); they are overwritten later."""
        rows = self.system.constraints
        turning = rows.hessians(rows.owned * self.multipliers)
        mass, damping, stiffness = (entry.mat for entry in self._mats)
        scale, free = self._row_scales()
        term = rows.row_of_term
        position = rows.local_jacobian() * scale[term][:, np.newaxis, np.newaxis]
        velocity = rows.force_jacobian * (scale * rows.slopes[:, 1] * ~rows.rigid)[term][
            :, np.newaxis, np.newaxis
        ]  # fmt: skip
        forces = rows.force_jacobian * free[term][:, np.newaxis, np.newaxis]
        corner = np.where(rows.rigid, 0.0, -scale * rows.compliance)[rows.owned_rows]
        nothing, none = np.zeros_like(forces), 0.0 * corner
        slopes = self._slopes = rows.elements.linearize(rows)
        position += slopes.position
        velocity += slopes.velocity
        self.states.scale(slopes)
        by_rate, by_state = self.states.damping(slopes), self.states.stiffness(slopes)
        modal, one = self._damper_values(), np.ones(self._modes)
        no, off = 0.0 * modal, 0.0 * one
        self._assemble(
            0, _MASS, 0.0 * turning, (nothing, nothing), (none, 0.0 * by_rate, no, no, off)
        )
        self._assemble(
            1, _VELOCITY, 0.0 * turning, (nothing, velocity), (none, by_rate, no, modal, off)
        )
        self._assemble(
            2, _STIFFNESS, turning, (forces, position), (corner, by_state, modal, no, -one)
        )
        stiffness = self._with_contacts(stiffness)
        if not self._moving():
            return Matrices(mass, damping, stiffness)
        self._ad.assemble(self._ad_values())
        stiffness = stiffness.copy()
        stiffness.axpy(1.0, damping.matMult(self._ad.mat))
        damping = damping.copy()
        damping.axpy(1.0, mass.matMult(self._ad.mat))
        if any(part.block.width == 3 for part in self.system.parts):
            # positions alone have inertial axes, in which steady velocities turn
            self._ad.assemble(self._ad_values(turning=False))
            turned = mass.matMult(self._ad.mat)
            damping.axpy(1.0, turned)
            stiffness.axpy(1.0, turned.matMult(self._ad.mat))
        return Matrices(mass, damping, stiffness)

    def of_modes(self) -> Matrices:
        """Matrices, constant in time, in the coordinates of the modes (collective)."""
        return self.matrices()

    def _with_contacts(self, stiffness: PETSc.Mat) -> PETSc.Mat:
        """Add the contacts that are closed, whose pattern changes from state to state."""
        touching = [(a, p) for a, p in enumerate(self.system.parts) if p.contacts is not None]
        total = stiffness.copy() if touching else stiffness
        for a, part in touching:
            for b, other in touching:
                assert part.contacts is not None
                rows, columns, values = part.contacts.entries(1.0, other.kind)
                row, column = self._unknown(a, rows), self._unknown(b, columns)
                own = CoordinateMatrix(self.system.comm, self.sizes, self.sizes, row, column)
                own.assemble(values)
                total.axpy(1.0, own.mat)
                own.mat.destroy()
        return total

    def _row_scales(self) -> tuple[FloatArray, FloatArray]:
        """Factors (r,) of the rows' equations, 0 where a law keeps the force constant, else 1.

        A spring's equation is divided by its slope, which makes the matrix symmetric.
        """
        rows = self.system.constraints
        slope = rows.slopes[:, 0]
        sprung = ~rows.rigid & (slope > 0.0)
        scale = np.where(sprung, 1.0 / np.where(sprung, slope, 1.0), 1.0)
        changing = rows.rigid | rows.of_elements | np.any(rows.slopes != 0.0, axis=1)
        free = np.where(changing, 1.0, 0.0)
        return scale, free

    def _assemble(
        self, which: int, shifts: Shifts, joints: FloatArray,
        gradients: tuple[FloatArray, FloatArray], others: tuple[FloatArray, ...],
    ) -> None:  # fmt: skip
        """Set a matrix: blocks of joints, gradients in the columns and the rows of multipliers.

        ``others`` are the diagonal of the multipliers, the entries of states, and those of dampers
        of modes: columns, rows, diagonal.
        """
        system, count = self.system, len(self.system.parts)
        values = [self._part_values(part, shifts) for part in system.parts]
        values += [self._couplings.values(a, b, joints) for a in range(count) for b in range(count)]
        for a in range(count):
            values += [self._couplings.side_values(a, gradient) for gradient in gradients]
        self._mats[which].assemble(np.concatenate([*values, *others]))

    def _part_values(self, part: BlockPart, shifts: Shifts) -> FloatArray:
        """Values of a part's own entries; of damped shells with what their matrix leaves out."""
        values, elements = part_values(self.system, part, shifts), part.elements
        if not (isinstance(elements, TurningElements) and elements.viscous):
            return values
        if shifts.stiffness != 0.0 and part.block.velocity.any():
            changes, _ = elements.rate_changes(part.block, shifts.array, shifts.scale, local=True)
            if part.block.dirichlet is not None:
                changes[part.dirichlet_entries[: len(changes)]] = 0.0
            values[: len(changes)] += changes
        return values

    def rigid_rows(self) -> FloatArray:
        """1 for the rigid rows in this rank's range, 0 for all other unknowns."""
        rows = self.system.constraints
        rigid = rows.rigid[rows.owned_rows].astype(np.float64)
        return np.concatenate([np.zeros(self.unknowns), rigid, np.zeros(self._modes)])

    def _moving(self) -> bool:
        mine = any(bool(p.block.velocity.any()) for p in self.system.parts)
        return bool(self.system.comm.allreduce(int(mine)))

    def _ad_values(self, turning: bool = True) -> FloatArray:
        """Values of the block-diagonal matrix of ``ad_v`` of all nodes of this rank.

        If not ``turning``, zero for nodes whose axes turn with them. Unknowns that are held have
        rows of their own in all matrices, which must not meet others.
        """
        blocks = []
        for part in self.system.parts:
            v = part.block.velocity[: part.block.owned]
            ad = np.zeros((len(v), 6, 6))
            ad[:, :3, :3] = ad[:, 3:, 3:] = so3.skew(v[:, 3:])
            ad[:, :3, 3:] = so3.skew(v[:, :3])
            width = part.block.width
            if not turning and width == 6:
                ad[:] = 0.0
            ad = ad[:, :width, :width]
            if part.block.dirichlet is not None:
                free = ~part.block.dirichlet[: part.block.owned]
                ad = ad * free[:, :, np.newaxis] * free[:, np.newaxis, :]
            blocks.append(ad.ravel())
        return np.concatenate([np.empty(0), *blocks])

    def damped(self) -> bool:
        """True if forces depend on velocities: something rotates or is damped (collective)."""
        return bool(self.matrices().damping.norm(PETSc.NormType.FROBENIUS) > 0.0)

    def total(self, local: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Sum of arrays over the ranks (collective)."""
        found = np.ascontiguousarray(local)
        self.system.comm.Allreduce(MPI.IN_PLACE, found, op=MPI.SUM)
        return found

    def split(self, values: FloatArray) -> list[FloatArray]:
        """Views (n_owned, width) into the parts of an array of this rank's range."""
        parts, at = [], 0
        for part in self.system.parts:
            count = part.block.sizes[0]
            parts.append(values[at : at + count].reshape(-1, part.block.width))
            at += count
        return parts

    def softness(self) -> FloatArray:
        """Compliances of rows with force laws in this rank's range, else 0; m/N or rad/(N m)."""
        rows = self.system.constraints
        scale, free = self._row_scales()
        soft = np.where(rows.rigid, 0.0, scale * rows.compliance * free)[rows.owned_rows]
        return np.concatenate([np.zeros(self.unknowns), soft, np.ones(self._modes)])

    def stiffness_by_states(self) -> FloatArray:
        """Sizes of stiffnesses of rows by states of force elements in this rank's range, N/m."""
        sizes = self.states.stiffness_of_rows(self._slopes)
        owned = sizes[self.system.constraints.owned_rows]
        return np.concatenate([np.zeros(self.unknowns), owned, np.zeros(self._modes)])

    def multiply(
        self, matrix: PETSc.Mat, shapes: npt.NDArray[Any], laws: PETSc.Mat | None = None
    ) -> npt.NDArray[np.complex128]:
        """A matrix times each of the shapes (k, n) of this rank's nodes (collective).

        Args:
            matrix: matrix, without its columns of multipliers.
            shapes: (k, n).
            laws: True to include the forces of rows with laws, by the columns of this matrix.
        """
        x, y, z = self.vector(), self.vector(), self.vector()
        out = np.zeros(shapes.shape, dtype=np.complex128)
        soft = self.softness()
        stiff = np.where(soft > 0.0, 1.0 / np.where(soft > 0.0, soft, 1.0), 0.0)
        for k, shape in enumerate(shapes):
            for part, unit in ((shape.real, 1.0), (shape.imag, 1.0j)):
                x.set(0.0)
                x.getArray()[: self.unknowns] = part
                matrix.mult(x, y)
                out[k] += unit * y.getArray()[: self.unknowns]
                if laws is not None:
                    x.setArray(stiff * y.getArray())
                    laws.mult(x, z)
                    out[k] += unit * z.getArray()[: self.unknowns]
        return out

    def rows_of(self, vector: PETSc.Vec) -> FloatArray:
        """Multipliers (r,) of all rows of this rank from a vector of all unknowns (collective)."""
        self._scatter.scatter(vector, self._here)
        return np.array(self._here.getArray(readonly=True))

    def move(self, steps: list[FloatArray]) -> None:
        """Move the nodes by local twists (n_owned, width) of each part (collective)."""
        for part, step in zip(self.system.parts, steps, strict=True):
            block = part.block
            block.owned_step[:] = step
            block.spread_step()
            block.frames[:] = se3.retract(block.frames, block.step)
        for contacts in self.system.contacts:
            contacts.update()
