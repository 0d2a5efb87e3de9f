# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solutions with inverted elements are refused: closed forms of bars with linear laws."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.families.floating.elements import FloatingGroup
from tests.unit.director_triangles import rigidly
from tests.unit.particle_body import particle_body
from tests.unit.refusals import assert_on_page
from tests.unit.test_director_statics import plate

SOFT = ff.Section.circle(0.05, ff.Material(1e6, 0.3, 1e3))


def bar(push: float = 0.0, *, smooth: bool = False, turning: bool = False) -> ff.Model:
    """A soft bar from a clamp, or a hub with a drive; pushed by a multiple of its stiffness EA."""
    line = ff.NurbsCurve.line((0, 0, 0), (1, 0, 0), degree=2, elements=2) if smooth else None
    mesh = None if smooth else ff.LineMesh.straight({"bar": [(0, 0, 0), (1, 0, 0)]}, elements=4)
    model = ff.Model("bar", mesh=mesh)
    hub, end, axis = ff.Marker("bar", "start"), ff.Marker("bar", "end"), (0, 0, 1)
    model.add(ff.Beam("bar", SOFT, curve=line))
    if turning:
        model.add(
            ff.Revolute("bearing", ff.Ground(), hub, axis=axis),
            ff.PrescribedAngle("drive", ff.Ground(), hub, axis=axis),
        )
    else:
        force = (-push * SOFT.stiffness[0, 0], 0, 0)
        model.add(ff.Rigid("clamp", ff.Ground(), hub), ff.PointForce("push", end, force))
    return model


@pytest.mark.parametrize("smooth", [False, True])
def test_bars_pushed_to_nothing(smooth: bool) -> None:
    """A bar of a linear law is as long as 1 - F/EA: at 1.5 EA equilibria end at t = 2/3."""
    options = ff.StaticOptions(load_steps=2, quiet=True)
    outcome = ff.solve_static(bar(1.5, smooth=smooth), options)
    assert outcome.status.startswith('Beam "bar": an element is inverted (its size is -')
    assert_on_page(outcome.status)
    if outcome.history:
        # steps are halved twelve times; without a check the run is ok and ends at 1
        assert outcome.history["t"][-1] == pytest.approx(2.0 / 3.0, abs=1e-3)


def test_arms_that_turn_too_fast() -> None:
    """Far above the largest speed equations have solutions again, with elements of either sign.

    A linear elastic arm bears up to pi/2 sqrt(E/rho)/L = 49.7 rad/s.
    """
    options = ff.CampbellOptions(modes=1, spin=40.0, spin_end=5000.0, speeds=2, quiet=True)
    outcome = ff.sweep_spin(bar(turning=True), options)
    assert outcome.status.startswith('Beam "bar": an element is inverted (its size is -')
    assert_on_page(outcome.status)
    assert " at the spin 5000 rad/s; reduce spin to find " in outcome.status
    assert "start rest" not in outcome.status  # a rotation is always in equilibrium
    if outcome.history:
        assert outcome.history["t"].tolist() == [40.0]


def test_modes_of_loads_that_are_too_large() -> None:
    options = ff.ModeOptions(modes=1, start="equilibrium", quiet=True)
    outcome = ff.find_modes(bar(1.5), options)
    assert outcome.status.startswith('Beam "bar": an element is inverted (its size is -')
    # without a rotation the model may also be taken as it is given
    assert " in the search for the equilibrium; use start rest " in outcome.status
    assert_on_page(outcome.status)


def test_motions_are_warned_of() -> None:
    """A force put on at once compresses twice as much: 0.9 EA by more than the length."""
    options = ff.RunOptions(dt=1e-3, t_end=0.04, quiet=True)
    turned = ff.simulate(bar(0.9), options)
    (line,) = [text for text in turned.summary["warnings"] if "is inverted" in text]
    assert line.startswith('Beam "bar": an element is inverted (its size is -')
    assert_on_page(line)
    # by 0.8 of the length
    sound = ff.simulate(bar(0.4), options)
    assert not any("is inverted" in text for text in sound.summary["warnings"])


def test_directors_behind_the_surface() -> None:
    """Areas seen along directors: of a stretched plate, one rotated as a whole, a mirrored one."""
    made, frames, _, _ = plate((2, 1), "left", (1.0, 0.5), 0.01, 1e6, 0.0)
    half_turn = np.diag([-1.0, 1.0, -1.0])
    stretched, mirrored = frames.copy(), frames.copy()
    stretched[:, 0] *= 2.0
    mirrored[:, 0] *= -0.5
    for moved, expected in (
        (frames, 1.0), (stretched, 2.0), (rigidly(frames, half_turn, np.ones(3)), 1.0),
        (mirrored, -0.5),
    ):  # fmt: skip
        # exact but for rounding; lengths alone give 0.5 for the mirrored one
        np.testing.assert_allclose(made.facing(moved), expected, rtol=1e-12)


@pytest.mark.parametrize("mean_axes", [False, True])
def test_interfaces_that_change_sides(mean_axes: bool) -> None:
    """Interfaces moved by a multiple of their places at rest, about the frame."""
    body = particle_body(np.random.default_rng(1), interfaces=3, modes=3, mean_axes=mean_axes)
    group = FloatingGroup(body.data, np.zeros((2, body.nodes + 1), np.int32), np.arange(2))
    coordinates = np.zeros((2, len(body.data.stiffness), 3))
    for part, factor in zip(coordinates, (0.5, -1.5), strict=True):
        part[:18, 0].reshape(3, 6)[:, :3] = factor * body.rest
    # exact but for rounding
    np.testing.assert_allclose(group.stretches(coordinates), [1.5, -0.5], rtol=1e-12)
