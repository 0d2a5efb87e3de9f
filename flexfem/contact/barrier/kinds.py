# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kinds of pairs: cells with each other, and points with obstacles by their signed distance."""

from dataclasses import replace

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.barrier.surface import ContactSurface
from flexfem.contact.dissipation.data import Groups, StepMotion
from flexfem.contact.dissipation.restitution import place_ends
from flexfem.contact.fields import ccd as field_ccd
from flexfem.contact.fields import statics as field_statics
from flexfem.contact.fields import steps as field_steps
from flexfem.contact.fields import tangents as field_tangents
from flexfem.contact.fields.data import FIELD_NUMBERS, FieldState
from flexfem.contact.fields.search import find_pairs as find_field_pairs
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.ccd import mark_unsafe, safe_part
from flexfem.contact.primitives.data import Pairs, Response
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from flexfem.contact.primitives.statics import forces_at_rest
from flexfem.contact.primitives.steps import forces_of_step, turn_forces
from flexfem.contact.primitives.tangents import add_actions, blocks_into

__all__ = ["OfCells", "OfFields"]


class OfCells:
    """Pairs of cells of a contact's surface; a ``PairKind``."""

    def __init__(self, own: ContactSurface, near: Neighbourhoods, here: BoolArray) -> None:
        """Store the surface, its pairs that are left out, and the points of this rank (n,)."""
        self._own, self._surface, self._near, self._here = own, own.surface, near, here
        self._way = 0.0

    def stiffen(self, kappa: FloatArray) -> None:
        """See ``PairKind``."""
        self._surface = replace(self._own.surface, kappa=kappa)

    def search(self, motion: Motion, at: FloatArray) -> tuple[Pairs, Response]:
        """See ``PairKind``."""
        own = self._own
        self._pairs = find_pairs(self._surface, self._near, motion, own.touching, self._here)
        self._response = Response.of(self._pairs)
        # pairs that are far apart sleep until points have moved by as much, m
        self._asleep, self._way = np.zeros(self._pairs.count), 0.0
        return self._pairs, self._response

    def begin(self) -> None:
        """See ``PairKind``."""

    def respond(self, motion: StepMotion, *, over_step: bool) -> None:
        """See ``PairKind``."""
        pairs, response = self._pairs.memory, self._response.memory
        if over_step:
            forces_of_step(pairs, motion.before, motion.after, response)
        else:
            forces_at_rest(pairs, motion.after, self._asleep, self._way, response)

    def turn(self, motion: StepMotion) -> None:
        """See ``PairKind``."""
        turn_forces(self._pairs.memory, motion.before, motion.after, self._response.memory)

    def response_of(self, copies: Pairs) -> Response:
        """See ``PairKind``."""
        return Response.of(copies)

    def respond_alone(
        self, copies: Pairs, chosen: IntArray, motion: StepMotion, response: Response
    ) -> None:
        """See ``PairKind``."""
        forces_of_step(copies.memory, motion.before, motion.after, response.memory)

    def add_actions(self, scale: float, steps: FloatArray, sums: FloatArray) -> None:
        """See ``PairKind``."""
        add_actions(self._pairs.memory, self._response.memory, scale, steps, sums)

    def blocks(self, scale: float) -> FloatArray:
        """See ``PairKind``."""
        blocks = np.empty((self._response.count[0], 12, 12))
        blocks_into(self._response.memory, scale, blocks)
        return blocks

    def safe_part(self, before: FloatArray, after: FloatArray, keep: float) -> float:
        """See ``PairKind``."""
        return float(safe_part(self._pairs.memory, before, after, keep))

    def mark_unsafe(
        self, before: FloatArray, after: FloatArray, way: float, keep: float, marks: FloatArray
    ) -> float:
        """See ``PairKind``."""
        pairs, ways = self._pairs.memory, (self._way, 2.0 * way)
        return float(mark_unsafe(pairs, before, after, keep, self._asleep, ways, marks))

    def went(self, way: float) -> None:
        """See ``PairKind``."""
        self._way += 2.0 * way

    def place_ends(self, groups: Groups, points: FloatArray, ends: Groups) -> None:
        """See ``PairKind``."""
        pairs, response = self._pairs.memory, self._response.memory
        place_ends(pairs, response, groups.memory, points, ends.memory)


class OfFields:
    """Pairs of a contact's stations and its obstacles; a ``PairKind``."""

    def __init__(self, own: ContactSurface, here: BoolArray) -> None:
        """Store the surface and the points of this rank (n,)."""
        self._stations, self._obstacles = own.stations(here), own.obstacles
        self._start: FieldState | None = None

    def stiffen(self, kappa: FloatArray) -> None:
        """See ``PairKind``."""
        self._stations = replace(self._stations, kappa=kappa[self._stations.rows])

    def search(self, motion: Motion, at: FloatArray) -> tuple[Pairs, Response]:
        """See ``PairKind``."""
        ways = np.maximum(motion.after - at, at - motion.before) + 0.5 * motion.skin
        self._found = find_field_pairs(
            self._obstacles, self._stations, self._obstacles.placed(at),
            np.linalg.norm(ways, axis=1),
        )  # fmt: skip
        self._response, self._start = Response.of(self._found.pairs, FIELD_NUMBERS), None
        return self._found.pairs, self._response

    def begin(self) -> None:
        """See ``PairKind``."""
        self._start = None

    def respond(self, motion: StepMotion, *, over_step: bool) -> None:
        """See ``PairKind``."""
        found, at = self._found, self._obstacles.placed(motion.after)
        state = self._obstacles.state(found, at)
        if over_step:
            if self._start is None:
                before = self._obstacles.placed(motion.before)
                self._start = self._obstacles.state(found, before)
            field_steps.forces_of_step(
                found.pairs.memory, self._start.memory, state.memory, self._response.memory
            )
        else:
            bends = self._obstacles.bends(found, at, state)
            field_statics.forces_at_rest(
                found.pairs.memory, state.memory, bends, self._response.memory
            )

    def turn(self, motion: StepMotion) -> None:
        """See ``PairKind``: unknown."""

    def response_of(self, copies: Pairs) -> Response:
        """See ``PairKind``."""
        return Response.of(copies, FIELD_NUMBERS)

    def respond_alone(
        self, copies: Pairs, chosen: IntArray, motion: StepMotion, response: Response
    ) -> None:
        """See ``PairKind``."""
        fields = self._found.fields[chosen]
        start, end = (
            self._obstacles.state_of_copies(copies, fields, points)
            for points in (motion.before, motion.after)
        )
        field_steps.forces_of_step(copies.memory, start.memory, end.memory, response.memory)

    def add_actions(self, scale: float, steps: FloatArray, sums: FloatArray) -> None:
        """See ``PairKind``."""
        pairs, response = self._found.pairs.memory, self._response.memory
        field_tangents.add_actions(pairs, response, scale, steps, sums)

    def blocks(self, scale: float) -> FloatArray:
        """See ``PairKind``."""
        blocks = np.empty((self._response.count[0], 15, 15))
        field_tangents.blocks_into(self._response.memory, scale, blocks)
        return blocks

    def safe_part(self, before: FloatArray, after: FloatArray, keep: float) -> float:
        """See ``PairKind``."""
        start, end = (self._obstacles.placed(points) for points in (before, after))
        return field_ccd.safe_part(self._obstacles, self._found, start, end, keep)

    def mark_unsafe(
        self, before: FloatArray, after: FloatArray, way: float, keep: float, marks: FloatArray
    ) -> float:
        """See ``PairKind``; all points near obstacles are cut."""
        part = self.safe_part(before, after, keep)
        if part < 1.0:
            marks[self._found.pairs.points.ravel(), 0] += 1.0
        return part

    def went(self, way: float) -> None:
        """See ``PairKind``."""

    def place_ends(self, groups: Groups, points: FloatArray, ends: Groups) -> None:
        """See ``PairKind``: those of the step."""
        for name in ("count", "starts", "sides", "points", "weights", "numbers"):
            getattr(ends, name)[:] = getattr(groups, name)
