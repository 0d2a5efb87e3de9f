# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strain energies of shells by kind: closed forms, and the total."""

from collections.abc import Mapping

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page

LENGTH, WIDTH, THICK, E = 1.0, 0.5, 0.01, 1e9


def strip(element: str, *, force: float = 0.0, across: float = 0.0) -> ff.Model:
    """A clamped strip under forces at its end, per length, along it and across."""
    mesh = ff.SurfaceMesh.rectangle("strip", (LENGTH, WIDTH), (8, 4))
    section = ff.ShellSection.isotropic(THICK, ff.Material(E, 0.0, 1000.0))
    model = ff.Model("strip", surface=mesh)
    model.add(
        ff.Shell("strip", section, element=element, edges={"strip_left": "clamped"}),
        ff.EdgeLoad("load", "strip", "strip_right", (force, 0.0, across)),
        ff.EnergyProbe(),
        ff.ShellEnergyProbe(),
        ff.ShellEnergyProbe("one", bodies=["strip"]),
    )
    return model


def solved(model: ff.Model, **options: object) -> Mapping[str, np.ndarray]:
    """History of one load step, on all ranks."""
    outcome = ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True, **options))
    found: Mapping[str, np.ndarray] = MPI.COMM_WORLD.bcast(dict(outcome.history))
    return found


@pytest.mark.parametrize("element", ff.SHELL_ELEMENTS)
@pytest.mark.parametrize("kind", ["membrane", "bending"])
def test_closed_forms(element: str, kind: str) -> None:
    """A strip stores n^2/(2 E h) per area when pulled, q^2 L^2/(6 D) per area when bent."""
    n, q = (1e3, 0.0) if kind == "membrane" else (0.0, 0.1)
    model = strip(element, force=n, across=q)
    end = solved(model)
    bent = 2.0 * q**2 * LENGTH**2 / (E * THICK**3)
    stored = (0.5 * n**2 / (E * THICK) + bent) * LENGTH * WIDTH
    other = "bending" if kind == "membrane" else "membrane"
    # eight cells along the strip; energies of the wrong kind, or without the factor of one half,
    # are off by all of it
    assert end[f"shell_{kind}"][-1] == pytest.approx(stored, rel=3e-2)
    assert abs(end[f"shell_{other}"][-1]) < 2e-3 * stored
    total = sum(end[f"shell_{part}"][-1] for part in ("membrane", "bending", "shear"))
    # the same sums: a kind left out changes the first digit
    assert total == pytest.approx(end["energy_strain"][-1], rel=1e-9)
    assert end[f"one_{kind}"][-1] == end[f"shell_{kind}"][-1]


def test_fields_hold_the_energy(shared_tmp_path) -> None:
    """Areas times the fields of ParaView are the columns of the probe."""
    pv = pytest.importorskip("pyvista")
    model = strip("rotation_free", force=1e3, across=0.1)
    history = solved(model, output=shared_tmp_path)
    files = sorted((shared_tmp_path / "shells").glob("*.vtu"))
    last = sorted({file.name.split("_")[1] for file in files})[-1]
    total = np.zeros(2)
    for file in files:
        if file.name.split("_")[1] == last:
            grid = pv.read(file)
            area = grid.compute_cell_sizes(length=False, volume=False)["Area"]
            total += [area @ grid[f"{kind}_energy"] for kind in ("membrane", "bending")]
    expected = [history[f"shell_{kind}"][-1] for kind in ("membrane", "bending")]
    # single precision, and areas stretched by 1e-4; energies of triangles instead of densities are
    # off by the areas
    assert total == pytest.approx(expected, rel=1e-3)


@pytest.mark.serial
def test_refusals() -> None:
    """Bodies that are no shells, and models without any."""
    model = strip("rotation_free")
    model.add(ff.RigidBody("ball", 1.0, (1.0, 1.0, 1.0)))
    model.add(ff.ShellEnergyProbe("more", bodies=["ball"]))
    alone = ff.Model("alone")
    alone.add(ff.RigidBody("body", 1.0, (1.0, 1.0, 1.0)), ff.ShellEnergyProbe("none"))
    for wrong, message in (
        (model, 'ShellEnergyProbe "more": Model "strip" has no shell "ball"'),
        (alone, 'ShellEnergyProbe "none": Model "alone" has no shells'),
    ):
        with pytest.raises(ValueError, match=message):
            wrong.validate()
        assert_on_page(message)
