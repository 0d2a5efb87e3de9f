# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step of generalized-alpha with impulses of unilateral forces.

Forces F that are evaluated at the end of a step are the derivative of nothing over it, and make
energy in impacts. They are therefore taken out of the scheme, as an impulse over the step:

``M W + h G^T L = h J^T F``, ``G W = 0``, ``v_1 = v_s + W``, ``q_1 = q_s + (h/2) W``,

with F the discrete derivative of the energy that they store, and L the constraints' share. The
smooth part s is the step of the scheme without them, all residuals being those at q_1. With n the
whole increment its accelerations are ``a(n) - W/(2 beta h)``, so that the equations of the step are
the usual ones with ``b J^T F``, ``b = (1 - alpha_m)/(1 - alpha_f)/(2 beta)``, and multipliers ``l_s
+ b L``. W is found once the iteration has converged. For ``rho_inf = 1`` the work of F is the
change of the kinetic energy, exactly.

Discrete derivatives: Gonzalez, J. Nonlinear Sci. 6 (1996) 449-467; Laursen, Chawla, Int. J. Numer.
Methods Eng. 40 (1997) 863-886. Splitting of impulses from a smooth scheme: Chen, Acary, Virlez,
Brüls, Int. J. Numer. Methods Eng. 96 (2013) 487-511.
"""

from collections.abc import Callable, Sequence

from mpi4py import MPI

import numpy as np

from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.prediction import Prediction
from flexfem.core.status import Status
from flexfem.integrators.split.impulse import Impulse
from flexfem.integrators.split.unilateral import (
    Unilateral,
    UnilateralContacts,
    UnilateralRows,
)
from flexfem.system.mechanics import EndPoint
from flexfem.system.system import Shifts, System

__all__ = ["Split"]


class Split(EndPoint):
    """Equilibrium at the end of a step with unilateral forces over it.

    Attributes:
        acting: True if there were forces in the last step that was solved.
    """

    @classmethod
    def of(cls, system: System) -> "Split | None":
        """The unilateral forces of a system; None if it has none on any rank."""
        forces: list[Unilateral] = [
            UnilateralContacts(contacts)
            for contacts in system.contacts
            if isinstance(contacts, BarrierContacts)
        ]
        if system.constraints.has_unilateral:
            forces.append(UnilateralRows(system))
        return cls(system, forces) if forces else None

    def __init__(self, system: System, forces: Sequence[Unilateral]) -> None:
        """Store the forces of the system, which act by impulses from now on."""
        self._system, self._forces, self._impulse = system, forces, Impulse(system)
        self._weight, self.acting = 1.0, False
        self._means = np.zeros(system.constraints.size)
        self._jumps = [np.zeros_like(part.block.step) for part in system.parts]
        system.constraints.split = True
        self._apart = system.constraints.apart

    def begin(self, h: float, weight: float) -> bool:
        """Start a step of size ``h`` (s) from the accepted state; False if masses are singular.

        Collective. In the equations the forces are multiplied by ``weight``.
        """
        self._weight = weight
        self._system.interface.update()
        if not self.separate():
            return False
        for forces in self._forces:
            forces.begin(h, weight)
        return True

    def separate(self) -> bool:
        """Take unilateral forces out of the accepted accelerations, where a start has put them.

        Collective; the trial state is the accepted one. False if masses are singular.
        """
        system, rows = self._system, self._system.constraints
        if not self._any([forces.pressing for forces in self._forces]):
            return True
        system.interface.update()
        rows.evaluate(_UNSCALED)
        impulses = np.zeros(rows.size)
        self._clear()
        for forces in self._forces:
            forces.add_pressing()
            forces.read_pressing(impulses)
        found = self._impulse.solve()
        if found is None:
            return False
        impulses += found * rows.rigid
        for part in system.parts:
            part.block.owned_step[:] *= -1.0
            part.block.slow()
        rows.impulses += impulses
        rows.forces -= impulses
        return True

    def evaluate_rows(self, system: System, shifts: Shifts) -> None:
        """See :class:`EndPoint`."""
        super().evaluate_rows(system, shifts)
        for forces in self._forces:
            forces.evaluate(shifts)

    def predict(self, shifts: Shifts) -> None:
        """Multipliers of a predicted trial state: those of the last step."""
        rows = self._system.constraints
        rows.multipliers[:] = shifts.scale * (rows.forces + self._weight * rows.impulses)

    def finish(self, shifts: Shifts, h: float, kick: Callable[[FrameBlock], None]) -> Status:
        """Find the impulses of a step of size ``h`` (s) that has been solved (collective).

        ``kick`` changes the velocities of a block by its steps.
        """
        system, rows = self._system, self._system.constraints
        self._means[:] = 0.0
        self.acting = self._any([forces.acting for forces in self._forces])
        if not self.acting:
            return Status.OK
        multipliers = rows.multipliers.copy()
        system.interface.update()
        self.evaluate_rows(system, shifts)
        self._clear()
        for forces in self._forces:
            forces.add_means(shifts)
            forces.read_means(shifts, self._means)
        found = self._impulse.solve()
        rows.multipliers[:] = multipliers
        if found is None:
            return Status.SINGULAR
        self._means += found * rows.rigid
        for part, jumps in zip(system.parts, self._jumps, strict=True):
            part.block.owned_step[:] *= -h
            kick(part.block)
            np.divide(part.block.step, h, out=jumps)
        return Status.OK

    def accept(self, shifts: Shifts) -> None:
        """Set the accepted forces of all rows, before the trial state is accepted."""
        rows = self._system.constraints
        np.divide(rows.multipliers, shifts.scale, out=rows.forces)
        rows.forces -= self._weight * self._means
        rows.forces[self._apart] = 0.0
        rows.impulses[:] = self._means

    def accepted(self) -> None:
        """Complete the accepted state of a step with impulses.

        Reported accelerations include those of unilateral forces. Those from which the next step
        goes on do not, and may be huge where these hold a stiff body: a prediction with them turns
        nodes by whole turns.
        """
        system = self._system
        for forces in self._forces:
            forces.end()
        if not self.acting:
            return
        for part, jumps in zip(system.parts, self._jumps, strict=True):
            part.block.acceleration += jumps
        if system.prediction is Prediction.ACCELERATION:
            system.prediction = Prediction.VELOCITY

    def _clear(self) -> None:
        for part in self._system.parts:
            part.block.residual[:] = 0.0

    def _any(self, flags: list[bool]) -> bool:
        """True if one of the flags is set on any rank (collective)."""
        comm = self._system.comm
        return comm.allreduce(any(flags), op=MPI.LOR) if comm.size > 1 else any(flags)


#: Factors with which rows are evaluated at a state, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])
