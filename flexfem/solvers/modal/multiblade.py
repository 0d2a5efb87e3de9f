# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotors of identical blades on a support that does not rotate, in multiblade coordinates.

The local coordinates ``u_k`` of blade k, at the azimuth ``psi_k = Omega t + phi_k``, become

``u_k = b_0 / sqrt(B) + sqrt(2/B) sum_n (b_nc cos n psi_k + b_ns sin n psi_k) [+ (-1)^k b_d /
sqrt(B)]``,

an orthonormal transformation (Coleman and Feingold 1958; Johnson, Helicopter Theory 1980, section
8-4), and the motion of other rotating nodes by its components in axes that do not rotate. With
``u = T(t) w`` and the equations of ``linearization``,

``T^T M T w'' + T^T (C T + 2 M T') w' + T^T (K T + C T' + M T'') w + T^T G^T dlambda = 0``

is constant in time if the rotor is isotropic and its forces do not depend on the azimuth.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.elements.force_elements import ElementSlopes
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.la.nest import CoordinateMatrix
from flexfem.lie import se3, so3
from flexfem.solvers.modal.linearization import Linearization, Matrices
from flexfem.solvers.modal.mode_errors import ComplexArray
from flexfem.solvers.modal.state_unknowns import StateUnknowns
from flexfem.solvers.modal.steady_rotation import Rotation, solver_of
from flexfem.system.system import BlockPart, System

__all__ = ["MultibladeLinearization", "Rotor", "RotorRotation", "harmonics"]

#: Largest deviation of a blade from the first one rotated, relative to the rotor's radius.
_ALIKE = 1e-6
#: Rate of joints' coordinates (m/s, rad/s) at a speed of 1 rad/s, below which a rotor is free.
_FREE = 1e-6


def harmonics(angles: FloatArray, order: int = 0) -> FloatArray:
    """(B, B) coordinates of blades by multiblade ones, or a derivative by the azimuth.

    Columns are collective, cosine and sine of each harmonic, and the alternating one if B is even.

    Args:
        angles: (B,) azimuths of the blades, rad.
        order: of the derivative.
    """
    count = len(angles)
    columns = [np.full(count, float(order == 0)) / np.sqrt(count)]
    for n in range(1, (count + 1) // 2):
        turned = n * angles + 0.5 * np.pi * order
        size = np.sqrt(2.0 / count) * n**order
        columns += [size * np.cos(turned), size * np.sin(turned)]
    if count % 2 == 0:
        place = np.round(angles * count / (2.0 * np.pi)).astype(np.int64)
        columns.append((order == 0) * (-1.0) ** place / np.sqrt(count))
    return np.stack(columns, axis=1)


@dataclass(frozen=True)
class _Nodes:
    """Nodes of a part on this rank, ghosts included.

    Attributes:
        turning: (n,) True for those of the rotor.
        blade: (n,) number of the blade, -1 for others.
        place: (n,) number of the node in its blade.
    """

    turning: BoolArray
    blade: IntArray
    place: IntArray


class Rotor:
    """The rotor of a system: its nodes, and the angles between its blades.

    Attributes:
        nodes: those of each part.
        angles: (B,) angle of each blade from the first one, rad, positive about the axis.
        unknowns: for each part, (B, m) global number of each blade's nodes in the part.
        reference: part, and local node or -1, of the first node of the first rotating body.
        axis, centre: of rotation at the start.
    """

    def __init__(
        self, system: System, bodies: Sequence[str], blades: Sequence[str], axis: FloatArray,
        centre: FloatArray,
    ) -> None:  # fmt: skip
        """Find the nodes (collective).

        Args:
            system: the system at the start.
            bodies: names of the other bodies that rotate; the first one carries the blades.
            blades: names of the blades.
            axis: unit vector of the axis of rotation.
            centre: a point on it, m.

        Raises:
            InputError: an unknown body, a first one with positions alone, held nodes, or blades
                that are not the same at equal angles.
        """
        self.axis, self.centre, self._comm = axis, centre, system.comm
        names = [[body.name for body in part.family.bodies] for part in system.parts]
        known = {name for some in names for name in some}
        for name in (*bodies, *blades):
            if name not in known:
                raise InputError(f"rotor: the model has no body '{name}'")
        self.nodes, self.unknowns = list[_Nodes](), list[IntArray]()
        self._serial: dict[int, tuple[IntArray, IntArray]] = {}
        starts = [
            self._add(part, own, bodies, blades)
            for part, own in zip(system.parts, names, strict=True)
        ]
        self.angles = _angles(blades, np.concatenate(starts, axis=1), axis, centre)
        self.reference = self._first(system, names, bodies[0] if bodies else blades[0])

    def _add(
        self, part: BlockPart, names: list[str], bodies: Sequence[str], blades: Sequence[str]
    ) -> FloatArray:
        """Find the nodes in a part with bodies of these names (collective).

        Returns:
            (B, m, 12) frames of the blades' nodes at the start.
        """
        order = {name: k for k, name in enumerate(blades)}
        blade = np.array([order.get(name, -1) for name in names])
        turning = np.array([name in order or name in bodies for name in names])
        whole = np.asarray(part.family.body_of_node)
        of_blade, place = blade[whole], np.zeros(len(whole), dtype=np.int64)
        members = [np.flatnonzero(of_blade == k) for k in range(len(blades))]
        counts = [len(mine) for mine in members]
        if len(set(counts)) > 1:
            words = ", ".join(map(str, counts))
            raise InputError(f"rotor: the blades {', '.join(blades)} have {words} nodes")
        for mine in members:
            place[mine] = np.arange(len(mine))
        block, ids = part.block, part.block.node_ids
        found = _Nodes(turning[whole[ids]], of_blade[ids], place[ids])
        self._refuse_held(block, found.turning, names, whole[ids])
        self._serial[part.kind] = of_blade, place
        self.nodes.append(found)
        numbers, frames = np.zeros((len(blades), counts[0])), np.zeros((len(blades), counts[0], 12))
        owned = np.flatnonzero(found.blade[: block.owned] >= 0)
        at = found.blade[owned], found.place[owned]
        numbers[at], frames[at] = block.offset + owned, block.start_frames[owned]
        if block.width == 3:  # axes of positions alone are any, see turn_axes
            frames[:, :, 3:] = 0.0
        self.unknowns.append(self._sum(numbers).astype(np.int64))
        return self._sum(frames)

    def _refuse_held(
        self, block: FrameBlock, turning: BoolArray, names: list[str], body: IntArray
    ) -> None:
        """Raise if nodes that turn are held (collective).

        Args:
            block: the nodes.
            turning: (n,) True for those of the rotor.
            names: of the bodies.
            body: (n,) number of the body of each node.

        Raises:
            InputError: names the first body.
        """
        if block.dirichlet is None:
            return
        held = block.dirichlet[:, :3].any(axis=1)  # directors do not turn about themselves
        mine = np.unique(body[turning & held]).tolist()
        every = sorted(number for some in self._comm.allgather(mine) for number in some)
        if every:
            raise InputError(
                f"rotor: '{names[every[0]]}' has held nodes, which do not rotate: join it to the "
                "rotor by a joint instead"
            )

    def _sum(self, values: FloatArray) -> FloatArray:
        self._comm.Allreduce(MPI.IN_PLACE, values, op=MPI.SUM)
        return values

    def _first(self, system: System, names: list[list[str]], body: str) -> tuple[int, int]:
        """Part and local node of the first node of a body; -1 on other ranks."""
        number = next(k for k, own in enumerate(names) if body in own)
        part = system.parts[number]
        if part.block.width == 3:
            raise InputError(
                f"rotor: '{body}' has nodes with positions alone, which carry no axis: name a body "
                "with axes first, such as a rigid hub"
            )
        first = int(np.flatnonzero(part.family.body_of_node == names[number].index(body))[0])
        mine = np.flatnonzero(part.block.node_ids[: part.block.owned] == first)
        return number, int(mine[0]) if len(mine) else -1

    def of_node(self, key: tuple[int, int]) -> tuple[int, int]:
        """Blade of a node given by kind and number, -1 if none, and its place in it."""
        blade, place = self._serial[key[0]]
        return int(blade[key[1]]), int(place[key[1]])

    def of_reference[A: npt.NDArray[Any]](self, values: Callable[[int, int], A]) -> A:
        """Values of the reference node, from the rank that owns it (collective)."""
        part, node = self.reference
        found = self._comm.allgather(values(part, node) if node >= 0 else None)
        value: A = next(one for one in found if one is not None)
        return value

    def present(self, system: System) -> tuple[FloatArray, FloatArray]:
        """Axis and a point on it at present, as the reference node carries them (collective)."""
        motion = self._motion(system)
        R = se3.rotation(motion)
        return R @ self.axis, se3.position(motion) + R @ self.centre

    def turn_axes(self, system: System) -> None:
        """Let axes of the rotor's nodes with positions alone turn with its first body (collective).

        They have any directions: now those of a blade are those of the first one, rotated, so that
        its unknowns are the same as of the first one, as with nodes that have axes of their own.
        """
        turn = se3.rotation(self._motion(system))
        for part, nodes in zip(system.parts, self.nodes, strict=True):
            if part.block.width == 3:
                angles = np.where(nodes.blade >= 0, self.angles[nodes.blade], 0.0)[nodes.turning]
                axes = turn @ so3.exp(angles[:, np.newaxis] * self.axis)
                part.block.frames[nodes.turning, 3:] = axes.reshape(-1, 9)

    def _motion(self, system: System) -> FloatArray:
        """Motion (12,) of the reference node since the start (collective)."""
        blocks = [part.block for part in system.parts]
        both = self.of_reference(
            lambda k, node: np.stack([blocks[k].start_frames[node], blocks[k].frames[node]])
        )
        return se3.compose(both[1], se3.inverse(both[0]))


def _angles(
    blades: Sequence[str], frames: FloatArray, axis: FloatArray, centre: FloatArray
) -> FloatArray:
    """(B,) angles of the blades, whose nodes have the frames (B, m, 12), from the first one.

    Raises:
        InputError: a blade is not the first one at a free multiple of the angle between blades.
    """
    count, arms = len(blades), frames[:, :, :3] - centre
    radius = float(np.linalg.norm(arms[0], axis=1).max())
    left, angles = set(range(1, count)), [0.0]
    for blade, own in zip(blades[1:], frames[1:], strict=True):
        gaps = {}
        for m in sorted(left):
            R = so3.exp(2.0 * np.pi * m / count * axis)
            turned = se3.compose(se3.frame(centre - R @ centre, R), frames[0])
            gaps[m] = np.abs(turned - own).max(initial=0.0, axis=0)
        best = min(gaps, key=lambda m: float(gaps[m].max()))
        gap = max(float(gaps[best][:3].max()), radius * float(gaps[best][3:].max()))
        if gap > _ALIKE * radius:
            raise InputError(
                f"rotor: '{blade}' is not '{blades[0]}' rotated by a multiple of "
                f"{360.0 / count:g} degrees about the axis, nodes are {gap:.3g} m apart"
            )
        left.remove(best)
        angles.append(2.0 * np.pi * best / count)
    return np.array(angles)


@dataclass(frozen=True)
class RotorRotation(Rotation):
    """A steady rotation of a rotor alone, about the axis that its first body carries.

    Attributes:
        rotor: the nodes that rotate.
        torque: of the drive that keeps the speed, N m, positive about the axis; of the last step.
    """

    rotor: Rotor
    torque: list[float]

    def set(self, system: System) -> None:
        """See :meth:`Rotation.set`: axes of nodes with positions alone turn with the first body."""
        self.rotor.turn_axes(system)
        super().set(system)

    def twists(self, system: System) -> list[FloatArray]:
        """See :meth:`Rotation.twists`: zero for what does not rotate."""
        axis, centre = self.rotor.present(system)
        whole = Rotation(self.spin, axis, centre).twists(system)
        turning = [nodes.turning[:, np.newaxis] for nodes in self.rotor.nodes]
        return [own * twists for own, twists in zip(turning, whole, strict=True)]

    def solve(self, linearization: Linearization, residual: FloatArray) -> PETSc.Vec | None:
        """See :meth:`Rotation.solve`: the first body of a free rotor keeps its azimuth.

        ``K x = r - torque f, f^T x = 0`` with the unit torque f on it.
        """
        matrix, system = linearization.matrices().stiffness, linearization.system
        self.torque[:] = [0.0]
        if not self._is_free(system):
            return solver_of(linearization, matrix)(residual)
        f, matrix = self._unit_torque(linearization), matrix.copy()
        size = matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY) or 1.0
        _add_outer(linearization, matrix, f, size)
        solve = solver_of(linearization, matrix)
        x, z = solve(residual), solve(f)
        if x is None or z is None:
            return None
        mine = np.array([f @ x.getArray(), f @ z.getArray()])
        system.comm.Allreduce(MPI.IN_PLACE, mine)
        self.torque[:] = [float(mine[0] / mine[1])]
        x.axpy(-self.torque[0], z)
        return x

    def _is_free(self, system: System) -> bool:
        """True if no joint prevents a rotation of the rotor (collective)."""
        rows = system.constraints
        replace(self, spin=1.0).set(system)
        system.interface.update()
        rates = np.where(rows.rigid | rows.pulling, rows.changes(system.interface.velocities), 0.0)
        self.set(system)
        system.interface.update()
        largest = float(np.abs(rates).max(initial=0.0))
        return bool(system.comm.allreduce(largest, op=MPI.MAX) < _FREE)

    def _unit_torque(self, linearization: Linearization) -> FloatArray:
        """Moment of 1 N m about the axis on the reference node, in this rank's range."""
        found = np.zeros(linearization.size)
        axis, _ = self.rotor.present(linearization.system)
        part, node = self.rotor.reference
        if node >= 0:
            R = se3.rotation(linearization.system.parts[part].block.frames[node])
            linearization.split(found)[part][node, 3:] = R.T @ axis
        return found


def _add_outer(
    linearization: Linearization, matrix: PETSc.Mat, f: FloatArray, size: float
) -> None:  # fmt: skip
    """Add ``size f f^T`` to a matrix, of a vector with entries of one node (collective)."""
    at = np.flatnonzero(f)
    numbers = (matrix.getOwnershipRange()[0] + at).astype(PETSc.IntType)
    values = size * np.outer(f[at], f[at])
    matrix.setValues(numbers, numbers, values, PETSc.InsertMode.ADD)
    matrix.assemble()


class _EvenStates(StateUnknowns):
    """States whose units are the same for all blades.

    Attributes:
        orbit: (count,) number of the states that are the same but for the blade, -1 without; of all
            ranks, and ``orbits``, their number.
    """

    orbit: IntArray
    orbits: int = 0

    def scale(self, slopes: ElementSlopes) -> None:
        """See :meth:`StateUnknowns.scale`."""
        super().scale(slopes)
        largest, chosen = np.zeros(self.orbits), self.orbit >= 0
        np.maximum.at(largest, self.orbit[chosen], self.units[chosen])
        self._system.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        self.units[chosen] = largest[self.orbit[chosen]]


class MultibladeLinearization(Linearization):
    """Linearised equations of a rotor on a support, see the module.

    Attributes:
        rotor: the rotor.
        spin: speed of the state, rad/s.
    """

    states: _EvenStates

    def __init__(self, system: System, rotor: Rotor) -> None:
        """Number the unknowns, those of the blades one by one (collective)."""
        super().__init__(system)
        self.rotor, self.spin = rotor, 0.0
        self.states = _EvenStates(system)
        self._of_states = self._orbits()

    def of_modes(self) -> Matrices:
        """See :meth:`Linearization.of_modes`: in multiblade coordinates."""
        given, omega = self.matrices(), self.spin
        T, first, second = (self.coordinates(order) for order in range(3))

        def projected(matrix: PETSc.Mat, *others: tuple[float, PETSc.Mat, PETSc.Mat]) -> PETSc.Mat:
            product = matrix.matMult(T)
            for factor, other, turned in others if omega else ():
                product.axpy(factor, other.matMult(turned))
            return T.transposeMatMult(product)

        M, C, K = given.mass, given.damping, given.stiffness
        return Matrices(
            projected(M), projected(C, (2.0 * omega, M, first)),
            projected(K, (omega, C, first), (omega**2, M, second)),
        )  # fmt: skip

    def coordinates(self, order: int = 0, azimuth: float = 0.0) -> PETSc.Mat:
        """All unknowns by multiblade ones, or a derivative by the azimuth (collective).

        Args:
            order: of the derivative.
            azimuth: of the rotor from the present one, rad.
        """
        axis, _ = self.rotor.present(self.system)

        def turned(R: FloatArray) -> FloatArray:
            own = R.transpose(0, 2, 1) @ axis
            rotated: FloatArray = so3.exp(-azimuth * own)
            for _ in range(order):
                rotated = -so3.skew(own) @ rotated
            return rotated

        return self.matrix(harmonics(self.rotor.angles + azimuth, order), turned, float(order == 0))

    def matrix(
        self, blades: FloatArray, turned: Callable[[FloatArray], FloatArray] | None = None,
        others: float = 0.0,
    ) -> PETSc.Mat:  # fmt: skip
        """Matrix that acts in the same way on every node of the blades (collective).

        Args:
            blades: (B, B) factors of each blade's unknowns by those of all blades.
            turned: (n, 3, 3) blocks of the other nodes of the rotor by their axes (n, 3, 3); None
                for zero.
            others: diagonal of all that does not rotate.
        """
        entries = [self._of_blades(a, blades) for a in range(len(self.system.parts))]
        entries += [self._of_nodes(a, turned, others) for a in range(len(self.system.parts))]
        entries += [self._of_other_states(blades, others)]
        i, j, values = (np.concatenate(x) for x in zip(*entries, strict=True))
        found = CoordinateMatrix(self.system.comm, self.sizes, self.sizes, i, j)
        found.assemble(values)
        return found.mat

    def _of_blades(self, part: int, blades: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Entries of this rank's nodes of blades."""
        block, nodes = self.system.parts[part].block, self.rotor.nodes[part]
        own = np.flatnonzero(nodes.blade[: block.owned] >= 0)
        k, place = nodes.blade[own], nodes.place[own]
        component = np.arange(block.width)
        rows = self._unknown(part, block.width * (block.offset + own)[:, np.newaxis] + component)
        partners = self.rotor.unknowns[part][:, place].T  # (n, B)
        columns = self._unknown(part, block.width * partners[:, :, np.newaxis] + component)
        values = np.broadcast_to(blades[k][:, :, np.newaxis], columns.shape)
        return (
            np.broadcast_to(rows[:, np.newaxis], columns.shape).ravel(),
            columns.ravel(),
            values.ravel(),
        )

    def _of_nodes(
        self, part: int, turned: Callable[[FloatArray], FloatArray] | None, others: float
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Entries of this rank's other nodes."""
        block, nodes = self.system.parts[part].block, self.rotor.nodes[part]
        own = np.flatnonzero(nodes.blade[: block.owned] < 0)
        blocks = np.broadcast_to(others * np.eye(6), (len(own), 6, 6)).copy()
        moving = nodes.turning[own]
        blocks[moving] = 0.0
        if turned is not None:
            R = turned(se3.rotation(block.frames[own[moving]]))
            blocks[moving, :3, :3] = blocks[moving, 3:, 3:] = R
        w = block.width
        numbers = self._unknown(part, w * (block.offset + own)[:, np.newaxis] + np.arange(w))
        shape = len(own), w, w
        return (
            np.broadcast_to(numbers[:, :, np.newaxis], shape).ravel(),
            np.broadcast_to(numbers[:, np.newaxis], shape).ravel(), blocks[:, :w, :w].ravel(),
        )  # fmt: skip

    def _of_other_states(
        self, blades: FloatArray, others: float
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Entries of this rank's states and multipliers."""
        first = self._of_modes_start()
        count = self.states.count
        alone = np.flatnonzero(self.states.orbit < 0)
        rows = np.append(alone, count + np.arange(self.size - self.unknowns)) + first
        i, j, values = [rows], [rows], [np.full(len(rows), others)]
        for state, blade, partners in self._of_states:
            i.append(np.full(len(partners), first + state))
            j.append(partners)
            values.append(blades[blade])
        return np.concatenate(i), np.concatenate(j), np.concatenate(values)

    def eigenvalues_of_states(self) -> ComplexArray:
        """Eigenvalues, Im > 0, of the states of forces where nothing moves (collective).

        Those of a blade's states, mu in its axes, are ``mu + i n Omega`` for the n-th harmonic.
        """
        own, chosen = self.states.eigenvalues(self._slopes), self.states.orbit < 0
        chosen[[state for state, blade, _ in self._of_states if blade == 0]] = True
        harmonic = np.arange(-((len(self.rotor.angles) - 1) // 2), len(self.rotor.angles) // 2 + 1)
        shifts = np.where(self.states.orbit[chosen, np.newaxis] < 0, 0.0, harmonic * self.spin)
        values = np.concatenate(
            self.system.comm.allgather((own[chosen, np.newaxis] + 1j * shifts).ravel())
        )
        found: ComplexArray = values[values.imag > 1e-9 * np.abs(values)]
        return found

    def _of_modes_start(self) -> int:
        """Number of this rank's first state."""
        end = self.system.comm.scan(self.size)
        return int(end - self.size + self.unknowns - self.states.count)

    def _orbits(self) -> list[tuple[int, int, IntArray]]:
        """States of blades on this rank: number, blade, and numbers of the same on all blades.

        Raises:
            InputError: a force acts on one blade and not on the others.
        """
        first, comm = self._of_modes_start(), self.system.comm
        mine = [(key, blade, first + at) for key, blade, at in self._states_of_blades()]
        found: dict[tuple[object, ...], dict[int, int]] = {}
        for key, blade, number in (one for some in comm.allgather(mine) for one in some):
            found.setdefault(key, {})[blade] = number
        count = len(self.rotor.angles)
        for key, numbers in found.items():
            if len(numbers) != count:
                raise InputError(f"rotor: {key[0]} has states on some blades and not on others")
        order = {key: k for k, key in enumerate(sorted(found, key=repr))}
        self.states.orbit, self.states.orbits = np.full(self.states.count, -1), len(order)
        own = []
        for key, blade, number in mine:
            self.states.orbit[number - first] = order[key]
            partners = np.array([found[key][k] for k in range(count)])
            own.append((number - first, blade, partners))
        return own

    def _states_of_blades(self) -> list[tuple[tuple[object, ...], int, int]]:
        """What is the same for all blades, the blade, and the number of this rank's states."""
        found = []
        for owner, element, keys, states in self.states.places():
            at = [self.rotor.of_node(key) for key in keys]
            blades = {blade for blade, _ in at}
            if len(blades) == 1 and -1 not in blades:
                places = tuple(
                    (kind, place) for (kind, _), (_, place) in zip(keys, at, strict=True)
                )
                found.append((owner, places, element, blades.pop(), states))
        # elements of one law on the same nodes are told apart by their order
        counts: dict[tuple[object, ...], int] = {}
        out: list[tuple[tuple[object, ...], int, int]] = []
        for owner, places, _, blade, states in sorted(found, key=lambda one: one[2]):
            again = counts[owner, places, blade] = counts.get((owner, places, blade), -1) + 1
            out += [((owner, places, again, n), blade, int(at)) for n, at in enumerate(states)]
        return out
