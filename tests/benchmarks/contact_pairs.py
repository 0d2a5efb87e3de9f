# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of primitives: search, forces, tangents and collision detection of two sheets.

A sheet of 60 by 60 nodes falls on another one, a quarter of the mesh size above it; columns are
what acts, and processor time in milliseconds (least of 15). Run from the source tree::

    python -m tests.benchmarks.contact_pairs

Of two sheets of this size ipctk 1.6.0 finds 64,000 pairs of vertices and triangles in 20 ms with
its fastest broad phase (LBVH); its additive CCD of these takes 30 ms. For as many pairs the search
takes 30 ms here, forces of a step 10 ms, and collision detection 3 ms.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.ccd import safe_part
from flexfem.contact.primitives.data import Kind, Pairs, Response
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from flexfem.contact.primitives.statics import forces_at_rest
from flexfem.contact.primitives.steps import forces_of_step
from flexfem.contact.primitives.tangents import add_actions, add_forces
from tests.benchmarks.boxes_against_kdtree import sheet
from tests.unit.primitive_pairs import surface_of


def least(call: Callable[[], Any]) -> float:
    """Least processor time of 15 calls after a first one, s."""
    call()
    times = []
    for _ in range(15):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)


def chosen(pairs: Pairs, these: np.ndarray) -> Pairs:
    """Some of the pairs, those of a group still in one."""
    counts = np.add.reduceat(these, pairs.starts[:-1])
    names = ("kind", "points", "weight", "touch", "dhat", "kappa")
    starts = np.concatenate([[0], np.cumsum(counts[counts > 0])])
    given = {name: getattr(pairs, name)[these] for name in names}
    return Pairs(**given, starts=starts, keys=pairs.keys[counts > 0])


def main() -> None:
    """Print the table."""
    one, triangles = sheet(60, 0.0)
    n, mesh = len(one), 1.0 / 59
    beside = mesh * np.array([0.3, 0.2, 0.25])
    points = np.concatenate([one, one + beside])
    surface = surface_of(
        points, np.concatenate([triangles, triangles + n]), label=np.repeat([0, 1], n),
        radius=0.05 * mesh, dhat=0.2 * mesh,
    )  # fmt: skip
    touching, here = ~np.eye(2, dtype=bool), np.ones(2 * n, bool)
    after = points.copy()
    after[n:, 2] -= 0.3 * mesh
    near = Neighbourhoods.of(surface, points, touching)
    motion = Motion(points, after)
    everything = find_pairs(surface, near, motion, touching, here)
    searched = 1e3 * least(lambda: find_pairs(surface, near, motion, touching, here))
    print(f"search of {everything.count} pairs: {searched:.1f} ms")
    print("pairs             all  acting    steps     rest   action      ccd")
    for name, kinds in (
        ("of vertices", [Kind.VERTEX_VERTEX, Kind.VERTEX_EDGE, Kind.VERTEX_TRIANGLE]),
        ("of edges", [Kind.EDGE_EDGE]),
    ):
        pairs = chosen(everything, np.isin(everything.kind, kinds))
        response, sums = Response.of(pairs), np.zeros_like(points)
        safe = points + 0.9 * safe_part(pairs.memory, points, after, 0.1) * (after - points)
        memories, awake = (pairs.memory, response.memory), np.zeros(pairs.count)
        calls = (
            lambda: forces_of_step(pairs.memory, points, safe, response.memory),  # noqa: B023
            lambda: forces_at_rest(pairs.memory, safe, awake, 0.0, response.memory),  # noqa: B023
            lambda: add_actions(*memories, 1.0, safe, sums),  # noqa: B023
            lambda: safe_part(pairs.memory, points, after, 0.1),  # noqa: B023
        )
        times = [1e3 * least(call) for call in calls]
        add_forces(*memories, 1.0, sums)
        row = " ".join(f"{t:8.2f}" for t in times)
        print(f"{name:12s} {pairs.count:8d} {response.count[0]:7d} {row}")


if __name__ == "__main__":
    main()
