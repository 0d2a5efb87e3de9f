# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contract of joints with markers on shells."""

import numpy as np
import pytest

from flexfem.lie import se3
from tests.contract.surface_examples import EXAMPLES, PlacedOnSurface

pytestmark = pytest.mark.serial
EVERY = pytest.mark.parametrize("example", EXAMPLES.values(), ids=EXAMPLES)
BOTH = pytest.mark.parametrize("both", [False, True], ids=["node", "surfaces"])


@BOTH
@EVERY
def test_start(example, both, rng):
    joint = PlacedOnSurface(example, both, rng)
    assert joint.rows.size == example.rows
    # round-off; a marker relative to another frame leaves a gap of order 0.1
    np.testing.assert_allclose(joint.evaluate(), 0.0, atol=1e-14)
    # not more unknowns than the nodes have
    np.testing.assert_array_equal(joint.rows.active_components(), 3)


@BOTH
@EVERY
def test_gradient(example, both, rng):
    joint = PlacedOnSurface(example, both, rng)
    joint.disturb(rng)
    joint.evaluate()
    expected = joint.derivative(joint.evaluate).reshape(-1, joint.count, 6)
    joint.evaluate()
    found = joint.dense(joint.rows.force_jacobian)
    # differences are good to 1e-9; a triangle that does not rotate would be of order 1 off
    np.testing.assert_allclose(found, expected, atol=1e-7)
    if both:  # shells have no unknowns of rotation
        np.testing.assert_array_equal(found[:, :, 3:], 0.0)


@BOTH
@EVERY
def test_second_derivatives(example, both, rng):
    joint = PlacedOnSurface(example, both, rng)
    joint.disturb(rng)
    factor = rng.normal(size=joint.rows.size)
    expected = joint.differenced_hessian(factor)
    # differences are good to 1e-8; what comes from the turning triangle is of order 1
    np.testing.assert_allclose(joint.hessian(factor), expected, atol=1e-6)


@BOTH
@EVERY
def test_second_rates(example, both, rng):
    joint = PlacedOnSurface(example, both, rng)
    joint.disturb(rng)
    rates = joint.differenced_rates()
    # centripetal terms left out would be of order 1
    np.testing.assert_allclose(joint.rows.second_rates(), rates, atol=1e-5)


@BOTH
@EVERY
def test_common_rigid_motion(example, both, rng):
    joint = PlacedOnSurface(example, both, rng)
    joint.disturb(rng)
    joint.evaluate()
    sums, poses = joint.rows.sums(), joint.rows.poses.copy()
    motion = se3.exp(np.array([3.0, -2.0, 1.0, 0.9, 1.4, -0.5]))
    joint.face.frames[:] = se3.compose(motion, joint.face.frames)
    joint.evaluate()
    if example.axes:
        np.testing.assert_allclose(joint.rows.poses, se3.compose(motion, poses), atol=1e-13)
    if example.rows not in (3, 5, 6):  # components in inertial axes rotate
        np.testing.assert_allclose(joint.rows.sums(), sums, atol=1e-13)


@BOTH
@EVERY
def test_reactions_balance(example, both, rng):
    """Wrenches at the markers have the resultant and the moment of the forces on the nodes."""
    joint = PlacedOnSurface(example, both, rng)
    joint.disturb(rng)
    joint.evaluate()
    rows = joint.rows
    rows.forces[:] = rng.normal(size=rows.size)
    total, found = joint.resultants()
    # moments that do not reach the nodes would be of order 1
    np.testing.assert_allclose(found, total, atol=1e-12)
