# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ends of beams that lie on another beam without a joint there."""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import Marker
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.layout.numbered_model import NumberedModel

#: Distance, relative to the size of the model, within which places are one.
_SAME = 1e-6
#: Of length one; meshes have no planes across it.
_DIRECTION = np.array([0.48, 0.64, 0.6])


def find(inspection: Inspection) -> Iterator[Finding]:
    """Pairs of beams that meet at an end of one of them where no joints lead from one to the other.

    Beams that touch one another are left out.
    """
    model, serial = inspection.model, inspection.serial
    if len(model.beams) < 2:
        return
    points = [_points(serial, number) for number in range(len(model.beams))]
    places = np.concatenate([nodes for nodes, _ in points])
    body = np.repeat(np.arange(len(points)), [len(nodes) for nodes, _ in points])
    is_end = np.concatenate([ends for _, ends in points])
    near = _Places(places, _SAME * inspection.extent)
    pairs = {
        (min(end, other), max(end, other))
        for end in np.flatnonzero(is_end).tolist()
        for other in near.at(places[end]).tolist()
        if body[end] != body[other]
    }
    told, joints = set[tuple[int, int]](), _JointsAtPlaces(inspection)
    for a, b in sorted(pairs):
        pair = (min(body[a], body[b]), max(body[a], body[b]))
        names = [model.beams[number].name for number in pair]
        if pair in told or joints.join(places[a], names) or _touching(inspection, names):
            continue
        told.add(pair)
        at = ", ".join(f"{value:.4g}" for value in places[a])
        yield Finding(
            "meeting",
            f"{owner_of(model.beams[pair[0]])} and {owner_of(model.beams[pair[1]])}",
            f"they meet at ({at}) m, where no joint holds them together",
            "add a joint (Rigid, Spherical, Revolute), or keep them apart if they only pass",
        )


def _points(serial: NumberedModel, number: int) -> tuple[FloatArray, FloatArray]:
    """Nodes (n, 3) of a beam, m, and which of them (n,) are ends of its line."""
    beam = serial.model.beams[number]
    family = serial.family_of(beam.name)
    chain = family.contact_chain(beam.name)
    if chain is None:
        curve = serial.model.curve(beam)
        ends = np.array([curve.points[0], curve.points[-1]])
        return ends, np.ones(2, dtype=np.bool_)
    nodes, counts = np.unique(chain, return_counts=True)
    return family.frames[nodes, :3], counts == 1


class _Places:
    """Points (n, 3) by their order in one direction, in which different ones hardly coincide."""

    def __init__(self, points: FloatArray, reach: float) -> None:
        self._reach, along = reach, points @ _DIRECTION
        self._order = np.argsort(along, kind="stable")
        self._points, self._along = points[self._order], along[self._order]

    def at(self, place: FloatArray) -> IntArray:
        """Numbers of the points within reach of a place (3,), m."""
        middle = float(place @ _DIRECTION)
        some = slice(*np.searchsorted(self._along, [middle - self._reach, middle + self._reach]))
        close = np.linalg.norm(self._points[some] - place, axis=1) <= self._reach
        return self._order[some][close]


class _JointsAtPlaces:
    """Joints by the places of their markers at the start."""

    def __init__(self, inspection: Inspection) -> None:
        rows = inspection.rows
        self._bodies = [
            {m.body for m in joint.markers if isinstance(m, Marker)} for joint in rows.joints
        ]
        poses = [(pose.position, i) for i, own in enumerate(rows.poses) for pose in own]
        self._joint = [i for _, i in poses]
        points = np.array([x for x, _ in poses]).reshape(-1, 3)
        self._places = _Places(points, _SAME * inspection.extent)

    def join(self, place: FloatArray, names: list[str]) -> bool:
        """Return True if joints with a marker at a place lead from one body to another."""
        here = [self._bodies[self._joint[k]] for k in self._places.at(place).tolist()]
        reached, grown = {names[0]}, True
        while grown and names[1] not in reached:
            more = set().union(*(bodies for bodies in here if bodies & reached)) - reached
            grown = bool(more)
            reached |= more
        return names[1] in reached


def _touching(inspection: Inspection, names: list[str]) -> bool:
    """Return True if a contact includes one of the bodies."""
    model = inspection.model
    touching = {n for c in model.contacts for side in c.members(model) for n in side}
    return bool(touching & set(names))
