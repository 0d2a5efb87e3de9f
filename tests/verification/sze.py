# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells with large rotations against the tables of Sze, Liu and Lo.

Sze, Liu, Lo, Finite Elem. Anal. Des. 40 (2004) 1551-1569. The models are those of the case
``shell_statics``. The paper tabulates the paths of the roofs in steps: limit loads are those of
refined meshes of the rotation-free shell.
"""

from dataclasses import dataclass

import flexfem as ff
from flexfem.cli import load_case

__all__ = ["BENCHMARKS", "Benchmark", "Row", "solve"]


@dataclass(frozen=True)
class Benchmark:
    """One benchmark.

    Attributes:
        references: displacements at the largest load by column; of roofs also the load factors of
            the limit points.
        meshes: cells of the table, by element.
        steps: equal load steps.
        own: columns whose references are not the paper's but of refined meshes.
        end: largest load factor of a path with limit points.
        stop: column and value that stand for the largest load where a displacement is prescribed.
    """

    references: dict[str, float]
    meshes: dict[str, tuple[str, ...]]
    steps: int = 10
    own: tuple[str, ...] = ()
    end: float = 0.0
    stop: tuple[str, float] | None = None


def _meshes(rotation_free: str, director: str) -> dict[str, tuple[str, ...]]:
    return {
        "rotation_free": tuple(rotation_free.split()),
        "director": tuple(director.split()),
    }


BENCHMARKS = {
    "cantilever": Benchmark(
        {"A": 6.698, "B": 3.286}, _meshes("16x1 32x2 64x4", "8x1 16x1 32x2"), 5
    ),
    "annulus": Benchmark(
        {"A": 13.891, "B": 17.528}, _meshes("30x6 60x10 80x10 120x16 160x20", "30x4 40x6 60x8")
    ),
    "hemisphere": Benchmark(
        {"A": 4.067, "B": 8.178}, _meshes("16x16 24x24 32x32 48x48", "8x8 12x12 16x16")
    ),
    "pinched": Benchmark(
        {"A": 83.102, "B": 34.272}, _meshes("", "64x16"), 36, stop=("force_fz", -3e3)
    ),
    "pullout": Benchmark(
        {"A": 2.768, "B": 4.551, "C": 3.269}, _meshes("24x16 36x24 48x32", "24x16 36x24"), 20
    ),
    # upper and lower limit load, times 3000
    "roof": Benchmark(
        {"upper": 0.74227, "lower": 0.16896, "A": 29.374},
        _meshes("8x8 16x16 32x32", "4x4 8x8 16x16"), own=("upper", "lower"), end=1.0835,
    ),
    "thin_roof": Benchmark(
        {"upper": 0.19429, "lower": -0.12904, "A": 38.450},
        _meshes("8x8 16x16", "8x8 16x16"), own=("upper", "lower"), end=1.0313,
    ),
}  # fmt: skip


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
    model = load_case("shell_statics").model(
        benchmark=benchmark, mesh=mesh, element=element, membrane=membrane
    )
    known = BENCHMARKS[benchmark]
    if known.end:
        options = ff.StaticOptions(arc_length=0.05, t_end=known.end, quiet=True)
    else:
        # coarse meshes of the rotation-free shell buckle locally, unless a displacement is given
        hold = element == "rotation_free" and known.stop is None
        column, value = known.stop or ("none", 0.0)
        options = ff.StaticOptions(
            load_steps=known.steps, stabilise=hold, stop_column=column, stop_value=value, quiet=True
        )
    outcome = ff.solve_static(model, options)
    summary, history = outcome.summary, outcome.history
    if outcome.status != "ok":
        raise RuntimeError(f"{benchmark} {mesh}: {outcome.status}")
    if known.stop and abs(history[column][-1] / value - 1.0) > 1e-6:
        raise RuntimeError(f"{benchmark} {mesh}: {column} is {history[column][-1]:g} at the end")
    values = {c: float(history[c][-1]) for c in known.references if c in history}
    if known.end:
        limits = [point["t"] for point in summary["critical_points"]]
        values |= dict(zip(("upper", "lower"), limits, strict=True))
    return Row(values, summary["unknowns"], summary["steps"], summary["newton_iterations"],
               summary["wall_seconds"])  # fmt: skip
