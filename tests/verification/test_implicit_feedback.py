# SPDX-License-Identifier: LGPL-3.0-or-later
"""Feedback of continuous laws acts implicitly: as springs and dampers of its gains do."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import pyvista

import flexfem as ff
from tests.histories import columns

PROPORTIONAL, DERIVATIVE, TARGET = 300.0, 20.0, 0.4
AXIS = (0.0, 1.0, 0.0)


def angle(t: float, root: ff.MarkerState) -> tuple[float, float]:
    """Angle of the root about y, and its rate."""
    return np.arctan2(-root.rotation[2, 0], root.rotation[0, 0]), root.angular_velocity[1]


def arm(kind: str, more: Any = None, *, resting: bool = False) -> ff.Model:
    """Two links, the first one flexible, whose light root a motor holds at an angle.

    It rests at the start without weight and with the angle zero, and is then pushed.
    """
    lines = {"arm": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], "hand": [(1.0, 0.0, 0.0), (1.5, 0.0, 0.0)]}
    section = ff.Section.circle(0.02, ff.Material(7e10, 0.3, 2700.0))
    model = ff.Model("arm", mesh=ff.LineMesh.straight(lines, 4))
    root, tip = ff.Marker("arm", "start"), ff.Marker("hand", "start")
    push = ff.PointForce(
        "push", ff.Marker("hand", "end"), (0.0, 0.0, 50.0), amplitude=lambda t: np.sin(40.0 * t)
    )  # fmt: skip
    model.add(
        push if resting else ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("arm", section, damping=1e-4), ff.Beam("hand", section, damping=1e-4),
        ff.Revolute("shoulder", ff.Ground(), root, axis=AXIS),
        ff.Revolute("elbow", ff.Marker("arm", "end"), tip, axis=AXIS),
        ff.Probe("turn", root, ("angle", "rate"), angle, unwrap=["angle"]),
        ff.PositionProbe("tip", ff.Marker("hand", "end")),
        ff.EnergyProbe(),
    )  # fmt: skip
    if kind == "spring":
        gains = {"stiffness": PROPORTIONAL, "damping": DERIVATIVE}
        gains["rest_angle"] = 0.0 if resting else TARGET
        model.add(ff.TorsionalSpringDamper("motor", ff.Ground(), root, axis=AXIS, **gains))
    else:
        model.add(ff.Actuator("motor", ff.Ground(), root, axis=AXIS))
        given = {"sample_time": 2e-3} if kind == "sampled" else {}
        model.add(ff.Controller("pd", ["angle", "rate"], ["motor"], more or gains_of, **given))
    model.add(ff.ReactionProbe("torque", "motor"))
    return model


def gains_of(t: float, y: np.ndarray, target: float = TARGET) -> float:
    """Proportional and derivative feedback."""
    return PROPORTIONAL * (target - y[0]) - DERIVATIVE * y[1]


def hold(t: float, y: np.ndarray) -> float:
    """The same about the angle zero."""
    return gains_of(t, y, target=0.0)


@pytest.mark.slow_on_ranks
def test_gains_act_as_a_spring_and_a_damper() -> None:
    """On a node of 1e-5 kg m^2 and with a step at which forces of the last step grow without bound.

    The same equations, and the same start where nothing acts; dampers let the root have the rate
    that a force gives it at once, of which feedback tells nothing. A rate of the step before moves
    the tip by 1e-3 m.
    """
    options = ff.RunOptions(dt=2e-3, t_end=0.1, tolerance=1e-10, quiet=True)
    wanted = columns(ff.simulate(arm("spring", resting=True), options))
    found = columns(ff.simulate(arm("feedback", hold, resting=True), options))
    for name in ("angle", "tip_x", "tip_z", "torque_my"):
        scale = np.abs(wanted[name]).max()
        np.testing.assert_allclose(found[name], wanted[name], atol=1e-7 * scale, err_msg=name)
    # what the history says of the controller is what has acted
    np.testing.assert_allclose(found["pd_motor"], found["torque_my"], atol=1e-6)
    feedback = arm("feedback", hold, resting=True)
    alone = ff.simulate(feedback, options, comm=MPI.COMM_SELF).history
    for name in ("angle", "tip_z", "torque_my", "energy_work"):
        scale = np.abs(alone[name]).max()
        np.testing.assert_allclose(found[name], alone[name], atol=1e-9 * scale, err_msg=name)


@pytest.mark.serial
def test_a_damper_gives_the_rate_of_its_force_at_once() -> None:
    """Of second order: half a step late, the angle is off by 2e-3, and by half of it with half."""
    angles = [
        ff.simulate(arm("spring"), ff.RunOptions(dt=dt, t_end=0.02, quiet=True)).history["angle"]
        for dt in (2e-3, 1e-3, 2.5e-4)
    ]
    first, second = (abs(own[-1] - angles[-1][-1]) for own in angles[:2])
    assert first < 1e-3
    assert second < first / 3.0


@pytest.mark.serial
def test_the_work_of_feedback_is_in_the_balance() -> None:
    """Of second order in the step; left out, the balance is off by all of the work."""
    begin = ff.SmoothStep(0.0, 0.3)

    def law(t: float, y: np.ndarray) -> float:
        return PROPORTIONAL * (TARGET * begin(t) - y[0]) - DERIVATIVE * y[1]

    options = ff.RunOptions(dt=2e-3, t_end=0.3, quiet=True)
    found = columns(ff.simulate(arm("feedback", law), options))
    assert np.abs(found["energy_balance"]).max() < 1e-3 * np.abs(found["energy_work"]).max()


@pytest.mark.slow
@pytest.mark.serial
def test_explicit_feedback_does_not_hold_it() -> None:
    """What the other test is about: the same gains, sampled, do not settle."""
    outcome = ff.simulate(arm("sampled"), ff.RunOptions(dt=2e-3, t_end=0.3, quiet=True))
    said = " ".join(outcome.summary["warnings"])
    assert 'Controller "pd": output "motor": its force alternates' in said
    lost = outcome.status != "ok" or np.abs(outcome.history["rate"]).max() > 1e3
    assert lost


@pytest.mark.serial
def test_pictures_show_what_acts_where(shared_tmp_path: Path) -> None:
    """The motor between its own markers, and a force at one marker there, not at measured ones."""
    model = arm("feedback")
    hand = ff.Marker("hand", 0.5)
    model.add(ff.Force("push", [hand], lambda t, ends, z: np.array([[0.0, 0.0, 3.0]])))
    options = ff.RunOptions(dt=2e-3, t_end=4e-3, output=shared_tmp_path, quiet=True)
    ff.simulate(model, options)
    if MPI.COMM_WORLD.rank == 0:
        picture = pyvista.read(sorted(shared_tmp_path.glob("**/joints_*.vtu"))[0])
        centres = picture.cell_centers().points
        for name, size, place in (
            ("force_magnitude", 3.0, 1.25), ("moment_magnitude", 120.0, 0.0),
        ):  # fmt: skip
            shown = np.isclose(picture[name], size, rtol=1e-3)
            # the size of a glyph; the joints are 0.5 m apart
            assert np.abs(centres[shown] - (place, 0.0, 0.0)).max() < 0.1, name
            assert shown.any(), name
