# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells with large rotations against the tables of Sze, Liu and Lo.

Sze, Liu, Lo, Finite Elem. Anal. Des. 40 (2004) 1551-1569. The models are those of the case
``shell_statics``; where the paper's table is not at hand, references are values of refined meshes.
"""

from dataclasses import dataclass

import flexfem as ff
from flexfem.cli import load_case

__all__ = ["BENCHMARKS", "Benchmark", "Row", "solve"]


@dataclass(frozen=True)
class Benchmark:
    """One benchmark.

    Attributes:
        references: displacements at the largest load by column; for roofs the load factors of the
            limit points.
        published: whether they are those of the paper.
        meshes: cells of the table.
        steps: equal load steps.
    """

    references: dict[str, float]
    published: bool
    meshes: tuple[str, ...]
    steps: int = 10


BENCHMARKS = {
    "cantilever": Benchmark({"A": 6.698, "B": 3.286}, True, ("16x1", "32x2", "64x4"), 5),
    "annulus": Benchmark(
        {"A": 13.891, "B": 17.528}, True, ("30x6", "60x10", "80x10", "120x16", "160x20")
    ),
    "hemisphere": Benchmark({"A": 4.067, "B": 8.178}, True, ("16x16", "24x24", "32x32", "48x48")),
    "pinched": Benchmark({"A": 83.102, "B": 34.272}, True, ("40x40", "60x60"), 20),
    "pullout": Benchmark(
        {"A": 2.7607, "B": 4.5668, "C": 3.2861}, False, ("24x16", "36x24", "48x32"), 20
    ),
    # upper and lower limit load, times 3000
    "roof": Benchmark({"upper": 0.74227, "lower": 0.16896}, False, ("8x8", "16x16", "32x32")),
    "thin_roof": Benchmark({"upper": 0.19429, "lower": -0.12904}, False, ("8x8", "16x16")),
}


@dataclass(frozen=True)
class Row:
    """Results on one mesh: computed values by column, and what they cost."""

    values: dict[str, float]
    unknowns: int
    steps: int
    iterations: int
    seconds: float


def solve(
    benchmark: str, mesh: str, element: str = "rotation_free", membrane: str = "constant"
) -> Row:
    """Follow a benchmark to its largest load, or through the snap of a roof (one process).

    Raises:
        RuntimeError: it does not get there.
    """
    model = load_case("shell_statics").build(
        benchmark=benchmark, mesh=mesh, element=element, membrane=membrane
    )
    if benchmark.endswith("roof"):
        options = ff.StaticOptions(
            arc_length=0.05, stop_column="A", stop_value=25.0, quiet=True
        )  # fmt: skip
    else:
        steps = BENCHMARKS[benchmark].steps
        options = ff.StaticOptions(load_steps=steps, stabilise=True, quiet=True)
    outcome = ff.solve_static(model, options)
    summary = outcome.summary
    if outcome.status != "ok":
        raise RuntimeError(f"{benchmark} {mesh}: {outcome.status}")
    if benchmark.endswith("roof"):
        limits = [point["t"] for point in summary["critical_points"]]
        values = dict(zip(("upper", "lower"), limits, strict=True))
    else:
        values = {c: float(outcome.history[c][-1]) for c in BENCHMARKS[benchmark].references}
    return Row(values, summary["unknowns"], summary["steps"], summary["newton_iterations"],
               summary["wall_seconds"])  # fmt: skip
