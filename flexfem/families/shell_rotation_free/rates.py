# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strain rates of rotation-free triangles, each with nodes of its own."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.shell_rotation_free.rate_changes import own_nodes, rate_tangents
from flexfem.families.shell_rotation_free.triangles import RotationFreeTriangles

__all__ = ["TriangleRates", "rate_changes"]


class TriangleRates:
    """See :class:`flexfem.families.shell_rotation_free.rate_changes.CellRates`.

    Attributes:
        unknowns: number of unknowns of a patch.
        sizes: (m, k) m.
    """

    def __init__(
        self, triangles: RotationFreeTriangles, points: FloatArray, velocities: FloatArray
    ) -> None:
        """Take inertial positions and velocities (n, 3) of nodes."""
        nodes = triangles.patches.nodes
        self._own = triangles.renumbered(own_nodes(nodes))
        self._points, self._velocities = points[nodes], velocities[nodes].reshape(-1, 3)
        self.unknowns = 3 * nodes.shape[1]
        self.sizes = np.repeat(np.sqrt(triangles.patches.areas)[:, np.newaxis], self.unknowns, 1)

    def moved(self, unknown: int, step: FloatArray) -> FloatArray:
        """See :class:`flexfem.families.shell_rotation_free.rate_changes.CellRates`."""
        points = self._points.copy()
        points[:, unknown // 3, unknown % 3] += step
        return self._own.strain_rates(points.reshape(-1, 3), self._velocities)

    def along(self, unknown: int) -> FloatArray:
        """See :class:`flexfem.families.shell_rotation_free.rate_changes.CellRates`."""
        velocities = np.zeros_like(self._points)
        velocities[:, unknown // 3, unknown % 3] = 1.0
        return self._own.strain_rates(self._points.reshape(-1, 3), velocities.reshape(-1, 3))


def rate_changes(
    triangles: RotationFreeTriangles, points: FloatArray, velocities: FloatArray
) -> FloatArray:
    """Derivatives (m, 3 p, 3 p) of forces by positions through strain rates, N/m."""
    stiffness = triangles.damping[:, None, None] * triangles.stiffness[triangles.sections]
    if triangles.law is not None:
        slow, fast = (triangles.response(points, velocities, rate=rate) for rate in (0.0, 1.0))
        stiffness = fast.stiffness - slow.stiffness
    rates = TriangleRates(triangles, points, velocities)
    return rate_tangents(rates, triangles.patches.areas[:, None, None] * stiffness)[0]
