# SPDX-License-Identifier: LGPL-3.0-or-later
"""Director shells in models: motion of free shells, held edges, loads, damping, refusals."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

STEEL = ff.Material(2e9, 0.3, 7800.0)


def roof(parameters):
    angle, y = parameters.T
    return np.column_stack([np.sin(angle), y, np.cos(angle)])


def free_roof(**options):
    """A curved shell that flies and spins, with the probes of its momenta."""
    surface = ff.SurfaceMesh.grid("roof", np.linspace(-0.5, 0.5, 4), [0.0, 0.4, 0.8], roof)
    model = ff.Model("free", surface=surface)
    section = ff.ShellSection.isotropic(0.02, STEEL)
    model.add(
        ff.Shell(
            "roof", section, element="director", velocity=(1.0, 0.5, -0.3),
            angular_velocity=(3.0, -5.0, 4.0), **options,
        ),
        ff.MomentumProbe("motion"),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize("mass", [pytest.param("lumped", marks=pytest.mark.serial), "consistent"])
def test_free_flight_keeps_momenta(mass):
    outcome = ff.simulate(free_roof(mass=mass), ff.RunOptions(dt=2e-3, t_end=0.1, split_above=6))
    assert outcome.status == "ok"
    if MPI.COMM_WORLD.rank > 0:
        return
    history = outcome.history
    for name in "pl":
        values = np.column_stack([history[f"motion_{name}{axis}"] for axis in "xyz"])
        size = np.linalg.norm(values, axis=1).max()
        # what the tolerance of Newton's method leaves; forces without balance give per cents
        assert abs(values - values[0]).max() < 1e-4 * size
    # generalised-alpha damps the vibrations of the start; a wrong inertia force gives per cents
    assert abs(history["energy_balance"]).max() < 5e-3 * history["energy_kinetic"][0]


def cantilever(force, damping=0.0):
    surface = ff.SurfaceMesh.rectangle("strip", (10.0, 1.0), (16, 1))
    model = ff.Model("cantilever", surface=surface)
    section = ff.ShellSection.isotropic(0.1, ff.Material(1.2e6, 0.0, 1.0))
    model.add(
        ff.Shell(
            "strip", section, element="director", edges={"strip_left": "clamped"}, damping=damping
        ),
        ff.PositionProbe("tip", ff.Marker("strip", "strip_top_right")),
    )
    for corner in ("bottom", "top"):
        point = ff.Marker("strip", f"strip_{corner}_right")
        model.add(ff.PointForce(f"pull_{corner}", point, (0.0, 0.0, force / 2)))
    return model


def test_cantilever_with_large_rotations():
    """Sze, Liu, Lo 2004, at a quarter of the largest load."""
    outcome = ff.solve_static(cantilever(1.0), ff.StaticOptions(load_steps=2, split_above=8))
    if MPI.COMM_WORLD.rank > 0:
        return
    tip = [outcome.history[f"tip_{a}"][-1] for a in "xz"]
    # measured within 0.5 % with the force at the corners; a hinged root turns freely
    np.testing.assert_allclose([tip[0] - 10.0, tip[1]], [-0.563, 3.015], rtol=0.01)


def test_shells_of_two_elements_are_refused():
    meshes = [ff.SurfaceMesh.rectangle(name, (1.0, 1.0), (1, 1)) for name in "ab"]
    model = ff.Model("mixed", surface=ff.SurfaceMesh.join(meshes))
    section = ff.ShellSection.isotropic(0.1, STEEL)
    model.add(ff.Shell("a", section), ff.Shell("b", section, element="director"))
    with pytest.raises(ValueError, match=r'Shell "b".*all shells of a model have the same'):
        ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=1e-3))


def test_roof_on_diaphragms():
    """Scordelis, Lo (1964): weight on a roof held along x and z at its ends, deep shell 0.3008."""
    angle = np.radians(40.0)

    def surface(p):
        return np.column_stack([25.0 * np.sin(p[:, 0]), p[:, 1], 25.0 * np.cos(p[:, 0])])

    mesh = ff.SurfaceMesh.grid(
        "roof", np.linspace(0.0, angle, 7), np.linspace(0.0, 25.0, 7), surface
    )
    model = ff.Model("roof", surface=mesh)
    section, small = ff.ShellSection.isotropic(0.25, ff.Material(4.32e8, 0.0, 1.0)), 1e-3
    model.add(
        ff.Shell(
            "roof", section, element="director", fixed={"roof_top": "xz"},
            edges={"roof_left": "symmetric x", "roof_bottom": "symmetric y"},
        ),
        ff.SurfaceLoad("weight", "roof", (0.0, 0.0, -90.0 * small)),
        ff.PositionProbe("side", ff.Marker("roof", "roof_bottom_right")),
    )  # fmt: skip
    options = ff.StaticOptions(load_steps=1, quiet=True, split_above=20)
    history = ff.solve_static(model, options).history
    if history:
        sag = (history["side_z"][0] - history["side_z"][-1]) / small
        # 0.3000 on these 6 x 6 cells; directors that cannot turn at the ends: 0.26
        assert sag == pytest.approx(0.3008, rel=0.006)


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_lines_held_along_an_axis_slide_and_turn_about_it():
    """A curved shell on lines held along z that flies and spins in the plane."""
    surface = ff.SurfaceMesh.grid("roof", np.linspace(-0.5, 0.5, 3), [0.0, 0.4, 0.8], roof)
    model = ff.Model("plane", surface=surface)
    section = ff.ShellSection.isotropic(0.02, STEEL)
    lines = {f"roof_{side}": "z" for side in ("left", "right", "top", "bottom")}
    model.add(
        ff.Shell(
            "roof", section, element="director", fixed=lines, velocity=(1.0, 0.5, 0.0),
            angular_velocity=(0.0, 0.0, 5.0),
        ),
        ff.MomentumProbe("motion"),
        ff.EnergyProbe(),
    )  # fmt: skip
    options = ff.RunOptions(dt=2e-3, t_end=0.1, quiet=True, split_above=4)
    history = ff.simulate(model, options).history
    if not history:
        return
    assert history["energy_kinetic"][0] > 100.0  # J
    for name in ("px", "py", "lz"):
        values = history[f"motion_{name}"]
        # what the tolerance of the iteration leaves; held axes that turn with the shell, or
        # directors that do not turn, resist at once
        assert abs(values - values[0]).max() < 1e-4 * abs(history["motion_px"][0]), name
    assert abs(history["energy_balance"]).max() < 5e-3 * history["energy_kinetic"][0]
