# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mistakes in shells, loads and probes on them are refused in one line naming object and value."""

import re

import numpy as np
import pytest

import flexfem as ff

pytestmark = pytest.mark.serial

SECTION = ff.ShellSection.isotropic(0.1, ff.Material(1e6, 0.3, 10.0))
NAN = float("nan")
OFFSET = ff.Marker("panel", "panel_top_left", (0, 0, 1))
CORNER = ff.Marker("panel", "panel_top_right")


def message_only(value: object) -> str | None:
    """Part of a test's name; functions have an address, which differs from process to process."""
    return value[:40] if isinstance(value, str) else None


def shell(**arguments: object) -> ff.Shell:
    return ff.Shell("panel", SECTION, **arguments)


CONSTRUCTORS = [
    (lambda: ff.Shell("", SECTION), "Shell: name must be a non-empty printable string"),
    (lambda: ff.Shell("panel", 0.1), 'Shell "panel": section must be a ShellSection, got 0.1'),
    (lambda: shell(body=3), "body must be a string, got 3"),
    (lambda: shell(element="quad"), "element must be .* got 'quad'"),
    (lambda: shell(edges={"top": "free"}), r'edges\["top"\] must be "clamped" or .* got \'free\''),
    (lambda: shell(edges={"top": 1}), r'edges\["top"\] must be a str, got 1'),
    (lambda: shell(edges={"top": "symmetric w"}), "got 'symmetric w'"),
    (lambda: shell(edges="clamped"), "edges must map names to words, got 'clamped'"),
    (lambda: shell(edges={3: "clamped"}), "edges: name must be a string, got 3"),
    (lambda: shell(fixed={"top": "w"}), r'fixed\["top"\] must be some of "xyz", got \'w\''),
    (lambda: shell(fixed={"top": ""}), r'fixed\["top"\] must be some of "xyz", got \'\''),
    (lambda: shell(fixed={"top": "xx"}), r'fixed\["top"\] must be some of "xyz", got \'xx\''),
    (lambda: shell(direction=(0, 0, 0)), r"direction must not be zero, got \(0, 0, 0\)"),
    (lambda: shell(averaged=1), "averaged must be a bool, got 1"),
    (lambda: shell(mass="diagonal"), 'mass must be "lumped" or "consistent", got \'diagonal\''),
    (lambda: shell(membrane="soft"), 'membrane must be "constant" or "smoothed", got \'soft\''),
    (
        lambda: shell(element="director", membrane="smoothed"),
        'Shell "panel": membrane "smoothed" needs element "rotation_free"',
    ),
    (lambda: shell(rest_curvature=1.0), "rest_curvature must hold 3 numbers, got 1"),
    (
        lambda: shell(rest_curvature=(1.0, 0.0, 0.0)),
        'Shell "panel": its rest_curvature is not equal in all directions: give the direction of',
    ),
    (lambda: shell(prestrain=lambda x, t: (0, 0, 0, 0, 0, 1)), "its prestrain is not equal in all"),
    (lambda: shell(prestrain=(1e-3, NAN, 0, 0, 0, 0)), "prestrain must be finite"),
    (lambda: shell(prestrain="hot"), "prestrain must hold 6 numbers, got 'hot'"),
    (
        lambda: shell(prestrain=ff.ThermalStrain(1e-5, gradient_y=2.0)),
        'Shell "panel": prestrain: a shell has no gradient_y, give gradient_z, got 2',
    ),
    (lambda: shell(damping=-1.0), "damping must not be negative, got -1"),
    (lambda: shell(velocity=(0, NAN, 0)), "velocity must be finite"),
    (lambda: shell(angular_velocity=(0, 1)), r"angular_velocity must hold 3 numbers, got \(0, 1\)"),
    (lambda: ff.Pressure("p", "panel", NAN), 'Pressure "p": pressure must be finite, got nan'),
    (lambda: ff.Pressure("p", 1, 2.0), 'Pressure "p": shell must be a string, got 1'),
    (lambda: ff.Pressure("p", "panel", "2"), "pressure must be a number, got '2'"),
    (lambda: ff.Pressure("p", "panel", 1.0, amplitude=2.0), "must be a function of time, got 2.0"),
    (
        lambda: ff.EdgeLoad("e", "panel", "panel_top", (1, 2)),
        "force_per_length must hold 3 numbers",
    ),
    (lambda: ff.EdgeLoad("e", "panel", 4, (1, 2, 3)), 'EdgeLoad "e": line must be a string, got 4'),
    (lambda: ff.SurfaceLoad("s", "panel", 3.0), "force_per_area must hold 3 numbers, got 3.0"),
    (lambda: ff.ShellStrainProbe("g", "panel", (1, 2)), "position must hold 3 numbers"),
    (lambda: ff.ShellStrainProbe("g", 1, (1, 2, 3)), "shell must be a string, got 1"),
]


@pytest.mark.parametrize(("make", "message"), CONSTRUCTORS, ids=message_only)
def test_constructors(make, message):
    with pytest.raises((ValueError, TypeError), match=message) as raised:
        make()
    assert "\n" not in str(raised.value)


def curved() -> ff.SurfaceMesh:
    """An eighth of a cylinder, an arc at its bottom and top."""
    return ff.SurfaceMesh.grid(
        "panel", np.linspace(0.0, 0.5, 4), np.linspace(0.0, 1.0, 3),
        lambda p: np.column_stack([np.sin(p[:, 0]), p[:, 1], np.cos(p[:, 0])]),
    )  # fmt: skip


def turned() -> ff.SurfaceMesh:
    """A flat rectangle, oblique in the plane XY."""
    R = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0]])
    return ff.SurfaceMesh.grid("panel", [0.0, 1.0, 2.0], [0.0, 1.0], lambda p: p @ R)


def inside(load):
    """Two triangles with a line between them."""
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    mesh = ff.SurfaceMesh(points, [[0, 1, 2], [0, 2, 3]], {"sheet": [0, 1]}, {"crease": [[0, 2]]})
    found = ff.Model("bad", surface=mesh)
    found.add(ff.Shell("sheet", SECTION), load)
    return found


def model(*things: object, mesh: ff.SurfaceMesh | None = None, **arguments: object) -> ff.Model:
    """A flat panel beside another one, with arguments of the first shell."""
    if mesh is None:
        flat = [ff.SurfaceMesh.rectangle(name, (2.0, 1.0), (2, 2)) for name in ("panel", "other")]
        mesh = ff.SurfaceMesh.join(flat)
    made = ff.Model("bad", surface=mesh)
    made.add(shell(**arguments))
    if "other" in mesh.bodies:
        made.add(ff.Shell("other", SECTION))
    made.add(ff.RigidBody("ball", 1.0, (1, 1, 1)), *things)
    return made


def without_mesh() -> ff.Model:
    made = ff.Model("bad")
    made.add(shell())
    return made


def unowned() -> ff.Model:
    made = ff.Model("bad", surface=model().surface)
    made.add(shell())
    return made


MODELS = [
    (without_mesh, 'Model "bad" has shells but no mesh, give Model'),
    (unowned, 'Model "bad": body "other" of the surface mesh belongs to no shell'),
    (lambda: model(body="side"), 'Shell "panel": the surface mesh has no body "side", it has'),
    (lambda: model(body="other"), 'Shell "other": body "other" is used already by Shell "panel"'),
    (lambda: model(edges={"side": "clamped"}), 'edges: line "side" is not in the mesh, which has'),
    (lambda: model(edges={"other_top": "clamped"}), 'line "other_top" is not on its boundary'),
    (lambda: model(fixed={"other_top": "x"}), 'it has no line or named node "other_top"'),
    (lambda: model(fixed={"nothing": "x"}), 'it has no line or named node "nothing"'),
    (lambda: model(direction=(0, 0, 1)), r"direction \[0.0, 0.0, 1.0\] is at right angles to tri"),
    (lambda: model(direction=(1, 0, 0), rest_curvature=lambda x: x[:, 0]),
     r'Shell "panel": rest_curvature must return shape \(8, 3\) or \(3,\) for 8 places, got'),
    (lambda: model(direction=(1, 0, 0), prestrain=lambda x, t: np.full(6, NAN)),
     r'Shell "panel": prestrain must return finite numbers for 8 places, got \[nan'),
    (lambda: model(direction=(1, 0, 0), prestrain=lambda x: np.zeros(6)), "prestrain: .*argument"),
    (lambda: model(prestrain=ff.ThermalStrain(1e-5, lambda x, t: 1.0 / 0.0)), "prestrain: .*Zero"),
    (lambda: model(direction=lambda x: x[0]), r"direction\(x\) must hold 8 x 3 numbers"),
    (
        lambda: model(mesh=curved(), edges={"panel_left": "symmetric"}),
        'line "panel_left" is straight and the shell curved there, which leaves its plane open',
    ),
    (
        lambda: model(mesh=curved(), edges={"panel_top": "symmetric x"}),
        'line "panel_top" is symmetric but does not lie in a plane normal to x',
    ),
    (
        lambda: model(
            mesh=turned(), edges={"panel_left": "symmetric"}, fixed={"panel_bottom_left": "x"}
        ),
        r"node 0 at \[0.0, 0.0, 0.0\] is held in two directions that are not at right angles",
    ),
    (lambda: model(ff.Pressure("p", "ball", 1.0)), 'Pressure "p": Model "bad" has no shell "ball"'),
    (
        lambda: model(ff.EdgeLoad("e", "side", "panel_top", (1, 0, 0))),
        'EdgeLoad "e": Model "bad" has no shell "side"',
    ),
    (
        lambda: model(ff.EdgeLoad("e", "panel", "side", (1, 0, 0))),
        'EdgeLoad "e": line "side" is not in the mesh, which has',
    ),
    (
        lambda: model(ff.EdgeLoad("e", "panel", "other_top", (1, 0, 0))),
        'EdgeLoad "e": line "other_top" is not on Shell "panel"',
    ),
    (
        lambda: model(ff.LineLoad("l", "panel", (1, 0, 0))),
        'LineLoad "l": "panel" is a shell, which takes EdgeLoad, SurfaceLoad and Pressure',
    ),
    (
        lambda: model(ff.EdgeLoad("e", "panel", "panel_top", moment_per_length=np.inf)),
        'EdgeLoad "e": moment_per_length must be finite',
    ),
    (
        lambda: inside(ff.EdgeLoad("e", "sheet", "crease", moment_per_length=1.0)),
        'EdgeLoad "e": line "crease" runs inside Shell "sheet", where a moment has no side',
    ),
    (
        lambda: model(ff.PointForce("f", ff.Marker("panel"), (1, 0, 0))),
        'PointForce "f": Marker on "panel": a shell needs a named node or a position',
    ),
    (
        lambda: model(ff.PointForce("f", ff.Marker("panel", "other_top_left"), (1, 0, 0))),
        "a shell needs a named node or a position .* got point 'other_top_left'",
    ),
    (
        lambda: model(ff.PointForce("f", OFFSET, (1, 0, 0))),
        r'Marker on "panel": a shell has no offsets, got \[0.0, 0.0, 1.0\]',
    ),
    (lambda: model(ff.StrainProbe("g", "panel", 0.5)), '"panel" is a shell, which takes Shell'),
    (
        lambda: model(ff.ShellStrainProbe("g", "ball", (0, 0, 0))),
        'ShellStrainProbe "g": Model "bad" has no shell "ball"',
    ),
    (lambda: model(ff.EnergyProbe("e", ["side"])), 'EnergyProbe "e": .* has no body "side"'),
]  # fmt: skip


@pytest.mark.parametrize(("make", "message"), MODELS, ids=message_only)
def test_models(make, message):
    """Nothing is computed: the run ends before it begins."""
    options = ff.RunOptions(dt=1e-3, t_end=1e-3, quiet=True)
    with pytest.raises(ValueError, match=message) as raised:
        ff.simulate(make(), options)
    text = str(raised.value)
    assert "\n" not in text
    assert re.match(r'^[A-Z]\w+ ".+"', text)
