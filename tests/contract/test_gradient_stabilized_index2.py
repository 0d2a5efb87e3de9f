# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions with ``stabilized_index2``: against the tangent and differences of motions.

Steps are long, so that positions are corrected by 1e-5 to 1e-2 m or rad besides what is integrated.
"""

from functools import partial

import numpy as np
import pytest

import flexfem as ff
from tests.contract.gradient_examples import (
    NUMBERS,
    PARTS,
    RUBBING,
    body,
    jointed,
    mechanism,
    rubbing,
)
from tests.contract.joint_examples import spatial_slider_crank
from tests.contract.test_gradient_steps import switched
from tests.contract.test_gradients import THROWN, agree_on_ranks, errors
from tests.verification.test_gradient_arrays import rod

CRANK = {"mass": 0.5, "gravity": 9.81, "stiffness": 100.0}


def crank(*, mass, gravity, stiffness) -> ff.Model:
    """A spatial slider-crank mechanism whose slider is on a spring."""
    model, slider = spatial_slider_crank(mass, gravity), ff.Marker("slider")
    model.add(
        ff.SpringDamper("spring", ff.Ground((0.5, 0.2, 0.0)), slider, stiffness=stiffness,
                        damping=3.0, rest_length=0.2),
        ff.PositionProbe("at", slider),
        ff.ReactionProbe("force", "pin"),
        ff.Probe("turn", ff.Marker("crank"), ("rate",), lambda t, s: (s.angular_velocity[0],)),
    )  # fmt: skip
    return model


def steps(dt, count, **others) -> ff.RunOptions:
    return ff.RunOptions(
        dt=dt, t_end=count * dt, tolerance=1e-13, integrator="stabilized_index2", **others
    )


#: Models with their numbers, columns, and steps.
MOTIONS = {
    "crank": (crank, CRANK, ["final:at_x", "mean:rate", "final:force_fy"], steps(0.02, 4)),
    "mechanism": (mechanism, PARTS, ["final:p_x", "mean:own"], steps(0.01, 4)),
    "turning drive": (partial(jointed, "PrescribedRotation"), THROWN, ["final:p1_x"],
                      steps(0.02, 4)),
    "friction": (rubbing, RUBBING, ["final:tip_x", "final:tip_z"], steps(0.02, 4)),
    "beam": (partial(body, "damped"), NUMBERS, ["final:tip_z", "mean:speed"], steps(0.015, 3)),
    "shell": (partial(body, "director"), NUMBERS, ["final:tip_z"], steps(0.015, 3)),
    "jump": (partial(switched, "se3", 0.0053), NUMBERS, ["final:tip_z", "final:lifted"],
             steps(3e-3, 4)),
}  # fmt: skip
SLOW = {
    kind: (partial(body, kind), NUMBERS, ["final:tip_z", "mean:speed"], steps(0.01, 5))
    for kind in ("nurbs", "rotation_free", "solid", "slider")
}


@pytest.mark.serial
@pytest.mark.parametrize(
    "name", [*MOTIONS, *(pytest.param(kind, marks=pytest.mark.slow) for kind in SLOW)]
)
def test_against_differences(name):
    build, numbers, of, options = {**MOTIONS, **SLOW}[name]
    found = ff.gradient(build, of, numbers, options, accuracy=1e-13, check=True)
    # derivatives of corrections that are not transposed give 1e-5, those of rates 1e-2; rounding
    # of solids leaves 1e-10
    assert max(found.check.values()) < 1e-9
    # as many as there are sizes of steps that a motion has not kept
    assert found.factorizations_backward <= 2
    # corrections that count as given are wrong by 1e-4 (crank), 1e-6 (beam, shell) or 7e-9 (jump),
    # those whose equation does not change with the start of a step by 2e-8 (crank)
    assert errors(found.gradient, build, numbers, of, options).max() < 3e-9


@pytest.mark.serial
def test_arrays_of_elements():
    """Groups of elements that change together are told apart at the neighbours as well."""
    options, values = steps(0.01, 3), np.full(8, 0.02)

    def single(**every):
        return rod([every[name] for name in sorted(every)])

    array = ff.gradient(rod, "final:z", {"heights": values}, options, accuracy=1e-13)
    numbers = {f"h{k}": value for k, value in enumerate(values)}
    apart = ff.gradient(single, "final:z", numbers, options, accuracy=1e-13)
    expected = [apart.gradient["final:z"][name] for name in numbers]
    # equations of the step that are taken for those at a neighbour give 1e-5
    np.testing.assert_allclose(
        array.gradient["final:z"]["heights"], expected, rtol=0.0, atol=1e-8 * np.ptp(expected)
    )


@pytest.mark.several_ranks
@pytest.mark.three_ranks
@pytest.mark.parametrize("name", ["crank", "beam"])
def test_ranks(name):
    """Ghosts or rows of other ranks that are left out are wrong in the first digit."""
    build, numbers, of, options = MOTIONS[name]
    agree_on_ranks(build, numbers, of[-1:], options)
