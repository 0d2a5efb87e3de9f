# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the reported forces of rows, see ``integrators.accepted_forces``.

At an accepted state with positions q, local velocities v, accelerations w and multipliers
``lambda_0`` these are ``lambda = lambda_0 + d`` with

``M x + G^T e = 0``, ``G_r (v + x) + b = 0``;  ``v' = v + x``,
``M y + G^T d + C(v) x = 0``, ``G_r (w + y) + gamma(q, v') + c = 0``, ``L(q, v', lambda) = 0``,

where ``G_r`` are the gradients of the rows that are constraint equations, L are the force laws of
the others, b and c rates of drives; x and the gyroscopic terms ``C(v) x`` are those of rigid bodies
alone. Forces that depend on no motion, as those of actuators, are those of the step. Redundant
constraints have ``- r e`` and ``- r d`` with their compliance r in the equations, as have all
solutions. Masses M are those of the start in the nodes' own axes, and do not change with q. The
derivative of ``f . lambda`` takes two solves with the same matrix, whatever the number of forces:

``M z + G_r^T s_r = 0``, ``G_r z = f_r``, ``s_l = (G_l z - f_l) / compliance``,
``M u + G_r^T k = X``, ``G_r u = 0``,

where X is the influence of x on the second equations with the factors z and s. What is left are
the derivatives of all equations, each times its factor, by q, v and w.

Multipliers that are means over steps leave ``R = M w + f(q, v) + G^T lambda_0``, which the second
equations have besides: ``lambda`` does not depend on ``lambda_0`` then, and on w by the change of
masses alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray
from flexfem.constraints.batch import Constraints
from flexfem.core.laws import LawKind
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.gradients.equations.node_maps import transposed
from flexfem.gradients.equations.odd_forces import AT_STATE
from flexfem.gradients.equations.step_tangent import (
    ACCELERATIONS,
    POSITIONS,
    VELOCITIES,
    BlockVectors,
    StepTangent,
    forces_at_interface,
    forces_on_blocks,
    put_steps,
)
from flexfem.gradients.forces.paths import second_rates_transposed
from flexfem.integrators.accepted_forces import AcceptedForces
from flexfem.integrators.drive_rates import DriveRates
from flexfem.system.mechanics import END_POINT
from flexfem.system.system import GYROSCOPIC, MASS, System

__all__ = ["ForceDerivatives", "StateSums", "hold_applied"]

#: Factors with which rows are evaluated at a state, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])


def hold_applied(rows: Constraints) -> None:
    """Give rows whose forces depend on no motion, as those of actuators, the forces of the step.

    Outputs of controllers act on them, which depend on earlier states. Means over steps are others.
    """
    if rows.mean_forces:
        return
    applied = (rows.elastic[:, 0] == LawKind.SPRING) & ~rows.elastic[:, 1:3].any(axis=1)
    rows.elastic[applied, 3] = rows.forces[applied]


@dataclass(frozen=True)
class StateSums:
    """Derivatives by an accepted state.

    Attributes:
        motion: for each block, (n_owned, w) by local twists, local velocities and their rates.
        forces: (r,) by the multipliers.
    """

    motion: tuple[BlockVectors, BlockVectors, BlockVectors]
    forces: FloatArray


@dataclass(frozen=True)
class _Taken:
    """Solutions at an accepted state, see the module.

    Attributes:
        rigid: (r,) constraint equations; gradients: (t, 2, 6) of these.
        e, d: (r,).
        x: (n, w) of each block; projected, y: (n, 6) v' and ``w + y`` of the interface nodes.
        drives: derivatives of drives by time.
    """

    rigid: BoolArray
    gradients: FloatArray
    e: FloatArray
    d: FloatArray
    x: BlockVectors
    projected: FloatArray
    y: FloatArray
    drives: DriveRates


class ForceDerivatives:
    """Derivatives of the reported forces of all rows of a system."""

    def __init__(
        self, system: System, accepted: AcceptedForces | None, *, controlled: bool
    ) -> None:
        """Store the computation of the forces (collective).

        Args:
            system: the system.
            accepted: the computation, None where multipliers are reported.
            controlled: True if there are controllers, on which forces of actuators depend.

        Raises:
            InputError: forces have no derivatives.
        """
        self._system, self._accepted = system, accepted
        self._turning = any(part.elements is None for part in system.parts)
        rows, found = system.constraints, {}
        if accepted is not None:
            found = {
                "impulses of contacts, stops or slack springs": rows.split,
                "friction": bool(len(rows.coupled) or rows.frictional.any()),
                "force elements": rows.has_elements,
            }
            if rows.mean_forces:
                found |= {
                    f"{name} with the integrator energy_momentum": present
                    for name, present in (
                        ("contacts", bool(system.contacts)), ("controllers", controlled),
                        ("redundant constraints", rows.relaxation != 0.0),
                    )
                }  # fmt: skip
        for name, present in found.items():
            if system.comm.allreduce(present, op=MPI.LOR):
                raise InputError(
                    f"gradient: there are no derivatives of forces of joints with {name} yet; take "
                    "other columns"
                )

    def back(self, factors: FloatArray) -> StateSums:
        """Derivatives of a sum of forces, at whose accepted state the system is (collective).

        Args:
            factors: (r,) of the forces, the same on all ranks that have a row.
        """
        rows = self._system.constraints
        rigid = self._system.comm.allreduce(bool(rows.rigid.any()), op=MPI.LOR)
        if self._accepted is None or rows.consistent or not (rigid or rows.mean_forces):
            nothing = [np.zeros_like(part.block.owned_step) for part in self._system.parts]
            return StateSums((nothing, nothing, nothing), factors)
        velocities = self._system.interface.velocities.copy()
        found = self._back(self._accepted, factors)
        self._system.interface.velocities[:] = velocities
        return found

    def _back(self, accepted: AcceptedForces, factors: FloatArray) -> StateSums:
        """The same where forces are computed from accelerations."""
        system, rows, one = self._system, self._system.constraints, self._take(accepted)
        z, s = self._solve(accepted, one.gradients, None, factors * one.rigid)
        put_steps(system, z)
        steps = system.interface.steps.copy()
        # forces that depend on no motion are those of the step
        laws = ~one.rigid & (rows.compliance > 0.0) & rows.slopes.any(axis=1)
        moves = rows.changes(steps)
        s = s * one.rigid
        s[laws] = (moves[laws] - factors[laws]) / rows.compliance[laws]
        q = -self._turned(one.d, steps)
        q -= forces_at_interface(system, rows.local_jacobian(), s * laws)
        v = -forces_at_interface(system, rows.force_jacobian, s * laws * rows.slopes[:, 1])
        w = -forces_at_interface(system, one.gradients, s)
        along = second_rates_transposed(system, s * one.rigid, one.projected, one.y)
        driven = self._driven(one, s)
        q, v = q - along[0] - driven[0], v - along[1] - driven[1]
        slowed = [np.zeros_like(own) for own in z]
        if self._turning:
            turns, pushed = self._gyroscopic(z), forces_on_blocks(system, v)
            slowed = [-own for own in self._gyroscopic(z, one.x)]
            right = [
                a - b if part.elements is None else 0.0 * a
                for part, a, b in zip(system.parts, pushed, turns, strict=True)
            ]
            u, k = self._solve(accepted, one.gradients, right, np.zeros(rows.size))
            k = k * one.rigid
            put_steps(system, u)
            q -= self._turned(one.e, system.interface.steps.copy())
            q -= self._turned(k, one.projected)
            q -= self._driven(one, k, again=False)[0]
            v = v - forces_at_interface(system, one.gradients, k)
        by_v = [a + b for a, b in zip(forces_on_blocks(system, v), slowed, strict=True)]
        motion = forces_on_blocks(system, q), by_v, forces_on_blocks(system, w)
        if not rows.mean_forces:
            return StateSums(motion, np.where(laws, moves, factors))
        left = self._out_of_balance(z)
        by_q, by_v, by_w = (
            [a - b for a, b in zip(*pair, strict=True)] for pair in zip(motion, left, strict=True)
        )
        return StateSums((by_q, by_v, by_w), np.zeros(rows.size))

    def _out_of_balance(self, z: BlockVectors) -> tuple[BlockVectors, BlockVectors, BlockVectors]:
        """Factors z times derivatives of R by twists, velocities and their rates."""
        system, rows = self._system, self._system.constraints
        system.interface.update()
        rows.multipliers[:] = rows.forces
        tangent, nothing = StepTangent(system), np.zeros(rows.size)
        tangent.take(AT_STATE)
        by_q, by_v, by_w = (
            tangent.apply_transposed(z, nothing, matrix)[0]
            for matrix in (POSITIONS, VELOCITIES, ACCELERATIONS)
        )
        for part, *sums in zip(system.parts, by_q, by_v, by_w, strict=True):
            _keep_local_rates(part.block, *sums)
        return by_q, by_v, by_w

    def _take(self, accepted: AcceptedForces) -> _Taken:
        """Solve the equations; rows are left evaluated at v' with the reported forces."""
        system, rows, face = self._system, self._system.constraints, self._system.interface
        forces = system.reported_forces()
        face.update()
        rows.multipliers[:], drives = rows.forces, accepted.drives()
        rows.evaluate(_UNSCALED)
        rigid, gradients = rows.rigid, rows.gradients_of(rows.rigid)
        self._prepare(accepted, gradients)
        x, e = [np.zeros_like(p.block.owned_step) for p in system.parts], np.zeros(rows.size)
        right = accepted.out_of_balance()
        if self._turning:
            rates = -(rows.rates() + drives.first) * rigid
            moved, e = self._solve(accepted, gradients, None, rates)
            pairs = zip(system.parts, moved, strict=True)
            x = [own if part.elements is None else 0.0 * own for part, own in pairs]
            slowed = self._gyroscopic(x, forwards=True)
            right = [a - b for a, b in zip(right, slowed, strict=True)]
            put_steps(system, x)
            face.velocities += face.steps
        rows.multipliers[:] = forces
        rows.evaluate(_UNSCALED)
        put_steps(
            system,
            [p.block.acceleration[: p.block.owned, : p.block.width] for p in system.parts],
        )
        accelerations, d = face.steps.copy(), forces - rows.forces
        gaps = (
            drives.second
            + 2.0 * drives.of_rates(rows)
            + rows.second_rates()
            + rows.changes(accelerations)
        )
        values = np.where(rigid, -gaps, -rows.yielding(d))
        y, _ = self._solve(accepted, gradients, right, values)
        put_steps(system, y)
        y_face = accelerations + face.steps
        projected = face.velocities.copy()
        return _Taken(rigid, gradients, e * rigid, d, x, projected, y_face, drives)

    def _driven(
        self, one: _Taken, factors: FloatArray, *, again: bool = True
    ) -> tuple[FloatArray, FloatArray]:
        """Factors (r,) times derivatives of rates of drives whose directions change with time.

        These are those by time at fixed positions: b, or with ``again`` the part of second rates.

        Returns:
            (n, 6) by local twists of the interface nodes, and by their velocities.
        """
        system, rows, drives = self._system, self._system.constraints, one.drives
        found = np.zeros((2, *one.projected.shape))
        if not drives.turning.any():
            return found[0], found[1]
        own = (factors * drives.turning)[:, np.newaxis]
        for k, t in enumerate(drives.times.tolist()):
            first, second = (own * drives.weights)[:, k], (own * drives.weights_again)[:, k]
            rows.set_drives(t)
            rows.evaluate(_UNSCALED)
            found[0] += forces_at_interface(system, rows.force_jacobian, second if again else first)
            if again:
                found[0] += 2.0 * self._turned(first, one.projected)
                found[1] += 2.0 * forces_at_interface(system, rows.force_jacobian, first)
        rows.set_drives(drives.time)
        rows.evaluate(_UNSCALED)
        return found[0], found[1]

    def _prepare(self, accepted: AcceptedForces, gradients: FloatArray) -> None:
        """Factorise the system of the multipliers."""
        rows = self._system.constraints
        own = rows.step_jacobian.copy()
        rows.step_jacobian[:] = gradients
        regular, _ = accepted.masses.constrain(MASS, np.zeros(rows.size), False, False)
        rows.step_jacobian[:] = own
        if not regular:
            raise InputError(
                "gradient: there are no derivatives of forces of joints between bodies whose "
                "masses are singular yet; take other columns"
            )

    def _solve(
        self, accepted: AcceptedForces, gradients: FloatArray, blocks: BlockVectors | None,
        values: FloatArray,
    ) -> tuple[BlockVectors, FloatArray]:  # fmt: skip
        """Solve with masses and constraint equations: steps of each block, and multipliers (r,)."""
        system, rows = self._system, self._system.constraints
        for k, part in enumerate(system.parts):
            part.block.residual[:] = 0.0
            if blocks is not None:
                part.block.owned_residual[:] = blocks[k]
        own = rows.step_jacobian.copy()
        rows.step_jacobian[:] = gradients
        _, multipliers = accepted.masses.again(values)
        rows.step_jacobian[:] = own
        steps = [part.block.owned_step.copy() for part in system.parts]
        return steps, multipliers

    def _turned(self, factors: FloatArray, steps: FloatArray) -> FloatArray:
        """Derivatives (n, 6) of ``factors . G steps`` by the interface nodes with fixed steps."""
        rows = self._system.constraints
        hessians = np.ascontiguousarray(rows.hessians(factors).transpose(0, 2, 1))
        return rows.turning_forces(hessians, steps)

    def _gyroscopic(
        self, steps: BlockVectors, velocities: BlockVectors | None = None, *, forwards: bool = False
    ) -> BlockVectors:
        """``C^T`` times steps, or C times steps, of rigid bodies; zero for others.

        Velocities are those of the bodies if they are not given.
        """
        found = []
        for k, part in enumerate(self._system.parts):
            block, out = part.block, np.zeros_like(steps[k])
            found.append(out)
            if part.elements is not None:
                continue
            own = block.velocity.copy()
            if velocities is not None:
                block.velocity[: block.owned] = velocities[k]
            matrices = END_POINT.masses(self._system, part, GYROSCOPIC)
            block.velocity[:] = own
            at = part.masses.nodes
            if forwards:
                matrices = matrices.transpose(0, 2, 1)
            np.add.at(out, at, transposed(matrices, steps[k][at]))
        return found


def _keep_local_rates(block: FrameBlock, q: FloatArray, v: FloatArray, w: FloatArray) -> None:
    """Turn derivatives at fixed rates in inertial axes to those at fixed local ones, in place.

    With local velocities V, ``R^T dv = dV + theta x V`` and ``R^T dw = d(V' + omega x V) + theta x
    (V' + omega x V)``.

    Args:
        block: of the nodes, whose rates may be those in inertial axes.
        q: (n, w) derivatives by local twists; v, w: by rates, in the axes of the nodes.
        v: see above.
        w: see above.
    """
    if not block.inertial or block.width < 6:
        return
    own = np.s_[: block.owned]
    velocity, omega = block.velocity[own, :3], block.velocity[own, 3:]
    acceleration = block.acceleration[own, :3] + np.cross(omega, velocity)
    q[:, 3:] += np.cross(velocity, v[:, :3]) + np.cross(acceleration, w[:, :3])
    v[:, :3] += np.cross(w[:, :3], omega)
    v[:, 3:] += np.cross(velocity, w[:, :3])
