# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sliders on lines that rigid bodies and bodies in floating frames carry."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

COMM = MPI.COMM_WORLD
G, LENGTH, RADIUS = 9.81, 1.0, 0.8
STEEL = ff.Material(2.1e11, 0.3, 7850.0)
ROD = ff.Section.rectangle(0.01, 0.01, STEEL)
NODES = np.linspace([0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0], 9)


def _rod(comm: MPI.Intracomm = COMM, **choice) -> ff.ReducedBody:
    """A rod of eight elements with its line, reduced to its ends."""
    return ff.reduce_body(
        ff.beam_body(NODES, ROD, orientation=(0, 1, 0), comm=comm),
        {"start": NODES[0], "end": NODES[-1]}, lines={"axis": NODES}, **choice,
    )  # fmt: skip


def _bead(position, rotation=None, **more) -> ff.RigidBody:
    inertia = (0.02, 0.03, 0.04)
    return ff.RigidBody("bead", 0.7, inertia, position=position, rotation=rotation, **more)


def _simulate(model: ff.Model, comm: MPI.Intracomm = COMM, **more) -> ff.Outcome:
    settings = {"dt": 5e-3, "t_end": 0.4, "tolerance": 1e-10, "quiet": True}
    outcome = ff.simulate(model, ff.RunOptions(**(settings | more)), comm=comm)
    assert outcome.status == "ok", outcome.status
    return outcome


def _ring(tied: bool) -> ff.Model:
    """A bead on a rigid ring in the plane XZ, 1 rad from the lowest point, at rest."""
    angles = np.linspace(-1.3, 1.3, 27)
    points = RADIUS * np.stack([np.sin(angles), 0.0 * angles, -np.cos(angles)], axis=1)
    at = RADIUS * np.array([-np.sin(1.0), 0.0, -np.cos(1.0)])
    model = ff.Model("ring")
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("ring", 2.0, (1.0, 1.0, 1.0)),
        ff.Rigid("hold", ff.Ground(), ff.Marker("ring")),
        _bead(at),
        ff.Sliding("slide", ff.Carrier("ring", points), ff.Marker("bead"), tied=tied),
        ff.Probe("path", ff.SlidingMarker("slide"), ("zeta", "x"),
                 lambda t, s: (s.arc, s.position[0])),
        ff.Probe("turning", ff.Marker("bead"), ("pitch",), lambda t, s: (s.angular_velocity[1],)),
        ff.EnergyProbe("energy"),
    )  # fmt: skip
    return model


@pytest.mark.serial
@pytest.mark.parametrize("tied", [False, True])
def test_bead_on_a_rigid_ring(tied):
    """Arc length, energy, and the angular velocity of a bead that turns with the ring or not."""
    history = _simulate(_ring(tied), t_end=0.25).history
    zeta, x, pitch = (history[name] for name in ("zeta", "x", "pitch"))
    # the spline through 27 points leaves 1e-6 m; a chord would be off by 1e-3
    np.testing.assert_allclose(zeta, RADIUS * (np.arcsin(x / RADIUS) + 1.3), atol=5e-6)
    assert zeta[-1] > zeta[0] + 0.05
    # of 1.6 J
    assert np.abs(history["energy_balance"]).max() < 1e-4
    rate = np.gradient(zeta, history["t"])[1:-1] / RADIUS
    # differences of 5 ms; without the tie it stands still
    np.testing.assert_allclose(pitch[1:-1], -rate if tied else 0.0, atol=5e-3 if tied else 1e-9)


@pytest.mark.serial
def test_load_on_a_clamped_rod():
    """A locked slider bends the rod where it is, and a tied one turns with it: closed forms."""
    P, a = -2.0, 0.75 * LENGTH
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    model = ff.Model("rod")
    slide = ff.Sliding("slide", ff.Carrier("rod", "axis"), ff.Marker("bead"), tied=True)
    start = np.array([0.3, -0.2, 0.5])
    place = start + turn @ np.array([a, 0.0, 0.0])
    model.add(
        ff.FloatingBody("rod", _rod(basis="full"), position=start, rotation=turn),
        ff.Rigid("clamp", ff.Ground(start), ff.Marker("rod", "start")),
        _bead(place),
        slide,
        ff.Lock("lock", slide, locked=True),
        ff.PointForce("load", ff.Marker("bead"), (0.0, 0.0, P)),
        ff.Probe("place", ff.Marker("bead"), ("z", "slope"),
                 lambda t, s: (s.position[2], s.rotation[2, 1])),
    )  # fmt: skip
    found = ff.solve_static(model, ff.StaticOptions(quiet=True, tolerance=1e-12))
    assert found.status == "ok"
    EI, GA = np.array(ROD.stiffness)[[5, 2], [5, 2]]
    z, slope = found.history["z"][-1], found.history["slope"][-1]
    # linear theory at a node of the rod: squares of the slope 1e-3; a line that does not bend with
    # the rod would leave z = 0, one without its own rotations the slope
    assert z - place[2] == pytest.approx(P * a**3 / (3.0 * EI) + P * a / GA, rel=1e-5)
    assert slope == pytest.approx(P * a**2 / (2.0 * EI), rel=1e-5)


def _crossing(floating: bool) -> ff.Model:
    """A bead that crosses a rod on two hinges."""
    if floating:
        model, rail = ff.Model("crossing"), ff.Carrier("rod", "axis")
        rod = ff.FloatingBody("rod", _rod(modes=8))
    else:
        curve = ff.NurbsCurve.line(NODES[0], NODES[-1], degree=3, elements=8)
        model, rail = ff.Model("crossing"), ff.Carrier("rod")
        rod = ff.Beam("rod", ROD, curve=curve, orientation=(0, 1, 0))
    model.add(
        rod,
        ff.Gravity((0.0, 0.0, -G)),
        ff.Revolute("left", ff.Ground(NODES[0]), ff.Marker("rod", "start"), axis=(0, 1, 0)),
        ff.PointOnLine("right", ff.Ground(NODES[-1]), ff.Marker("rod", "end"), axis=(1, 0, 0)),
        _bead((0.1, 0.0, 0.0), velocity=(4.0, 0.0, 0.0)),
        ff.Sliding("slide", rail, ff.Marker("bead")),
        ff.Probe("path", ff.SlidingMarker("slide"), ("zeta", "z"),
                 lambda t, s: (s.arc, s.position[2])),
    )  # fmt: skip
    return model


@pytest.mark.serial
def test_bead_crosses_a_rod():
    """Beside a NURBS beam, which is another theory, another mesh, and another carrier."""
    modal, nurbs = (
        _simulate(_crossing(which), t_end=0.15, dt=1e-3).history for which in (True, False)
    )
    sag = np.abs(nurbs["z"]).max()
    assert sag > 2e-3
    # 0.4 %; a carrier that does not bend between its ends would be off by all of it
    assert np.abs(modal["z"] - nurbs["z"]).max() < 0.01 * sag
    assert np.abs(modal["zeta"] - nurbs["zeta"]).max() < 1e-4


def _two_rails(comm: MPI.Intracomm) -> ff.Model:
    """A rod that falls about a pin, a rigid rail hinged to its end, and a bead on each."""
    model, axis = ff.Model("rails"), (0, 1, 0)
    slides = [
        ff.Sliding("one", ff.Carrier("rod", "axis"), ff.Marker("bead")),
        ff.Sliding("two", ff.Carrier("rail", [(-0.2, 0, 0), (0.3, 0, 0)]), ff.Marker("shoe"),
                   tied=True),
    ]  # fmt: skip
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.FloatingBody("rod", _rod(comm, modes=4)),
        ff.RigidBody("rail", 0.5, (0.01, 0.02, 0.02), position=(1.2, 0, 0)),
        ff.Revolute("pin", ff.Ground(), ff.Marker("rod", "start"), axis=axis),
        ff.Revolute("hinge", ff.Marker("rod", "end"), ff.Marker("rail", offset=(-0.2, 0, 0)),
                    axis=axis),
        _bead((0.45, 0.0, 0.0), velocity=(1.0, 0.0, 0.0)),
        ff.RigidBody("shoe", 0.2, (1e-3,) * 3, position=(1.3, 0, 0)),
        *slides,
        ff.JointFriction("rub", slides[0], force=0.2, velocity=0.05),
        ff.SlideStop("stop", slides[1], upper=0.45, stiffness=500.0),
        ff.Probe("way", [ff.SlidingMarker(s.name) for s in slides], ("way_1", "way_2"),
                 lambda t, *s: [one.arc for one in s]),
        ff.PositionProbe("shoe_at", ff.Marker("shoe")),
        ff.ReactionProbe("force", "one"),
    )  # fmt: skip
    return model


@pytest.mark.several_ranks
@pytest.mark.three_ranks
def test_any_number_of_ranks_gives_the_same_motion():
    found = _simulate(_two_rails(COMM), t_end=0.1)
    alone = _simulate(_two_rails(MPI.COMM_SELF), MPI.COMM_SELF, t_end=0.1)
    if COMM.rank == 0:
        for name, values in alone.history.items():
            scale = max(np.abs(values).max(), 1.0)
            # round-off; a node that misses a force shows in the first digits
            np.testing.assert_allclose(found.history[name], values, rtol=0.0, atol=1e-9 * scale)
        assert alone.history["way_1"][-1] > 0.5


@pytest.mark.three_ranks
def test_lines_are_those_of_one_rank():
    body, alone = _rod(modes=3), _rod(MPI.COMM_SELF, modes=3)
    line, own = body.lines["axis"], alone.lines["axis"]
    for name, values in own.arrays.items():
        # round-off; points that two ranks count would be twice as large
        np.testing.assert_allclose(line.arrays[name], values, rtol=0.0, atol=1e-9)
    shift, turn = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.4, -0.3])
    motion = body.rigid_motions @ np.concatenate([shift, turn])
    # it moves with the body as a whole
    np.testing.assert_allclose(line.displacement @ motion, shift + np.cross(turn, NODES), atol=1e-9)
    np.testing.assert_allclose(line.rotation @ motion, np.tile(turn, (9, 1)), atol=1e-9)
