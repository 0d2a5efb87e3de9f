# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of Euler–Bernoulli elements against the matrices of textbooks and other elements."""

import numpy as np
import pytest
import scipy.linalg

import flexfem as ff
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

L, B, H, E, RHO = 0.8, 0.03, 0.02, 7e10, 2700.0
SECTION = ff.Section.rectangle(H, B, ff.Material(E, 0.3, RHO))
UP = (0.0, 1.0, 0.0)


def line(elements, turn=None):
    x = np.linspace([0.0, 0.0, 0.0], [L, 0.0, 0.0], elements + 1)
    return x if turn is None else x @ turn.T


def test_one_element_is_the_classic_one():
    """Cantilever: stiffness and consistent mass of the far end, with rotary inertia."""
    body = ff.euler_bernoulli_body(line(1), SECTION, {"root": 0, "tip": 1}, orientation=UP)
    inertia, mass = B * H**3 / 12.0, RHO * B * H * L
    K, M = body.stiffness[6:, 6:], body.mass_matrix[6:, 6:]
    bending, rotary = E * inertia / L**3, RHO * inertia
    known = bending * np.array([[12.0, -6.0 * L], [-6.0 * L, 4.0 * L**2]])
    np.testing.assert_allclose(K[np.ix_([1, 5], [1, 5])], known, rtol=1e-12)
    heavy = mass / 420.0 * np.array([[156.0, -22.0 * L], [-22.0 * L, 4.0 * L**2]])
    heavy += rotary / 30.0 * np.array([[36.0 / L, -3.0], [-3.0, 4.0 * L]])
    # without rotary inertia 8e-4 would be missing
    np.testing.assert_allclose(M[np.ix_([1, 5], [1, 5])], heavy, rtol=1e-12)
    assert K[0, 0] == pytest.approx(E * B * H / L, rel=1e-12)
    assert M[0, 0] == pytest.approx(mass / 3.0, rel=1e-12)
    # the other bending plane: about e2, with the other sign of the slope
    other = E * H * B**3 / 12.0 / L**3
    assert K[2, 4] == pytest.approx(6.0 * L * other, rel=1e-12)
    assert K[2, 2] == pytest.approx(12.0 * other, rel=1e-12)


def test_nothing_is_left_out_and_axes_do_not_matter():
    """Frequencies of a cantilever of three elements: those of all nodal unknowns, in any axes."""
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    found = []
    for ends, R in (({"a": 0, "b": 3}, None), ({"b": 3, "a": 0}, turn), ({"a": 0}, turn)):
        body = ff.euler_bernoulli_body(
            line(3, R), SECTION, ends, orientation=UP if R is None else R @ UP
        )
        first = body.interface("a")
        free = np.delete(np.arange(body.size), 6 * first + np.arange(6))
        K, M = body.stiffness[np.ix_(free, free)], body.mass_matrix[np.ix_(free, free)]
        found.append(np.sqrt(scipy.linalg.eigvalsh(K, M)))
        assert body.size == 6 * 3 + 6
        assert body.mass == pytest.approx(RHO * B * H * L, rel=1e-12)
        assert body.inertia.trace() == pytest.approx(
            RHO * B * H * L * (2.0 * L**2 / 3.0 + (B**2 + H**2) / 6.0), rel=1e-12
        )
    for others in found[1:]:
        np.testing.assert_allclose(others, found[0], rtol=1e-7)
    exact = 1.8751**2 * np.sqrt(E * H**2 / 12.0 / RHO) / L**2
    # rotary inertia takes 1e-4 off; a free far end that is fixed would give 6 times as much
    assert found[0][0] == pytest.approx(exact, rel=5e-4)


def test_motion_in_a_floating_frame():
    """A pendulum that bends: the same as shear-deformable elements that are slender."""
    thin = ff.Section.rectangle(0.004, 0.01, ff.Material(E, 0.3, RHO))
    ends = {"root": 0, "tip": 3}
    unreduced = ff.euler_bernoulli_body(line(3), thin, ends, orientation=UP)
    places = {"root": (0.0, 0.0, 0.0), "tip": (L, 0.0, 0.0)}
    other = ff.reduce_body(ff.beam_body(line(3), thin, orientation=UP), places, modes=6)
    tips = []
    for reduced in (unreduced, other):
        model = ff.Model("pendulum")
        model.add(
            ff.Gravity((0.0, -9.81, 0.0)),
            ff.FloatingBody("bar", reduced),
            ff.Revolute("pin", ff.Ground(), ff.Marker("bar", "root"), axis=(0.0, 0.0, 1.0)),
            ff.PointForce("hit", ff.Marker("bar", "tip"), (0.0, 1.0, 0.0),
                          amplitude=lambda t: np.sin(60.0 * t)),
            ff.Probe("tip", (ff.Marker("bar", "root"), ff.Marker("bar", "tip")), ("u", "v"),
                     lambda t, a, b: (a.rotation.T @ (b.position - a.position))[:2]),
        )  # fmt: skip
        options = ff.RunOptions(dt=1e-3, t_end=0.1, quiet=True)
        tips.append(ff.simulate(model, options).history)
    bent = np.abs(tips[0]["v"]).max()
    assert bent > 0.01
    # shear and another number of modes are 1e-4 of it; a wrong sign of a slope would show at once
    np.testing.assert_allclose(tips[0]["v"], tips[1]["v"], atol=2e-3 * bent)
    # linear elements do not get shorter as they bend
    assert np.abs(tips[0]["u"] - L).max() < 1e-5 * bent


BAD = {
    "must be at least two": {"nodes": [[0.0, 0.0, 0.0]]},
    "orientation must not be along an element": {"orientation": (1.0, 0.0, 0.0)},
    "interfaces must hold at least one node": {"interfaces": {}},
    'node of "a" must lie in': {"interfaces": {"a": 7}},
    "nodes of interfaces must differ": {"interfaces": {"a": 0, "b": 0}},
    "interfaces must be a dictionary": {"interfaces": [0]},
    'node of "a" must be a number': {"interfaces": {"a": 0.5}},
    "section must be": {"section": 3.0},
}


@pytest.mark.parametrize("message", BAD)
def test_mistakes_are_named(message):
    given = {"nodes": line(2), "section": SECTION, "interfaces": {"a": 0}, "orientation": UP}
    with pytest.raises((ValueError, TypeError), match=message) as raised:
        ff.euler_bernoulli_body(**(given | BAD[message]))
    assert_on_page(str(raised.value))
