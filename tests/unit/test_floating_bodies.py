# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in floating frames in a model: data, nodes, markers, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

import flexfem as ff
from flexfem.families.floating.elements import FloatingGroup
from flexfem.families.floating.nodes import body_data
from tests.unit.particle_body import bar
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial


@pytest.fixture(scope="module")
def beam():
    """A bar with two ends and four modes."""
    return bar()


def test_integrals_count_from_the_frame(beam):
    """Those of a body clamped at its far end equal those of the reversed body."""
    far = body_data(ff.FloatingBody("bar", beam, frame="right"))
    near = body_data(ff.FloatingBody("bar", beam, frame="left"))
    n = len(near.stiffness)
    second = far.products.reshape(3, 3, n + 1, n + 1)[:, :, 0, 0]
    mass, length = beam.mass, 1.0
    # positions from the far end; a wrong sign of the shift would give 7/3 for 1/3
    assert far.moments[0, 0] == pytest.approx(-0.5 * mass * length, rel=1e-9)
    assert second[0, 0] == pytest.approx(mass * length**2 / 3.0, rel=1e-9)
    turned = near.products.reshape(3, 3, n + 1, n + 1)[:, :, 0, 0]
    assert second == pytest.approx(turned, rel=0, abs=1e-12)
    # a rod moved by its end takes 3 EI/L^3, whichever end that is
    assert np.linalg.eigvalsh(far.stiffness) == pytest.approx(
        np.linalg.eigvalsh(near.stiffness), rel=1e-7
    )


@pytest.mark.parametrize("frame", ["right", "mean_axes"])
def test_second_order_displacements_do_the_work_they_should(frame):
    """The work of uniform and linear accelerations is that of the reduced data."""
    reduced = bar(stiffening=True, modes=2)
    body = ff.FloatingBody("bar", reduced, frame=frame, stiffening=True)
    data, own = body_data(body), body.coordinates
    n = len(own)
    eta = np.random.default_rng(3).normal(size=n)
    zeta = 0.5 * np.einsum("kij,i,j->k", data.bending.reshape(12, n, n), eta, eta)
    every = np.concatenate([np.zeros(n + 1), zeta])
    work = 0.5 * np.einsum("kij,i,j->k", reduced.acceleration_stiffness[:, own][..., own], eta, eta)
    about_frame = work[3:].reshape(3, 3) - np.outer(work[:3], body.origin)
    linear = data.products.reshape(3, 3, n + 13, n + 13)[:, :, 0] @ every
    scale = np.abs(work).max()
    # a wrong order of axes or fields is off by the size of the work
    assert data.moments @ every == pytest.approx(work[:3], rel=0, abs=1e-8 * scale)
    found = linear.T
    assert found == pytest.approx(about_frame, rel=0, abs=1e-8 * scale)


@pytest.mark.parametrize("stiffening", [False, True])
def test_a_bar_bent_to_an_arc_is_not_pulled(stiffening):
    """Stresses follow from coordinates less the shortening by bending."""
    body = ff.FloatingBody("bar", bar(stiffening=True, modes=0), stiffening=stiffening)
    group = FloatingGroup(body_data(body), np.zeros((1, 2), dtype=np.int32), np.zeros(1))
    angle = 0.1
    arc = np.zeros((1, 6))
    arc[0, [0, 1, 5]] = np.sin(angle) / angle - 1.0, (1.0 - np.cos(angle)) / angle, angle
    shortening = angle**2 / 6.0
    strains = group.strains(arc)
    # the next term of the series is angle^2/20 of it
    left = 0.0 if stiffening else -shortening
    assert strains[0, 0] == pytest.approx(left, rel=0, abs=2e-3 * shortening)
    # bending is as it was
    assert strains[0, 1:] == pytest.approx(arc[0, 1:], rel=0, abs=1e-3 * angle)


def test_mean_axes_are_at_the_centre_and_meet_rigid_motions(beam):
    """A rigid displacement is its own mean."""
    body = ff.FloatingBody("bar", beam, frame="mean_axes")
    data = body_data(body)
    assert body.origin == pytest.approx([0.5, 0.0, 0.0], abs=1e-12)
    about_centre = beam.rigid_motions.copy()
    about_centre[:, 3:] -= about_centre[:, :3] @ np.array(
        [[0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, -0.5, 0.0]]
    )
    # a mean about the body's origin instead of its centre would be off by a half
    assert data.conditions @ about_centre == pytest.approx(np.eye(6), rel=0, abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"frame": "top"}, 'frame must be one of left, right, mean_axes, got "top"'),
        ({"stiffening": True}, "no data for geometric stiffening"),
        ({"position": (0.0, 1.0)}, "position must hold 3 numbers"),
        ({"rotation": np.ones((3, 3))}, "rotation"),
        ({"velocity": (np.nan, 0.0, 0.0)}, "velocity"),
    ],
)
def test_bad_bodies(beam, arguments, words):
    with pytest.raises(ValueError, match=words) as raised:
        ff.FloatingBody("bar", beam, **arguments)
    assert_on_page(str(raised.value))


def test_bad_types(beam):
    with pytest.raises(TypeError, match="reduced must be a ReducedBody"):
        ff.FloatingBody("bar", "bar.h5")
    with pytest.raises(TypeError, match="stiffening"):
        ff.FloatingBody("bar", beam, stiffening="yes")


@pytest.mark.parametrize(
    ("frame", "marker", "words"),
    [
        ("left", ff.Marker("bar", "top"), 'no interface "top"; it has left, right'),
        ("left", ff.Marker("bar", 0.5), "no interface"),
        ("mean_axes", ff.Marker("bar"), "the mean axes carry no marker"),
        ("left", ff.AmplitudeMarker("bar", 4), "there is no amplitude 4, it has 4"),
    ],
)
def test_bad_markers(beam, frame, marker, words):
    model = ff.Model("m")
    model.add(ff.FloatingBody("bar", beam, frame=frame), ff.PositionProbe("p", marker))
    with pytest.raises(ValueError, match=words) as raised:
        model.validate()
    assert_on_page(str(raised.value))


def test_bad_amplitude():
    with pytest.raises(ValueError, match="number"):
        ff.AmplitudeMarker("bar", -1)
    with pytest.raises(TypeError, match="number"):
        ff.AmplitudeMarker("bar", 0.5)


def test_energy_momentum_is_refused(beam):
    model = ff.Model("m")
    model.add(ff.FloatingBody("bar", beam))
    options = ff.RunOptions(dt=1e-3, t_end=1e-2, integrator="energy_momentum", quiet=True)
    with pytest.raises(ValueError, match=r'FloatingBody "bar": the integrator energy_momentum'):
        ff.simulate(model, options)


def test_bodies_of_one_kind_share_their_integrals(beam):
    """Others have their own."""
    from flexfem.families.floating.nodes import FloatingNodes

    same = [ff.FloatingBody(name, beam) for name in "ab"]
    other = ff.FloatingBody("c", replace(beam, recovery=None))
    turned = ff.FloatingBody("d", beam, frame="right")
    assert FloatingNodes([same[0], other, same[1], turned]).kinds == [[0, 2], [1], [3]]
