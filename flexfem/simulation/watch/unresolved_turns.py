# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps in which flexible bodies rotate so far that unresolved vibrations grow.

See ``GeneralizedAlpha.turn_limit``. They grow until steps fail, and the shorter steps that replace
these keep vibrations without physical excitation.
"""

from math import exp, floor, log10

import numpy as np

from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.inspection.finding import owner_of
from flexfem.integrators.generalized_alpha import TURN_LIMIT
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.system import BlockPart, System

__all__ = ["UnresolvedTurns"]

#: Number of steps between two evaluations of rotations.
_EVERY = 8
#: Vibrations grow by ``exp(_RATE (turn - limit))`` a step at least: 1.1 to 1.6 in linear analyses
#: of a rotating stiff direction, with rotations up to twice the limit and rho_inf from 0.5 to 0.95.
_RATE = 1.3
#: Growth from which failed steps are attributed to it. Round-off becomes visible by e^20,
#: excitation by starts and drives by less.
_GROWN = exp(3.0)


class UnresolvedTurns:
    """Monitor of the rotations of flexible bodies in whole steps, until one fails."""

    def __init__(
        self, system: System, serial: NumberedModel, options: RunOptions, limit: float
    ) -> None:
        """Begin with zero growth.

        Args:
            system: the system, at its start.
            serial: serial data of its model.
            options: those of the run.
            limit: that of the integrator, rad.
        """
        self._system, self._serial, self._options, self._limit = system, serial, options, limit
        self._parts = [] if options.adaptive else [p for p in system.parts if _stiff(p)]
        self._grown = [np.zeros(part.block.owned) for part in self._parts]
        self._last = [np.zeros(part.block.owned) for part in self._parts]
        # without the rotations of the vibrations themselves at the end
        self._turns = [np.zeros(part.block.owned) for part in self._parts]
        self._count, self._failed_at, self._rejected = 0, system.time, 0

    def step(self, rejected: int) -> None:
        """Evaluate the end of a whole step; ``rejected``: number of rejected steps so far."""
        if self._rejected or rejected:
            self._rejected = rejected
            return
        self._count, self._failed_at = self._count + 1, self._system.time
        if self._count % _EVERY:
            return
        every = zip(self._parts, self._grown, self._turns, self._last, strict=True)
        for part, grown, turns, last in every:
            now = self._options.dt * np.linalg.norm(_spins(part), axis=1)
            np.minimum(now, last, out=turns)
            last[:] = now
            grown[:] = np.maximum(grown + _EVERY * _RATE * (turns - self._limit), 0.0)

    def texts(self) -> list[str]:
        """Return the warnings of the run, the same on every rank (collective)."""
        own = (0.0, 0.0, 0, 0)
        for part, grown, turns in zip(self._parts, self._grown, self._turns, strict=True):
            if len(grown):
                node = int(np.argmax(grown))
                body = int(part.node_body[node])
                own = max(own, (float(grown[node]), float(turns[node]), part.kind, body))
        every = self._system.comm.allgather(own)
        grown, turn, kind, body = max(
            every, key=lambda one: (float(f"{one[0]:.6g}"), -one[2], -one[3])
        )
        if not self._rejected or exp(min(grown, 100.0)) < _GROWN:
            return []
        options = self._options
        radius = floor(20.0 * (1.0 - turn / TURN_LIMIT)) / 20.0
        smaller = options.dt * 0.9 * min(self._limit / turn, 1.0)
        advice = [f"steps of {_down(smaller):.1g} s or less"] if smaller > 0.0 else []
        advice += [f"a rho_inf of {radius:.2g}"] if radius >= 0.0 else []
        return [
            f"{owner_of(self._serial.body(kind, body))}: it rotates by {turn:.3g} rad in a step of "
            f"{options.dt:.3g} s, and steps fail after t = {self._failed_at:.4g} s "
            f"({self._rejected} of them): beyond {self._limit:.3g} rad, with rho_inf "
            f"{options.rho_inf:g}, vibrations grow that the steps do not resolve; results are "
            f"doubtful, use {' or '.join(advice)}"
        ]


def _stiff(part: BlockPart) -> bool:
    """Return True if a part has elements whose nodes rotate, with inertial translations."""
    return part.elements is not None and part.block.inertial and part.block.width == 6


def _spins(part: BlockPart) -> FloatArray:
    """Angular velocities (n, 3) of owned nodes, zero where rotations are fixed."""
    spins: FloatArray = part.block.velocity[: part.block.owned, 3:]
    if part.block.dirichlet is not None:
        spins = spins * ~part.block.dirichlet[: part.block.owned, 3:]
    return spins


def _down(size: float) -> float:
    """A number rounded down to one digit."""
    unit = 10.0 ** floor(log10(size))
    return floor(size / unit) * unit
