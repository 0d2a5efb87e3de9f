# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rest states of shells: strains without stress, which may change with time.

Elements measure strains since their start. With a rest state they measure them since the strain
that has no stress: initial strains less those at the start are added, mapped to the elements' own
measure of strain. Everything else, forces, tangents, energies, follows from these.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.common.given_values import present_values, values_at

__all__ = ["RestState", "RestStrains", "check_rest"]

_CURVATURE, _STRAIN = "rest_curvature", "prestrain"


@dataclass(frozen=True)
class RestState:
    """What a shell has no stress with: constants, functions, or None.

    Attributes:
        owner: name of the shell in messages.
        curvature: (3,), or a function of points.
        strain: initial strain (6,), or a function of points and the time.
        timed: True if the initial strain may change with time.
    """

    owner: str
    curvature: Any
    strain: Any
    timed: bool


def check_rest(state: RestState, points: FloatArray) -> None:
    """Call the functions of a shell's rest state at points (k, 3) of it.

    Raises:
        TypeError: a function does not return numbers.
        ValueError: it fails or returns something else.
    """
    if state.curvature is not None:
        values_at(state.owner, _CURVATURE, state.curvature, (points,), (3,))
    if state.strain is not None:
        values_at(state.owner, _STRAIN, state.strain, (points, 0.0), (6,))


class RestStrains:
    """Strains without stress of some triangles, in the measure of their elements.

    Attributes:
        strained: True if a shell of the model has any; timed: True if one changes with time. The
            same on all ranks.
    """

    def __init__(
        self,
        states: Sequence[RestState],
        body: IntArray,
        places: FloatArray,
        starts: FloatArray,
        maps: FloatArray,
    ) -> None:
        """Evaluate what is constant.

        Args:
            states: of all shells of the model.
            body: (m,) number of each triangle's shell.
            places: (m, q, 3) points of the triangles at which strains count.
            starts: (m, k) strains at the start in the elements' measure, those of membrane and
                bending first, six at each point.
            maps: (m, q, 6, 6) from strains along e1 and e2 to that measure.
        """
        given = [what for state in states for what in (state.curvature, state.strain)]
        self.strained = any(what is not None for what in given)
        self.timed = any(state.timed for state in states)
        self._starts, self._maps, self._places = starts.copy(), maps, places
        self._constant = starts.copy()
        self._changing: list[tuple[RestState, IntArray]] = []
        for number, state in enumerate(states):
            rows = np.flatnonzero(body == number)
            if state.curvature is not None:
                self._bend(state, rows)
            if state.timed:
                self._changing.append((state, rows))
            elif state.strain is not None:
                arguments = self._points(rows), 0.0
                strain = values_at(state.owner, _STRAIN, state.strain, arguments, (6,))
                self._add(self._constant, rows, strain)

    def _points(self, rows: IntArray) -> FloatArray:
        """Places (r q, 3) of some triangles."""
        return self._places[rows].reshape(-1, 3)

    def _bend(self, state: RestState, rows: IntArray) -> None:
        """Replace the curvatures of some triangles at the start."""
        given = np.zeros((len(rows) * self._places.shape[1], 6))
        arguments = (self._points(rows),)
        given[:, 3:] = values_at(state.owner, _CURVATURE, state.curvature, arguments, (3,))
        for p in range(self._places.shape[1]):
            self._constant[rows, 6 * p + 3 : 6 * p + 6] = 0.0
        self._add(self._constant, rows, given)

    def _add(self, found: FloatArray, rows: IntArray, strains: FloatArray) -> None:
        """Add strains (r q, 6) along e1 and e2 of some triangles to (m, k)."""
        count = 6 * self._places.shape[1]
        mapped = self._maps[rows] @ strains.reshape(len(rows), self._places.shape[1], 6, 1)
        found[rows, :count] += mapped.reshape(len(rows), count)

    def at(self, t: float, fraction: float = 1.0) -> FloatArray:
        """Strains without stress (m, k), with a fraction of what there is since the start.

        A function of a user's that fails in a run is noted, and its strains are nan.

        Raises:
            FunctionError: it fails outside of a run.
        """
        found = self._constant.copy()
        for state, rows in self._changing:
            arguments = self._points(rows), t
            strain = present_values(state.owner, _STRAIN, state.strain, arguments, (6,))
            self._add(found, rows, strain)
        if fraction != 1.0:
            found = self._starts + fraction * (found - self._starts)
        return found
