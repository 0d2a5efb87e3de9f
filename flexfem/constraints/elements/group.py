# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force elements with one law on a rank: their forces, states, and derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, ReturnError, noted
from flexfem._types import FloatArray, IntArray
from flexfem.constraints.elements.differences import exact_derivatives, law_derivatives
from flexfem.constraints.elements.kernels import correct_states, finite
from flexfem.constraints.elements.states import AT_REST, StateStep
from flexfem.core.laws import ElementLaw, ElementMotion

__all__ = ["ElementGroup", "Slopes"]

#: Most iterations for the states; relative tolerances of these, and of one that is round-off.
_ITERATIONS, _SMALL, _ROUND_OFF = 30, 1e-12, 1e-8
#: Contraction of an iteration above which its derivatives are computed again.
_SLOW = 0.1
#: Evaluations within a step after which derivatives of forces are computed again.
_MANY = 8
#: Rates of states at rest, over their sizes, that count as drift (1/s).
_DRIFT = 1e-6


class _StuckError(ReturnError):
    """The states of a step do not converge; those of a shorter one may."""


@dataclass(frozen=True)
class Slopes:
    """Derivatives of the forces of e elements with r rows, whose states follow.

    Attributes:
        by_place: (e, r, 6 m) by displacements of the markers at fixed twists.
        by_twist: (e, r, 6 m) by their twists.
    """

    by_place: FloatArray
    by_twist: FloatArray


class ElementGroup:
    """The elements of one law that this rank evaluates.

    Attributes:
        law: their law.
        elements: (e,) their numbers in it.
        rows, markers: (e, r) and (e, m) their rows, and the markers that the law depends on.
        z0, g0, w0: (e, n) states, their rates and rate-like variables at the accepted state.
        held: (e, r) forces at the accepted state, which explicit laws keep through a step.
        z, g: (e, n) states and their rates at the last evaluation.
        forces: (e, r) of the rows at the last evaluation, N or N m.
        kept: (e, 1 + k) the derivatives of the law that steps use, after the number of their steps;
            zero if they are to be computed at the next evaluation.
        exact: True if states are found to round-off, and derivatives to about ten digits where they
            are computed; the iteration of a motion needs less.
    """

    def __init__(
        self, law: ElementLaw, elements: IntArray, rows: IntArray, markers: IntArray
    ) -> None:
        """Take the states at the start."""
        self.law, self.elements, self.rows, self.markers = law, elements, rows, markers
        self.z0 = law.initial(elements)
        self.g0, self.w0 = np.zeros((2, *self.z0.shape))
        self.z, self.g = self.z0.copy(), self.g0.copy()
        self.forces, self.held = np.zeros((2, *rows.shape))
        (e, r), n, self._columns = rows.shape, law.states, 6 * law.size
        self._nothing = Slopes(*np.zeros((2, e, r, self._columns)))
        self.kept = np.zeros((e, 1 + (r + n) * (2 * self._columns + n)))
        self._slopes, self._count = self._nothing, 0
        self._inverse: FloatArray | None = None
        self.exact = False
        self._suited: float | None = None

    def begin(self, step: StateStep = AT_REST) -> None:
        """A step begins, or begins again: its states are looked for with the accepted rates."""
        self._count, self._inverse = 0, None
        self.z[:] = step.begin(self.z0, self.w0, self.g0) + step.gain * self.g0

    def evaluate(self, motion: ElementMotion, step: StateStep | None, *, slopes: bool) -> Slopes:
        """Compute forces and states; derivatives are those of an evaluation before, or zero.

        A law that fails leaves NaN and is noted. States that do not converge leave NaN, too, which
        makes the step fail.

        Args:
            motion: of the elements.
            step: step of the states; None for steady ones.
            slopes: True if derivatives are wanted.
        """
        if self.law.explicit and step is not None and step is not AT_REST:
            self.forces[:] = self.held
            return self._nothing
        try:
            self._settle(motion, step)
            if not (slopes and finite(self.forces.reshape(-1))):
                return self._nothing
            self._count += 1
            if step is None or self._count % _MANY == 0 or not self.kept[:, 0].all():
                self._differentiate(motion, step)
                self._count = max(self._count, 1)
                self._slopes = self._condensed(step)
            elif self._count == 1:
                self._slopes = self._condensed(step)
            return self._slopes
        except _StuckError:
            self.forces[:] = np.nan
            return self._nothing
        except FAILURES as error:
            noted(self.law.owner, self.law.function, error)
            self.forces[:] = np.nan
            return self._nothing

    def accept(self, motion: ElementMotion, step: StateStep | None) -> None:
        """Accept a state with this motion at the end of a step."""
        if self.law.states or self.law.explicit:  # others carry nothing on: no call of the law
            try:
                self._settle(motion, step)
            except FAILURES as error:
                noted(self.law.owner, self.law.function, error)
                return
        if step is None or step is AT_REST:
            self.w0 = self.g.copy()
        else:
            self.w0 = step.auxiliary(self.z, self.z0, self.w0)
            self._age()
        self.z0, self.g0 = self.z.copy(), self.g.copy()
        self.held[:] = self.forces
        self.begin()

    def arrived(self, motion: ElementMotion, step: StateStep) -> tuple[FloatArray, ...]:
        """What a step carries on if it ends with this motion, or a motion that begins with it.

        States, their rates and rate-like variables (e, n), and forces (e, r) of explicit laws.
        """
        self._settle(motion, step)
        w = self.g if step is AT_REST else step.auxiliary(self.z, self.z0, self.w0)
        return self.z, self.g, w, self.forces

    def exactly(self, motion: ElementMotion, step: StateStep) -> FloatArray:
        """(e, r + n, 12 m + n) exact derivatives of the law at the end of a step."""
        if self.law.explicit:  # whose steps need none
            self._settle(motion, step)
            self._differentiate(motion, step)
        return self.derivatives

    def _age(self) -> None:
        """Derivatives serve as many steps as they have columns: differences cost a call a step."""
        age = self.kept[:, 0]
        age += age > 0.0
        age[age > 2 * self._columns + self.law.states] = 0.0

    def start(self, motion: ElementMotion) -> None:
        """Take the rates of the present states: a motion begins here, or goes on after a jump."""
        self.accept(motion, AT_REST)

    def linearized(self, motion: ElementMotion) -> FloatArray:
        """(e, r + n, 12 m + n) derivatives of forces and rates at steady states of a motion.

        See ``differences.law_derivatives``; the steady states are accepted.
        """
        self.accept(motion, None)
        return law_derivatives(self.law, self.elements, motion, self.z0, self._sizes(1.0))

    def _settle(self, motion: ElementMotion, step: StateStep | None) -> None:
        """States at the end of a step, or steady ones, and forces with them.

        NaN where the motion is not finite, which no law needs to understand.

        Raises:
            ReturnError: states do not converge, or drift, or the law does not return numbers.
            Exception: whatever the law raises.
        """
        if step is AT_REST:
            self.z[:] = self.z0
        if not (finite(motion.poses.reshape(-1)) and finite(motion.twists.reshape(-1))):
            self.forces[:] = np.nan
            return
        self._call(motion)
        if step is AT_REST or not self.z.size:
            return
        begin = None if step is None else step.begin(self.z0, self.w0, self.g0)
        before, fresh, small = np.inf, False, 0.0 if self.exact else _SMALL
        sizes = np.abs(self.z) + np.abs((1.0 if step is None else step.gain) * self.g)
        sizes[sizes == 0.0] = 1.0
        change = np.empty_like(sizes)
        for iteration in range(_ITERATIONS):
            if begin is None or step is None:
                missed = self.g
            else:
                missed = begin + step.gain * self.g - self.z
            if self._inverse is None:
                self._inverse = self._inverted(motion, step, fresh=fresh)
            size = correct_states(missed, self._inverse, sizes, change)
            slow = iteration > 0 and not size < _SLOW * before
            if size <= small or (slow and size <= _ROUND_OFF):
                if step is None:
                    self._check_steady()
                return
            if iteration > 0 and not slow and step is not None and size * size <= small * before:
                self._finish(change)
                return
            if slow:
                self._inverse, fresh = None, True
            before = size
            self.z += change
            self._call(motion)
        raise _StuckError(f"has states that do not converge at t = {motion.time:.6g} s")

    def _finish(self, change: FloatArray) -> None:
        """Change the states by what is left, the forces and rates by the kept derivatives.

        The contraction of the last change says that the next one would be below the tolerance; the
        error of the derivatives is of the size of this contraction.
        """
        r = self.rows.shape[1]
        by_state = self.derivatives[:, :, 2 * self._columns :] @ change[:, :, np.newaxis]
        self.z += change
        self.forces += by_state[:, :r, 0]
        self.g += by_state[:, r:, 0]

    def _call(self, motion: ElementMotion) -> None:
        """Forces and rates by the present states."""
        self.forces[:], self.g[:] = self.law.forces(self.elements, motion, self.z)
        for what, values in (("forces", self.forces), ("rates of states", self.g)):
            if not finite(values.reshape(-1)):
                found = _checks.show(values[~np.isfinite(values)].tolist())
                raise ReturnError(f"returned {what} with {found} at t = {motion.time:.6g} s")

    def _check_steady(self) -> None:
        """Raise for states that drift where all else is at rest."""
        drift = np.abs(self.g) > _DRIFT * np.maximum(1.0, np.abs(self.z))
        if drift.any():
            rates = _checks.show(self.g[drift.any(axis=1)][0].tolist())
            raise ReturnError(f"has no steady states at rest, their rates are {rates}")

    def _sizes(self, gain: float) -> FloatArray:
        """(n,) magnitudes of the states; one where they are unknown."""
        every = np.abs([self.z, self.z0, gain * self.g]).max(axis=(0, 1), initial=0.0)
        return np.where(every > 0.0, every, 1.0)

    def _inverted(
        self, motion: ElementMotion, step: StateStep | None, *, fresh: bool
    ) -> FloatArray:
        """(e, n, n) inverse of the equations of the states; ``fresh``: not with those kept."""
        r, gain = self.rows.shape[1], 1.0 if step is None else step.gain
        if self.kept[:, 0].all() and not fresh:
            return _inverse(self.derivatives[:, r:, 2 * self._columns :], step)
        values, sizes = np.concatenate([self.forces, self.g], axis=1), self._sizes(gain)
        found = law_derivatives(
            self.law, self.elements, motion, self.z, sizes, values, 2 * self._columns
        )
        return _inverse(found[:, r:], step)

    @property
    def derivatives(self) -> FloatArray:
        """(e, r + n, 12 m + n) derivatives of the law that are kept."""
        (e, r), n = self.rows.shape, self.law.states
        return self.kept[:, 1:].reshape(e, r + n, 2 * self._columns + n)

    def _differentiate(self, motion: ElementMotion, step: StateStep | None) -> None:
        """Compute the derivatives of the law that are kept."""
        gain = 1.0 if step is None else step.gain
        given = self.law, self.elements, motion, self.z, self._sizes(gain)
        if self.exact:
            every, self._suited = exact_derivatives(*given, self._suited)
        else:
            every = law_derivatives(*given, np.concatenate([self.forces, self.g], axis=1))
        self.kept[:, 0], self.kept[:, 1:] = 1.0, every.reshape(len(every), -1)

    def _condensed(self, step: StateStep | None) -> Slopes:
        """Derivatives of the forces with states that satisfy their equations."""
        r, every, count = self.rows.shape[1], self.derivatives, self._columns
        total = every[:, :r, : 2 * count]
        if self.z.size:
            gain = 1.0 if step is None else step.gain
            self._inverse = _inverse(every[:, r:, 2 * count :], step)
            follow = gain * (self._inverse @ every[:, r:, : 2 * count])
            total = total + every[:, :r, 2 * count :] @ follow
        parts = total[:, :, :count], total[:, :, count:]
        return Slopes(*map(np.ascontiguousarray, parts))


def _inverse(by_state: FloatArray, step: StateStep | None) -> FloatArray:
    """(e, n, n) inverse of the equations of the states, of least norm for steady ones.

    Args:
        by_state: (e, n, n) derivatives of their rates.
        step: step of the states; None for steady ones.
    """
    if step is None:
        return np.linalg.pinv(-by_state)
    return np.linalg.inv(np.eye(by_state.shape[-1]) - step.gain * by_state)
