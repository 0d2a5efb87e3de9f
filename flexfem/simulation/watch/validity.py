# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions beyond what a model is made for: bodies that bend too far, bodies that fly off.

A linear elastic body obeys its equations at any displacement, so that a run of one that bends by a
quarter of its length ends well with results that are wrong. Explicit or wrong forces drive bodies
away from a model by many times its size, which no other check need notice. Nonlinear reduced bodies
obey equations that leave out what their functions cannot represent.
"""

from typing import NamedTuple

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.inspection.finding import owner_of
from flexfem.layout.numbered_model import NumberedModel
from flexfem.simulation.watch.sagging import sagging_cables
from flexfem.simulation.watch.wraps import lost_sheaves
from flexfem.system.bounding_box import diagonal, model_box
from flexfem.system.system import BlockPart, System

__all__ = ["ValidityWatch", "doubtful_state"]

#: Rotation in its frame, rad, above which results of a linear body are doubtful. So much has a
#: cantilever whose end is displaced by 13 % of its length, which makes it too long by 1 %.
_BENT = 0.2
#: Beyond this one, rad, half a turn is near, where rotation vectors jump from pi to -pi. States are
#: looked at between many steps.
_TURNED = 2.0
#: Part of its displacement, in the energy norm, that a nonlinear reduced body may miss: deflections
#: are then wrong by some per cent. Strains that are missing below this size do not count.
_MISSING, _STRAIN = 0.1, 1e-6
#: Distance of a node from the middle of the model at the start, over the model's size there.
_FAR = 1e3
_DIGITS = 6


class _Worst(NamedTuple):
    """The largest value on a rank, rounded so that round-off does not choose between bodies.

    Attributes:
        value: of the body.
        kind, body: minus numbers of family and body, so that the largest is the first of equals.
        time: s.
    """

    value: float = 0.0
    kind: int = 0
    body: int = 0
    time: float = 0.0


class _Missing(NamedTuple):
    """What reduced bodies of a rank have missed so far, (m,) each.

    Attributes:
        bodies: their numbers.
        most: displacements that are missing, energy norm.
        when: their times, s.
        largest: of their own displacements.
        unit: norms of strains of one.
    """

    bodies: IntArray
    most: FloatArray
    when: FloatArray
    largest: FloatArray
    unit: FloatArray


class ValidityWatch:
    """Largest deflections of bodies, and largest distance from the model, during a run.

    Args:
        serial: serial data of the model.
        system: of a run.
        box: (2, 3) bounding box of the model at the start, see ``model_box``.
    """

    def __init__(self, serial: NumberedModel, system: System, box: FloatArray) -> None:
        """Nothing was seen yet."""
        self._serial, self._system = serial, system
        self._centre, self._size = box.mean(axis=0), diagonal(box)
        self._bent, self._far = _Worst(), _Worst()
        self._missing: dict[int, _Missing] = {}
        # some nodes are amplitudes
        placed = [
            (p, np.flatnonzero(p.family.placed[p.block.node_ids[: p.block.owned]]))
            for p in system.parts
        ]
        self._placed = [(part, nodes) for part, nodes in placed if len(nodes)]

    def look(self) -> None:
        """Look at the accepted state of this rank."""
        for part in self._system.parts:
            bodies, deflections = part.family.deflections(part)
            if len(bodies):
                worst = int(np.argmax(deflections))
                self._bent = self._worse(
                    self._bent, deflections[worst], part.kind, int(bodies[worst])
                )
            self._look_at_reduced(part)
        for part, nodes in self._placed:
            away = part.block.frames[nodes, :3] - self._centre
            squares = np.einsum("ni,ni->n", away, away)
            node = int(np.argmax(squares))
            times = float(np.sqrt(squares[node])) / self._size
            self._far = self._worse(self._far, times, part.kind, int(part.node_body[nodes[node]]))

    def _look_at_reduced(self, part: BlockPart) -> None:
        """Keep the largest of what the reduced bodies of a part miss, and of their displacements.

        A body that swings through its shape at rest still moves in functions that it misses.
        """
        bodies, missing, moved, unit = part.family.missing(part)
        if not len(bodies):
            return
        none = np.zeros(len(bodies))
        start = _Missing(bodies, none, none.copy(), none.copy(), unit)
        seen = self._missing.setdefault(part.kind, start)
        seen.when[missing > seen.most] = self._system.time
        np.maximum(seen.most, missing, out=seen.most)
        np.maximum(seen.largest, moved, out=seen.largest)

    def _most_missing(self) -> _Worst:
        """The reduced body of this rank that misses most, relative to how far it deforms."""
        worst = _Worst()
        for kind, (bodies, most, when, largest, unit) in self._missing.items():
            counted = most > _STRAIN * unit
            whole = np.hypot(most, largest)
            ratios = np.divide(most, whole, out=np.zeros_like(most), where=counted)
            at = int(np.argmax(ratios))
            value = float(f"{ratios[at]:.{_DIGITS}g}")
            worst = max(worst, _Worst(value, -kind, -int(bodies[at]), float(when[at])))
        return worst

    def _worse(self, before: _Worst, value: float, kind: int, body: int) -> _Worst:
        """The worse one of the former value and one of the present state."""
        if not np.isfinite(value):  # told elsewhere
            return before
        return max(before, _Worst(float(f"{value:.{_DIGITS}g}"), -kind, -body, self._system.time))

    def texts(self) -> list[str]:
        """Warnings, the same on every rank (collective)."""
        every = self._system.comm.allgather((self._bent, self._most_missing(), self._far))
        bent, missing, far = (max(found) for found in zip(*every, strict=True))
        texts = []
        if bent.value > _BENT:
            jump = ""
            if bent.value > _TURNED:
                jump = ", and at half a turn of an interface its energy jumps, whatever the steps"
            texts.append(
                f"{self._owner(bent)}: it bends by {bent.value:.3g} rad in its frame (at "
                f"t = {bent.time:.4g}), for which its linear elasticity is not accurate{jump}; "
                "divide it into several bodies, or use beams or shells"
            )
        if missing.value > _MISSING:
            texts.append(
                f"{self._owner(missing)}: it deforms as its modes cannot: they miss "
                f"{missing.value:.3g} of its displacement in the energy norm (at "
                f"t = {missing.time:.4g}); reduce it with more derivatives or modes, divide it, or "
                "take a Solid"
            )
        if far.value > _FAR:
            texts.append(
                f"{self._owner(far)}: it is {far.value * self._size:.3g} m away from where the "
                f"model was, {far.value:.3g} times its size of {self._size:.3g} m, at "
                f"t = {far.time:.4g}; look for forces that feed energy, steps that do not resolve "
                "them, and bodies without a joint"
            )
        return texts

    def _owner(self, worst: _Worst) -> str:
        return owner_of(self._serial.body(-worst.kind, -worst.body))


def doubtful_state(serial: NumberedModel, system: System) -> list[str]:
    """Warnings of one state, the accepted one, the same on every rank (collective)."""
    watch = ValidityWatch(serial, system, model_box(serial))
    watch.look()
    return [*watch.texts(), *lost_sheaves(system), *sagging_cables(system)]
