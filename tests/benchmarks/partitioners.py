# SPDX-License-Identifier: LGPL-3.0-or-later
"""Partition of bodies over ranks: flexfem's own bisection against the graph partitioners at hand.

Graphs of bodies and joints are cut into 2, 3 and 4 parts by ``flexfem.mesh.distributed.partition``,
by PT-SCOTCH and KaHIP as DOLFINx has them, and by PT-SCOTCH as petsc4py has it. None of the three
takes weights of vertices from Python, DOLFINx's none of edges either. Columns: rows of joints
between parts, weight of the heaviest part over the mean, seconds (least of five), parts. Every
result is computed five times; ``!`` follows those that are not always the same. Run from the
source tree::

    python -m tests.benchmarks.partitioners
"""

import time
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flexfem._types import IntArray
from flexfem.installation import load_dolfinx
from flexfem.mesh.distributed.partition import partition_bodies
from tests.benchmarks.space_frame import grid_beams

load_dolfinx()  # in the order that its wheels need

from mpi4py import MPI  # noqa: E402
from petsc4py import PETSc  # noqa: E402

from dolfinx import graph  # noqa: E402

REPEATS = 5


class Graph(NamedTuple):
    """Elements of the bodies, and rows between two of them."""

    elements: list[int]
    links: dict[tuple[int, int], int]

    @property
    def near(self) -> list[list[tuple[int, int]]]:
        """Neighbours of each body, with the rows."""
        found: list[list[tuple[int, int]]] = [[] for _ in self.elements]
        for (a, b), rows in self.links.items():
            found[a].append((b, rows))
            found[b].append((a, rows))
        return [sorted(one) for one in found]


def frame(order: str, rows: int = 6, shape: tuple[int, int, int] = (3, 5, 7)) -> Graph:
    """Beams that are joined where they meet: the first at a point holds the others."""
    beams, first, links = grid_beams(shape, order), {}, {}
    for number, ends in enumerate(beams):
        for point in ends:
            if point in first:
                links[first[point], number] = rows
            first.setdefault(point, number)
    return Graph([4] * len(beams), links)


def chain(number: int, rng: np.random.Generator) -> Graph:
    """Revolute joints between beams of 1 to 30 elements."""
    return Graph(rng.integers(1, 31, number).tolist(), dict.fromkeys(pairwise(range(number)), 5))


def tree(number: int) -> Graph:
    """Each body carries two others."""
    return Graph([4] * number, {((k - 1) // 2, k): 5 for k in range(1, number)})


def own(given: Graph, parts: int) -> IntArray:
    """The part of each body by flexfem."""
    ones = [1] * len(given.elements)
    found = partition_bodies(given.elements, ones, given.links, parts, split_above=10**9)
    return np.array([one[0] for one in found])


def by_dolfinx(partitioner: Callable[..., graph.AdjacencyList]) -> Callable[..., IntArray]:
    """The same by a partitioner of DOLFINx."""

    def cut(given: Graph, parts: int) -> IntArray:
        near = [np.array([other for other, _ in one], dtype=np.int64) for one in given.near]
        offsets = np.cumsum([0, *map(len, near)]).astype(np.int32)
        edges = graph.adjacencylist(np.concatenate(near), offsets)
        found = partitioner(MPI.COMM_SELF, parts, getattr(edges, "_cpp_object", edges), False)
        return np.array(found.array, dtype=np.int64)

    return cut


def by_petsc(given: Graph, parts: int) -> IntArray:
    """The same by PT-SCOTCH in PETSc, with rows as weights of edges."""
    near, n = given.near, len(given.elements)
    offsets = np.cumsum([0, *map(len, near)]).astype(np.int32)
    columns = np.array([other for one in near for other, _ in one], dtype=np.int32)
    values = np.array([float(rows) for one in near for _, rows in one])
    matrix = PETSc.Mat().createAIJ(n, csr=(offsets, columns, values), comm=PETSc.COMM_SELF)
    options = PETSc.Options("bodies_")
    options["mat_partitioning_nparts"] = parts
    options["mat_partitioning_use_edge_weights"] = True
    cutter = PETSc.MatPartitioning().create(PETSc.COMM_SELF)
    cutter.setOptionsPrefix("bodies_")
    cutter.setAdjacency(matrix)
    cutter.setType("ptscotch")
    cutter.setFromOptions()
    found = PETSc.IS().create(PETSc.COMM_SELF)
    cutter.apply(found)
    return np.array(found.getIndices(), dtype=np.int64)


PARTITIONERS = {
    "flexfem": own,
    "SCOTCH, DOLFINx": by_dolfinx(graph.partitioner_scotch()),
    "KaHIP, DOLFINx": by_dolfinx(graph.partitioner_kahip()),
    "SCOTCH, PETSc": by_petsc,
}


def result(cut: Callable[[Graph, int], IntArray], given: Graph, parts: int) -> str:
    """Result of a partitioner as text."""
    found, seconds = [], []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        try:
            found.append(cut(given, parts))
        except Exception as error:
            return f"{type(error).__name__}"
        seconds.append(time.perf_counter() - begin)
    part = found[0]
    rows = sum(rows for (a, b), rows in given.links.items() if part[a] != part[b])
    weights = np.bincount(part, given.elements, minlength=parts)
    same = all(np.array_equal(part, other) for other in found)
    ratio, shortest = weights.max() / weights.mean(), 1e3 * min(seconds)
    return f"{rows}, {ratio:.2f}, {shortest:.1f} ms{'' if same else ' !'}"


def main() -> None:
    """Print the table."""
    rng = np.random.default_rng(5)
    graphs = {
        "frame by kind": frame("kind"),
        "frame by bay": frame("bay"),
        "frame at random": frame("random"),
        "tower, 3 rows": frame("random", rows=3, shape=(3, 3, 40)),
        "chain, uneven": chain(120, rng),
        "chain, one end heavy": Graph([1] * 60 + [20] * 60, chain(120, rng).links),
        "tree": tree(255),
    }
    print("| graph | parts | " + " | ".join(PARTITIONERS) + " |")
    print("|---" * (2 + len(PARTITIONERS)) + "|")
    for name, given in graphs.items():
        for parts in (2, 3, 4):
            cells = [result(cut, given, parts) for cut in PARTITIONERS.values()]
            print(f"| {name} | {parts} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
