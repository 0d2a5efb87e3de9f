# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of a mechanism by one formalism, or by several side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.status import Status
from flexfem.research.equations.vector_alpha import VectorAlpha
from flexfem.research.equations.vector_equations import Motion, Picture, Stepper, VectorEquations
from flexfem.research.formalisms.equations import MechanismEquations
from flexfem.research.formalisms.motion import FormalismMotion
from flexfem.research.formalisms.schemes.hamilton_midpoint import HamiltonMidpoint
from flexfem.research.formalisms.schemes.maggi_alpha import MaggiAlpha

__all__ = ["SchemedMotion", "SideBySide"]

#: Scheme in time of each formalism.
_SCHEMES: dict[str, Callable[[], Stepper]] = {
    "lagrange": VectorAlpha, "gibbs_appell": VectorAlpha, "maggi": MaggiAlpha,
    "hamilton": HamiltonMidpoint,
}  # fmt: skip


class SchemedMotion(FormalismMotion):
    """Equations of a mechanism with the scheme in time of their formalism."""

    def __init__(self, model: MechanismEquations, formalism: str) -> None:
        """Bring the declared state to the constraints."""
        super().__init__(model, formalism)
        self.stepper = _SCHEMES[formalism]()


class SideBySide(VectorEquations):
    """The same mechanism by several formalisms, advanced with the same steps.

    Columns are those of each formalism with its name before them; pictures are of the first.

    Attributes:
        motions: of the formalisms.
    """

    def __init__(self, model: MechanismEquations, formalisms: Sequence[str]) -> None:
        """Bring the declared state to the constraints."""
        self.motions = [SchemedMotion(model, name) for name in formalisms]
        sizes = [motion.summary() for motion in self.motions]
        self.size = sum(size["unknowns"] for size in sizes)
        self.multipliers = sum(size["multipliers"] for size in sizes)
        self.columns = [f"{m.formalism}_{name}" for m in self.motions for name in m.columns]
        self._together = _Together(self.motions)
        self.stepper = cast(Stepper, self._together)

    def start(self) -> tuple[FloatArray, FloatArray]:
        """See :class:`VectorEquations`."""
        return self.motions[0].start()

    def observe(self, motion: Motion) -> Sequence[float]:
        """See :class:`VectorEquations`."""
        pairs = zip(self.motions, self._together.steppers, strict=True)
        return [value for own, stepper in pairs for value in own.observe(stepper.motion)]

    def pictures(self, motion: Motion) -> Mapping[str, Picture]:
        """See :class:`VectorEquations`."""
        return self.motions[0].pictures(motion)

    def summary(self) -> Mapping[str, Any]:
        """See :class:`VectorEquations`."""
        names = [motion.formalism for motion in self.motions]
        seconds = self._together.seconds.tolist()
        return {"wall_seconds_of_formalisms": dict(zip(names, seconds, strict=True))}

    def identity(self) -> Mapping[str, str]:
        """See :class:`VectorEquations`."""
        return {**super().identity(), "mechanism": self.motions[0].model.mechanism.name}


class _Together:
    """Schemes of several formalisms as one.

    Attributes:
        steppers: one for each formalism.
        seconds: wall time of the accepted steps of each.
    """

    def __init__(self, motions: Sequence[SchemedMotion]) -> None:
        self._motions = motions
        self.steppers: list[Stepper] = [motion.stepper for motion in motions]  # type: ignore[misc]
        self.seconds = np.zeros(len(motions))

    @property
    def motion(self) -> Motion:
        """Accepted state of the first."""
        return self.steppers[0].motion

    @property
    def counters(self) -> dict[str, int]:
        """Sums over all."""
        names = self.steppers[0].counters
        return {name: sum(s.counters[name] for s in self.steppers) for name in names}

    def begin(self, equations: VectorEquations, options: Any) -> Status:
        """See :class:`Stepper`."""
        self._options = options
        for motion, stepper in zip(self._motions, self.steppers, strict=True):
            status = stepper.begin(motion, options)
            if status is not Status.OK:
                return status
        return Status.OK

    def step(self, h: float) -> Status:
        """See :class:`Stepper`; all advance, or none does."""
        before = [(s, s.state()) for s in self.steppers]
        for k, (stepper, _) in enumerate(before):
            begin = time.perf_counter()
            status = stepper.step(h)
            self.seconds[k] += time.perf_counter() - begin
            if status is not Status.OK:
                for (done, state), motion in zip(before[:k], self._motions, strict=False):
                    done.restore(motion, self._options, state)
                return status
            stepper.motion.t = self.steppers[0].motion.t
        return Status.OK

    def state(self) -> Mapping[str, FloatArray]:
        """See :class:`Stepper`."""
        pairs = zip(self._motions, self.steppers, strict=True)
        return {f"{m.formalism}_{k}": v for m, s in pairs for k, v in s.state().items()}

    def restore(
        self, equations: VectorEquations, options: Any, state: Mapping[str, FloatArray]
    ) -> None:
        """See :class:`Stepper`."""
        self._options = options
        for motion, stepper in zip(self._motions, self.steppers, strict=True):
            start = f"{motion.formalism}_"
            own = {k.removeprefix(start): v for k, v in state.items() if k.startswith(start)}
            stepper.restore(motion, options, own)
