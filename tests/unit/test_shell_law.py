# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws of shell sections written by the user."""

import numpy as np
import pytest
import ufl

import flexfem as ff
from flexfem.lie import se3

E, NU, H, RHO = 7e9, 0.3, 2e-3, 2000.0
LINEAR = ff.ShellSection.isotropic(H, ff.Material(E, NU, RHO))


def _isotropic(strain, p):
    """Energy of a plate with stiffness A and D, and A c/4 of the fourth power of stretch."""
    eps, kappa = ([strain[first + i] for i in range(3)] for first in (0, 3))

    def plane(e):
        return e[0] ** 2 + e[1] ** 2 + 2 * p.nu * e[0] * e[1] + (1 - p.nu) / 2 * e[2] ** 2

    return p.A / 2 * plane(eps) + p.D / 2 * plane(kappa) + p.A * p.c / 4 * eps[0] ** 4


def _viscous(strain, rate, p):
    """Dissipation of tau times the linear stiffness."""
    return p.tau * _isotropic(rate, p)


A = E * H / (1.0 - NU**2)
VALUES = {"A": A, "D": A * H**2 / 12.0, "nu": NU, "c": 0.0, "tau": 1e-4}
LAW = ff.ShellLaw(_isotropic, parameters=VALUES)


def _history(section, **arguments):
    """End of a strip that swings from a clamp, with its own damping or that of the law."""
    mesh = ff.SurfaceMesh.rectangle("strip", (0.4, 0.1), (6, 2))
    model = ff.Model("strip", surface=mesh)
    model.add(ff.Shell("strip", section, edges={"strip_left": "clamped"}, **arguments))
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    model.add(ff.PositionProbe("end", ff.Marker("strip", "strip_top_right")), ff.EnergyProbe())
    return ff.simulate(
        model, ff.RunOptions(dt=5e-3, t_end=0.05, quiet=True, tolerance=1e-10)
    ).history


ELEMENTS = pytest.mark.parametrize("element", ["rotation_free", "director"])


@ELEMENTS
def test_a_law_of_the_linear_energy_moves_like_the_section(element):
    linear, law = (_history(one, element=element) for one in (LINEAR, LINEAR.with_law(LAW)))
    for column in linear:
        # round-off of 1e-13 here; a wrong order of strains or factor of shear is off by parts of it
        assert law[column] == pytest.approx(linear[column], abs=1e-9), column


def test_dissipation_is_damping():
    damped = _history(LINEAR, damping=1e-4)
    law = ff.ShellLaw(_isotropic, dissipation=_viscous, parameters=VALUES)
    viscous = _history(LINEAR.with_law(law))
    if damped:  # the first rank has the history
        assert damped["energy_dissipation"][-1] > 1e-6  # J: there is something to compare
    for column in damped:
        # without viscous stiffness in the tangent the iteration would not converge to 1e-10; the
        # start leaves out what damping ends within a step, but not that of laws: 1.4e-7 here
        assert viscous[column] == pytest.approx(damped[column], abs=5e-7), column


@pytest.mark.serial
@ELEMENTS
def test_stretch_of_a_stiffening_sheet(element):
    stiffening = LAW.with_parameters(c=1e6, nu=0.0)
    mesh = ff.SurfaceMesh.rectangle("sheet", (1.0, 0.2), (4, 1))
    model = ff.Model("sheet", surface=mesh)
    fixed = {"sheet_left": "xz", "sheet_right": "z", "sheet_bottom_left": "y"}
    section = LINEAR.with_law(stiffening)
    options = {"fixed": fixed, "direction": (1.0, 0.0, 0.0), "element": element}
    model.add(ff.Shell("sheet", section, **options))
    strain = 2e-3
    # Green's strain of the director shell and the force along the stretched sheet
    green = strain + strain**2 / 2 if element == "director" else strain
    force = 0.2 * A * (green + 1e6 * green**3) * (1.0 + strain if element == "director" else 1.0)
    model.add(ff.EdgeLoad("pull", "sheet", "sheet_right", (force / 0.2, 0.0, 0.0)))
    model.add(ff.PositionProbe("end", ff.Marker("sheet", "sheet_top_right")))
    model.add(ff.ShellStrainProbe("amid", "sheet", (0.5, 0.1, 0.0)))
    options = ff.StaticOptions(quiet=True, tolerance=1e-12)
    outcome = ff.solve_static(model, options)
    # the force per length in the same axes; another's or a linear one differs by parts of it
    assert outcome.history["amid_eps11"][-1] == pytest.approx(green, rel=1e-6)
    resultant = A * (green + 1e6 * green**3)
    assert outcome.history["amid_n11"][-1] == pytest.approx(resultant, rel=1e-6)
    # the linear law would give five times the strain
    assert outcome.history["end_x"][-1] == pytest.approx(1.0 + strain, abs=1e-9)


@pytest.mark.parametrize(
    ("section", "arguments", "message"),
    [
        (lambda: LINEAR.with_law(LAW), {"damping": 1e-3}, "give the dissipation of its ShellLaw"),
        (
            lambda: LINEAR.with_law(ff.ShellLaw(lambda strain, p: p.none * strain[0])), {},
            'uses the parameter "none"',
        ),
        (
            lambda: LINEAR.with_law(ff.ShellLaw(lambda strain, p: -ufl.dot(strain, strain))), {},
            "stiffness at zero strain",
        ),
        (lambda: LINEAR.with_law(ff.BeamLaw(_isotropic)), {}, "law must be a ShellLaw"),
    ],
)  # fmt: skip
def test_bad_laws_are_told_in_one_line(section, arguments, message):
    with pytest.raises((ValueError, TypeError), match=message) as caught:
        _history(section(), **arguments)
    assert "\n" not in str(caught.value)


@ELEMENTS
def test_stress_is_the_derivative_of_the_energy(element):
    law = LAW.with_parameters(c=3.0)
    mesh = ff.SurfaceMesh.rectangle("sheet", (1.0, 1.0), (1, 1))
    model = ff.Model("sheet", surface=mesh)
    model.add(ff.Shell("sheet", LINEAR.with_law(law), element=element))
    from mpi4py import MPI

    from flexfem.simulation.run.setup import set_up

    _, system = set_up(model, MPI.COMM_SELF, 10)
    (part,) = system.parts
    block, rng = part.block, np.random.default_rng(3)
    block.frames[:, :3] += 0.05 * rng.standard_normal((len(block.frames), 3))
    start, direction = block.frames.copy(), rng.standard_normal((len(block.frames), 3))
    turns = se3.rotation(start)

    def inertial():
        return np.einsum("nij,nj->ni", turns, block.residual[:, :3])

    def residual(at):
        block.frames[:, :3] = start[:, :3] + at * direction
        block.residual[:] = 0.0
        part.elements.add_residual(block, np.zeros(3), 1.0)
        return inertial()

    step, energies = 1e-6, []
    slopes = (residual(step) - residual(-step)) / (2.0 * step)
    for sign in (1.0, -1.0):
        residual(sign * step)
        energies.append(part.elements.energies(block.frames).sum())
    force = residual(0.0)
    # differences have 1e-9; the linear law's stress alone would miss the fourth power by 1e-3
    slope = (energies[0] - energies[1]) / (2.0 * step)
    assert (force * direction).sum() == pytest.approx(slope, rel=1e-7)
    block.step[:], block.residual[:] = 0.0, 0.0
    block.step[:, :3] = np.einsum("nji,nj->ni", turns, direction)
    part.elements.add_action(block, np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0)
    # the same for the tangent of the law
    np.testing.assert_allclose(inertial(), slopes, atol=1e-6 * abs(slopes).max())
