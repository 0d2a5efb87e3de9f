# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads across the plane in which a plane body moves, which have no effect on it.

Axisymmetric bodies move in the plane of x and y, y their axis: forces along x act outwards all
around.
"""

from collections.abc import Iterator
from typing import Any

from flexfem._types import FloatArray
from flexfem.families.solid.loads import SurfaceTraction
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection

__all__ = ["find"]


def find(inspection: Inspection) -> Iterator[Finding]:
    """One finding for each plane body under gravity, and for each traction on one."""
    model = inspection.model
    plane = {body.name: body for body in model.other_bodies if getattr(body, "plane", None)}
    for body in plane.values():
        if model.gravity is not None:
            yield from _found(body, owner_of(body), "gravity", model.gravity.acceleration)
    for load in model.of(SurfaceTraction):
        if load.solid in plane:
            yield from _found(plane[load.solid], owner_of(load), "its force", load.traction)


def _found(body: Any, owner: str, what: str, vector: FloatArray) -> Iterator[Finding]:
    """Findings of a vector that acts on a plane body."""
    if vector[2] != 0.0:
        yield Finding(
            "across", owner,
            f"{what} along z has no effect on a plane body, which moves in x and y",
            "let it act along y",
        )  # fmt: skip
    if body.plane == "axisymmetric" and what == "gravity" and vector[0] != 0.0:
        yield Finding(
            "across", owner, "gravity along x acts outwards all around an axisymmetric body",
            "let it act along y, the axis",
        )  # fmt: skip
