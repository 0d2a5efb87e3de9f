# SPDX-License-Identifier: LGPL-3.0-or-later
"""The steps that a motion took: which states they lead to, how large they are, and what is between.

A gradient goes over the same steps, whose sizes count as given: those of parts of a step between
kinks of loads, of steps that were halved after a failure, and of adaptive ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from flexfem._checks import InputError
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.integrators.integrator import Integrator
from flexfem.simulation.motion.journal import Journal

__all__ = ["Grid", "Lead", "Step"]


@dataclass(frozen=True)
class Step:
    """A step from one state to the next.

    Attributes:
        scheme: its coefficients.
        h: its size, s.
    """

    scheme: GeneralizedAlpha
    h: float


@dataclass(frozen=True)
class Lead:
    """A change of the acceleration-like variable a of a state, after the step to it.

    It becomes ``w + part (w - w_before)`` with the accelerations w there and at an earlier state.

    Attributes:
        part: factor.
        before: number of the earlier state.
    """

    part: float
    before: int


@dataclass
class Grid(Journal):
    """All steps of a motion.

    Attributes:
        add: called for each new state.
        change: called where the last state changes.
        main: coefficients of whole steps.
        steps: the step to each state but the first.
        leads: changes of states by their numbers.
    """

    add: Callable[[], None]
    change: Callable[[], None]
    main: GeneralizedAlpha
    steps: list[Step] = field(default_factory=list)
    leads: dict[int, Lead] = field(default_factory=dict)

    def stepped(self, scheme: Integrator, h: float) -> None:
        """See :class:`Journal`."""
        assert isinstance(scheme, GeneralizedAlpha)
        self.steps.append(Step(scheme, h))
        self.add()

    def renewed(self) -> None:
        """See :class:`Journal`.

        Raises:
            InputError: always, as accelerations that are computed again have no adjoint yet.
        """
        raise InputError(
            "gradient: a load jumps, or has a kink just behind the end of a step, where "
            "accelerations are computed again, which has no derivatives yet; take a smooth one"
        )

    def began_parts(self) -> None:
        """See :class:`Journal`."""
        self._lead(0.0)

    def ended_parts(self, ratio: float) -> None:
        """See :class:`Journal`."""
        self._lead((self.main.alpha_m - self.main.alpha_f) * ratio)

    def _lead(self, part: float) -> None:
        last = len(self.steps)
        self.leads[last] = Lead(part, max(last - 1, 0))
        self.change()
