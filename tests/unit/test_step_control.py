# SPDX-License-Identifier: LGPL-3.0-or-later
"""Decisions on the step size, by themselves."""

import pytest

from flexfem.simulation.motion.step_control import HALVINGS, StepControl

pytestmark = pytest.mark.serial


def _walk(control: StepControl, outcome) -> list[float]:
    """Parts of one largest step; ``outcome(at, size)`` is None or the error, to be judged."""
    control.begin()
    parts, at = [], 0.0
    while not control.done:
        size = control.part
        assert control.end == at + size
        error = outcome(at, size)
        if error is None or (control.tolerance is not None and error > control.tolerance):
            assert control.refused(error)
            continue
        control.accepted(error)
        parts.append(size)
        at += size
    assert at == 1.0
    return parts


def test_without_error_control_steps_are_as_large_as_the_grid_allows():
    control = StepControl(None, 2)
    assert _walk(control, lambda at, size: 0.0) == [1.0]
    # fails where a step covers 0.3 and is longer than an eighth
    hard = _walk(control, lambda at, size: None if at < 0.3 < at + size and size > 0.125 else 0.0)
    assert hard == [0.25, 0.125, 0.125, 0.5]
    assert _walk(control, lambda at, size: 0.0) == [1.0]


def test_failures_end():
    control = StepControl(None, 2)
    control.begin()
    for _ in range(HALVINGS):
        assert control.refused()
    assert not control.refused()


def test_steps_follow_the_error_and_stay_on_their_grids():
    control = StepControl(1e-6, 2)
    # local error 1e-3 h^3 until half of the third step, then nothing
    steps = [_walk(control, lambda at, size: 1e-3 * size**3) for _ in range(2)]
    assert set(steps[1]) == {0.0625}  # 1e-3/16^3 = 2.4e-7; an eighth has 2e-6
    third = _walk(control, lambda at, size: 1e-3 * size**3 if at < 0.5 else 0.0)
    at = 0.0
    for size in third:
        assert at % size == 0.0
        at += size
    assert third[:8] == [0.0625] * 8
    # three good steps before each doubling, and then on the doubled grid only
    assert third[8:] == [0.0625] * 4 + [0.125] * 2
    fourth = _walk(control, lambda at, size: 0.0)
    assert fourth == [0.125] * 2 + [0.25] * 3


def test_steps_are_doubled_after_three_good_ones():
    """The first sixteenth takes two small steps that are not good, all others have no error."""
    control = StepControl(1e-6, 2)
    steps = _walk(control, lambda at, size: 3.6e-3 * size**3 if at < 0.0625 else 0.0)
    # after two in a row they would be doubled at 1/8 already, after four those of 1/16 at 1/2 only
    assert steps == [0.03125] * 6 + [0.0625] * 3 + [0.125] * 3 + [0.25]


def test_large_errors_skip_sizes():
    control = StepControl(1e-6, 2)
    control.begin()
    control.refused(1e-6 * 8.0**2)
    assert control.part == 0.125  # the estimate and the safety ask for an eighth
    control.refused(1.0)
    assert control.part == 0.125 / 8.0  # at most three halvings at once
    control.refused(None)
    assert control.part == 0.125 / 16.0
