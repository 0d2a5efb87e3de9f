# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time per triangle of shells by hand-written kernels and by their UFL forms (``--kernels``).

    python -m tests.benchmarks.shell_kernels

CPU time of one process, the least of fifteen calls for 3200 triangles.
"""

from collections.abc import Callable
from time import process_time

from mpi4py import MPI

import numpy as np

import flexfem as ff
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.build import build


def sheet(element: str) -> ff.Model:
    """A sheet of 40 x 40 cells of two triangles."""
    model = ff.Model("sheet", surface=ff.SurfaceMesh.rectangle("sheet", (1.0, 0.8), (40, 40)))
    section = ff.ShellSection.isotropic(2e-3, ff.Material(2e9, 0.3, 7800.0))
    model.add(ff.Shell("sheet", section, element=element))
    return model


def least(call: Callable[[], object]) -> float:
    """Least CPU time of some calls, s."""
    call()
    times = []
    for _ in range(15):
        start = process_time()
        call()
        times.append(process_time() - start)
    return min(times)


def times(element: str, kernels: str) -> list[float]:
    """Times of residual, tangent and action, microseconds a triangle."""
    (part,) = build(NumberedModel(sheet(element), kernels), MPI.COMM_SELF, split_above=10_000).parts
    family, block = part.elements, part.block
    assert family is not None
    gravity, stiffness = np.zeros(3), np.array([0.0, 0.0, 1.0])
    calls = (
        lambda: family.add_residual(block, gravity, 1.0),
        lambda: family.values(block, gravity, stiffness, 1.0),
        lambda: family.add_action(block, gravity, stiffness, 1.0),
    )
    return [1e6 * least(call) / len(family.body) for call in calls]


def main() -> None:
    """Print a row for each element and path."""
    print("microseconds a triangle: residual, tangent, action")
    for element in ("rotation_free", "director"):
        for kernels in ("fast", "ufl"):
            found = ", ".join(f"{time:.2f}" for time in times(element, kernels))
            print(f"{element:14} {kernels:5} {found}", flush=True)


if __name__ == "__main__":
    main()
