# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contract of joints with markers on lines."""

import numpy as np
import pytest

from flexfem.core.laws import LawKind
from flexfem.lie import se3
from tests.contract.line_examples import FIXED, LINES, SLIDING, PlacedOnLine

pytestmark = pytest.mark.serial
EXAMPLES = SLIDING | {f"{name}-fixed": example for name, example in FIXED.items()}
EVERY = pytest.mark.parametrize("example", EXAMPLES.values(), ids=EXAMPLES)
LINE = pytest.mark.parametrize("line", LINES)


@LINE
@EVERY
def test_start(example, line, rng):
    joint = PlacedOnLine(example, line, rng)
    assert np.sum(joint.rows.joint_of_row == joint.rows.joint_of_row[-1]) == example.rows
    values = joint.evaluate()
    locked = joint.rows.switchable.any()
    if (example.rows > 1 or locked) and joint.rows.rigid.all():
        # round-off; a slider that is not found, or locked elsewhere, leaves a gap of order 0.1
        np.testing.assert_allclose(values, 0.0, atol=1e-13)


@LINE
@EVERY
def test_gradient(example, line, rng):
    joint = PlacedOnLine(example, line, rng)
    joint.disturb(rng)
    joint.rigid()
    joint.evaluate()  # the elements in which differences are taken
    expected = joint.derivative(joint.evaluate).reshape(-1, joint.count, 6)
    joint.evaluate()
    # differences are good to 1e-10; a slider fixed in place would be of order 0.1 off
    np.testing.assert_allclose(joint.dense(joint.rows.force_jacobian), expected, atol=1e-7)
    np.testing.assert_array_equal(joint.rows.step_jacobian, joint.rows.force_jacobian)


@LINE
@EVERY
def test_second_derivatives(example, line, rng):
    joint = PlacedOnLine(example, line, rng)
    joint.disturb(rng)
    joint.rigid()
    factor = rng.normal(size=joint.rows.size)
    expected = joint.differenced_hessian(factor)
    # differences are good to 1e-9; what comes from the motion along the line is of order 0.1
    np.testing.assert_allclose(joint.hessian(factor), expected, atol=2e-7)


@LINE
@EVERY
def test_second_rates(example, line, rng):
    joint = PlacedOnLine(example, line, rng)
    joint.disturb(rng)
    joint.rigid()
    rates = joint.differenced_rates()
    # centripetal terms along the line left out would be of order 1
    np.testing.assert_allclose(joint.rows.second_rates(), rates, atol=1e-6)


@LINE
@pytest.mark.parametrize("inertial", [False, True], ids=["local", "inertial"])
@pytest.mark.parametrize("name", [name for name, example in EXAMPLES.items() if example.elastic])
def test_laws_with_rates(name, line, inertial, rng):
    """Derivatives of the equations of laws while velocities follow the increments."""
    joint = PlacedOnLine(EXAMPLES[name], line, rng)
    joint.disturb(rng)
    joint.face.inertial[:] = inertial
    joint.rows.multipliers[:] = 0.02 * rng.normal(size=joint.rows.size)
    joint.evaluate()
    row = joint.rows.size - 1
    compliance = joint.rows.compliance[row]
    law = joint.rows.elastic[row].copy()
    if law[0] >= LawKind.FRICTION:  # friction's tangent is a secant: only its viscous part is exact
        joint.rows.elastic[row] = (1.0, 0.0, 0.3, 0.0, 0.0)
    expected = joint.derivative(joint.evaluate).reshape(-1, joint.count, 6)
    joint.evaluate()
    found = joint.dense(joint.rows.step_jacobian)
    assert compliance > 0.0
    scale = np.abs(expected[row]).max()
    if law[0] == LawKind.LIMIT:  # the scale of its equation changes with its slopes
        cosine = np.sum(found[row] * expected[row]) / np.linalg.norm(found[row])
        assert cosine / np.linalg.norm(expected[row]) > 0.9
        return
    # the rate's own derivative left out is of the size of the damping
    np.testing.assert_allclose(found[row], expected[row], atol=1e-6 * scale)


@LINE
@EVERY
def test_common_rigid_motion(example, line, rng):
    joint = PlacedOnLine(example, line, rng)
    joint.disturb(rng)
    joint.evaluate()
    sums, poses = joint.rows.sums(), joint.rows.poses.copy()
    motion = se3.exp(np.array([3.0, -2.0, 1.0, 0.9, 1.4, -0.5]))
    joint.move(motion)
    joint.evaluate()
    # the marker moves with the line
    np.testing.assert_allclose(joint.rows.poses, se3.compose(motion, poses), atol=1e-13)
    if example.slides:
        # a place that depends on inertial axes would move by 0.1
        np.testing.assert_allclose(joint.rows.sums(), sums, atol=1e-13)


@LINE
@EVERY
def test_reactions_balance(example, line, rng):
    """Wrenches at the markers have the resultant and the moment of those on the nodes."""
    joint = PlacedOnLine(example, line, rng)
    joint.disturb(rng)
    joint.evaluate()
    rows = joint.rows
    rows.forces[:] = rng.normal(size=rows.size)
    total, found = joint.resultants()
    # forces along the line left out would be of order 1
    np.testing.assert_allclose(found, total, atol=1e-12)
    force, moment = joint.nodal_forces()
    w, at, x = rows.reactions(rows.forces), rows.poses[:, :3], joint.face.frames[:, :3]
    slider = np.isin(rows.marker_node, [joint.count - 1])
    b = w[slider].sum(axis=0)
    arm = at[np.flatnonzero(slider)[0]] - x[-1]
    np.testing.assert_allclose(b[:3], force[-1], atol=1e-12)
    np.testing.assert_allclose(b[3:] + np.cross(arm, b[:3]), moment[-1], atol=1e-12)


@LINE
def test_force_is_at_right_angles_to_the_line(line, rng):
    """The slider's force has no part along the tangent, with sheared sections too."""
    joint = PlacedOnLine(SLIDING["Sliding"], line, rng)
    joint.disturb(rng)
    # the slider onto the line
    joint.evaluate()
    H = joint.rows.poses[0]
    joint.face.frames[-1, :3] += H[:3] - joint.rows.poses[1, :3]
    np.testing.assert_allclose(joint.evaluate(), 0.0, atol=1e-14)
    e, xi = joint.rows.lines.places[0]
    eps = 1e-6
    ends = [joint.section(joint.face.frames, int(e), xi + s * eps)[:3] for s in (1.0, -1.0)]
    tangent = (ends[0] - ends[1]) / np.linalg.norm(ends[0] - ends[1])
    gradient = joint.dense(joint.rows.force_jacobian)[:, -1, :3]
    pull = gradient @ se3.rotation(joint.face.frames[-1]).T
    axis = se3.rotation(H)[:, 0]
    assert abs(axis @ tangent) < 1.0 - 1e-4  # sections are sheared
    # along the section's plane instead it would be the angle between both, 0.01 and more
    np.testing.assert_allclose(pull @ tangent, 0.0, atol=1e-8)


@LINE
def test_passing_from_element_to_element(line, rng):
    """A slider that moves on is found in the next element, and its arc length continues."""
    joint = PlacedOnLine(SLIDING["PrescribedSlide"], line, rng)
    joint.evaluate()
    rows, version, arcs = joint.rows, joint.rows.lines.version, []
    for place in ((0, 0.95), (0, 1.0 - 1e-9), (1, 0.01), (1, 0.4), (0, 0.3)):
        joint.face.frames[-1, :3] += joint.section(joint.start, *place)[:3] - rows.poses[1, :3]
        joint.evaluate()
        e, xi = rows.lines.places[0]
        # the other element, continued, would be 0.01 away
        assert e + xi == pytest.approx(sum(place), abs=1e-8)
        arcs.append(rows.sums()[-1])
        rows.accept()
        nodes = rows.term_nodes[rows.term_start[0] :][:2].ravel()
        np.testing.assert_array_equal(nodes[: len(joint.cells[0])], joint.cells[int(e)])
    expected = np.array([0.95 * 0.8 + 0.1 * 0.95**2, 0.9, 0.9 + 0.01 - 0.2e-4, 0.9 + 0.4 - 0.032])
    np.testing.assert_allclose(arcs[:4], expected, atol=1e-8)
    assert rows.lines.version == version + 2
