# SPDX-License-Identifier: LGPL-3.0-or-later
"""Space frame of beams along x, y and z, rigidly joined: the model does not say where it is long.

The points of a grid of ``x`` by ``y`` by ``z`` points, 1 m apart, are joined by beams of 4 elements
that are connected rigidly at each point; the frame stands on the ground and sways from rest under a
gravity that is oblique. The beams are declared in the order ``order``: all along x, then y, then z
("kind"), by their height ("bay"), or shuffled ("random"). Motion does not depend on it.

History: ``top_x, top_y, top_z`` of the last corner, m. The summary holds ``shared_rows`` and
``wall_seconds_steps``. Run from the source tree::

    python tests/benchmarks/space_frame.py --order kind
    mpirun -n 2 python tests/benchmarks/space_frame.py --order kind
"""

import random
import sys

import numpy as np

import flexfem as ff

Point = tuple[int, int, int]
ELEMENTS = 4


def grid_beams(shape: Point, order: str) -> list[tuple[Point, Point]]:
    """Ends of all beams in their order."""
    points = list(np.ndindex(shape))
    beams = []
    for axis in range(3):
        for point in points:
            end = tuple(int(c) + (k == axis) for k, c in enumerate(point))
            if end[axis] < shape[axis]:
                beams.append((point, end))
    if order == "bay":
        beams.sort(key=lambda ends: (ends[0][2], ends))
    if order == "random":
        random.Random(7).shuffle(beams)
    return beams


def build(*, x: int, y: int, z: int, order: str) -> ff.Model:
    """Model of the frame."""
    beams = grid_beams((x, y, z), order)
    along = np.linspace(0.0, 1.0, ELEMENTS + 1)[:, np.newaxis]
    points, cells, groups, marks = [], [], {}, {}
    for number, ends in enumerate(beams):
        a, b = np.array(ends, dtype=float)
        first = len(points)
        points += list(a + along * (b - a))
        rows = np.arange(ELEMENTS)
        groups[f"beam_{number}"] = len(cells) + rows
        cells += [[first + k, first + k + 1] for k in range(ELEMENTS)]
        marks[number] = (first, first + ELEMENTS)
    mesh = ff.LineMesh(np.array(points), np.array(cells), groups)
    section = ff.Section.circle(0.01, ff.Material(210e9, 0.3, 7850.0))
    model = ff.Model("space_frame", mesh=mesh)
    held: dict[Point, ff.Marker] = {}
    for number, ends in enumerate(beams):
        name = f"beam_{number}"
        model.add(ff.Beam(name, section))
        for side, point in zip(("start", "end"), ends, strict=True):
            marker = ff.Marker(name, side)
            if point in held:
                model.add(ff.Rigid(f"{name}_{side}", held[point], marker))
            elif point[2] == 0:
                ground = ff.Ground(tuple(float(c) for c in point))
                model.add(ff.Rigid(f"{name}_{side}", ground, marker))
            held.setdefault(point, marker)
    model.add(ff.Gravity((3.0, 2.0, -9.81)))
    model.add(ff.PositionProbe("top", held[x - 1, y - 1, z - 1]))
    return model


CASE = ff.Case(
    name="space_frame",
    summary="space frame of beams, declared by kind, by bay or at random (ranks)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("x", int, 3, "points along x", minimum=2),
        ff.Option("y", int, 5, "points along y", minimum=2),
        ff.Option("z", int, 7, "points along z", minimum=2),
        ff.Option("order", str, "kind", "order of the beams", choices=("kind", "bay", "random")),
    ),
    dt=1e-3,
    t_end=0.1,
    smoke={"x": 2, "y": 2, "z": 3, "t_end": 3e-3},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
