# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in floating frames for ParaView: displacements and stresses from their coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.series import VtuSeries

if TYPE_CHECKING:
    from mpi4py import MPI

    from flexfem.model.bodies.floating_body import FloatingBody
    from flexfem.reduction.reduced_body import Recovery

__all__ = ["FloatingState", "FloatingWriter"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Names of the components of stresses, in the axes of the body.
STRESS = ("xx", "yy", "zz", "yz", "xz", "xy")


@dataclass(frozen=True)
class FloatingState:
    """Frame and coordinates of one body at one instant.

    Attributes:
        frame: (12,) floating frame.
        twist: (6,) its velocity and angular velocity in its own axes.
        coordinates, rates: (n,) of all functions of the reduced body, those of the frame's
            interface are zero.
        strains: (n,) the coordinates without motions that cause no stress.
    """

    frame: FloatArray
    twist: FloatArray
    coordinates: FloatArray
    rates: FloatArray
    strains: FloatArray


@dataclass(frozen=True)
class _Piece:
    """Points and cells of one body on this rank at one instant."""

    position: FloatArray
    displacement: FloatArray
    deformation: FloatArray
    velocity: FloatArray
    cells: IntArray
    stress: FloatArray


class FloatingWriter:
    """Series ``floating_bodies`` (surfaces) and ``floating_lines`` (bodies of line elements).

    Points have ``displacement`` since the start, ``deformation`` relative to the floating frame and
    ``velocity``; cells ``body``, ``stress`` in the body's axes and ``von_mises`` (Pa).
    """

    def __init__(
        self, folder: Path, comm: MPI.Comm, bodies: Sequence[FloatingBody], *,
        resume: float | None = None, fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """Declare both series; nothing is written yet.

        Args:
            folder: Result folder.
            comm: Communicator; `write` and `close` are collective.
            bodies: Of the model; those without recovery are not shown.
            resume: Keep the instants of an earlier run up to this time (s).
            fields: To write, and their precision.
        """
        self._bodies = bodies
        self._series = {
            corners: VtuSeries(
                folder, name, comm, components={"stress": STRESS}, resume=resume, fields=fields
            )
            for name, corners in (("floating_bodies", 3), ("floating_lines", 2))
        }

    def write(self, time: float, step: int, states: Sequence[FloatingState]) -> None:
        """Write one instant; collective.

        Args:
            time: Time in s.
            step: Step number.
            states: Of all bodies, the same on every rank.
        """
        for corners, series in self._series.items():
            shown = [
                (number, body.reduced.recovery)
                for number, body in enumerate(self._bodies)
                if body.reduced.recovery is not None
                and body.reduced.recovery.cells.shape[1] == corners
            ]
            pieces = [_piece(self._bodies[i], data, states[i]) for i, data in shown]
            first = np.cumsum([0, *(len(piece.position) for piece in pieces)])
            cells = [piece.cells + start for piece, start in zip(pieces, first[:-1], strict=True)]
            stress = _joined([piece.stress for piece in pieces], 6)
            owner = [np.full(len(p.cells), i) for (i, _), p in zip(shown, pieces, strict=True)]
            series.write(
                time,
                step,
                _joined([piece.position for piece in pieces], 3),
                np.concatenate([np.empty((0, corners), dtype=np.int64), *cells]),
                {2: "line", 3: "triangle"}[corners],
                {
                    name: _joined([getattr(piece, name) for piece in pieces], 3)
                    for name in ("displacement", "deformation", "velocity")
                },
                {
                    "body": np.concatenate([np.empty(0, dtype=np.int64), *owner]),
                    "stress": stress,
                    "von_mises": _von_mises(stress),
                },
            )

    def close(self) -> None:
        """End the series; collective."""
        for series in self._series.values():
            series.close()


def _joined(parts: Sequence[FloatArray], width: int) -> FloatArray:
    return np.concatenate([np.empty((0, width)), *parts])


def _piece(body: FloatingBody, data: Recovery, state: FloatingState) -> _Piece:
    """This rank's part of a body."""
    x, R = state.frame[:3], state.frame[3:].reshape(3, 3)
    moved = data.displacement @ state.coordinates
    local = data.points - body.origin + moved
    rate = data.displacement @ state.rates + state.twist[:3] + np.cross(state.twist[3:], local)
    start = body.position + data.points @ body.rotation.T
    position = x + local @ R.T
    values = data.stresses(state.strains)
    return _Piece(position, position - start, moved @ R.T, rate @ R.T, data.cells, values)


def _von_mises(stress: FloatArray) -> FloatArray:
    """Equivalent stress (m,) of stresses (m, 6)."""
    xx, yy, zz, yz, xz, xy = stress.T
    normal = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
    equivalent: FloatArray = np.sqrt(normal + 3.0 * (yz**2 + xz**2 + xy**2))
    return equivalent
