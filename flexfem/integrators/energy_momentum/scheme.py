# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy-momentum method with controllable dissipation for constrained flexible systems.

A step goes from state 0 to state 1 by the increments of its nodes: ``dx`` in inertial axes and the
Cayley vector ``phi``, ``R_1 = R_0 cay(phi)``. With rates r (inertial velocities of centres and
angular velocities in body axes), mean forces f over the step and ``D`` for differences,

``dx, phi = h [(r_0 + r_1)/2 + chi/2 (Dr - Dr_last)]`` and ``momentum_1 - momentum_0 = h f``,

the work of f on the increments is the change of the kinetic energy plus ``chi/2 Dr M (Dr -
Dr_last)``: for translations trivially, for rotations since the spin momenta ``R J Omega`` have the
same components along phi in both frames (Simo, Wong 1991). Internal forces, springs, gravity and
constraints act through discrete derivatives that reproduce the change of strains, lengths and
constraint functions exactly (Gonzalez 1996; Betsch, Steinmann 2002); stresses are those of the
strain ``(e_0 + e_1)/2 + chi/2 (De - De_last)``. As ``2 a (a - b) = a^2 - b^2 + (a - b)^2``,

``E + chi/4 (Dr M Dr + De K De)`` loses ``chi/4`` times the same forms of the second differences in
every step, whatever its size: with ``chi = 0`` the energy E is constant, and otherwise E stays
below a bound that never increases. The discrete derivatives vanish for rigid motions about the mean
positions, and so linear momentum is kept, and with ``chi = 0`` angular momentum too.

Families provide the mean forces (``layout.elements.StepForces``): beams by their linear strains,
solids by Green's strains, whose energy need not be quadratic. Loads inside elements are means of
both ends of the step.

Second order for every chi: the dissipation acts on second differences. A linear vibration of
infinite frequency is multiplied by ``-rho_inf`` in a step, where ``chi = rho (1 - rho)/(1 +
rho)^2``; 1/3 is the least radius (chi = 1/8).

Multipliers are means over the step, and so are the accelerations that are reported. Loads that vary
in time are those of the midpoint of the step; follower loads and moments are averages of both ends.
"""

from functools import partial
from typing import ClassVar

from flexfem._checks import InputError
from flexfem.core.nodes.prediction import Prediction
from flexfem.core.state import State
from flexfem.core.status import Status
from flexfem.integrators.energy_momentum.mechanics import StepMechanics
from flexfem.integrators.integrator import Integrator, discard, predictions
from flexfem.solvers.newton.policy import Policy
from flexfem.system.system import Shifts, System

__all__ = ["EnergyMomentum"]

#: Least spectral radius at infinite frequency that the scheme reaches, with chi = 1/8.
_LEAST = 1.0 / 3.0


class EnergyMomentum(Integrator):
    """A step of the method.

    Attributes:
        rho_inf: spectral radius at infinite frequency, 1/3 to 1 (no dissipation).
    """

    order: ClassVar[int] = 2

    def __init__(self, rho_inf: float = 1.0) -> None:
        """Store the coefficient.

        Raises:
            InputError: the spectral radius lies outside [1/3, 1].
        """
        if not _LEAST - 1e-12 <= rho_inf <= 1.0:
            raise InputError(
                f"EnergyMomentum: rho_inf must lie in [1/3, 1], got {rho_inf:.6g} (1 dissipates "
                "nothing)"
            )
        self.rho_inf = rho_inf
        self._mechanics: StepMechanics | None = None

    @property
    def chi(self) -> float:
        """Weight of the second differences of stresses and velocities."""
        return self.rho_inf * (1.0 - self.rho_inf) / (1.0 + self.rho_inf) ** 2

    def prepare(self, system: System) -> None:
        """See :meth:`Integrator.prepare`.

        Raises:
            InputError: a part of the model has no such equations.
        """
        self._mechanics = StepMechanics(system, self.chi)
        system.constraints.mean_forces = True

    @property
    def mechanics(self) -> StepMechanics:
        """See :attr:`Integrator.mechanics`."""
        assert self._mechanics is not None  # prepared
        return self._mechanics

    def state(self, system: System) -> State:
        """See :meth:`Integrator.state`."""
        return self.mechanics.state(system)

    def restore(self, system: System, state: State) -> None:
        """See :meth:`Integrator.restore`."""
        self.mechanics.restore(system, state)

    def renewed(self, system: System) -> None:
        """See :meth:`Integrator.renewed`."""
        self.mechanics.rows.renewed()

    def shifts(self, h: float) -> Shifts:
        """Factors of the iteration matrix at step size ``h`` (s)."""
        reach = 0.5 * h * (1.0 + self.chi)
        return Shifts(1.0 / reach, 1.0 / reach**2, reach**2)

    def solve(self, system: System, policy: Policy, h: float) -> Status:
        """See :meth:`Integrator.solve`."""
        mechanics, begin = self.mechanics, system.time
        system.set_time(begin + 0.5 * h)
        factors = system.factors.copy()
        system.set_time(begin + h)
        mechanics.begin(system, h, factors)
        status = Status.DIVERGED
        for restart in predictions(system, partial(_predict, system, mechanics)):
            status = policy.solve(self.shifts(h), restart)
            if status is Status.OK:
                return status
        discard(system, begin)
        return status

    def error(self, system: System, policy: Policy, h: float) -> float:
        """See :meth:`Integrator.error`.

        From the change of the mean accelerations since the last step.
        """
        return self.mechanics.error(system)

    def accept(self, system: System, h: float) -> None:
        """See :meth:`Integrator.accept`."""
        rows = system.constraints
        rows.forces[:] = rows.multipliers / self.mechanics.weight
        self.mechanics.accept(system)


def _predict(system: System, mechanics: StepMechanics, prediction: Prediction) -> None:
    """Predict the trial state at the beginning of the iteration."""
    rows = system.constraints
    mechanics.predict(system, prediction)
    rows.multipliers[:] = mechanics.weight * rows.forces
