# SPDX-License-Identifier: LGPL-3.0-or-later
"""Events: located in time, carried out with the right jumps of velocity, the same on all ranks."""

import json

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem._faults import FunctionError
from flexfem.analyses.dynamics import RunOptions
from flexfem.simulation.dynamics import simulate

SCHEMES = ("generalized_alpha", "stabilized_index2")
G = 9.81


def _ball(*actions, height=1.0, once=False, direction=-1, **keywords) -> ff.Model:
    model, ball = ff.Model("ball"), ff.Marker("ball")
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("ball", 2.0, (0.1, 0.2, 0.3), position=(0, 0, height), velocity=(0.3, 0, 0)),
        ff.PointOnPlane("floor", ff.Ground(), ball, axis=(0, 0, 1)),
        ff.Event("hit", ball, lambda t, s: s.position[2], actions, once=once,
                 direction=direction, **keywords),
        ff.PositionProbe("at", ball),
    )  # fmt: skip
    model.release("floor")
    return model


def _bounces(restitution: float, end: float) -> np.ndarray:
    """Times at which a ball dropped from 1 m meets the floor."""
    times, speed = [np.sqrt(2.0 / G)], np.sqrt(2.0 * G)
    while times[-1] < end:
        speed *= restitution
        times.append(times[-1] + 2.0 * speed / G)
    return np.array(times[:-1])


def _times(outcome) -> np.ndarray:
    return np.array([event["t"] for event in outcome.summary["events"]])


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize("integrator", SCHEMES)
@pytest.mark.parametrize("policy", ["auto", "updated"])
def test_bouncing_ball(integrator, policy):
    for dt in (0.05, 0.03):
        options = RunOptions(
            dt=dt, t_end=2.4, integrator=integrator, iteration_matrix=policy, tolerance=1e-9
        )
        outcome = simulate(_ball(ff.Rebound("floor", 0.8)), options)
        assert outcome.status == "ok"
        expected = _bounces(0.8, 2.4)
        assert len(expected) == 4
        # times add the tolerance of 1e-9 s at every bounce, whatever the step; found at the ends
        # of steps they are off by 1e-2
        np.testing.assert_allclose(_times(outcome), expected, atol=2e-8)
        if outcome.history:
            t = outcome.history["t"]
            np.testing.assert_allclose(t, np.arange(len(t)) * 2.4 / (len(t) - 1), atol=1e-12)
            past = t - np.concatenate([[0.0], expected])[np.searchsorted(expected, t)]
            speed = np.sqrt(2.0 * G) * 0.8 ** np.searchsorted(expected, t)
            flight = np.where(t < expected[0], 1.0 - 0.5 * G * t**2, past * (speed - G * past / 2))
            np.testing.assert_allclose(outcome.history["at_z"], flight, atol=1e-6)
            np.testing.assert_allclose(outcome.history["at_x"], 0.3 * t, atol=1e-9)


@pytest.mark.slow_on_ranks
def test_a_ball_comes_to_rest():
    options = RunOptions(dt=0.05, t_end=2.0, tolerance=1e-9)
    outcome = simulate(_ball(ff.Rebound("floor", 0.5, rest_speed=0.02)), options)
    assert outcome.status == "ok"
    speeds = np.sqrt(2.0 * G) * 0.5 ** np.arange(1, 20)
    assert len(_times(outcome)) == int((speeds > 0.02).sum()) + 1  # the last one closes the stop
    if outcome.history:
        np.testing.assert_allclose(outcome.history["at_z"][-5:], 0.0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.serial
def test_impacts_without_end_are_a_failure():
    options = RunOptions(dt=0.05, t_end=2.0, tolerance=1e-9)
    endless = simulate(_ball(ff.Rebound("floor", 0.5)), options)
    assert endless.status.startswith('Event "hit": too many in one step at t = 1.35457 s')


@pytest.mark.three_ranks  # two of which have no body
def test_a_run_can_be_stopped(shared_tmp_path):
    options = RunOptions(dt=0.04, t_end=2.0, output=shared_tmp_path, quiet=True, tolerance=1e-9)
    outcome = simulate(_ball(ff.Stop()), options)
    end = np.sqrt(2.0 / G)
    assert outcome.status == "ok"
    MPI.COMM_WORLD.Barrier()
    summary = json.loads((shared_tmp_path / "summary.json").read_text())
    assert summary["stopped_by"] == "hit"
    assert [event["name"] for event in summary["events"]] == ["hit"]
    assert summary["events"][0]["t"] == pytest.approx(end, abs=2e-9)
    last = (shared_tmp_path / "history.csv").read_text().splitlines()[-1].split(",")
    np.testing.assert_allclose(np.array(last, dtype=float), (end, 0.3 * end, 0, 0), atol=1e-8)


@pytest.mark.three_ranks
def test_a_run_stops_after_all_events():
    # stopping at the first event, or never, gives another last row
    model = _ball(lambda mechanism: None)
    for name, height in (("half_way", 0.5), ("low", 0.2)):
        model.add(
            ff.Event(name, ff.Marker("ball"), lambda t, s, z=height: s.position[2] - z,
                     ff.Stop(after=("low", "half_way")))
        )  # fmt: skip
    outcome = _run(model, t_end=2.0)
    assert outcome.summary["stopped_by"] == "low"
    if outcome.history:
        assert outcome.history["t"][-1] == pytest.approx(np.sqrt(1.6 / G), abs=2e-9)


def _catch(where: float, flexible: bool = False, act=None, plane: float = 0.0) -> ff.Model:
    """A slider with a pendulum at its side that is caught at a position.

    The catch is a joint that holds at another one, ``plane``, m; by default it is held where it
    is. The pendulum's arm carries a small beam in its middle to have a flexible body too.
    """
    mesh = None
    if flexible:
        points = np.linspace(0.0, 1.0, 4)[:, np.newaxis] * np.array([0.1, 0.0, 0.0])
        cells = np.array([[0, 1], [1, 2], [2, 3]])
        mesh = ff.LineMesh(points, cells, {"leaf": np.arange(3)})
    model, slider = ff.Model("catch", mesh=mesh), ff.Marker("slider")
    model.add(
        ff.RigidBody("slider", 2.0, (0.1, 0.2, 0.3), velocity=(1.0, 0, 0)),
        ff.RigidBody("bob", 1.0, (0.01, 0.02, 0.03), position=(0, -1, 0), velocity=(1.0, 0, 0)),
        ff.Prismatic("rail", ff.Ground(), slider, axis=(1, 0, 0)),
        ff.Revolute("pin", slider, ff.Marker("bob", offset=(0, 1, 0)), axis=(0, 0, 1)),
        ff.PointOnPlane("catch", ff.Ground((plane, 0, 0)), slider, axis=(1, 0, 0)),
        ff.Event(
            "caught", slider, lambda t, s: s.position[0] - where, act or ff.LockJoint("catch")
        ),
        ff.PositionProbe("at", slider),
        ff.Probe("turn", ff.Marker("bob"), ("spin",), lambda t, s: (s.angular_velocity[2],)),
    )
    model.release("catch")
    if flexible:
        material = ff.Material(2.1e9, 0.3, 1000.0)
        model.add(
            ff.Beam(
                "leaf",
                ff.Section.rectangle(0.01, 0.01, material),
                velocity=(1.0, 0, 0),
                orientation=(0, 1, 0),
            ),
            ff.Rigid("clamp", slider, ff.Marker("leaf", "start")),
            ff.PositionProbe("leaf_end", ff.Marker("leaf", "end")),
        )
    return model


@pytest.mark.parametrize("integrator", SCHEMES)
@pytest.mark.parametrize("dt", [0.02, 0.013])
def test_a_locked_slider_loses_the_energy_of_the_plastic_impact(integrator, dt):
    """The bob keeps its moment of momentum about the pin: (J + m l^2) w = m l v."""
    options = RunOptions(dt=dt, t_end=0.8, integrator=integrator, tolerance=1e-9)
    outcome = simulate(_catch(0.5037), options)
    assert outcome.status == "ok"
    assert _times(outcome) == pytest.approx([0.5037], abs=2e-9)
    if outcome.history:
        t, spin = outcome.history["t"], outcome.history["spin"]
        after = t > 0.5037
        # 1/2 (J + m l^2) w^2 = (m l v)^2 / (2 (J + m l^2)) is left of 3/2: a velocity that jumps
        # by another metric than kinetic energy leaves another spin
        np.testing.assert_allclose(spin[after], 1.0 / 1.03, atol=1e-7)
        np.testing.assert_allclose(spin[~after], 0.0, atol=1e-9)
        np.testing.assert_allclose(outcome.history["at_x"][after], 0.5037, atol=5e-9)


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "policy", ["auto", *(pytest.param(p, marks=pytest.mark.serial) for p in ("frozen", "updated"))]
)
def test_locks_beside_flexible_bodies(policy):
    """All ranks do the same, and the bodies' factors outlive the event."""
    options = RunOptions(dt=0.01, t_end=0.6, iteration_matrix=policy, tolerance=1e-9)
    outcome = simulate(_catch(0.5037, flexible=True), options)
    assert outcome.status == "ok"
    assert _times(outcome) == pytest.approx([0.5037], abs=2e-8)
    if outcome.history:
        np.testing.assert_allclose(outcome.history["at_x"][-9:], 0.5037, atol=2e-8)
        # the leaf's end swings about its clamp, by less than its length
        swing = outcome.history["leaf_end_x"][-9:] - 0.6037
        assert np.abs(swing).max() < 1e-3


def _kick(t: float) -> float:
    """A pulse of 0.03 s, which asks for small steps."""
    return float(np.sin(np.pi * min(max((t - 0.093) / 0.03, 0.0), 1.0)) ** 4)


@pytest.mark.parametrize(
    "integrator",
    [
        "generalized_alpha",
        pytest.param("stabilized_index2", marks=pytest.mark.serial),
    ],
)
def test_any_number_of_ranks_gives_the_same_events(integrator):
    """Error control, an event and a flexible body; each rank alone against all together."""
    options = RunOptions(
        dt=0.02, t_end=0.52, tolerance=1e-10, integrator=integrator, adaptive=True,
        error_tolerance=1e-5,
    )  # fmt: skip
    model = _catch(0.5037, flexible=True)
    model.add(ff.PointForce("kick", ff.Marker("bob"), (50.0, 0, 0), amplitude=_kick))
    together = simulate(model, options)
    alone = simulate(model, options, comm=MPI.COMM_SELF)
    assert together.status == alone.status == "ok"
    for key in ("steps", "rejected_steps"):
        assert together.summary[key] == alone.summary[key]
    assert alone.summary["rejected_steps"] > 0
    # summation in another order; a decision taken differently on a rank would never end
    np.testing.assert_allclose(_times(together), _times(alone), atol=1e-9)
    for name, column in together.history.items():
        np.testing.assert_allclose(column, alone.history[name], atol=1e-8)


def test_a_lock_of_a_joint_is_switched_on_and_off():
    """A slider on a slope, stopped at 0.2 m by the lock of its guide and set free at 1 s."""
    model, slider = ff.Model("brake"), ff.Marker("slider")
    rail = ff.Prismatic("rail", ff.Ground(), slider, axis=(1, 0, 0))
    model.add(
        ff.Gravity((2.0, 0, 0)),
        ff.RigidBody("slider", 2.0, (0.1, 0.2, 0.3)),
        rail,
        ff.Lock("brake", joint=rail, motion="translation"),
        ff.Event("hold", slider, lambda t, s: s.position[0] - 0.2, ff.LockJoint("brake")),
        ff.Event("free", slider, lambda t, s: t - 1.003, ff.ReleaseJoint("brake")),
        ff.PositionProbe("at", slider),
    )
    outcome = simulate(model, RunOptions(dt=0.03, t_end=1.5, tolerance=1e-9))
    assert outcome.status == "ok"
    np.testing.assert_allclose(_times(outcome), (np.sqrt(0.2), 1.003), atol=2e-9)
    if outcome.history:
        t = outcome.history["t"]
        expected = np.where(t < np.sqrt(0.2), t**2, 0.2 + np.maximum(t - 1.003, 0.0) ** 2)
        np.testing.assert_allclose(outcome.history["at_x"], expected, atol=1e-7)


def test_a_joint_that_does_not_hold_is_not_closed_as_it_is_defined():
    """The catch is defined at x = 0; there it closes, at 0.3 m the slider would jump back."""
    model = _catch(0.3, act=ff.LockJoint("catch", hold=False))
    with pytest.raises(FunctionError) as caught:
        simulate(model, RunOptions(dt=0.03, t_end=0.6))
    outcome = caught.value.outcome
    told = 'Event "caught": "catch" does not hold at t = 0.3 s: it is off by 0.3 (m or rad) and'
    assert outcome.status.startswith(told)
    if outcome.history:
        assert outcome.history["t"][-1] == pytest.approx(0.3, abs=1e-8)
    model = _catch(0.3, act=ff.LockJoint("catch", hold=False), plane=0.3)
    outcome = simulate(model, RunOptions(dt=0.03, t_end=0.6))
    assert outcome.status == "ok"
    if outcome.history:
        np.testing.assert_allclose(outcome.history["at_x"][-1], 0.3, atol=1e-8)


def test_a_function_as_action():
    """An action of one's own, with a joint whose rows keep what they measure at the time."""
    seen = []

    def act(mechanism):
        seen.append(mechanism.time)
        mechanism.set_active("catch", True, hold=True)

    model = _catch(0.3)
    other = ff.Event("own", ff.Marker("slider"), lambda t, s: s.position[0] - 0.2, act)
    model.add(other)
    outcome = simulate(model, RunOptions(dt=0.03, t_end=0.6, tolerance=1e-9))
    assert outcome.status == "ok"
    assert [event["name"] for event in outcome.summary["events"]] == ["own"]
    assert seen == pytest.approx([0.2], abs=2e-9)


@pytest.mark.serial
def test_directions_and_repetition():
    """A pendulum of angular frequency 2 pi / s passes its rest position twice a second."""
    counts = {}
    for direction in (-1, 0, 1):
        for once in (True, False):
            model, wheel = ff.Model("wheel"), ff.Marker("wheel")
            model.add(
                ff.RigidBody("wheel", 1.0, (1.0, 1.0, 1.0), angular_velocity=(0, 0, 1.0)),
                ff.Revolute("pin", ff.Ground(), wheel, axis=(0, 0, 1)),
                ff.TorsionalSpringDamper("spring", ff.Ground(), wheel, axis=(0, 0, 1),
                                         stiffness=4.0 * np.pi**2),
                ff.Event("pass", wheel, lambda t, s: s.rotation[1, 0], lambda m: None,
                         direction=direction, once=once),
            )  # fmt: skip
            outcome = simulate(model, RunOptions(dt=0.01, t_end=2.75))
            counts[direction, once] = len(_times(outcome))
            # period errors of (0.01 * 2 pi)^2 / 12
            expected = np.arange(1, 6) * 0.5
            if direction:
                expected = expected[0 if direction < 0 else 1 :: 2]
            np.testing.assert_allclose(_times(outcome), expected[: 1 if once else None], atol=3e-3)
    assert [counts[direction, False] for direction in (-1, 0, 1)] == [3, 5, 2]
    assert [counts[direction, True] for direction in (-1, 0, 1)] == [1, 1, 1]


def _raises(message, build):
    with pytest.raises((TypeError, ValueError)) as caught:
        build()
    text = str(caught.value)
    assert message in text
    assert "\n" not in text


def test_bad_events():
    ball = ff.Marker("ball")

    def event(function=lambda t, s: 1.0, actions=None, markers=ball, **keywords):
        return ff.Event("e", markers, function, actions or ff.Stop(), **keywords)

    _raises('Event "e": function must be callable, got 3', lambda: event(3))
    _raises('Event "e": actions must be callable, got 3', lambda: event(actions=[3]))
    _raises('Event "e": actions must hold at least one', lambda: ff.Event("e", ball, len, []))
    _raises('Event "e": direction must be -1, 0 or 1, got 2', lambda: event(direction=2))
    _raises('Event "e": tolerance must be positive, got 0', lambda: event(tolerance=0))
    _raises('Event "e": markers must be a Marker or Ground', lambda: event(markers=["ball"]))
    _raises('Rebound of "floor": restitution must lie in [0, 1], got 1.5',
            lambda: ff.Rebound("floor", 1.5))  # fmt: skip
    _raises("Stop: after must be a list of names, got 'hit'", lambda: ff.Stop(after="hit"))
    _raises('Rebound of "floor": rest_speed must not be negative',
            lambda: ff.Rebound("floor", 0.5, -1.0))  # fmt: skip


def _run(model, **keywords):
    return simulate(model, RunOptions(**{"dt": 0.01, "t_end": 0.1, **keywords}))


def test_bad_models_with_events():
    _raises('Event "hit": Model "ball" has no joint "roof"',
            lambda: _run(_ball(ff.Rebound("roof", 0.5))))  # fmt: skip
    _raises('Event "hit": stops after "roof", which is no event',
            lambda: _run(_ball(ff.Stop(after=["roof"]))))  # fmt: skip
    model = _ball(ff.Stop())
    model.release("roof")
    _raises('Model "ball": release: Model "ball" has no joint "roof"', lambda: _run(model))
    for value, text in [
        (np.nan, 'Event "e": function must be finite at t = 0'),
        ("high", "Event \"e\": function must return a number, got 'high'"),
        ((1.0, 2.0), 'Event "e": function must return a number, got shape (2,), from lambda'),
    ]:
        model = _ball(ff.Stop())
        model.add(ff.Event("e", ff.Marker("ball"), lambda t, s, value=value: value, ff.Stop()))
        _raises(text, lambda model=model: _run(model))
    model = _ball(ff.Stop())
    model.add(ff.Event("e", ff.Marker("cube"), lambda t, s: 1.0, ff.Stop()))
    _raises('Event "e": Marker on "cube"', lambda: _run(model))


def test_bad_rebounds():
    hook, spring = ff.Marker("ball"), ff.Ground((0.0, 0.0, 2.0))
    model = _ball(ff.Rebound("pull", 0.5))
    model.add(ff.SpringDamper("pull", spring, hook, stiffness=1.0))
    model.release("pull")
    # it would cut the spring at the impact
    _raises('Event "hit": rebounds need a rigid constraint, but "pull" has', lambda: _run(model))
    closed = _ball(ff.Rebound("wall", 0.5))
    closed.add(ff.PointOnPlane("wall", ff.Ground(), hook, axis=(1, 0, 0)))
    # it would open the joint at the impact
    _raises('Event "hit": rebounds need an open joint, but "wall" is never released',
            lambda: _run(closed))  # fmt: skip
    model = _ball(ff.Stop())
    model.add(ff.Event("e", ff.Marker("ball"), lambda t: 1.0, ff.Stop()))
    _raises('Event "e": ', lambda: _run(model))


def test_a_drive_is_let_go_and_held():
    """A turntable that a motor drives; it runs free, then a brake holds it where it is."""
    disk, axis = ff.Marker("disk"), (0.0, 0.0, 1.0)
    model = ff.Model("turntable")
    model.add(
        ff.RigidBody("disk", 1.0, (0.1, 0.1, 0.2)),
        ff.Revolute("axle", ff.Ground(), disk, axis=axis),
        ff.PrescribedAngle("motor", ff.Ground(), disk, axis, lambda t: 5.0 * t * t),
        ff.Event("off", disk, lambda t, s: t - 0.0305, ff.ReleaseJoint("motor")),
        ff.Event("brake", disk, lambda t, s: t - 0.0605, ff.LockJoint("motor")),
        ff.Probe("turn", disk, ("angle",), lambda t, s: (np.arctan2(*s.rotation[1::-1, 0]),)),
    )
    for integrator in (*SCHEMES, "energy_momentum"):
        history = _run(model, integrator=integrator, rho_inf=0.9).history
        if history:
            t = history["t"]
            free = 5.0 * 0.0305**2 + 0.305 * (t - 0.0305)
            expected = np.where(t < 0.0305, 5.0 * t * t, np.minimum(free, free[0] + 0.305 * 0.0605))
            # a motor that keeps pulling the disk would put it at 0.05 rad
            np.testing.assert_allclose(history["angle"], expected, atol=3e-6)


def test_a_function_that_fails_later_ends_the_run():
    model = _ball(ff.Stop())
    model.add(
        ff.Event("e", ff.Marker("ball"), lambda t, s: 1.0 if t < 0.055 else np.nan, ff.Stop())
    )
    outcome = _run(model)
    assert outcome.status == 'Event "e": the function is not finite after t = 0.05 s'
    if outcome.history:
        assert outcome.history["t"][-1] == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("keywords", "text"),
    [
        ({"integrator": "euler"}, "integrator must be one of generalized_alpha, energy_momentum, "),
        ({"adaptive": 1}, "adaptive must be True or False, got 1"),
        ({"error_tolerance": -1e-5}, "error_tolerance must be a finite number > 0"),
        ({"error_tolerance": np.nan}, "error_tolerance must be a finite number > 0"),
    ],
)
def test_bad_options(keywords, text):
    _raises(text, lambda: RunOptions(dt=0.1, t_end=1.0, **keywords))
