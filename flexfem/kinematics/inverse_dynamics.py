# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inverse dynamics: the forces of actuators that drive a mechanism along a prescribed motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray
from flexfem.core.joint import Joint
from flexfem.core.laws import applied
from flexfem.core.pose import Pose
from flexfem.core.row import Row
from flexfem.joints.actuator import Actuator
from flexfem.joints.cable import Cable
from flexfem.kinematics.differences import stencil
from flexfem.kinematics.distribution import Distribution, DriveState, LeastEffort
from flexfem.kinematics.mechanism import RigidMechanism, marker_key, place_loads
from flexfem.kinematics.rigid_parts import RigidParts
from flexfem.layout.numbered_model import NumberedModel
from flexfem.loads.amplitude import Spline
from flexfem.model.model import Model

__all__ = ["InverseDynamics", "inverse_dynamics"]

#: Singular values below this part of the largest count as zero; gap that counts as reached.
_SINGULAR, _REACHED = 1e-9, 1e-10
#: Drives are differentiated over this part of the whole time, but no longer than between samples.
_SPAN, _INSTANT = 2e-3, 1e-3


@dataclass(frozen=True)
class InverseDynamics:
    """Histories of the actuators along a prescribed motion.

    Attributes:
        times: (n,) s.
        names: of the k actuators.
        forces: (n, k) N m or N.
        coordinates, rates, accelerations: (n, k) of the coordinates of actuators: angles (rad),
            displacements or distances (m), counted as the actuator does.
    """

    times: FloatArray
    names: tuple[str, ...]
    forces: FloatArray
    coordinates: FloatArray
    rates: FloatArray
    accelerations: FloatArray

    @property
    def powers(self) -> FloatArray:
        """(n, k) powers of the actuators, W."""
        return self.forces * self.rates

    def amplitude(self, name: str, degree: int = 5) -> Spline:
        """The force of an actuator as a smooth function of time, to be fed forward.

        Raises:
            ValueError: there is no such actuator.
        """
        if name not in self.names:
            raise ValueError(
                f'InverseDynamics: there is no actuator "{name}", they are {", ".join(self.names)}'
            )
        return Spline(self.times, self.forces[:, self.names.index(name)], degree)


def inverse_dynamics(
    model: Model,
    outputs: Sequence[Joint],
    actuators: Sequence[Actuator],
    times: npt.ArrayLike,
    distribution: Distribution | None = None,
    *,
    difference: float | None = None,
) -> InverseDynamics:
    """Forces of actuators that make a mechanism follow a prescribed motion.

    All bodies move rigidly, flexible ones in their shape at the start. Joints, gravity, loads at
    markers, springs and dampers of the model count. The motion follows from the outputs alone,
    positions, velocities and accelerations one after the other; of the equations of motion
    ``r + G^T lambda = B tau`` only those along the motions that the joints leave are needed,
    ``Theta^T (r - B tau) = 0`` with ``G Theta = 0`` (Nikravesh 1988, section 11.5).

    Args:
        model: the mechanism, its joints satisfied at the start.
        outputs: driven joints that are not in the model: the motion is theirs. They have as many
            constraints as the mechanism has degrees of freedom.
        actuators: in the model or not; their own forces do not count.
        times: strictly increasing times, s; the first position is found from that of the start.
        distribution: objective where there are more actuators than degrees of freedom:
            ``LeastEffort()`` when None, ``LeastPower()``, ``LeastJointForces(markers)``.
        difference: span between the times from which drives are differentiated to eighth order, s;
            None for 1/500 of the whole time, no more than between samples.

    Returns:
        Forces and motion of the actuators at the times.

    Raises:
        InputError: a mistake in the model; outputs too few, too many or dependent; a motion out of
            reach, a singular position, actuators that cannot drive it, with the time; a joint
            without a place; friction that depends on joint forces (a ValueError).
        TypeError: an argument has the wrong type.
    """
    owner = "inverse_dynamics"
    _checks.instance(owner, "model", model, Model)
    for joint in outputs:
        _checks.instance(owner, "outputs", joint, Joint)
    for actuator in actuators:
        _checks.instance(owner, "actuators", actuator, Actuator)
    if difference is not None:
        _checks.number(owner, "difference", difference, positive=True)
    try:
        at = _checks.array(owner, "times", times, (-1,))
        if len(at) == 0 or (np.diff(at) <= 0.0).any():
            raise ValueError(f"{owner}: times must increase, got {_checks.show(times)}")
        task = _Task(model, outputs, actuators, distribution or LeastEffort(), at, difference)
        rows = [task.solve(float(t)) for t in at]
    except ValueError as error:
        raise InputError(str(error)) from error
    stacked = [np.array(column) for column in zip(*rows, strict=True)]
    return InverseDynamics(at, tuple(a.name for a in actuators), *stacked)


@dataclass(frozen=True, eq=False)
class _Coordinate(Joint):
    """Joint coordinate that an actuator acts on, without its force.

    Attributes:
        actuator: the actuator.
    """

    actuator: Actuator

    @property
    def owner(self) -> str:
        """See :attr:`Joint.owner`."""
        return self.actuator.owner

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return (Row((self.actuator.coordinate(poses),), 0.0, applied(0.0)),)


class _Task:
    """A mechanism on its way."""

    def __init__(
        self, model: Model, outputs: Sequence[Joint], actuators: Sequence[Actuator],
        distribution: Distribution, times: FloatArray, difference: float | None,
    ) -> None:  # fmt: skip
        model.validate()
        serial = NumberedModel(model)
        if heavy := [j for j in model.joints if isinstance(j, Cable) and j.mass_per_length]:
            raise ValueError(
                f"{heavy[0].owner}: mass_per_length is not supported in inverse dynamics"
            )
        own = [joint for joint in serial.body_joints if not any(joint is a for a in actuators)]
        for joint in outputs:
            if not joint.driven or any(joint is other for other in own):
                raise ValueError(f"{joint.owner}: an output is a driven joint outside the model")
        if not actuators:
            raise ValueError("inverse_dynamics: actuators must hold at least one, got none")
        parts = RigidParts(serial)
        acting = [_Coordinate(a.name, a.a, a.b, a) for a in actuators]
        self.mechanism = RigidMechanism(serial, parts, [*own, *outputs, *acting])
        if len(self.mechanism.rows.coupled):
            rubbing = self.mechanism.rows.joint_of_row[self.mechanism.rows.coupled[0, 0]]
            raise ValueError(
                f"{self.mechanism.joints[rubbing].owner}: friction that depends on joint forces "
                "is not supported in inverse dynamics"
            )
        self.names = tuple(actuator.name for actuator in actuators)
        self.outputs = outputs
        self.loads = place_loads(parts, model.loads)
        self.distribution = distribution
        self._span = float(times[0]), float(times[-1])
        whole = self._span[1] - self._span[0]
        spacing = whole / max(len(times) - 1, 1)
        self._step = difference or (min(_SPAN * whole, spacing) or _INSTANT)
        mask = self.mechanism.rows_of
        rigid = self.mechanism.rows.rigid
        self.driven, self.acting = mask(outputs) & rigid, mask(acting)
        self.passive = rigid & ~self.driven & ~self.acting
        self.constrained = self.passive | self.driven
        self._check_freedoms()
        self._sides = self._marker_sides()
        self._moving_rows: BoolArray = np.array(
            [j.driven for j in self.mechanism.joints], dtype=np.bool_
        )[self.mechanism.rows.joint_of_row] & self.constrained  # fmt: skip

    def _check_freedoms(self) -> None:
        """Raise unless there are as many outputs as degrees of freedom at the start."""
        mechanism = self.mechanism
        gap = np.abs(mechanism.rows.values * self.passive)
        if not gap.max(initial=0.0) <= 1e-6:
            worst = mechanism.joints[int(mechanism.rows.joint_of_row[int(np.argmax(gap))])]
            raise ValueError(
                f"{worst.owner}: the markers violate the joint at the start by {gap.max():.6g} "
                "(m or rad); place the bodies so that it holds, or let flexfem.assemble move them"
            )
        freedoms = mechanism.size - _rank(mechanism.jacobian()[self.passive])
        prescribed = int(self.driven.sum())
        if prescribed != freedoms:
            raise ValueError(
                f"inverse_dynamics: outputs must prescribe {freedoms} coordinates, the "
                f"degrees of freedom of the mechanism, got {prescribed}"
            )
        if len(self.names) < freedoms:
            raise ValueError(
                f"inverse_dynamics: {freedoms} degrees of freedom need as many actuators, got "
                f"{len(self.names)}: {', '.join(self.names)}"
            )
        self.freedoms = freedoms

    def _marker_sides(self) -> list[BoolArray]:
        """(t, 2) sides of the terms of passive joints at each marker of the distribution."""
        rows, found = self.mechanism.rows, []
        keys = [marker_key(m) for placed in rows.joints for m in placed.joint.markers]
        passive = self.passive[rows.row_of_term][:, np.newaxis]
        for marker in self.distribution.markers:
            own = np.array([key == marker_key(marker) for key in keys], dtype=np.bool_)
            sides = own[rows.term_marker] & passive
            if not sides.any():
                raise ValueError(
                    f'LeastJointForces: no joint acts at Marker on "{marker.body}" ({marker})'
                )
            found.append(sides)
        return found

    def solve(self, t: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Forces, coordinates, rates and accelerations (k,) of the actuators at time t."""
        mechanism, rows = self.mechanism, self.mechanism.rows
        gap = mechanism.close(t, self.constrained)
        S = mechanism.jacobian()[self.constrained]
        left, sizes, right = np.linalg.svd(S, full_matrices=False)
        rank = int((sizes > _SINGULAR * sizes.max(initial=0.0)).sum())
        names = ", ".join(joint.owner for joint in self.outputs)
        if not gap <= _REACHED:
            raise ValueError(
                f"{names}: the motion is out of reach at t = {t:.6g} s, a gap of {gap:.6g} "
                "remains; prescribe a motion that the mechanism can follow, without jumps"
            )
        if rank < mechanism.size:
            raise ValueError(
                f"{names}: these outputs leave {mechanism.size - rank} degrees of freedom of the "
                f"mechanism free at t = {t:.6g} s (a singular configuration, or dependent outputs)"
            )
        inverse = (right[:rank].T / sizes[:rank]) @ left[:, :rank].T
        rows.accept()
        velocities, accelerations = self._rates(t, inverse)
        forces = self._forces(t, inverse, velocities, accelerations)
        actuators = mechanism.jacobian()[self.acting]
        turning = rows.second_rates()[self.acting]
        second = actuators @ accelerations + turning
        return forces, rows.sums()[self.acting], actuators @ velocities, second

    def _rates(self, t: float, inverse: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocities and accelerations (6 n,) of the parts; they are set, the rows evaluated."""
        mechanism, rows = self.mechanism, self.mechanism.rows
        mechanism.velocities[:] = 0.0
        times, weights = stencil(t, *self._span, self._step)
        directions, turn = rows.directions.copy(), False
        values = np.zeros((len(times), rows.size))
        for value, time in zip(values, times, strict=True):
            value[:] = self._values(time)
            turn = turn or not np.array_equal(directions, rows.directions)
        by_time, second = weights[1:] @ values
        velocities = -inverse @ by_time[self.constrained]
        mechanism.velocities[:] = velocities.reshape(-1, 6)
        if turn:
            rates = np.array([self._values(time, rates=True) for time in times])
            second = second + 2.0 * (weights[1] @ rates)
        mechanism.at(t)
        return velocities, -inverse @ (rows.second_rates() + second)[self.constrained]

    def _values(self, t: float, *, rates: bool = False) -> FloatArray:
        """Values (r,) of the driven rows at time t, or their rates with constant drives."""
        self.mechanism.at(t)
        rows = self.mechanism.rows
        return np.where(self._moving_rows, rows.rates() if rates else rows.values, 0.0)

    def _forces(
        self, t: float, inverse: FloatArray, velocities: FloatArray, accelerations: FloatArray
    ) -> FloatArray:
        """Forces (k,) of the actuators."""
        mechanism = self.mechanism
        needed = mechanism.inertial_forces(accelerations.reshape(-1, 6))
        needed += mechanism.law_forces(self.acting) - mechanism.load_forces(self.loads, t)
        jacobian = mechanism.jacobian()
        B = jacobian[self.acting]
        motions = inverse[:, self.driven[self.constrained]]  # the motions per output
        A, right = (B @ motions).T, motions.T @ needed.ravel()
        left, sizes, across = np.linalg.svd(A)
        if not sizes.min(initial=np.inf) > _SINGULAR * sizes.max(initial=0.0):
            raise ValueError(
                f"inverse_dynamics: the actuators {', '.join(self.names)} cannot drive all "
                f"{self.freedoms} degrees of freedom at t = {t:.6g} s (they are dependent there, "
                "or the configuration is singular)"
            )
        tau: FloatArray = across[: len(sizes)].T @ ((left.T @ right) / sizes)
        free = across[len(sizes) :].T
        if free.shape[1]:
            state = self._state(inverse, velocities, accelerations, needed.ravel(), B)
            W, w = self.distribution.norm(state)
            tau = tau + free @ np.linalg.lstsq(W @ free, -(W @ tau + w), rcond=_SINGULAR)[0]
        return tau

    def _state(
        self, inverse: FloatArray, velocities: FloatArray, accelerations: FloatArray,
        needed: FloatArray, B: FloatArray,
    ) -> DriveState:  # fmt: skip
        """Return the data that the distribution may look at."""
        rows = self.mechanism.rows
        count = len(self.names)
        # multipliers: G^T lambda = B^T tau - needed, those of the outputs left out
        carried = inverse.T @ np.column_stack([-needed, B.T])
        multipliers = np.zeros((rows.size, count + 1))
        multipliers[self.constrained] = carried
        multipliers[self.driven] = 0.0
        forces = [np.zeros((0, count + 1))]
        for sides in self._sides:
            gradient = rows.force_jacobian[:, :, :3] * sides[:, :, np.newaxis]
            forces.append(
                -np.einsum("tsi,tk->ik", gradient, multipliers[rows.row_of_term], optimize=True)
            )
        every = np.concatenate(forces)
        return DriveState(
            self.names, B @ velocities,
            B @ accelerations + rows.second_rates()[self.acting], every[:, 0], every[:, 1:],
        )  # fmt: skip


def _rank(matrix: FloatArray) -> int:
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return int((sizes > _SINGULAR * sizes.max(initial=0.0)).sum())
