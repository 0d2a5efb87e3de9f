# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elements much smaller than the others or than their section, and needle-like triangles."""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.layout.mesh_facts import MeshFacts
from flexfem.model.bodies.shell import Shell

#: Length relative to the median of the body below which an element is tiny.
_TINY = 0.01
#: Length relative to the depth of the section below which it has no meaning for the body.
_SHORT = 0.02
#: Height of a triangle relative to its longest edge.
_NEEDLE = 0.02


def find(inspection: Inspection) -> Iterator[Finding]:
    """At most one finding for each body."""
    for mesh in inspection.meshes:
        owner, lengths = owner_of(mesh.body), mesh.lengths
        at, median = int(np.argmin(lengths)), float(np.median(lengths))
        what = "edge" if isinstance(mesh.body, Shell) else "element"
        if lengths[at] < _TINY * median:
            yield Finding(
                "elements", owner,
                f"its shortest {what} at {_place(mesh.centroids[at])} has {lengths[at]:.3g} m, the "
                f"median is {median:.3g} m",
                "merge points that almost coincide, or mesh more evenly",
            )  # fmt: skip
        elif lengths[at] < _SHORT * mesh.depth:
            yield Finding(
                "elements", owner,
                f"its shortest {what} has {lengths[at]:.3g} m, the section is {mesh.depth:.3g} m "
                "deep",
                "take fewer elements, or check the units of section and mesh",
            )  # fmt: skip
        elif isinstance(mesh.body, Shell):
            yield from _needles(inspection, mesh, owner)


def _needles(inspection: Inspection, mesh: MeshFacts, owner: str) -> Iterator[Finding]:
    """Triangles whose height is small against their longest edge."""
    surface = inspection.model.surface
    assert surface is not None
    assert isinstance(mesh.body, Shell)
    areas = surface.areas[surface.body_rows(mesh.body.body)]
    flat = 2.0 * areas / mesh.longest**2
    if flat.min() < _NEEDLE:
        at = int(np.argmin(flat))
        yield Finding(
            "elements", owner,
            f"{int((flat < _NEEDLE).sum())} triangles are needles, that at "
            f"{_place(mesh.centroids[at])} has a height of {flat[at]:.2g} of its longest edge",
            "mesh it with triangles of better shape",
        )  # fmt: skip


def _place(x: FloatArray) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in x) + ") m"
