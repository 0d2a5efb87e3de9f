# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every column of a run is the same on one rank and on all of them, forces and energies included.

Sums in another order end in positions and rotations that differ by a rounding, however small the
tolerance of the iteration is. Of that an element of the length h at the place x makes a force of
``eps (|x| / h + 1) EA``, eps = 2.2e-16: 2e-11 N with the soft material here, 2e-7 N with steel. A
run on one rank whose positions are moved by their last digit after every step differs as much.
"""

import math
from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

COMM = MPI.COMM_WORLD
#: Moduli, Pa.
SOFT, STEEL = 2e7, 2.1e11
DIAMETER = 0.02
#: Prefixes of the names of forces of joints and in sections.
FORCES = ("force_", "tied_", "pull_", "strain_")
ROUNDING = float(np.finfo(np.float64).eps)


def rod(modulus: float) -> ff.Section:
    """Section of all beams."""
    material = ff.Material(youngs_modulus=modulus, poisson_ratio=0.3, density=1200.0)
    return ff.Section.circle(DIAMETER, material)


def chain(bodies: int, modulus: float) -> ff.Model:
    """Beams that swing on balls, with a rigid bob on a bushing at the end, and a rope beside."""
    names = [f"rod_{i}" for i in range(bodies)]
    lines = {name: [(0.4 * i, 0.0, 0.0), (0.4 * (i + 1), 0.0, 0.0)]
             for i, name in enumerate(names)}  # fmt: skip
    model = ff.Model("chain", mesh=ff.LineMesh.straight(lines, 4))
    before: ff.Marker | ff.Ground = ff.Ground()
    for name in names:
        model.add(ff.Beam(name, rod(modulus), orientation=(0.0, 1.0, 0.0), damping=1e-4))
        model.add(ff.Spherical(f"ball_{name}", before, ff.Marker(name, "start")))
        model.add(ff.ReactionProbe(f"force_{name}", f"ball_{name}"))
        before = ff.Marker(name, "end")
    bob = ff.RigidBody("bob", 0.5, (0.01, 0.01, 0.01), position=(0.4 * bodies, 0.0, 0.0))
    model.add(bob, ff.Rigid("tie", before, ff.Marker("bob")), ff.ReactionProbe("tied", "tie"))
    rope = ff.Ground((0.4, 0.0, 1.0)), ff.Marker(names[1], "start")
    model.add(ff.SpringDamper("rope", *rope, stiffness=300.0, damping=1.0))
    model.add(ff.ReactionProbe("pull", "rope"), ff.StrainProbe("strain", names[0], 0.5))
    return model


def frame(storeys: int, modulus: float) -> ff.Model:
    """Posts and girders that are rigidly joined, in the order of a list by kind; loops."""
    ends = [((x, 0.0, z), (x, 0.0, z + 1.0)) for x in (0.0, 1.0) for z in range(storeys)]
    ends += [((0.0, 0.0, z + 1.0), (1.0, 0.0, z + 1.0)) for z in range(storeys)]
    lines = {f"beam_{i}": list(pair) for i, pair in enumerate(ends)}
    parts = [ff.LineMesh.straight({name: line}, 3) for name, line in lines.items()]
    model = ff.Model("frame", mesh=ff.LineMesh.join(parts))
    held: dict[tuple[float, ...], ff.Marker | ff.Ground] = {
        (x, 0.0, 0): ff.Ground((x, 0.0, 0.0)) for x in (0.0, 1.0)
    }
    for name, line in lines.items():
        model.add(ff.Beam(name, rod(modulus), orientation=(0.0, 1.0, 0.0), damping=1e-4))
        for side, point in zip(("start", "end"), line, strict=True):
            marker = ff.Marker(name, side)
            if point in held:
                model.add(ff.Rigid(f"{name}_{side}", held[point], marker))
                model.add(ff.ReactionProbe(f"force_{name}_{side}", f"{name}_{side}"))
            held.setdefault(point, marker)
    model.add(ff.StrainProbe("strain", "beam_0", 0.5))
    return model


@pytest.mark.several_ranks
@pytest.mark.three_ranks
@pytest.mark.parametrize("modulus", [SOFT, STEEL])
@pytest.mark.parametrize(
    ("build", "farthest", "length"),
    [(chain, 1.2, 0.1), (frame, math.hypot(1.0, 3.0), 1.0 / 3.0)],
)
def test_all_columns_are_the_same_on_any_number_of_ranks(
    build: Callable[[int, float], ff.Model], farthest: float, length: float, modulus: float
) -> None:
    """A sum that lacks a rank's share, or a node that is not exchanged, is off by 1e-3 and more.

    Forces of soft beams differ by up to 5e-11 of the largest. Multipliers of index 3, which a
    rounding of positions disturbs by the mass over the square of the step, do by 3e-9. Those of
    steel differ by up to 0.3 of what a rounding makes, or 4e-8 of the largest of their columns.
    """
    found = []
    for comm in (MPI.COMM_SELF, COMM):
        model = build(3, modulus)
        model.add(
            ff.Gravity((1.0, 2.0, -9.81)), ff.EnergyProbe("energy"), ff.MomentumProbe("whole")
        )
        options = ff.RunOptions(dt=1e-3, t_end=0.05, quiet=True)
        found.append(ff.simulate(model, options, comm=comm))
    alone, together = found
    assert alone.status == together.status == "ok"
    assert (together.summary["shared_rows"] > 0) == (COMM.size > 1)
    if COMM.rank > 0:
        return
    assert list(alone.history) == list(together.history)
    stiffness = modulus * math.pi * 0.25 * DIAMETER**2
    for column, values in alone.history.items():
        family = [v for k, v in alone.history.items()
                  if k.rpartition("_")[0] == column.rpartition("_")[0]]  # fmt: skip
        allowed = 1e-9 * max(np.abs(v).max() for v in family)
        if modulus == STEEL and column.startswith(FORCES):
            allowed = max(allowed, ROUNDING * (farthest / length + 1.0) * stiffness)
        assert np.abs(values - together.history[column]).max() <= allowed, column


def strips(count: int) -> ff.Model:
    """Soft sheets hinged to one another in a row, which the first one carries."""
    u = np.linspace(0.0, 0.2, 5)
    meshes = [ff.SurfaceMesh.grid(f"s{k}", u + 0.2 * k, u) for k in range(count)]
    model = ff.Model("strips", surface=ff.SurfaceMesh.join(meshes))
    model.add(ff.Gravity((0.0, 1.0, -9.81)))
    section = ff.ShellSection.isotropic(2e-3, ff.Material(2e6, 0.3, 1000.0))
    for k in range(count):
        edges = {} if k else {"s0_left": "clamped"}
        model.add(ff.Shell(f"s{k}", section, damping=1e-4, edges=edges))
    for k in range(1, count):
        ends = ff.ShellLine(f"s{k - 1}", f"s{k - 1}_right"), ff.ShellLine(f"s{k}", f"s{k}_left")
        model.add(ff.HingeLine(f"hinge_{k}", *ends))
        model.add(ff.ReactionProbe(f"force_{k}", f"hinge_{k}"))
    return model


@pytest.mark.several_ranks
@pytest.mark.three_ranks
def test_factors_are_renewed_alike_on_any_number_of_ranks() -> None:
    """Steps of 20 ms fold the sheets, so that factors are renewed within most of them."""
    options = ff.RunOptions(dt=0.02, t_end=0.2, quiet=True)
    alone, together = (ff.simulate(strips(3), options, comm=comm) for comm in (MPI.COMM_SELF, COMM))
    for name in ("newton_iterations", "factorizations", "fallbacks"):
        # 55 and 50 iterations where a rank renews factors of its own bodies without the others
        assert together.summary[name] == alone.summary[name]
    if COMM.rank > 0:
        return
    for column, values in alone.history.items():
        family = [v for k, v in alone.history.items()
                  if k.rpartition("_")[0] == column.rpartition("_")[0]]  # fmt: skip
        allowed = 1e-9 * max(np.abs(v).max() for v in family)
        assert np.abs(values - together.history[column]).max() <= allowed, column
