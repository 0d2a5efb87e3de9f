# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solids on stored meshes, of which each rank reads its part, move as those on whole ones do."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

COMM = MPI.COMM_WORLD
SIZES = (0.4, 0.06, 0.05)


def whole_mesh(cell: str, curved: int) -> ff.SolidMesh:
    """A beam with two regions, one of the other, and a set of one node."""
    mesh = ff.SolidMesh.box(SIZES, (6, 2, 2), cell).raised(curved)
    x = mesh.points
    if curved > 1:
        bulge = 25.0 * x[:, :1] * (SIZES[0] - x[:, :1])  # none at the ends
        mesh = mesh.moved(x + 0.002 * bulge * np.sin(20.0 * x[:, [1, 2, 0]]))
    along = x[mesh.corners].mean(axis=1)[:, 0]
    return ff.SolidMesh(
        mesh.points, mesh.cells, cell, degree=curved, surfaces=mesh.surfaces,
        regions={"left": np.flatnonzero(along < 0.2), "right": np.flatnonzero(along >= 0.2),
                 "end": np.flatnonzero(along > 0.33)},
        nodes={"corner": [int(np.argmax(x.sum(axis=1)))]},
    )  # fmt: skip


def stored(mesh: ff.SolidMesh, folder: Path, degree: int, pieces: int) -> ff.StoredSolidMesh:
    """The mesh as the first rank has stored it."""
    if COMM.rank == 0:
        ff.store_solid_mesh(mesh, folder, degree=degree, pieces=pieces)
    COMM.Barrier()
    return ff.StoredSolidMesh(folder)


def swung(mesh: Any, degree: int) -> ff.Model:
    """A spinning beam of two materials on a ball at one end, with a body at the other."""
    laws = {"left": ff.laws.NeoHookean.from_young(2e5, 0.3),
            "right": ff.laws.NeoHookean.from_young(1e5, 0.35)}  # fmt: skip
    beam = ff.Solid(
        "beam", laws, mesh, density={"left": 1200.0, "right": 900.0}, degree=degree,
        fixed={"corner": "z"}, angular_velocity=(0.0, 0.0, 2.0),
    )  # fmt: skip
    tip = beam.surface_marker("x1")
    bob = ff.RigidBody("bob", 0.2, (1e-4, 1e-4, 1e-4), position=(0.4, 0.03, 0.025),
                       velocity=(-0.06, 0.8, 0.0), angular_velocity=(0.0, 0.0, 2.0))  # fmt: skip
    block = ff.SolidMesh.box((0.1, 0.1, 0.1), (3, 2, 1), mesh.cell, origin=(0.0, 1.0, 0.0))
    model = ff.Model("swung")
    model.add(
        ff.Solid("block", laws["left"], block, density=900.0, degree=degree, fixed={"x0": "xyz"},
                 start_velocities=lambda x: np.sin(9.0 * x)),
        beam, bob, ff.Gravity((0.0, -9.81, 0.0)),
        ff.Spherical("ball", ff.Ground((0.0, 0.03, 0.025)), beam.surface_marker("x0")),
        ff.Rigid("tie", tip, ff.Marker("bob")),
        ff.SpringDamper("rope", ff.Ground((0.2, 0.03, 0.5)), beam.point_marker((0.21, 0.03, 0.02)),
                        stiffness=30.0, damping=0.1),
        ff.SurfacePressure("wind", "beam", "y1", 40.0),
        ff.SurfaceTraction("pull", "beam", "z1", (3.0, 0.0, 20.0)),
        ff.PositionProbe("place", ff.Marker("beam", (0.29, 0.06, 0.05))),
        ff.SolidProbe("at", "beam", (0.11, 0.02, 0.03), measures=("stress", "strain", "J")),
        ff.SolidProbe("end", "beam", "end", measures=("von_mises", "volume")),
        ff.SolidProbe("all", "beam", measures=("stress",)),
        ff.SolidProbe("edge", "block", "x1", measures=("displacement",)),
        ff.SolidProbe("side", "beam", "y0", measures=("displacement",)),
        ff.ReactionProbe("held", "ball"), ff.EnergyProbe("energy"), ff.MomentumProbe("whole"),
    )  # fmt: skip
    return model


@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("cell", "degree", "curved", "pieces"),
    [("hexahedron", 1, 1, 7), pytest.param("tetrahedron", 2, 2, 10_000, marks=pytest.mark.slow)],
)
def test_all_columns_are_those_of_the_whole_mesh(
    shared_tmp_path: Path, cell: str, degree: int, curved: int, pieces: int
) -> None:
    """A cell of a wrong material or a facet that no rank has changes columns by 1e-2 and more."""
    mesh = whole_mesh(cell, curved)
    parts = stored(mesh, shared_tmp_path / "mesh", degree, pieces)
    options = {"dt": 2e-3, "t_end": 0.02, "split_above": 2, "quiet": True}
    found = []
    for name, one in (("whole", mesh), ("parts", parts)):
        folder = shared_tmp_path / name
        made = ff.simulate(swung(one, degree), ff.RunOptions(**options, output=folder), comm=COMM)
        assert made.status == "ok"
        found.append(made)
    if COMM.rank > 0:
        return
    whole, read = found
    assert list(whole.history) == list(read.history)
    for column, values in whole.history.items():
        family = [v for k, v in whole.history.items()
                  if k.rpartition("_")[0] == column.rpartition("_")[0]]  # fmt: skip
        allowed = 1e-9 * max(np.abs(v).max() for v in family)
        assert np.abs(values - read.history[column]).max() <= allowed, column


def test_the_mesh_of_other_ranks_is_not_read(shared_tmp_path: Path, monkeypatch: Any) -> None:
    """A rank reads the rows of its own cells and their nodes.

    One that reads all of them would have twice as many on two ranks.
    """
    from flexfem.mesh.array_folder import ArrayFolder

    mesh = ff.SolidMesh.box((1.0, 0.1, 0.1), (60, 1, 1))
    parts = stored(mesh, shared_tmp_path / "mesh", 1, 10_000)
    model = ff.Model("m")
    law = ff.laws.NeoHookean.from_young(1e5, 0.3)
    model.add(ff.Solid("s", law, parts, density=1e3, degree=1, fixed={"x0": "xyz"}))
    rows, read = dict[str, int](), ArrayFolder.rows

    def counted(self: Any, name: str, *args: Any, **kwargs: Any) -> Any:
        found = read(self, name, *args, **kwargs)
        rows[name] = max(rows.get(name, 0), len(found))
        return found

    monkeypatch.setattr(ArrayFolder, "rows", counted)
    options = ff.RunOptions(dt=1e-3, t_end=1e-3, split_above=2, quiet=True)
    assert ff.simulate(model, options, comm=COMM).status == "ok"
    assert rows["cells"] <= -(-60 // COMM.size) + 1
    assert rows["points"] <= 4 * (-(-60 // COMM.size) + 2)


def held(mesh: Any, modulus: float = 2e5) -> ff.Model:
    """A cantilever under its weight and a pressure."""
    model, law = ff.Model("held"), ff.laws.NeoHookean.from_young(modulus, 0.3)
    model.add(
        ff.Solid("beam", law, mesh, density=1e3, degree=1, fixed={"x0": "xyz"}),
        ff.Gravity((0.0, 0.0, -9.81)), ff.SurfacePressure("wind", "beam", "y1", 20.0),
        ff.PositionProbe("tip", ff.Marker("beam", SIZES)),
    )  # fmt: skip
    return model


def test_other_analyses_are_those_of_the_whole_mesh(shared_tmp_path: Path) -> None:
    """Equilibria by factors and by multigrid, frequencies, and the gradient of a motion.

    Cells that no rank has, or that two have, change all of them by more than 1e-2.
    """
    whole = ff.SolidMesh.box(SIZES, (8, 2, 2))
    found = []
    for mesh in (whole, stored(whole, shared_tmp_path / "mesh", 1, 9)):
        numbers = []
        for solver in ("direct", "iterative"):
            options = ff.StaticOptions(
                load_steps=2, linear_solver=solver, split_above=2, quiet=True
            )
            made = ff.solve_static(held(mesh), options, comm=COMM)
            assert made.status == "ok"
            numbers += [made.history[f"tip_{axis}"][-1] for axis in "xyz" if COMM.rank == 0]
        modes = ff.find_modes(
            held(mesh), ff.ModeOptions(modes=3, split_above=2, frames=0, quiet=True), comm=COMM
        )
        if COMM.rank == 0:
            numbers += list(modes.history["frequency"])
        motion = ff.RunOptions(dt=1e-3, t_end=5e-3, split_above=2, quiet=True)
        found.append((numbers, ff.gradient(
            lambda modulus, mesh=mesh: held(mesh, modulus), "final:tip_z", {"modulus": 2e5},
            motion, comm=COMM,
        ).gradient))  # fmt: skip
    (numbers, slope), (read, slope_read) = found
    np.testing.assert_allclose(read, numbers, rtol=1e-8)
    assert slope_read["final:tip_z"]["modulus"] == pytest.approx(
        slope["final:tip_z"]["modulus"], rel=1e-7
    )
