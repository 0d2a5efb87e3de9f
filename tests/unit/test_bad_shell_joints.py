# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints on shells that make no sense: one line that names the object and the value."""

import re
from collections.abc import Callable

import numpy as np
import pytest

import flexfem as ff
from flexfem.simulation.motion.stepping import Simulation

pytestmark = pytest.mark.serial

SECTION = ff.ShellSection.isotropic(0.01, ff.Material(1e9, 0.3, 1000.0))


def _model(gap: float = 0.0, **edges: dict[str, str]) -> ff.Model:
    """Two squares side by side and a body."""
    x = np.linspace(0.0, 1.0, 3)
    mesh = ff.SurfaceMesh.join(
        [ff.SurfaceMesh.grid("near", x, x), ff.SurfaceMesh.grid("far", 1.0 + gap + x, x)]
    )
    model = ff.Model("squares", surface=mesh)
    model.add(
        ff.Shell("near", SECTION, edges=edges.get("near", {})),
        ff.Shell("far", SECTION, edges=edges.get("far", {})),
        ff.RigidBody("hub", 1.0, (1.0, 1.0, 1.0)),
    )
    return model


NEAR, FAR = ff.ShellLine("near", "near_right"), ff.ShellLine("far", "far_left")
HUB = ff.Marker("hub")
HELD = {"near": {"near_right": "clamped"}, "far": {"far_left": "hinged"}}

CASES: dict[str, tuple[Callable[[], ff.Model], list[object], str]] = {
    "gap": (
        lambda: _model(gap=0.1), [ff.HingeLine("j", NEAR, FAR)],
        'HingeLine "j": node 2 of line "near_right" of Shell "near" is 0.1 m away from line '
        '"far_left" of Shell "far", more than 1e-06 of the length 1 m',
    ),
    "clamped gap": (
        lambda: _model(gap=0.1), [ff.ClampedLine("j", NEAR, FAR)], 'ClampedLine "j": node 2 of'
    ),
    "no shell": (
        _model, [ff.HingeLine("j", ff.ShellLine("hub", "near_right"), FAR)],
        'HingeLine "j": ShellLine: Model "squares" has no shell "hub"',
    ),
    "no line": (
        _model, [ff.HingeLine("j", ff.ShellLine("near", "seam"), FAR)],
        'HingeLine "j": ShellLine on "near": SurfaceMesh: line "seam" is not in the mesh',
    ),
    "line of another": (
        _model, [ff.HingeLine("j", ff.ShellLine("near", "far_left"), FAR)],
        'HingeLine "j": ShellLine on "near": line "far_left" is not on this shell',
    ),
    "joint of points": (
        _model, [ff.Spherical("j", NEAR, HUB)],
        'Spherical "j": a ShellLine ("near:near_right") is for joints of lines only',
    ),
    "probe": (
        _model, [ff.PositionProbe("j", NEAR)],
        'PositionProbe "j": a ShellLine ("near:near_right") is for joints of lines only',
    ),
    "no edge": (
        _model, [ff.Spherical("j", ff.SurfaceMarker("near", (0, 8), (0.5, 0.5)), HUB)],
        'Spherical "j": SurfaceMarker on "near": it has no triangle with the nodes (0, 8)',
    ),
    "place of a load": (
        _model, [ff.PointForce("j", ff.SurfaceMarker("near", (0,), (1.0,)), (1, 0, 0))],
        'PointForce "j": a SurfaceMarker ("near:0") is for joints only',
    ),
    "same line": (
        _model, [ff.HingeLine("j", NEAR, NEAR)],
        "share node 2, where they are hinged without a joint",
    ),
    "twice": (
        _model, [ff.HingeLine("j", NEAR, FAR), ff.ClampedLine("k", NEAR, FAR)],
        'HingeLine "j", ClampedLine "k"',
    ),
    "twice on a body": (  # rows of all nodes of a line depend on each other, its name comes once
        _model, [ff.HingeLine("j", NEAR, HUB), ff.ClampedLine("k", NEAR, HUB)],
        'HingeLine "j", ClampedLine "k": 9 of 18 constraints are redundant',
    ),
    "held": (
        lambda: _model(**HELD), [ff.HingeLine("j", NEAR, FAR)],
        'HingeLine "j": 3 of 3 constraints are redundant',
    ),
    "axes": (
        _model, [ff.HingeLine("j", NEAR, FAR), ff.ReactionProbe("r", "j", axes="b")],
        'ReactionProbe "r": HingeLine "j" needs axes "inertial", got "b"',
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_one_line(name):
    make, things, message = CASES[name]
    model = make()
    model.add(*things)
    with pytest.raises(ValueError, match=re.escape(message)) as raised:
        Simulation(model, ff.RunOptions(dt=1e-3, t_end=1e-3, quiet=True))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("nodes", "weights", "message"),
    [
        ((0, 1), (0.5,), "needs one to three nodes with a weight each"),
        ((0, 0), (0.5, 0.5), "needs one to three nodes with a weight each"),
        ((0, 1), (0.5, 0.6), r"add up to one, got \(0.5, 0.6\)"),
        ((0, 1), (1.5, -0.5), "must not be negative"),
    ],
)
def test_places(nodes, weights, message):
    with pytest.raises(ValueError, match=f'SurfaceMarker on "near": .*{message}'):
        ff.SurfaceMarker("near", nodes, weights)
