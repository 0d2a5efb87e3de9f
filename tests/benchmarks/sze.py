# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of shells with large rotations: meshes, deviation from the references, and cost.

Run from the source tree, all benchmarks or some of them, with one element or both::

    python -m tests.benchmarks.sze
    python -m tests.benchmarks.sze director cantilever hemisphere
    python -m tests.benchmarks.sze rotation_free --membrane=smoothed annulus
"""

import sys

from tests.verification.sze import BENCHMARKS, solve

ELEMENTS = ("rotation_free", "director")


def table(name: str, element: str, membrane: str) -> None:
    """Print the meshes of one benchmark."""
    benchmark = BENCHMARKS[name]
    given = ", ".join(
        f"{key} {value:g}" + (" (own refined mesh)" if key in benchmark.own else "")
        for key, value in benchmark.references.items()
    )
    print(f"{name}, {element}, membrane {membrane}: {given}")
    print("  mesh     unknowns  steps  iterations  seconds  values and deviation in per cent")
    for mesh in benchmark.meshes[element]:
        try:
            row = solve(name, mesh, element, membrane)
        except RuntimeError as error:
            print(f"  {mesh:<7}  {error}", flush=True)
            continue
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
    words = [word for word in sys.argv[1:] if not word.startswith("--")]
    elements = [word for word in words if word in ELEMENTS] or list(ELEMENTS)
    names = [word for word in words if word not in ELEMENTS] or list(BENCHMARKS)
    unknown = [name for name in names if name not in BENCHMARKS]
    if unknown:
        print(f"{unknown[0]} is none of {', '.join(BENCHMARKS)}", file=sys.stderr)
        return 2
    for name in names:
        for element in elements:
            table(name, element, membrane)
    return 0


if __name__ == "__main__":
    sys.exit(main())
