# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initial velocities that were projected onto the constraints at the start of a motion."""

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.inspection.finding import owner_of
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.bounding_box import model_extent
from flexfem.system.system import BlockPart, System

__all__ = ["StartVelocities"]

#: Change that counts as rounding, relative to the largest speed, and relative to the size of the
#: model per second.
_ROUNDING, _NOTHING = 1e-3, 1e-6
#: Part of a change that is round-off.
_ROUND_OFF = 1e-9
#: Kind and number of a body.
_Body = tuple[int, int]


class StartVelocities:
    """Comparison of the velocities given in a model with those at the start of its motion."""

    def __init__(self, serial: NumberedModel, system: System) -> None:
        """Store the present velocities."""
        self._serial, self._system = serial, system
        self._given = [part.block.velocity.copy() for part in system.parts]

    def changes(self) -> list[str]:
        """A line on the body that was changed most, if any, the same on all ranks (collective)."""
        size, comm = model_extent(self._serial), self._system.comm
        given = zip(self._system.parts, self._given, strict=True)
        pairs = [(part, before[: part.block.owned]) for part, before in given]
        speeds = [_ways(v, size).max(initial=0.0) for part, b in pairs for v in (b, _now(part))]
        fastest = comm.allreduce(float(np.max(speeds, initial=0.0)), op=MPI.MAX)
        least = max(_ROUNDING * fastest, _NOTHING * size)
        mine: dict[_Body, tuple[float, str]] = {}
        for part, before in pairs:
            mine |= _changed(part, before, size, least)
        found: dict[_Body, tuple[float, str]] = {}
        for one in comm.allgather(mine):  # a body may lie on several ranks
            found |= {body: max(told, found.get(body, told)) for body, told in one.items()}
        return [self._line(found)] if found else []

    def _line(self, found: dict[_Body, tuple[float, str]]) -> str:
        """Line on the first of those that were changed most, independent of rounding and ranks."""
        most = max(float(f"{way:.3g}") for way, _ in found.values())
        body = min(b for b, (way, _) in found.items() if float(f"{way:.3g}") == most)
        others = f" and {len(found) - 1} more" if len(found) > 1 else ""
        slowed = self._system.slowed
        dampers, smaller = (", or stiff dampers end them", ", or reduce dt") if slowed else ("", "")
        return (
            f"{owner_of(self._serial.body(*body))}{others}: initial velocities violate joints "
            f"or drives{dampers}: the run starts with {found[body][1]}; give consistent ones, or "
            f"let drives begin smoothly (SmoothStep){smaller}"
        )


def _now(part: BlockPart) -> FloatArray:
    return part.block.velocity[: part.block.owned]


def _changed(
    part: BlockPart, before: FloatArray, size: float, least: float
) -> dict[_Body, tuple[float, str]]:
    """Change of each body with a node of this rank that has changed by more than ``least`` (m/s).

    It is that of the node with the largest change: its size, with rotations times the model's size,
    and text.
    """
    ways, bodies = _ways(_now(part) - before, size), part.node_body[: part.block.owned]
    found: dict[_Body, tuple[float, str]] = {}
    for node in np.flatnonzero(ways > least):
        body = part.kind, int(bodies[node])
        if body not in found or ways[node] > found[body][0]:
            found[body] = float(ways[node]), _words(_now(part)[node], before[node], size)
    return found


def _words(now: FloatArray, before: FloatArray, size: float) -> str:
    """Return given and changed velocity as text: the rotation if it has changed more."""
    change = now - before
    turns = size * _length(change[3:]) > _length(change[:3])
    axes, unit = (slice(3, 6), "rad/s") if turns else (slice(3), "m/s")
    off = _length(change[axes])
    after, given = (
        value if (value := _length(twist[axes])) > _ROUND_OFF * off else 0.0
        for twist in (now, before)
    )
    return f"{after:.4g} {unit} instead of {given:.4g}, off by {off:.4g}"


def _length(vector: FloatArray) -> float:
    return float(np.linalg.norm(vector))


def _ways(twists: FloatArray, size: float) -> FloatArray:
    """(n,) speeds of nodes, m/s, with rotations times the model's size."""
    turns: FloatArray = size * np.linalg.norm(twists[:, 3:], axis=1)
    return np.maximum(np.linalg.norm(twists[:, :3], axis=1), turns)
