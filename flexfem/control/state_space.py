# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear law with states: compensators, observers with state feedback, filters."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray

__all__ = ["StateSpace"]

#: Methods of discretisation of a continuous law, by their names in ``scipy.signal.cont2discrete``.
METHODS = ("zoh", "foh", "bilinear", "euler", "backward_diff")


@dataclass(eq=False, init=False)
class StateSpace:
    """Discrete linear law about an operating point.

    ``u_k = u0 + C x_k + D (y_k - y0)``, ``x_{k+1} = A x_k + B (y_k - y0)``. A law without states is
    a matrix D alone: ``A``, ``B`` and ``C`` then have no rows or columns.

    Attributes:
        A, B, C, D: (n, n), (n, m), (p, n), (p, m).
        y0, u0: (m,) and (p,) measurements and outputs at the operating point.
        initial: (n,) x at the start.
        state: (n,) x.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    y0: FloatArray
    u0: FloatArray
    initial: FloatArray
    state: FloatArray = field(init=False, repr=False)

    def __init__(
        self,
        A: npt.ArrayLike,
        B: npt.ArrayLike,
        C: npt.ArrayLike,
        D: npt.ArrayLike,
        *,
        y0: npt.ArrayLike | None = None,
        u0: npt.ArrayLike | None = None,
        initial: npt.ArrayLike | None = None,
    ) -> None:
        """Check the matrices; ``y0``, ``u0`` and the initial state are zero by default.

        Raises:
            TypeError: an argument does not consist of numbers.
            ValueError: the shapes do not fit, or a number is not finite.
        """
        self.D = _checks.array("StateSpace", "D", D, (-1, -1))
        p, m = self.D.shape
        states = len(np.asarray(A))
        empty = states == 0
        for what, given, shape in (("A", A, (states, states)), ("B", B, (states, m)),
                                   ("C", C, (p, states))):  # fmt: skip
            value = np.zeros(shape) if empty else _checks.array("StateSpace", what, given, shape)
            setattr(self, what, value)
        self.y0 = _checks.array("StateSpace", "y0", np.zeros(m) if y0 is None else y0, (m,))
        self.u0 = _checks.array("StateSpace", "u0", np.zeros(p) if u0 is None else u0, (p,))
        x = np.zeros(states) if initial is None else initial
        self.initial = (
            np.zeros(0) if empty else _checks.array("StateSpace", "initial", x, (states,))
        )
        self.state = self.initial.copy()

    def discretised(self, sample_time: float, method: str = "bilinear") -> "StateSpace":
        """The discrete law of ``u = u0 + C x + D (y - y0)``, ``x' = A x + B (y - y0)``.

        Args:
            sample_time: that of the controller, s.
            method: "bilinear" (Tustin), "zoh", "foh", "euler" or "backward_diff", see
                ``scipy.signal.cont2discrete``. The initial state is kept as it is.

        Raises:
            TypeError: the sample time is not a number.
            ValueError: it is not positive, or another method.
        """
        from scipy.signal import cont2discrete

        h = _checks.number("StateSpace", "sample_time", sample_time, positive=True)
        if method not in METHODS:
            raise ValueError(
                f"StateSpace: method must be one of {', '.join(METHODS)}, got "
                f"{_checks.show(method)}"
            )
        parts = (self.A, self.B, self.C, self.D)
        if len(self.state):
            parts = cont2discrete(parts, h, method=method)[:4]
        return StateSpace(*parts, y0=self.y0, u0=self.u0, initial=self.state)

    def update(self, t: float, y: FloatArray) -> FloatArray:
        """Take the measurements, shape (m,), at a sample; returns the outputs (p,).

        Raises:
            ValueError: the number of measurements is another one.
        """
        if y.shape != self.y0.shape:
            raise ValueError(f"StateSpace: takes {len(self.y0)} measurements, got {len(y)}")
        change = y - self.y0
        outputs: FloatArray = self.u0 + self.C @ self.state + self.D @ change
        self.state = self.A @ self.state + self.B @ change
        return outputs
