# SPDX-License-Identifier: LGPL-3.0-or-later
"""The steady state of a rotor that rotates on a support, about which it is linearised."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.modes import RotorOptions
from flexfem.core.status import Status
from flexfem.lie import se3, so3
from flexfem.model.model import Model
from flexfem.simulation.equilibria.operating_point import OperatingPoint
from flexfem.solvers.modal.multiblade import MultibladeLinearization, Rotor, RotorRotation
from flexfem.solvers.modal.steady_rotation import Rotation

__all__ = ["RotorPoint"]

#: An azimuth at which forces are compared with those at the first, rad.
_AZIMUTH = 0.7
#: Rounding of forces, relative to the largest stiffness and the farthest place.
_ROUNDED = 100.0


class RotorPoint(OperatingPoint):
    """A model with a rotor, in the steady rotation of this about which it is linearised.

    Attributes:
        variation: change of forces with the azimuth, relative to the largest.
    """

    options: RotorOptions
    linearization: MultibladeLinearization

    def __init__(
        self, model: Model, options: RotorOptions, comm: MPI.Intracomm | None = None
    ) -> None:
        """Build the system, and find the rotor in it (collective).

        Raises:
            InputError: a mistake in the model, or blades that are not alike.
        """
        self._rotor: Rotor | None = None
        self.variation = 0.0
        super().__init__(model, options, comm)

    @property
    def rotor(self) -> Rotor:
        """The rotor, found when it is first asked for (collective)."""
        if self._rotor is None:
            axis = np.array(self.options.axis_vector)
            self._rotor = Rotor(
                self.system, self.options.rotor_names, self.options.blade_names,
                axis / np.linalg.norm(axis), np.array(self.options.centre_vector),
            )  # fmt: skip
        return self._rotor

    def rotation(self, spin: float) -> RotorRotation:
        """See :meth:`OperatingPoint.rotation`."""
        return RotorRotation(spin, self.rotor.axis, self.rotor.centre, self.rotor, [0.0])

    def _linearization(self) -> MultibladeLinearization:
        return MultibladeLinearization(self.system, self.rotor)

    def settle(self, spin: float) -> Status:
        """See :meth:`OperatingPoint.settle`."""
        self.linearization.spin = spin
        status = super().settle(spin)
        if status is Status.OK:
            self._check_azimuths(self.rotation(spin))
        return status

    def _check(self, rotation: Rotation) -> None:
        """Forces are compared in the steady state."""

    @property
    def torque(self) -> float:
        """Torque that keeps the speed, N m."""
        return self._settled.torque[0] if isinstance(self._settled, RotorRotation) else 0.0

    def turn(self, angle: float) -> None:
        """Rotate the rotor about its present axis (collective)."""
        axis, centre = self.rotor.present(self.system)
        R = so3.exp(angle * axis)
        moved = se3.frame(centre - R @ centre, R)
        for part, nodes in zip(self.system.parts, self.rotor.nodes, strict=True):
            frames = part.block.frames
            frames[nodes.turning] = se3.compose(moved, frames[nodes.turning])

    def rotate(self) -> Status:
        """Settle at another azimuth of the rotor (collective)."""
        self.turn(_AZIMUTH)
        return self.settle(self.linearization.spin)

    def _check_azimuths(self, rotation: RotorRotation) -> None:
        """Raise if forces depend on the azimuth (collective).

        Raises:
            InputError: names the body with the largest change.
        """
        lin, system = self.linearization, self.system
        kept, multipliers = [p.block.frames.copy() for p in system.parts], lin.multipliers.copy()
        found = []
        for angle in (0.0, _AZIMUTH):
            self.turn(angle)
            rotation.set(system)
            found.append(self._forces(lin.evaluate(np.zeros_like(multipliers)), angle))
            for part, frames in zip(system.parts, kept, strict=True):
                part.block.frames[:] = frames
        rotation.set(system)
        lin.evaluate(multipliers)
        change, size, name = self._largest(*found)
        if change > self.options.variation * size and change <= self._rounding():
            change = 0.0
        self.variation = change / size if size > 0.0 else 0.0
        if self.variation > self.options.variation:
            raise InputError(
                f"{self.serial.model!r}: forces on '{name}' change with the azimuth of the rotor "
                f"by {self.variation:.2g} of the largest; steady states are without gravity "
                "across the axis and in a flow along it that is the same all around (variation "
                f"{self.options.variation:g} is accepted)"
            )

    def _rounding(self) -> float:
        """Forces that are rounding of places, of a rotor at rest without loads all of them, N."""
        stiffest = self.linearization.matrices().stiffness.getDiagonal()
        places = [np.abs(part.block.frames[:, :3]).max(initial=0.0) for part in self.system.parts]
        reach = self.system.comm.allreduce(max(places), op=MPI.MAX)
        size = stiffest.norm(PETSc.NormType.NORM_INFINITY)
        return float(_ROUNDED * np.finfo(float).eps * size * reach)

    def _forces(self, residual: FloatArray, angle: float) -> list[FloatArray]:
        """Forces of each part's nodes in axes in which those of a steady rotor are the same."""
        axis, _ = self.rotor.present(self.system)
        forces = []
        for part, nodes, found in zip(
            self.system.parts, self.rotor.nodes, self.linearization.split(residual), strict=True
        ):
            own, width = found.copy(), part.block.width
            on_hub = np.flatnonzero((nodes.turning & (nodes.blade < 0))[: part.block.owned])
            R = se3.rotation(part.block.frames[on_hub])
            back = so3.exp(-angle * (R.transpose(0, 2, 1) @ axis)).transpose(0, 2, 1)
            for half in (slice(0, 3), slice(3, 6))[: width // 3]:
                own[on_hub, half] = (back @ own[on_hub, half, np.newaxis])[:, :, 0]
            forces.append(own)
        return forces

    def _largest(
        self, before: list[FloatArray], after: list[FloatArray]
    ) -> tuple[float, float, str]:
        """Largest change of a force, largest force (N), and the body of the change."""
        mine, size = (0.0, ""), 0.0
        for part, a, b in zip(self.system.parts, before, after, strict=True):
            if not len(a):
                continue
            changes = np.abs(b - a)[:, :3].max(axis=1)
            node = int(np.argmax(changes))
            name = part.family.bodies[int(part.node_body[node])].name
            mine = max(mine, (float(changes[node]), name))
            size = max(size, float(np.abs(a[:, :3]).max()))
        comm = self.system.comm
        change, name = max(comm.allgather(mine))
        return change, comm.allreduce(size, op=MPI.MAX), name
