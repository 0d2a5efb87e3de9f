# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells from their UFL forms do what the hand-written kernels do, in all analyses, on ranks."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

STEEL = ff.Material(2e9, 0.3, 7800.0)
ELEMENTS = pytest.mark.parametrize("element", ["rotation_free", "director"])


def hardening(strain: Any, p: Any) -> Any:
    """Energy per area of a sheet whose membrane gets stiffer."""
    stretch = sum(strain[i] ** 2 for i in range(3))
    bending = sum(strain[i] ** 2 for i in range(3, 6))
    return p.membrane * (stretch + p.hard * stretch**2) / 2 + p.bending * bending / 2


def flag(element: str, damping: float = 1e-4, *, law: bool = False) -> ff.Model:
    """A strip that swings down from its hinged end."""
    section = ff.ShellSection.isotropic(2e-3, STEEL)
    if law:
        parameters = {"membrane": 4e6, "hard": 1e4, "bending": 1.5}
        section = section.with_law(ff.ShellLaw(hardening, parameters=parameters))
        damping = 0.0
    mesh = ff.SurfaceMesh.rectangle("flag", (1.0, 0.4), (6, 3))
    model = ff.Model("flag", surface=mesh)
    tip = ff.Marker("flag", "flag_top_right")
    model.add(
        ff.Shell("flag", section, element=element, edges={"flag_left": "hinged"}, damping=damping),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Pressure("wind", "flag", 20.0, amplitude=lambda t: np.sin(40.0 * t)),
        ff.PointMass("lump", 0.3, tip),
        ff.PositionProbe("tip", tip),
        ff.ShellStrainProbe("strain", "flag", (0.5, 0.2, 0.0)),
        ff.EnergyProbe("energy"),
    )
    return model


def assert_same(found: Any, expected: Any, tolerance: float) -> None:
    """Compare histories, by groups of columns of one kind."""
    if MPI.COMM_WORLD.rank > 0:
        return
    assert list(found) == list(expected)
    groups: dict[str, float] = {}
    for name, values in expected.items():
        kind = name.rstrip("0123456789xyz")
        groups[kind] = max(groups.get(kind, 0.0), float(np.abs(values).max()))
    energy = max(size for kind, size in groups.items() if kind.startswith("energy"))
    for name, values in expected.items():
        kind = name.rstrip("0123456789xyz")
        size = energy if kind.startswith("energy") else groups[kind]
        np.testing.assert_allclose(
            found[name], values, rtol=0.0, atol=tolerance * size, err_msg=name
        )


@pytest.mark.slow_on_ranks
@ELEMENTS
@pytest.mark.parametrize("law", [pytest.param(False, marks=pytest.mark.serial), True])
def test_motions(element: str, law: bool) -> None:
    options = {"dt": 1e-3, "t_end": 0.04, "tolerance": 1e-11, "quiet": True}
    fast = ff.simulate(flag(element, law=law), ff.RunOptions(**options), comm=MPI.COMM_SELF)
    made = ff.simulate(
        flag(element, law=law), ff.RunOptions(**options, kernels="ufl", split_above=1)
    )
    assert made.status == fast.status == "ok"
    # a stress or a derivative that differs by 1e-6 of itself shows at 1e-7
    assert_same(made.history, fast.history, 1e-8)
    if MPI.COMM_WORLD.rank == 0:
        assert made.history["tip_z"][-1] < -1e-3


def cantilever(element: str) -> ff.Model:
    """A strip that bends by a fifth of its length under a force at a corner."""
    section = ff.ShellSection.isotropic(2e-3, STEEL)
    mesh = ff.SurfaceMesh.rectangle("strip", (1.0, 0.4), (6, 3))
    model = ff.Model("cantilever", surface=mesh)
    tip = ff.Marker("strip", "strip_top_right")
    model.add(
        ff.Shell("strip", section, element=element, edges={"strip_left": "clamped"}),
        ff.PointForce("pull", tip, (0.0, 0.0, 0.3)),
        ff.PositionProbe("tip", tip),
        ff.EnergyProbe("energy"),
    )
    return model


@pytest.mark.three_ranks
@ELEMENTS
def test_equilibria(element: str) -> None:
    options = {"load_steps": 3, "tolerance": 1e-9, "quiet": True}
    fast = ff.solve_static(cantilever(element), ff.StaticOptions(**options), comm=MPI.COMM_SELF)
    options |= {"kernels": "ufl", "split_above": 1}
    made = ff.solve_static(cantilever(element), ff.StaticOptions(**options))
    assert made.status == fast.status == "ok"
    assert_same(made.history, fast.history, 1e-8)  # as above
    if MPI.COMM_WORLD.rank == 0:
        assert made.history["tip_z"][-1] > 0.1


@ELEMENTS
def test_modes(element: str) -> None:
    found = [
        ff.find_modes(
            flag(element, 0.0), ff.ModeOptions(modes=4, quiet=True, kernels=kernels)
        ).modes.frequencies
        for kernels in ("fast", "ufl")
    ]
    np.testing.assert_allclose(found[1], found[0], rtol=1e-8, atol=1e-6)  # the first one is zero


def test_relaxation() -> None:
    settings = {"tolerance": 1e-3, "max_iterations": 60, "record_every": 20, "every": 60}
    outcomes = [
        ff.relax(flag("rotation_free"), ff.RelaxationOptions(**settings, kernels=k, quiet=True))
        for k in ("fast", "ufl")
    ]
    assert outcomes[0].status == outcomes[1].status
    assert_same(outcomes[1].history, outcomes[0].history, 1e-8)  # as above


def test_other_names_are_refused() -> None:
    with pytest.raises(ValueError, match="kernels must be one of fast, ufl, got 'fenics'"):
        ff.RunOptions(dt=1e-3, t_end=1.0, kernels="fenics")


@pytest.mark.slow_on_ranks
@ELEMENTS
def test_a_run_goes_on_with_other_kernels(element: str, shared_tmp_path: Path) -> None:
    options = {"dt": 1e-3, "t_end": 0.01, "tolerance": 1e-11, "quiet": True}
    whole = ff.simulate(flag(element), ff.RunOptions(**options))
    options |= {"output": shared_tmp_path, "checkpoint_every": 5}
    ff.simulate(flag(element), ff.RunOptions(**options, kernels="ufl"))
    begun = shared_tmp_path / "checkpoint_000005.h5"
    options |= {"output": None, "checkpoint_every": 0}
    rest = ff.simulate(flag(element), ff.RunOptions(**options, restart=begun))
    if MPI.COMM_WORLD.rank == 0:
        rows = len(rest.history["t"])
        assert 0 < rows < len(whole.history["t"])
        late = {name: values[-rows:] for name, values in whole.history.items()}
        # factors of thin shells are renewed at a restart: what the tolerance of Newton leaves
        assert_same(rest.history, late, 1e-6)
