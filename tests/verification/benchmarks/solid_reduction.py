# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear reduced solids against all nodes of the same mesh: a soft beam that falls on a joint.

The beam of 1 m hangs on its first end face by a spherical joint and bends as it starts to fall from
the horizontal. Reduced, its frame is that of this face, in which the other one turns.
"""

from collections.abc import Iterator
from functools import cache
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx import mesh

import flexfem as ff
from tests.verification.result import Result

Values = np.ndarray
#: Size, m, cells of second degree, density, kg/m^3, and gravity, m/s^2.
SIZE, CELLS, DENSITY, GRAVITY = (1.0, 0.02, 0.05), (6, 1, 1), 1200.0, 30.0
LAW = ff.laws.SaintVenantKirchhoff(2e7, 0.3)
#: Steps, and the end of the fall, s.
STEP, END = 1e-3, 0.14
LOW = (0.0, -SIZE[1] / 2, -SIZE[2] / 2)


def full() -> tuple[Any, Any, Any]:
    """The solid, and its markers at both ends."""
    body = ff.Solid("beam", LAW, ff.SolidMesh.box(SIZE, CELLS, origin=LOW), density=DENSITY)
    return body, body.surface_marker("x0"), ff.Marker("beam", (SIZE[0], 0.0, 0.0))


@cache
def reduction(modes: int, derivatives: int, cells: tuple[int, int, int] = CELLS) -> ff.ReducedBody:
    """Its data in so many modes and derivatives."""
    high = (SIZE[0], SIZE[1] / 2, SIZE[2] / 2)
    domain = mesh.create_box(MPI.COMM_WORLD, [LOW, high], cells, mesh.CellType.hexahedron)
    ends = {
        "root": lambda x: np.isclose(x[0], 0.0),
        "tip": lambda x: np.isclose(x[0], SIZE[0]),
    }
    return ff.reduce_body(
        ff.solid_body(domain, LAW, density=DENSITY), ends, modes=modes, derivatives=derivatives,
        ties=dict.fromkeys(ends, "average"),
    )  # fmt: skip


def reduced(modes: int, derivatives: int) -> tuple[Any, Any, Any]:
    """The reduced body, and its markers at both ends."""
    return ff.FloatingBody("beam", reduction(modes, derivatives)), *reduced_markers()


def reduced_markers() -> tuple[ff.Marker, ff.Marker]:
    """At both ends of the reduced body."""
    return ff.Marker("beam", "root"), ff.Marker("beam", "tip")


def falling(body: Any, root: Any, tip: Any) -> ff.Model:
    """The beam, horizontal at the start."""
    model = ff.Model("falling_beam")
    model.add(
        body,
        ff.Gravity((0.0, -GRAVITY, 0.0)),
        ff.Spherical("pin", ff.Ground(), root),
        ff.PositionProbe("tip", tip),
        ff.EnergyProbe(),
    )
    if isinstance(body, ff.FloatingBody):
        model.add(ff.ReductionErrorProbe("missing", "beam"))
    return model


def fall(parts: tuple[Any, Any, Any], end: float = END, dt: float = STEP) -> dict[str, Values]:
    """History."""
    return dict(ff.simulate(falling(*parts), ff.RunOptions(dt=dt, t_end=end, quiet=True)).history)


def apart(first: dict[str, Values], second: dict[str, Values]) -> Values:
    """Distances of the tips, m."""
    tips = [np.array([history[f"tip_{axis}"] for axis in "xyz"]) for history in (first, second)]
    distances: Values = np.linalg.norm(tips[0] - tips[1], axis=0)
    return distances


def falls(cases: tuple[tuple[int, int, float], ...], end: float) -> Iterator[Result]:
    """Largest distance of the tips. The free end turns by 0.9 rad in the frame of the other."""
    exact = fall(full(), end)
    for modes, derivatives, tolerance in cases:
        found = fall(reduced(modes, derivatives), end)
        yield Result(
            "soft beam that falls on a joint", "largest distance of the tips, m", 0.0,
            "solid of the same mesh", float(apart(found, exact).max()),
            f"{modes} modes, {derivatives} derivatives, h = {1e3 * STEP:g} ms to {end:g} s",
            tolerance,
        )  # fmt: skip


def results(full: bool = True) -> list[Result]:
    """All lines; an inertia that is linear in the rotation of the end is 0.009 to 0.010 m off."""
    return list(falls(((4, 8, 3e-3), (8, 24, 2e-3)) if full else ((4, 8, 3e-3),), END))
