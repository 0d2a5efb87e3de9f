# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of shells with large rotations: meshes, deviation from the references, and cost.

Run from the source tree, all benchmarks or some of them::

    python -m tests.benchmarks.sze
    python -m tests.benchmarks.sze cantilever hemisphere
    python -m tests.benchmarks.sze --membrane=smoothed annulus
"""

import sys

from tests.verification.sze import BENCHMARKS, solve


def table(name: str, membrane: str) -> None:
    """Print the meshes of one benchmark."""
    benchmark = BENCHMARKS[name]
    source = "Sze, Liu, Lo 2004" if benchmark.published else "own refined mesh"
    given = ", ".join(f"{key} {value:g}" for key, value in benchmark.references.items())
    print(f"{name}: {given} ({source}); membrane: {membrane}")
    print("  mesh     unknowns  steps  iterations  seconds  values and deviation in per cent")
    for mesh in benchmark.meshes:
        row = solve(name, mesh, membrane=membrane)
        values = "  ".join(
            f"{key} {row.values[key]:.4f} ({100.0 * (row.values[key] / reference - 1.0):+.2f})"
            for key, reference in benchmark.references.items()
        )
        print(
            f"  {mesh:<7}  {row.unknowns:8d}  {row.steps:5d}  {row.iterations:10d}  "
            f"{row.seconds:7.1f}  {values}",
            flush=True,
        )


def main() -> int:
    """Command line."""
    membrane = "smoothed" if "--membrane=smoothed" in sys.argv else "constant"
    names = [name for name in sys.argv[1:] if not name.startswith("--")] or list(BENCHMARKS)
    unknown = [name for name in names if name not in BENCHMARKS]
    if unknown:
        print(f"{unknown[0]} is none of {', '.join(BENCHMARKS)}", file=sys.stderr)
        return 2
    for name in names:
        table(name, membrane)
    return 0


if __name__ == "__main__":
    sys.exit(main())
