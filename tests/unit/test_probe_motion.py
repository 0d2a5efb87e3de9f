# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accelerations and elongations that probes record."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.lie import se3
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.measure.marker_states import MarkerStates
from flexfem.system.measure.probes import ProbeRecorder
from tests.unit.particle_body import bar
from tests.unit.refusals import assert_on_page

COLUMNS = [f"{what}{axis}" for what in "vwab" for axis in "xyz"]
NAMES = ("node", "inside", "body", "interface")


def swinging() -> ff.Model:
    """A beam that rotates about two axes and bends, with a body at its end; another beam slides."""
    section = ff.Section.rectangle(0.01, 0.02, ff.Material(2e9, 0.3, 1200.0))
    model = ff.Model("swinging", mesh=ff.LineMesh.straight({"beam": [(0, 0, 0), (1, 0, 0)]}, 3))
    markers = {
        "node": ff.Marker("beam", "end", offset=(0.1, 0.2, -0.1)),
        "inside": ff.Marker("beam", 0.45, offset=(0.0, 0.05, 0.02)),
        "body": ff.Marker(
            "ball", offset=(0.02, -0.03, 0.04), rotation=[(0, -1, 0), (1, 0, 0), (0, 0, 1)]
        ),
        "interface": ff.Ground((1.0, 2.0, 3.0)),
    }
    model.add(
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.Beam("beam", section),
        ff.RigidBody("ball", 0.3, (1e-3, 2e-3, 2e-3), position=(1.0, 0.0, 0.1),
                     velocity=(0.0, 0.0, 2.0)),
        ff.Rigid("weld", ff.Marker("beam", "end"), ff.Marker("ball", offset=(0.0, 0.0, -0.1))),
        ff.Spherical("pin", ff.Ground(), ff.Marker("beam", "start")),
    )  # fmt: skip
    for name, marker in markers.items():
        model.add(
            ff.Probe(name, marker, [f"{name}_{column}" for column in COLUMNS],
                     lambda t, s: [*s.velocity, *s.angular_velocity, *s.acceleration,
                                   *s.angular_acceleration])
        )  # fmt: skip
    return model


def move(simulation: Simulation, at: list[np.ndarray], span: float) -> None:
    """Trial state after a time ``span`` of a motion with given twists and rates of all nodes."""
    rng = np.random.default_rng(4)
    for part, frames in zip(simulation.system.parts, at, strict=True):
        block = part.block
        v, w = rng.normal(size=(2, block.size_global, 6))[:, block.node_ids]
        block.frames[:] = se3.retract(frames, span * v + 0.5 * span**2 * w)
        block.velocity[:], block.acceleration[:] = v + span * w, w


def test_accelerations_are_rates_of_velocities():
    """Of markers on nodes, off them and inside elements, for probes and for controllers."""
    model, span = swinging(), 1e-4
    simulation = Simulation(model, ff.RunOptions(dt=1e-3, t_end=1.0, split_above=1))
    system, serial = simulation.system, simulation.serial
    states = MarkerStates(system, serial, [m for probe in model.probes for m in probe.markers])
    recorder = ProbeRecorder(system, serial)
    start = [part.block.frames.copy() for part in system.parts]
    velocities = []
    for when in (-span, span, 0.0):
        move(simulation, start, when)
        found = states.evaluate()
        velocities.append([np.concatenate([s.velocity, s.angular_velocity]) for s in found])
    slopes = (np.array(velocities[1]) - velocities[0]) / (2.0 * span)
    own = [np.concatenate([s.acceleration, s.angular_acceleration]) for s in found]
    # differences are good to 1e-7 here; a centripetal term, or the turning element's own, is 1
    np.testing.assert_allclose(own, slopes, atol=1e-5)
    starts = [serial.marker_pose(m).rotation for probe in model.probes for m in probe.markers]
    for state, turned in zip(found, starts, strict=True):
        # rounding alone; a rotation whose transpose is taken is off by 1
        np.testing.assert_allclose(state.turn @ turned, state.rotation, atol=1e-14)
    recorder.record(0.0)
    for _, values in recorder.flush():  # on the first rank
        table = values.reshape(len(NAMES), 12)
        np.testing.assert_allclose(table[:, 6:], own, atol=1e-9)
        np.testing.assert_allclose(table[:, :6], velocities[2], atol=1e-12)


@pytest.mark.serial
def test_linear_models_refuse_them():
    with pytest.raises(ValueError, match='Probe "node": columns of a linear model must be numbers'):
        ff.linearize(swinging())


def stretched(links: bool) -> ff.Model:
    """A bar of two elements, or in a floating frame, that is pulled and bent at its end."""
    section = ff.Section.rectangle(0.01, 0.02, ff.Material(7e10, 0.3, 2700.0))
    mesh = ff.LineMesh.straight({"bar": [(0, 0, 0), (0, 1, 0)]}, 4) if links else None
    model = ff.Model("stretched", mesh=mesh)
    if links:
        model.add(ff.Beam("bar", section, orientation=(1.0, 0.0, 0.0)))
        ends = ff.Marker("bar", "start"), ff.Marker("bar", "end")
    else:
        turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        model.add(ff.FloatingBody("bar", bar(modes=0, side=0.01, stiffening=True),
                                  rotation=turned, stiffening=True))  # fmt: skip
        ends = ff.Marker("bar", "left"), ff.Marker("bar", "right")
    model.add(
        ff.Rigid("wall", ff.Ground(), ends[0]),
        ff.PointForce("load", ends[1], (20.0, 2000.0, 0.0)),
        ff.ElongationProbe("longer", "bar"),
        ff.PositionProbe("end", ends[1]),
    )
    return model


@pytest.mark.serial
@pytest.mark.parametrize("links", [True, False])
def test_elongation_is_what_normal_forces_stretch(links):
    """F l/(EA), while the end comes nearer by bending."""
    history = ff.solve_static(stretched(links), ff.StaticOptions(quiet=True)).history
    area = 2e-4 if links else 1e-4
    stretch = 2000.0 / (7e10 * area)
    # the slope turns some force away: 1e-4; what bending takes is of the size of the elongation
    assert history["longer"][-1] == pytest.approx(stretch, rel=5e-3)
    shorter = 1.0 + history["longer"][-1] - history["end_y"][-1]
    assert shorter > 0.05 * stretch


BAD = {
    "has no SE.3. beam": lambda: ff.ElongationProbe("e", "nobody"),
    "ends must be None for a beam": lambda: ff.ElongationProbe("e", "bar", ("start", "end")),
    "ends must be two names": lambda: ff.ElongationProbe("e", "bar", ("start",)),
}


@pytest.mark.serial
@pytest.mark.parametrize("message", BAD)
def test_mistakes_of_elongations_are_named(message):
    def make():
        model = stretched(True)
        model.add(BAD[message]())
        model.validate()

    with pytest.raises(ValueError, match=message) as raised:
        make()
    assert_on_page(str(raised.value))


@pytest.mark.serial
def test_ends_of_a_floating_body_are_interfaces():
    model = stretched(False)
    model.add(ff.ElongationProbe("e", "bar", ("left", "middle")))
    with pytest.raises(ValueError, match='ends must be two interfaces of "bar", which has left'):
        model.validate()
