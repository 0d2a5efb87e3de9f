# SPDX-License-Identifier: LGPL-3.0-or-later
"""Places along NURBS curves, where markers are."""

from dataclasses import dataclass

import numpy as np

from flexfem.mesh.nurbs.curve import NurbsCurve
from flexfem.mesh.nurbs.elements import NurbsElements

__all__ = ["Place", "element_at_fraction", "place_at_fraction", "place_in"]

#: Distance from the end of an element, as a part of it, that is round-off.
_SAME = 1e-10


@dataclass(frozen=True)
class Place:
    """Position of a marker on a beam: at a node, or inside an element of a curve.

    A place at the common end of two elements is in the second one.

    Attributes:
        node: node of the mesh, or number of the control point along the curve; None inside an
            element, where the marker moves with all its control points.
        element: number of the element along the curve.
        xi: place in the element, 0 to 1.
    """

    node: int | None
    element: int = -1
    xi: float = 0.0

    def __str__(self) -> str:
        """Return a short text for messages."""
        if self.node is None:
            return f"place {self.xi:.6g} in element {self.element}"
        return f"node {self.node}"


def place_in(parts: NurbsElements, element: int, xi: float) -> Place:
    """Place in an element: a node where the curve passes through a control point.

    It does so at its ends and at knots whose multiplicity is the degree.
    """
    weights = parts.shape[element]
    if xi <= _SAME:
        values, xi = weights[:, 0], 0.0
    elif xi >= 1.0 - _SAME:
        values, xi = weights.sum(axis=1), 1.0
    else:
        return Place(None, element, xi)
    values = values / values.sum()
    at = int(np.argmax(values))
    if values[at] > 1.0 - _SAME:
        return Place(int(parts.nodes[element, at]))
    if xi == 1.0:  # not the last element: there is a node
        element, xi = element + 1, 0.0
    return Place(None, element, xi)


def element_at_fraction(curve: NurbsCurve, fraction: float) -> tuple[int, float]:
    """Element and place in it at a fraction of the curve's arc length, exact to round-off."""
    element, xi = curve.places(np.atleast_1d(curve.parameter_at(fraction)))
    return int(element[0]), float(xi[0])


def place_at_fraction(curve: NurbsCurve, fraction: float) -> Place:
    """Place at a fraction of the curve's arc length, exact to round-off."""
    return place_in(curve.elements, *element_at_fraction(curve, fraction))
