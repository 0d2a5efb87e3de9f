# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beads on stiff wires, whose motion along the wire has a closed form."""

import numpy as np
import pytest

import flexfem as ff

pytestmark = pytest.mark.serial  # wire and bead are on one rank in any case
G, MASS, RADIUS = 9.81, 0.7, 0.8
SLOPE = 0.6
ALONG = np.array([np.cos(SLOPE), 0.0, -np.sin(SLOPE)])
WIRE = ff.Section.rectangle(0.1, 0.1, ff.Material(1e11, 0.3, 1000.0))
FORMULATIONS = pytest.mark.parametrize("formulation", ["nurbs", "se3"])


def _straight(formulation: str, elements: int = 5) -> tuple[ff.LineMesh | None, ff.Beam]:
    """A wire of 2 m down the slope from the origin."""
    if formulation == "nurbs":
        line = ff.NurbsCurve.line((0, 0, 0), 2.0 * ALONG, degree=2, elements=elements)
        return None, ff.Beam("wire", WIRE, curve=line, orientation=(0, 1, 0))
    points = np.linspace(0.0, 2.0, elements + 1)[:, np.newaxis] * ALONG
    cells = np.stack([np.arange(elements), np.arange(1, elements + 1)], axis=1)
    mesh = ff.LineMesh(points, cells, {"wire": np.arange(elements)})
    return mesh, ff.Beam("wire", WIRE, orientation=(0, 1, 0))


def _curved(curve: ff.NurbsCurve) -> tuple[None, ff.Beam]:
    return None, ff.Beam("wire", WIRE, curve=curve)


def _bead(
    wire: tuple[ff.LineMesh | None, ff.Beam], position, *more, velocity=(0, 0, 0), spin=(0, 0, 0),
    gravity=G, tied=False, inertia=(0.02, 0.03, 0.04),
) -> ff.Model:  # fmt: skip
    """A body that slides on a wire held at both ends; ``more`` may be functions of the joint."""
    mesh, beam = wire
    slide = ff.Sliding("slide", ff.Carrier("wire"), ff.Marker("bead"), tied=tied)
    ends = [ff.Marker("wire", end) for end in ("start", "end")]
    curve = beam.curve
    places = mesh.points[[0, -1]] if mesh is not None else curve.points[[0, -1]]
    model = ff.Model("bead", mesh=mesh)
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        beam,
        ff.RigidBody("bead", MASS, inertia, position=position, velocity=velocity,
                     angular_velocity=spin),
        ff.Rigid("first", ff.Ground(places[0]), ends[0]),
        ff.Rigid("last", ff.Ground(places[1]), ends[1]),
        slide,
        *(part(slide) if callable(part) else part for part in more),
        ff.Probe("path", ff.SlidingMarker("slide"), ("zeta", "rate"),
                 lambda t, s: (s.arc, s.arc_rate)),
        ff.EnergyProbe("energy"),
        ff.ReactionProbe("force", "slide"),
    )  # fmt: skip
    return model


def _run(model: ff.Model, **more):
    settings = {"dt": 1e-2, "t_end": 0.6, "tolerance": 1e-9, "quiet": True, "rho_inf": 0.6}
    outcome = ff.simulate(model, ff.RunOptions(**(settings | more)))
    assert outcome.status == "ok", outcome.status
    return outcome


def _columns(history, *names):
    return [history[name] for name in names]


@FORMULATIONS
@pytest.mark.parametrize("coefficient", [0.0, 0.3])
def test_bead_on_a_slope(formulation, coefficient):
    """Constant acceleration g (sin - mu cos), through all elements of the wire."""
    more = []
    if coefficient:
        more = [lambda slide: ff.JointFriction("rub", slide, coefficient=coefficient)]
    model = _bead(_straight(formulation), 0.1 * ALONG, *more, velocity=0.5 * ALONG)
    history = _run(model).history
    t, zeta, rate, balance = _columns(history, "t", "zeta", "rate", "energy_balance")
    a = G * (np.sin(SLOPE) - coefficient * np.cos(SLOPE))
    # the wire gives way by 1e-6 m; another slope in one of the elements would be off by 1e-2
    np.testing.assert_allclose(zeta, 0.1 + 0.5 * t + 0.5 * a * t**2, atol=2e-5)
    # the wire trembles, as gravity falls upon it; a rate by another coordinate is off by tenths
    np.testing.assert_allclose(rate, 0.5 + a * t, atol=5e-3)
    # of 4 J: the forces of the first steps swing, too; work of friction left out is of order 1
    assert np.abs(balance).max() < 2e-3
    # the wire presses at right angles; N without the cosine is off by a fifth
    force = np.array(_columns(history, "force_fx", "force_fy", "force_fz"))[:, -1]
    normal = MASS * G * np.cos(SLOPE) * np.array([np.sin(SLOPE), 0.0, np.cos(SLOPE)])
    np.testing.assert_allclose(force, normal, atol=1e-2)


def test_bead_on_a_helix():
    """Constant acceleration along the wire by its slope, over one and a half turns."""
    pitch, angle = -3.0, 3.0 * np.pi
    curve = ff.NurbsCurve.helix(
        (0, 0, 0), (RADIUS, 0, 0), (0, 0, 1), angle, pitch, degree=4, elements=36
    )
    way = np.hypot(RADIUS, pitch / (2.0 * np.pi))
    a, errors = G * -pitch / (2.0 * np.pi * way), []
    for dt in (2e-2, 1e-2):
        history = _run(_bead(_curved(curve), (RADIUS, 0, 0)), t_end=1.8, dt=dt, rho_inf=0.9).history
        t, zeta = _columns(history, "t", "zeta")
        errors.append(np.abs(zeta - 0.5 * a * t**2).max())
    assert 0.9 * angle * way < zeta[-1] < angle * way
    # of 8 m, at up to 10 rad/s
    assert errors[1] < 0.012
    # second order: nothing is left that does not fall with the step
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


def _ring(**keywords) -> ff.Model:
    """A bead at rest on a ring in the plane XZ, 1 rad from the lowest point."""
    start, at = (RADIUS * np.array([-np.sin(a), 0.0, -np.cos(a)]) for a in (1.2, 1.0))
    curve = ff.NurbsCurve.arc((0, 0, 0), start, (0, -1, 0), 2.4, degree=3, elements=12)
    slider = ff.SlidingMarker("slide")
    return _bead(
        _curved(curve), at,
        ff.Event("bottom", slider, lambda t, s: s.position[0], ff.Stop()),
        ff.Probe("axes", (slider, ff.Marker("bead")), [f"r{i}" for i in range(9)],
                 lambda t, a, b: (a.rotation.T @ b.rotation).ravel()),
        **keywords,
    )  # fmt: skip


def _quarter(inertia: float) -> float:
    """Time from 1 rad to the lowest point by the arithmetic-geometric mean."""
    a, b = 1.0, np.cos(0.5)
    for _ in range(6):
        a, b = 0.5 * (a + b), np.sqrt(a * b)
    return float(0.5 * np.pi * np.sqrt(RADIUS / G * (1.0 + inertia / (MASS * RADIUS**2))) / a)


@pytest.mark.parametrize("integrator", ["generalized_alpha", "stabilized_index2"])
@pytest.mark.parametrize("tied", [False, True])
def test_bead_on_a_ring(tied, integrator):
    """A pendulum; tied to the section, the bead turns with it, and its inertia slows it down."""
    inertia = (0.06, 0.1, 0.05)
    outcome = _run(_ring(tied=tied, inertia=inertia), t_end=1.0, dt=5e-3, integrator=integrator)
    (event,), history = outcome.summary["events"], outcome.history
    # the scheme's error; with the inertia of the other kind 0.05 s
    assert event["t"] == pytest.approx(_quarter(inertia[1] if tied else 0.0), abs=5e-5)
    axes = np.array([history[f"r{i}"] for i in range(9)])
    change = float(np.abs(axes - axes[:, :1]).max())
    # tied: round-off; free: it stands still while the section turns by 1 rad
    assert change == pytest.approx(0.0 if tied else np.sin(1.0), abs=1e-9 if tied else 1e-6)
    # of 3.2 J; a force with a part along the ring would do work
    assert np.abs(history["energy_balance"]).max() < 5e-4
    # weight and centripetal force once the first swing is over; without the latter off by a half
    angle = 1.0 - (history["zeta"] - history["zeta"][0]) / RADIUS
    force = MASS * (G * np.cos(angle) + history["rate"] ** 2 / RADIUS)
    found = np.linalg.norm(_columns(history, "force_fx", "force_fy", "force_fz"), axis=0)
    np.testing.assert_allclose(found[50:-1], force[50:-1], rtol=1e-2)


def test_stops_at_both_ends():
    """Half a period of the spring at each stop, the speed reversed, the energy kept."""
    k, speed = 2e3, 1.5
    model = _bead(
        _straight("nurbs"), 1.2 * ALONG,
        lambda slide: ff.SlideStop("stop", slide, lower=0.5, upper=1.5, stiffness=k),
        velocity=speed * ALONG, gravity=0.0,
    )  # fmt: skip
    history = _run(model, t_end=1.2, dt=4e-3, rho_inf=1.0).history
    t, zeta, kinetic = _columns(history, "t", "zeta", "energy_kinetic")
    contact = np.pi * np.sqrt(MASS / k)
    first, second = 0.3 / speed, 0.3 / speed + contact + 1.0 / speed
    back, forth = (t > first + contact) & (t < second), t > second + contact
    assert min(back.sum(), forth.sum()) > 50
    # steps that begin beside a stop and end beyond it: a part of the step; without a stop the bead
    # would be 0.5 m away
    expected = 1.5 - speed * (t[back] - first - contact)
    np.testing.assert_allclose(zeta[back], expected, atol=speed * 4e-3)
    expected = 0.5 + speed * (t[forth] - second - contact)
    np.testing.assert_allclose(zeta[forth], expected, atol=2.0 * speed * 4e-3)
    assert zeta.max() == pytest.approx(1.5 + speed * np.sqrt(MASS / k), abs=1e-3)
    # steps over the stop's kink; a stop that pulls on the way out takes all of it
    np.testing.assert_allclose(kinetic[back | forth], kinetic[0], rtol=2e-2)


def test_damped_stop_keeps_the_bead():
    """At rest where the stop carries the weight, beyond the end of the wire."""
    model = _bead(
        _straight("se3"), 1.8 * ALONG,
        lambda slide: ff.SlideStop("stop", slide, upper=2.0, stiffness=2e3, damping=40.0),
    )  # fmt: skip
    history = _run(model, t_end=1.0).history
    # of 1.9 mm
    assert history["zeta"][-1] - 2.0 == pytest.approx(MASS * G * np.sin(SLOPE) / 2e3, rel=1e-2)
    lost = MASS * G * np.sin(SLOPE) * 0.2
    assert history["energy_dissipation"][-1] == pytest.approx(lost, rel=5e-2)


def test_driven_bead():
    """zeta is the given function; the drive carries weight and inertia along the wire."""

    def motion(t: float) -> float:
        return 0.9 + 0.4 * float(np.sin(5.0 * t))

    model = _bead(
        _straight("se3"), 0.9 * ALONG,
        lambda slide: ff.PrescribedSlide("drive", slide, zeta=motion),
        ff.ReactionProbe("pull", "drive"),
        velocity=2.0 * ALONG,
    )  # fmt: skip
    history = _run(model, t_end=0.8, rho_inf=0.5).history
    t, zeta = _columns(history, "t", "zeta")
    # held by the last iteration
    np.testing.assert_allclose(zeta, [motion(x) for x in t], atol=1e-9)
    pull = np.array(_columns(history, "pull_fx", "pull_fy", "pull_fz"))
    along = MASS * (-10.0 * np.sin(5.0 * t) - G * np.sin(SLOPE))
    # from when the first swing of the wire is over; of up to 11 N, second order of the step
    np.testing.assert_allclose(pull[:, 30:], np.outer(ALONG, along[30:]), atol=2e-2)


@FORMULATIONS
def test_lock_at_a_place(formulation):
    """Held from 1 m on by an event, and let go again later, from rest."""
    slider, a = ff.SlidingMarker("slide"), G * np.sin(SLOPE)
    model = _bead(
        _straight(formulation), 0.1 * ALONG,
        lambda slide: ff.Lock("lock", slide),
        ff.Event("there", slider, lambda t, s: s.arc - 1.0, ff.LockJoint("lock"), once=True),
        ff.Event("go", ff.Ground(), lambda t, s: t - 0.8, ff.ReleaseJoint("lock")),
    )  # fmt: skip
    outcome = _run(model, t_end=1.2, rho_inf=0.5)
    assert [event["name"] for event in outcome.summary["events"]] == ["there", "go"]
    reached = outcome.summary["events"][0]["t"]
    # the wire gives way; at the ends of steps it would be off by 1e-3
    assert reached == pytest.approx(np.sqrt(1.8 / a), abs=1e-5)
    t, zeta = _columns(outcome.history, "t", "zeta")
    # the place at the time found, of 3 m/s
    np.testing.assert_allclose(zeta[(t > reached) & (t < 0.8)], 1.0, atol=1e-7)
    free = t > 0.8
    # a lock that keeps a part of the velocity, or of its force, would be off by 0.1
    np.testing.assert_allclose(zeta[free], 1.0 + 0.5 * a * (t[free] - 0.8) ** 2, atol=1e-5)


@FORMULATIONS
def test_statics_on_a_slope(formulation):
    """The weight stretches a spring along the wire; a weak one lets the bead go."""

    def hung(stiffness: float) -> ff.Model:
        spring = ff.SpringDamper("spring", ff.Ground(), ff.Marker("bead"), stiffness=stiffness)
        return _bead(_straight(formulation), ALONG, spring, tied=True)

    options = ff.StaticOptions(load_steps=4, gravity_load="proportional", quiet=True)
    held = ff.solve_static(hung(20.0), options)
    assert held.status == "ok"
    # the wire gives way; the weight without the sine would be 0.15 m off
    way = MASS * G * np.sin(SLOPE) / 20.0
    assert held.history["zeta"][-1] == pytest.approx(1.0 + way, abs=1e-5)
    gone = ff.solve_static(hung(3.0), options)
    assert gone.status.startswith('Sliding "slide": the slider leaves Beam "wire" of 2 m at zeta')
    # three quarters of the load are borne
    assert gone.history["zeta"][-1] == pytest.approx(1.0 + 0.75 * way * 20.0 / 3.0, abs=1e-4)
