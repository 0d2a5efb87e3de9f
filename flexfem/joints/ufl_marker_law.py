# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws of a `Force` that are written in UFL."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import ufl

from flexfem import _checks
from flexfem._faults import ReturnError
from flexfem._types import FloatArray
from flexfem.core.laws import Ends
from flexfem.kernels.users.ufl_function import UFLFunction

__all__ = ["UFLMarkerLaw"]


class UFLMarkerLaw:
    """Functions of arrays, as `Force` calls them, made of a law in UFL; one compilation for all.

    Attributes:
        function: the law of UFL arguments: time, `Ends` with tuples of m vectors and tensors, the
            vector of the states, and that of the parameters if it takes them.
    """

    def __init__(
        self, function: Callable[..., Any], size: int, states: int, parameters: int | None
    ) -> None:
        """Take a law of ``size`` markers; ``parameters``: their number, None without them."""
        self.function = function
        self._size, self._states, self._parameters = size, states, parameters

    def law(self, t: float, ends: Ends, z: FloatArray, parameters: FloatArray | None = None) -> Any:
        """Forces (m, 3), moments (m, 3) and rates of the states, of the shape of ``z``."""
        found = self._compiled.evaluate(0, self._arguments(t, ends, z, parameters))
        wrenches = found[:, : 6 * self._size].reshape(-1, 2, 3)
        return wrenches[:, 0], wrenches[:, 1], found[:, 6 * self._size :].reshape(z.shape)

    def jacobian(
        self, t: float, ends: Ends, z: FloatArray, parameters: FloatArray | None = None
    ) -> FloatArray:
        """Derivatives of all of these, see ``Force.jacobian``."""
        m = self._size
        x = self._arguments(t, ends, z, parameters)
        count, rows = len(x), 6 * m + self._states
        by = self._compiled.evaluate(1, x).reshape(count, rows, sum(self._counts))
        place, axes, speed, spin, states, _ = np.split(by, np.cumsum(self._counts)[:-1], axis=2)
        R = ends.rotations.reshape(count, 1, m, 3, 3)
        # a rotation by a small vector changes the axis r by its cross product with r
        turned = np.cross(R, axes.reshape(count, rows, m, 3, 3), axis=3).sum(axis=4)
        parts = [x.reshape(count, rows, m, 3) for x in (place, turned, speed, spin)]
        return np.concatenate(
            [np.stack(parts, axis=3).reshape(count, rows, 12 * m), states], axis=2
        )

    @property
    def _counts(self) -> list[int]:
        """Numbers of coordinates, axes, velocities, angular velocities, states, and others."""
        m = self._size
        return [3 * m, 9 * m, 3 * m, 3 * m, self._states, 1 + (self._parameters or 0)]

    def _arguments(
        self, t: float, ends: Ends, z: FloatArray, parameters: FloatArray | None
    ) -> FloatArray:
        """(e, n) arguments of the compiled function."""
        motion = (ends.positions, ends.rotations, ends.velocities, ends.angular_velocities)
        count = len(ends.positions) // self._size
        out = np.empty((count, sum(self._counts)))
        parts = np.split(out, np.cumsum(self._counts)[:-1], axis=1)
        for part, given in zip(parts, (*motion, z), strict=False):
            part[:] = given.reshape(part.shape)
        parts[-1][:, 0] = t
        if parameters is not None:
            parts[-1][:, 1:] = parameters
        return out

    @cached_property
    def _compiled(self) -> UFLFunction:
        """The compiled function.

        Raises:
            ReturnError: the law does not return UFL expressions of the right shapes.
            Exception: whatever it raises.
        """
        made = UFLFunction(sum(self._counts))
        ends_at = np.cumsum(self._counts).tolist()
        entries = [made.x[i] for i in range(ends_at[-1])]
        places, axes, speeds, spins, states, others = (
            entries[last - count : last] for count, last in zip(self._counts, ends_at, strict=True)
        )
        vectors = [
            tuple(ufl.variable(ufl.as_vector(x[k : k + 3])) for k in range(0, len(x), 3))
            for x in (places, speeds, spins)
        ]
        tensors = tuple(
            ufl.variable(ufl.as_matrix([axes[k + i : k + i + 3] for i in (0, 3, 6)]))
            for k in range(0, len(axes), 9)
        )
        ends = Ends(vectors[0], tensors, vectors[1], vectors[2], np.arange(self._size))  # type: ignore[arg-type]
        given = [others[0], ends, ufl.as_vector(states) if states else ()]
        if self._parameters is not None:
            given.append(ufl.as_vector(others[1:]))
        values = self._values(self.function(*given))
        made.compile(values, made.slopes(values))
        return made

    def _values(self, found: Any) -> list[Any]:
        """All values (6 m + n) that the law has returned: wrench after wrench, then rates."""
        parts = found if isinstance(found, tuple) and len(found) <= 3 else (found,)
        parts = (*parts, *(3 - len(parts)) * (None,))
        shape = self._size, 3
        forces = _scalars("forces", parts[0], shape)
        moments = len(forces) * [0.0] if parts[1] is None else _scalars("moments", parts[1], shape)
        rates = _scalars("rates of states", parts[2], (self._states,)) if self._states else []
        pairs = range(0, len(forces), 3)
        return [x for k in pairs for x in (*forces[k : k + 3], *moments[k : k + 3])] + rates


def _scalars(what: str, value: Any, shape: tuple[int, ...]) -> list[Any]:
    """Entries of a list, a list of vectors, or a UFL expression.

    Raises:
        ReturnError: it is something else, or of another shape.
    """
    try:
        whole = ufl.as_tensor(_listed(value))
    except Exception as error:  # UFL raises many kinds
        raise ReturnError(
            f"law must return UFL expressions of the shape {shape} for {what}, got "
            f"{_checks.show(str(value))}"
        ) from error
    if whole.ufl_shape != shape:
        raise ReturnError(f"law must return {what} of the shape {shape}, got {whole.ufl_shape}")
    return [whole[index] for index in np.ndindex(*shape)]


def _listed(value: Any) -> Any:
    """The same with lists in place of tuples and arrays."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_listed(one) for one in value]
    return value
