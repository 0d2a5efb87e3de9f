# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid joints where beams meet."""

from collections.abc import Sequence

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.marker import LINE_ENDS, Marker
from flexfem.joints.rigid import Rigid
from flexfem.mesh.line_mesh import LineMesh
from flexfem.model.bodies.basic import Beam

__all__ = ["weld"]

# Distance of points that are in one place, relative to the size of the mesh
_CLOSE = 1e-9


def weld(mesh: LineMesh, beams: Sequence[Beam]) -> list[Rigid]:
    """Make rigid joints where ends and named points of different beams are in one place.

    Where k beams meet there are k - 1 joints, all with the first of the beams. They are called
    after both beams, "mast_arm", and numbered from the second on, "mast_arm_2".

    Args:
        mesh: Of the beams; :func:`read_mesh` names the points where groups of a file meet.
        beams: Beams along groups of it.

    Raises:
        TypeError: An argument is of the wrong kind.
        ValueError: A beam along no group, or of a group that is not in the mesh.
    """
    _checks.instance("weld", "mesh", mesh, LineMesh)
    ends = []
    for beam in beams:
        _checks.instance("weld", "each beam", beam, Beam)
        if beam.group is None:
            raise ValueError(f'weld: Beam "{beam.name}" is along no group of the mesh')
        own = set(mesh.group_cells(beam.group).ravel().tolist())
        points = {node: name for name, node in mesh.point_groups.items() if node in own}
        order = mesh.order(beam.group)
        if order is not None and order[0] != order[-1]:
            points = dict(zip(order[[0, -1]].tolist(), LINE_ENDS, strict=True)) | points
        ends += [(beam.name, name, mesh.points[node]) for node, name in points.items()]
    joints: list[Rigid] = []
    times: dict[str, int] = {}
    for place in _places([point for *_, point in ends], float(np.ptp(mesh.points, axis=0).max())):
        first, *others = [ends[i] for i in place]
        met = {first[0]}
        for other in others:
            if other[0] in met:
                continue
            met.add(other[0])
            name = f"{first[0]}_{other[0]}"
            times[name] = times.get(name, 0) + 1
            name += "" if times[name] == 1 else f"_{times[name]}"
            joints.append(Rigid(name, Marker(first[0], first[1]), Marker(other[0], other[1])))
    return joints


def _places(points: Sequence[FloatArray], size: float) -> list[list[int]]:
    """Return the numbers of the points in each place that has several, in their order."""
    from scipy.spatial import cKDTree

    if not points:
        return []
    near = cKDTree(np.array(points)).query_ball_point(points, _CLOSE * size, return_sorted=True)
    return [place for i, place in enumerate(near) if len(place) > 1 and place[0] == i]
