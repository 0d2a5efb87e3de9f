# SPDX-License-Identifier: LGPL-3.0-or-later
"""Markers at a fraction of a beam of two-node elements where it has no node."""

from collections.abc import Iterable, Iterator
from itertools import chain

from flexfem.core.marker import Marker
from flexfem.inspection.finding import Finding, listed, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.model.bodies import Beam
from flexfem.model.resolve import node_fraction

#: Part of a beam's length by which a node may miss a fraction that is written with few digits.
_NEAR = 1e-3


def find(inspection: Inspection) -> Iterator[Finding]:
    """Fractions whose nearest node is elsewhere, with all that attaches there."""
    model = inspection.model
    users: dict[tuple[str, float], list[str]] = {}
    for thing in chain(
        model.joints, model.loads, model.point_masses, model.probes, model.events
    ):  # fmt: skip
        for marker in _markers(thing):
            if isinstance(marker, Marker) and isinstance(marker.point, float):
                users.setdefault((marker.body, marker.point), []).append(owner_of(thing))
    for (name, wanted), owners in users.items():
        beam = model[name]
        if not isinstance(beam, Beam) or beam.formulation == "nurbs" or model.mesh is None:
            continue
        found = node_fraction(model.mesh, beam, Marker(name, wanted))
        if abs(found - wanted) > _NEAR:
            yield Finding(
                "fractions", listed(list(dict.fromkeys(owners))),
                f"{name}:{wanted:g} is the node at {found:.4g} of {owner_of(beam)}, the nearest",
                "choose elements so that a node is there, or formulation nurbs",
            )  # fmt: skip


def _markers(thing: object) -> Iterable[object]:
    """What something attaches to."""
    several = getattr(thing, "markers", ())
    return several or (getattr(thing, "marker", None),)
