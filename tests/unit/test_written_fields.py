# SPDX-License-Identifier: LGPL-3.0-or-later
"""The option ``fields``: which arrays the series for ParaView hold."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.io.vtu.reader import Grid, read_index, read_pieces
from flexfem.options import FIELDS
from tests.unit.swing import mechanism

#: Whatever is chosen: numbers and axes, from which pages draw.
ALWAYS = {"body", "joint", "section", "e1", "e2", "e3"}


def run(folder: Path, fields: str, precision: str = "mixed") -> dict[str, list[Grid]]:
    """Grids of the last instant of a short run, of all ranks, by series."""
    options = ff.RunOptions(
        dt=0.02, t_end=0.04, every=1, quiet=True, output=folder, fields=fields, split_above=1,
        fields_precision=precision,
    )  # fmt: skip
    assert ff.simulate(mechanism(), options).status == "ok"
    MPI.COMM_WORLD.Barrier()
    indices = sorted(folder.glob("*.pvd"))
    found = {path.stem: read_pieces(read_index(path, path.stem)[-1].file) for path in indices}
    MPI.COMM_WORLD.Barrier()
    return found


def arrays(grids: list[Grid]) -> set[str]:
    return {name for grid in grids for name in (*grid.point_data, *grid.cell_data)}


def test_only_chosen_fields_are_written(shared_tmp_path: Path) -> None:
    """Those of another run in the folder are gone, and what is left has the same values."""
    whole = run(shared_tmp_path, "all")
    assert {"beams", "beam_surfaces", "rigid_bodies", "joints", "reactions"} == whole.keys()
    every = set().union(*map(arrays, whole.values()))
    assert every - ALWAYS <= set(FIELDS)  # names that the option knows
    assert all(grid.points.dtype == np.float64 for grid in whole["beams"])
    few = run(shared_tmp_path, "resultant,velocity")
    assert few.keys() == whole.keys() - {"beam_surfaces"}
    assert not (shared_tmp_path / "beam_surfaces.pvd").exists()
    assert not list((shared_tmp_path / "beam_surfaces").glob("*.vtu"))
    for series, grids in few.items():
        assert arrays(grids) - ALWAYS <= {"resultant", "velocity"}
        for one, other in zip(grids, whole[series], strict=True):
            np.testing.assert_array_equal(one.points, other.points)
    for one, other in zip(few["beams"], whole["beams"], strict=True):
        np.testing.assert_array_equal(one.cell_data["resultant"], other.cell_data["resultant"])


def test_series_of_another_model_are_gone(shared_tmp_path: Path) -> None:
    """Solids of an earlier run in the folder; files of ParaView that are no series stay."""
    law, sizes = ff.laws.NeoHookean.from_young(1e6, 0.3), (1.0, 1.0, 1.0)
    block = ff.Model("block")
    box = ff.SolidMesh.box(sizes, (1, 1, 1), "hexahedron")
    block.add(ff.Solid("cube", law, box, density=1e3, degree=1, fixed={"x0": "xyz"}))
    options = ff.RunOptions(dt=0.02, t_end=0.02, quiet=True, output=shared_tmp_path)
    assert ff.simulate(block, options).status == "ok"
    MPI.COMM_WORLD.Barrier()
    assert (shared_tmp_path / "solids.pvd").exists()
    own = shared_tmp_path / "own.pvd"
    if MPI.COMM_WORLD.rank == 0:
        own.write_text("<VTKFile><Collection/></VTKFile>")
    MPI.COMM_WORLD.Barrier()
    assert ff.simulate(mechanism(), options).status == "ok"
    MPI.COMM_WORLD.Barrier()
    left = {path.stem for path in shared_tmp_path.glob("*.pvd")}
    assert "own" in left
    assert not [name for name in left if name.startswith("solid")]
    assert not list(shared_tmp_path.glob("solid*/*.vtu"))


def test_a_stress_brings_the_surfaces(shared_tmp_path: Path) -> None:
    found = run(shared_tmp_path, "von_mises")
    assert arrays(found["beam_surfaces"]) == {"body", "von_mises"}
    assert not {"strain", "velocity"} & arrays(found["beams"])


def test_double_precision_reaches_all_series(shared_tmp_path: Path) -> None:
    """Values of the mixed files are these, rounded; positions of swept surfaces as well."""
    mixed = run(shared_tmp_path, "all")
    double = run(shared_tmp_path, "all", "double")
    assert mixed.keys() == double.keys()
    for series, grids in double.items():
        for one, other in zip(grids, mixed[series], strict=True):
            rounded = one.points.astype(other.points.dtype)
            if series != "beam_surfaces":
                np.testing.assert_array_equal(rounded, other.points)
            for name, values in {**one.point_data, **one.cell_data}.items():
                known = {**other.point_data, **other.cell_data}[name]
                assert values.dtype == (np.float64 if known.dtype == np.float32 else known.dtype)
                np.testing.assert_array_equal(values.astype(known.dtype), known)
    # not single numbers in files of doubles
    strain = double["beams"][0].cell_data["strain"]
    assert np.any(strain != strain.astype(np.float32))


@pytest.mark.serial
def test_unknown_precision_is_refused() -> None:
    with pytest.raises(ValueError, match="fields_precision must be one of mixed, single, double"):
        ff.RunOptions(dt=0.1, t_end=1.0, fields_precision="half")


@pytest.mark.serial
@pytest.mark.parametrize("fields", ["speed", "velocity,", "all,velocity", ""])
def test_unknown_fields_are_refused(fields: str) -> None:
    with pytest.raises(ValueError, match="fields must be all, none, or names of fields"):
        ff.RunOptions(dt=0.1, t_end=1.0, fields=fields)


@pytest.mark.serial
def test_lists_of_names_are_taken() -> None:
    options = ff.RunOptions(dt=0.1, t_end=1.0, fields=["velocity", "strain"])  # type: ignore[arg-type]
    assert options.fields == "velocity,strain"
