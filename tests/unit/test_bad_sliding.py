# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sliding joints that make no sense: one line that names the joint and the value."""

from collections.abc import Callable

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.simulation.motion.stepping import Simulation
from tests.unit.refusals import assert_refused
from tests.unit.test_reduced_body import two_masses

pytestmark = pytest.mark.serial

BEAD, RAIL = ff.Marker("bead"), ff.Carrier("rail")
SLIDE = ff.Sliding("slide", RAIL, BEAD)
AXIS = ff.BodyLine([(0, 0, 0), (1, 0, 0)], np.zeros((2, 3, 12)), np.zeros((2, 3, 12)))
ELASTIC = two_masses(lines={"axis": AXIS})
ROD = ff.FloatingBody("rod", ELASTIC, position=(0, 5, 0))
MEAN = ff.FloatingBody("mean", ELASTIC, position=(0, 5, 0), frame="mean_axes")
HINGE = ff.Revolute("hinge", ff.Ground(), BEAD)

ALONE = {
    "marker as carrier": (
        lambda: ff.Sliding("j", ff.Marker("rail", "start"), BEAD), "a must be a Carrier, got Marker"
    ),
    "ground as carrier": (
        lambda: ff.Sliding("j", ff.Ground(), BEAD), "a must be a Carrier, got Ground"
    ),
    "name as carrier": (lambda: ff.Sliding("j", "rail", BEAD), "a must be a .*, got 'rail'"),
    "no slider": (lambda: ff.Sliding("j", RAIL, "bead"), "b must be a Marker .*, got 'bead'"),
    "carrier as slider": (lambda: ff.Sliding("j", RAIL, ff.Carrier("rod")), "b must .*Carrier"),
    "one point": (
        lambda: ff.Carrier("j", [(0, 0, 0)]), 'Carrier on "j": line must have two points at least'
    ),
    "two equal points": (lambda: ff.Carrier("j", [(1, 0, 0)] * 2), "neighbours at different"),
    "points in a plane": (lambda: ff.Carrier("j", [(1, 0), (2, 0)]), "line must hold n x 3"),
    "beyond": (
        lambda: ff.Sliding("j", RAIL, BEAD, beyond=-0.1), "beyond must not be negative, got -0.1"
    ),
    "tied": (lambda: ff.Sliding("j", RAIL, BEAD, tied=1), "tied must be a bool, got 1"),
    "drive of a hinge": (
        lambda: ff.PrescribedSlide("j", HINGE, zeta=lambda t: t),
        'joint must be a Sliding joint, got Revolute "hinge"',
    ),
    "drive by a number": (
        lambda: ff.PrescribedSlide("j", SLIDE, zeta=0.5), "zeta must be a function .*, got 0.5"
    ),
    "drive by a vector": (
        lambda: ff.PrescribedSlide("j", SLIDE, zeta=lambda t: (t, t)), r"zeta\(0\) must be a number"
    ),
    "drive by nothing": (
        lambda: ff.PrescribedSlide("j", SLIDE, zeta=lambda t: float("nan")), r"zeta\(0\) must be"
    ),
    "stop of a hinge": (
        lambda: ff.SlideStop("j", HINGE, upper=1.0, stiffness=1.0),
        'joint must be a Sliding joint, got Revolute "hinge"',
    ),
    "stop without limits": (lambda: ff.SlideStop("j", SLIDE, stiffness=1.0), "got neither"),
    "stop without stiffness": (
        lambda: ff.SlideStop("j", SLIDE, upper=1.0), "stiffness must be positive, got 0.0"
    ),
    "stops in the wrong order": (
        lambda: ff.SlideStop("j", SLIDE, lower=1.0, upper=0.5, stiffness=1.0),
        "lower must be below upper, got 1.0 and 0.5",
    ),
    "friction against a rotation": (
        lambda: ff.JointFriction("j", SLIDE, "rotation", force=1.0),
        'Sliding "slide" has no free rotation',
    ),
}  # fmt: skip


@pytest.mark.parametrize(("make", "message"), ALONE.values(), ids=ALONE)
def test_refused_when_made(make: Callable[[], object], message: str) -> None:
    assert_refused(make, message)


def _slide(carrier: str, slider: ff.Marker = BEAD) -> ff.Sliding:
    return ff.Sliding("j", ff.Carrier(carrier), slider)


def _probe(joint: str) -> ff.Probe:
    return ff.Probe("j", ff.SlidingMarker(joint), ("zeta",), lambda t, s: (s.arc,))


IN_MODEL = {
    "unknown carrier": ([_slide("wire")], 'Sliding "j": .* has no beam or body .* "wire"'),
    "body as carrier": (
        [_slide("other", ff.Marker("rail", "start"))],
        'Sliding "j": Carrier on "other": give points of the line',
    ),
    "line of a beam": (
        [ff.Sliding("j", ff.Carrier("rail", [(0, 0, 0), (1, 0, 0)]), BEAD)],
        'Sliding "j": Carrier on "rail": a beam has one line',
    ),
    "beside the line of a body": (
        [ff.Sliding("j", ff.Carrier("other", [(0, 0, 0), (1, 0, 0)]), BEAD)],
        r'Sliding "j": the slider at \[0.5, 0.0, 0.0\] is 1.5 m away from the line of "other"',
    ),
    "unknown line of a floating body": (
        [ROD, ff.Sliding("j", ff.Carrier("rod", "top"), BEAD)],
        'Carrier on "rod": line must name one of the reduced body, which has axis',
    ),
    "line of mean axes": (
        [MEAN, ff.Sliding("j", ff.Carrier("mean", "axis"), BEAD)],
        'Carrier on "mean": mean axes carry no lines',
    ),
    "branching carrier": (
        [_slide("tee", ff.Marker("other"))], 'Sliding "j": Beam "tee": group "tee" branches'
    ),
    "unknown slider": ([_slide("rail", ff.Marker("shoe"))], 'Sliding "j": Marker on "shoe": .*'),
    "beside the line": (
        [_slide("rail", ff.Marker("bead", offset=(0, 0.3, 0)))],
        r'Sliding "j": the slider at \[0.5, 0.3, 0.0\] is 0.3 m away from the line of "rail"',
    ),
    "beyond the end": (
        [_slide("rail", ff.Marker("bead", offset=(0.7, 0, 0)))], 'Sliding "j": .* 0.2 m away from'
    ),
    "carrier in another joint": (
        [ff.Spherical("j", RAIL, BEAD)], r'Spherical "j": a Carrier \("rail"\) is for sliding'
    ),
    "carrier in a drive": (
        [ff.PrescribedAngle("j", ff.Ground(), RAIL, (0, 0, 1), lambda t: t)],
        'PrescribedAngle "j": a Carrier',
    ),
    "carrier with a load": ([ff.PointForce("j", RAIL, (0, 0, 1))], 'PointForce "j": a Carrier'),
    "carrier with a mass": ([ff.PointMass("j", 1.0, RAIL)], 'PointMass "j": a Carrier'),
    "carrier in a probe": ([ff.PositionProbe("j", RAIL)], 'PositionProbe "j": a Carrier'),
    "carrier in an event": (
        [ff.Event("j", RAIL, lambda t, s: t - 1.0, ff.Stop())], 'Event "j": a Carrier'
    ),
    "probe of no joint": ([_probe("nothing")], 'Probe "j": .* has no sliding joint "nothing"'),
    "probe of a hinge": ([HINGE, _probe("hinge")], 'Probe "j": .* has no sliding joint "hinge"'),
    "probe of a body": ([_probe("bead")], 'Probe "j": .* has no sliding joint "bead"'),
    "event of a hinge": (
        [HINGE, ff.Event("j", ff.SlidingMarker("hinge"), lambda t, s: s.arc, ff.Stop())],
        'Event "j": .* has no sliding joint "hinge"',
    ),
    "stop of an unknown joint": (
        [ff.SlideStop("j", SLIDE, upper=1.0, stiffness=1.0)], 'SlideStop "j": .* no joint "slide"'
    ),
    "lock of an unknown joint": ([ff.Lock("j", SLIDE)], 'Lock "j": .* has no joint "slide"'),
    "event without a lock": (
        [SLIDE, ff.Event("j", ff.SlidingMarker("slide"), lambda t, s: s.arc - 2.0,
                         ff.LockJoint("brake"))],
        'Event "j": .* has no joint "brake"',
    ),
    "on its own line": (
        [_slide("rail", ff.Marker("rail", "start"))], 'Sliding "j": 2 of 2 constraints are redund'
    ),
    "driven from elsewhere": (
        [SLIDE, ff.PrescribedSlide("j", SLIDE, zeta=lambda t: 0.7)],
        'PrescribedSlide "j": the markers violate the joint at the start by 0.2'
    ),
    "driven twice": (
        [SLIDE, ff.PrescribedSlide("one", SLIDE, zeta=lambda t: 0.5),
         ff.PrescribedSlide("j", SLIDE, zeta=lambda t: 0.5)],
        'PrescribedSlide "one", PrescribedSlide "j": 1 of 2 constraints are redundant',
    ),
}  # fmt: skip


@pytest.mark.parametrize("formulation", ["nurbs", "se3"])
@pytest.mark.parametrize(("parts", "message"), IN_MODEL.values(), ids=IN_MODEL)
def test_refused_in_a_model(parts: list[object], message: str, formulation: str) -> None:
    points = [[0, 0, 0], [0.4, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [2, 0, 1], [3, 0, 0]]
    cells = [[3, 4], [3, 5], [3, 6], [0, 1], [1, 2]]
    groups = {"tee": [0, 1, 2], "rail": [3, 4]}
    section = ff.Section.rectangle(0.01, 0.01, ff.Material(2e11, 0.3, 7800.0))
    curve, inertia = None, np.ones(3)
    if formulation == "nurbs":
        curve = ff.NurbsCurve.line((0, 0, 0), (1, 0, 0), degree=2, elements=2)
        points, cells, groups = points[3:], [[0, 1], [0, 2], [0, 3]], {"tee": [0, 1, 2]}
    model = ff.Model("test", mesh=ff.LineMesh(points, cells, groups))
    model.add(
        ff.Beam("rail", section, curve=curve),
        ff.Beam("tee", section),
        ff.RigidBody("bead", 1.0, inertia, position=(0.5, 0, 0)),
        ff.RigidBody("other", 1.0, inertia, position=(2.0, 0, 0)),
        *parts,
    )
    with pytest.raises(ValueError, match=message) as raised:
        Simulation(model, RunOptions(dt=1e-3, t_end=1.0))
    assert "\n" not in str(raised.value)
