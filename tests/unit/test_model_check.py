# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of models: for every finding a model that has it, and one close by that has not."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.analyses.statics import StaticOptions
from flexfem.core.joint import Joint
from flexfem.inspection import checks

pytestmark = pytest.mark.serial

STEEL = ff.Material(2.1e11, 0.3, 7850.0)
BAR = ff.Section.circle(0.02, STEEL)
X, Y, Z = np.eye(3).tolist()
DOWN = ff.Gravity((0.0, 0.0, -9.81))
MOTION = RunOptions(dt=1e-3, t_end=1.0)
STATICS = StaticOptions()
START = ff.Marker("rod", "start")


def beam(
    section: ff.Section = BAR, *, length: float = 1.0, joined: bool = True,
    gravity: ff.Gravity = DOWN, points: np.ndarray | None = None,
) -> ff.Model:  # fmt: skip
    """A beam along x that is clamped at its start."""
    x = np.linspace(0.0, length, 5) if points is None else points
    places = np.column_stack([x, 0.0 * x, 0.0 * x])
    cells = np.column_stack([np.arange(len(x) - 1), np.arange(1, len(x))])
    model = ff.Model(mesh=ff.LineMesh(places, cells, {"rod": np.arange(len(cells))}))
    model.add(gravity, ff.Beam("rod", section))
    if joined:
        model.add(ff.Rigid("wall", ff.Ground(), ff.Marker("rod", "start")))
    return model


def loaded_from(place: float, *breakpoints: float) -> ff.Model:
    """A clamped beam with a load per length that begins somewhere."""

    def load(s: float) -> tuple[float, float, float]:
        return (0.0, 0.0, -1.0 if s > place else 0.0)

    model = beam()
    model.add(ff.LineLoad("snow", "rod", load, breakpoints=breakpoints))
    return model


def flag(plane: str = "strain", *, gravity: object = None, force: object = None) -> ff.Model:
    """A plane body, held at one edge and pulled at the other."""
    mesh = ff.SolidMesh.box((0.4, 0.05), (8, 1), "quadrilateral", origin=(0.1, 0.0, 0.0))
    model, rubber = ff.Model("flag"), ff.laws.NeoHookean.from_young(1e6, 0.4)
    model.add(ff.Solid("flag", rubber, mesh, density=1100.0, plane=plane, fixed={"x0": "xy"}))
    model.add(ff.SurfaceTraction("pull", "flag", "x1", force or (1.0, 0.0, 0.0)))
    if gravity is not None:
        model.add(ff.Gravity(gravity))
    return model


def waves(number: float) -> ff.Model:
    """A clamped beam with a moment per length in waves, counted by the beam's length."""
    model = beam()
    model.add(
        ff.LineLoad(
            "twist", "rod", moment_per_length=lambda x: (np.sin(6.28 * number * x), 0.0, 0.0),
            coordinate="fraction",
        )
    )  # fmt: skip
    return model


def two(joined: bool) -> ff.Model:
    """Two beams that meet at a corner, both on the ground, one with another beam in its middle."""
    lines = {"a": [(0, 0, 0), (1, 0, 0)], "b": [(1, 0, 0), (1, 1, 0)]}
    model = ff.Model(mesh=ff.LineMesh.straight(lines, 4))
    model.add(DOWN, ff.Beam("a", BAR), ff.Beam("b", BAR))
    model.add(ff.Rigid("wall", ff.Ground(), ff.Marker("a", "start")))
    model.add(ff.Rigid("other", ff.Ground((1, 1, 0)), ff.Marker("b", "end")))
    if joined:
        hub = ff.RigidBody("hub", 1.0, (1e-3, 1e-3, 1e-3), position=(1, 0, 0))
        model.add(hub, ff.Rigid("first", ff.Marker("hub"), ff.Marker("a", "end")))
        model.add(ff.Spherical("second", ff.Marker("hub"), ff.Marker("b", "start")))
    return model


def falling(surface: bool) -> ff.Model:
    """A sheet over a ball, which it touches, or not; a pendulum is there, too."""
    mesh = ff.SurfaceMesh.rectangle("sheet", (1.0, 1.0), (2, 2))
    model = ff.Model(mesh=beam().mesh, surface=mesh)
    model.add(*beam().things, DOWN)
    model.add(ff.Shell("sheet", ff.ShellSection.isotropic(1e-3, ff.Material(1e6, 0.3, 1000.0))))
    if surface:
        ball = ff.RigidSphere(ff.Ground((0.5, 0.5, -0.6)), 0.5)
        model.add(ff.Contact("touch", "sheet", surfaces=ball))
    return model


def sheet(u: np.ndarray, thickness: float = 1e-3, v: np.ndarray | None = None) -> ff.Model:
    """A clamped sheet with lines at u and v."""
    across = np.linspace(0.0, 1.0, 5) if v is None else v
    model = ff.Model(surface=ff.SurfaceMesh.grid("sheet", u, across))
    section = ff.ShellSection.isotropic(thickness, STEEL)
    model.add(DOWN, ff.Shell("sheet", section, edges={"sheet_left": "clamped"}))
    return model


def body(joint: type[Joint] = ff.Revolute, **options: object) -> ff.Model:
    """A rigid body on a hinge."""
    model = ff.Model()
    inertia = options.pop("inertia", (0.1, 0.1, 0.1))
    ground = options.pop("ground", (0.0, 0.0, 0.0))
    model.add(ff.RigidBody("bob", 1.0, inertia, position=(0, 0, -1), **options), DOWN)
    axis = {"axis": Y} if joint is ff.Revolute else {}
    model.add(joint("hinge", ff.Ground(ground), ff.Marker("bob", offset=(0, 0, 1)), **axis))
    return model


def wire(*held: str) -> ff.Model:
    """A net that is one taut cable of two pieces along x, with its fixed ends."""
    ends = {"left": [0], "right": [2]}
    points = np.outer([0.0, 0.4, 1.0], [1.0, 0.0, 0.0])
    mesh = ff.ElementMesh(points, [[0, 1], [1, 2]], "interval", nodes=ends)
    model, fixed = ff.Model("wire"), dict.fromkeys(held, "xyz")
    model.add(
        ff.CableNet("wire", mesh, 1e4, preload=100.0, mass_per_length=0.1, fixed=fixed),
        ff.PointForce("pull", ff.Marker("wire", "right"), (1.0, 0.0, 0.0)),
    )
    return model


def driven(rate: float, spin: float, **options: object) -> ff.Model:
    """A rotor whose drive and initial velocity may differ."""
    model = ff.Model()
    model.add(ff.RigidBody("rotor", 1.0, (0.1, 0.1, 0.1), angular_velocity=(0, 0, spin), **options))
    ends = ff.Ground(), ff.Marker("rotor")
    model.add(ff.Revolute("bearing", *ends, axis=Z))
    model.add(ff.PrescribedAngle("motor", *ends, axis=Z, angle=lambda t: rate * t))
    model.add(ff.PositionProbe("place", ff.Marker("rotor", offset=(0.3, 0, 0))))
    return model


def switched(end: float) -> ff.Model:
    """A rotor that its drive rotates by one radian from 0.5 s on."""
    model = ff.Model()
    model.add(ff.RigidBody("rotor", 1.0, (0.1, 0.1, 0.1)))
    ends = ff.Ground(), ff.Marker("rotor")
    angle = ff.SmoothStep(0.5, end)
    model.add(ff.Revolute("bearing", *ends, axis=Z))
    model.add(ff.PrescribedAngle("motor", *ends, axis=Z, angle=angle))
    return model


def splined(width: float) -> ff.Model:
    """A moment along a smooth spline with a pulse of this width (s) between two steps."""
    model = driven(0.0, 0.0)
    pulse = ff.Spline(0.2505 + width * np.arange(-4, 5), np.eye(9)[4], 3)
    model.add(ff.PointMoment("push", ff.Marker("rotor"), Z, amplitude=pulse))
    return model


def shaken(frequency: float, *, told: bool = False, drive: bool = False) -> ff.Model:
    """A rotor that a moment or a drive swings, or that its drive switches now and then."""

    def swing(t: float) -> float:
        return 1e-3 * np.sin(2.0 * np.pi * frequency * t)

    model = switched(0.9)
    if drive:
        ends = ff.Ground(), ff.Marker("rotor")
        model.add(ff.PrescribedAngle("shaker", *ends, axis=Z, angle=swing))
        return model
    amplitude = ff.TimeFunction(swing, np.arange(1.0, 2000.0) / 2000.0) if told else swing
    model.add(ff.PointMoment("push", ff.Marker("rotor"), Z, amplitude=amplitude))
    return model


def bursts(width: float) -> ff.Model:
    """A rotor that is pushed five times, by a function that does not tell when."""
    model = switched(0.9)
    often = ff.PointMoment(
        "push", ff.Marker("rotor"), Z, amplitude=lambda t: float((5.0 * t) % 1.0 < width)
    )
    model.add(often)
    return model


def turned(angle: float) -> ff.Model:
    """A body whose drive prescribes a rotation at the start."""
    model = ff.Model()
    ends = ff.Ground(), ff.Marker("bob")
    model.add(ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1)), ff.Spherical("ball", *ends))
    model.add(ff.PrescribedRotation("turn", *ends, rotation=lambda t: (angle, 0.0, t**2)))
    return model


def door(first: type[Joint], second: type[Joint]) -> ff.Model:
    """A door on two joints."""
    model = body(first)
    marker = ff.Marker("bob", offset=(0, 0.5, 1))
    model.add(second("other", ff.Ground((0, 0.5, 0)), marker, axis=Y))
    return model


def spring(stiffness: float) -> ff.Model:
    """A beam on a spring."""
    model = beam()
    tip = ff.Marker("rod", "end")
    model.add(ff.SpringDamper("spring", ff.Ground((1, 0, 1)), tip, stiffness=stiffness))
    return model


def hinged(joint: Joint) -> ff.Model:
    """A beam that a joint alone holds."""
    model = beam(joined=False)
    model.add(joint)
    return model


def spring_held() -> ff.Model:
    """A beam on a hinge with a torsional spring."""
    model = hinged(ff.Revolute("pin", ff.Ground(), START, axis=Y))
    ends = ff.Ground(), START
    model.add(ff.TorsionalSpringDamper("torsion", *ends, axis=Y, stiffness=1e3))
    return model


def arch(elements: int, continuity: int = 2) -> ff.Model:
    """An arch of 215 degrees on one clamp, 1083 times as long as thick."""
    curve = ff.NurbsCurve.arc(
        (100, 0, 0), (0, 0, 0), Z, np.radians(215.0), degree=3, elements=elements
    )
    section = ff.Section.general((1e8, 1e8, 1e8, 1e6, 1e6, 1e6), (1.0,) * 6)
    model = ff.Model()
    model.add(
        ff.Beam("rod", section, curve=curve.with_continuity(continuity)),
        ff.Rigid("clamp", ff.Ground(curve.position(0.0)), START), DOWN,
    )  # fmt: skip
    return model


def stepped(times: int) -> ff.Model:
    """A bar of two thicknesses along a smooth curve with a repeated knot between them."""
    thin, thick = ff.Section.circle(0.02, STEEL), ff.Section.circle(0.03, STEEL)
    table = ff.SectionTable.of([0.0, 0.5, 0.5, 1.0], [thick, thick, thin, thin], relative=True)
    line = ff.NurbsCurve.line((0, 0, 0), (1, 0, 0), elements=5, degree=3)
    model = ff.Model()
    model.add(
        DOWN, ff.Beam("rod", table, curve=line.insert(times * [0.5 * line.knots[-1]])),
        ff.Rigid("wall", ff.Ground(), START),
    )  # fmt: skip
    return model


def row(width: float, rows: int = 1, element: str = "director") -> ff.Model:
    """A clamped strip of 1 m length."""
    model = ff.Model(surface=ff.SurfaceMesh.rectangle("sheet", (1.0, width), (8, rows)))
    section = ff.ShellSection.isotropic(1e-2, ff.Material(2e9, 0.0, 1000.0))
    model.add(DOWN, ff.Shell("sheet", section, element=element, edges={"sheet_left": "clamped"}))
    return model


def unused(used: bool) -> ff.Model:
    """A mesh of lines, and a beam on it or a rigid body."""
    model = beam()
    if used:
        return model
    other = ff.Model(mesh=model.mesh)
    other.add(*body().things, DOWN)
    return other


def still(gravity: bool) -> ff.Model:
    model = ff.Model()
    model.add(ff.RigidBody("bob", 1.0, (1, 1, 1)), *([DOWN] if gravity else []))
    model.add(ff.Spherical("pin", ff.Ground(), ff.Marker("bob")))
    return model


def railed(axis: list[float]) -> ff.Model:
    """A body that has been rotated about y, on a rail."""
    rail = ff.Prismatic("rail", ff.Ground(), ff.Marker("bob"), axis=axis)
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    model = ff.Model()
    model.add(DOWN, ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), rotation=turn), rail)
    return model


def rod_between(end: ff.Marker | ff.Ground) -> ff.Model:
    """A body on a vertical rail, and one beside it on a level rod."""
    model = railed([0.0, 0.0, 1.0])
    model.add(ff.RigidBody("weight", 1.0, (0.1, 0.1, 0.1), position=(1.0, 0.0, 0.0)))
    model.add(ff.Distance("rod", end, ff.Marker("weight")))
    return model


def beside_a_ball(length: float) -> ff.Model:
    """A sheet that is as long and wide, and a ball."""
    model = sheet(length * EVEN, 0.1, length * EVEN)
    model.add(ff.RigidBody("ball", 1.0, (1e-3, 1e-3, 1e-3), shape=ff.Sphere(0.05)))
    return model


def rubber(length: float, law: ff.laws.SolidLaw) -> ff.Model:
    """A cube of a solid, and a ball on its side."""
    model = ff.Model("rubber")
    mesh = ff.SolidMesh.box(length * np.ones(3), (1, 1, 1))
    model.add(
        ff.Solid("cube", law, mesh, density=1000.0, fixed={"x0": "xyz"}),
        ff.RigidBody("ball", 1.0, (1e-3, 1e-3, 1e-3), shape=ff.Sphere(0.05)),
    )
    return model


#: Laws with the shear modulus 2e5 Pa and the bulk modulus 1e6 Pa at small strains.
LAWS = {
    "neo-Hooke": ff.laws.NeoHookean([1e5, 3e5], 1e6),
    "Mooney": ff.laws.MooneyRivlin(6e4, 4e4, 1e6),
    "Ogden": ff.laws.Ogden([3e5, -2e5], [2.0, 1.0], 1e6),
    "Hooke": ff.laws.SaintVenantKirchhoff(9e6 * 2e5 / 3.2e6, 2.6 / 6.4),
    "muscle": ff.laws.ActiveStress(ff.laws.NeoHookean(2e5, 1e6), lambda t: t, (1, 0, 0)),
    "metal": ff.laws.J2Plasticity(2e5, 1e6, 1e3),
    "relaxing": ff.laws.Viscoelastic(ff.laws.NeoHookean(1e5, 1e6), [1e5], [1.0]),
}


@pytest.mark.parametrize("name", LAWS)
def test_moduli_of_small_strains(name: str) -> None:
    """Of all laws by the same energies; strains of 1e-3 leave out 1e-6."""
    # twice a modulus, as of shear strains that are counted half, would be 2e-1
    assert LAWS[name].small_strain_moduli() == pytest.approx((2e5, 1e6), rel=1e-4)


def sized(E: float, density: float, diameter: float = 0.02) -> ff.Section:
    return ff.Section.circle(diameter, ff.Material(E, 0.3, density))


EVEN = np.linspace(0.0, 1.0, 5)
MASSLESS = ff.Section.circle(0.02, ff.Material(2.1e11, 0.3, 0.0))

#: check, words that its finding must hold, a model that has it, a near one that has not, options
FINDINGS: dict[str, tuple[str, str, Callable[[], ff.Model], Callable[[], ff.Model], object]] = {
    "free fall": ("unconnected", "falls freely", lambda: beam(joined=False), beam, None),
    "flight": (
        "unconnected", "falls freely", lambda: beam(joined=False),
        lambda: beam(joined=False, gravity=ff.Gravity((0, 0, 0))), MOTION,
    ),
    # axes of the body lie across those of gravity
    "on a rail": (
        "unconnected", "no joint to the ground supports it", lambda: railed(Z), lambda: railed(X),
        None,
    ),
    # the rod between both falls with them
    "let go from the side": (
        "unconnected", "no joint to the ground supports it", lambda: rod_between(ff.Marker("bob")),
        lambda: rod_between(ff.Ground()), None,
    ),
    "lost sheet": (
        "unconnected", 'Shell "sheet": no joint', lambda: falling(False), lambda: falling(True),
        None,
    ),
    "corner": ("meeting", "(1, 0, 0) m", lambda: two(False), lambda: two(True), None),
    "tiny element": (
        "elements", "0.002 m, the median is 0.25 m",
        lambda: beam(points=np.array([0.0, 0.002, 0.25, 0.5, 0.75, 1.0])),
        lambda: beam(points=np.array([0.0, 0.01, 0.25, 0.5, 0.75, 1.0])), None,
    ),
    "shorter than deep": (
        "elements", "the section is 2 m deep", lambda: beam(sized(2e11, 7850.0, 2.0), length=0.1),
        lambda: beam(sized(2e11, 7850.0, 0.5), length=0.1), None,
    ),
    "tiny triangle": (
        "elements", "shortest edge", lambda: sheet(np.array([0, 0.002, 0.25, 0.5, 0.75, 1.0])),
        lambda: sheet(np.array([0, 0.01, 0.25, 0.5, 0.75, 1.0])), None,
    ),
    "needles": (
        "elements", "32 triangles are needles", lambda: sheet(EVEN, v=0.01 * EVEN),
        lambda: sheet(EVEN, v=0.05 * EVEN), None,
    ),
    "millimetres": (
        "slenderness", "1e+06", lambda: beam(sized(2e11, 7850.0, 1e-3), length=1000.0),
        lambda: beam(sized(2e11, 7850.0, 0.1), length=1000.0), None,
    ),
    "stubby": (
        "slenderness", "0.1 m long and 0.2 m deep",
        lambda: beam(sized(2e11, 7850.0, 0.2), length=0.1),
        lambda: beam(sized(2e11, 7850.0, 0.05), length=0.1), None,
    ),
    "thin sheet": (
        "slenderness", "1e+07", lambda: sheet(EVEN, 1e-7), lambda: sheet(EVEN, 1e-5), None
    ),
    "stiff spring": (
        "slenderness", 'SpringDamper "spring": its stiffness', lambda: spring(1e21),
        lambda: spring(1e12), None,
    ),
    "one row": (
        "one_row", "0.5 times as wide as long", lambda: row(0.5), lambda: row(0.2), None
    ),
    "a row wider than long": (
        "one_row", "1.6 times as wide as long", lambda: row(1.6), lambda: row(1.6, 2), None
    ),
    "two rows": ("one_row", "1 times", lambda: row(1.0), lambda: row(1.0, 2), None),
    "a row without directors": (
        "one_row", "1 times", lambda: row(1.0), lambda: row(1.0, 1, "rotation_free"), None
    ),
    "smooth elements": (
        "locking", "lock: it is too stiff, by about 2 %", lambda: arch(20), lambda: arch(40), None
    ),
    "jumps of sections": (
        "jumps", "its section jumps at s = 0.5 m", lambda: stepped(2), lambda: stepped(3), None
    ),
    "corners between them": (
        "locking", "up to 58 times as long as thick", lambda: arch(20), lambda: arch(20, 0), None
    ),
    "gravity": (
        "units", "1000 times", lambda: beam(gravity=ff.Gravity((0, -9810, 0))),
        lambda: beam(gravity=ff.Gravity((0, -9.81, 0))), None,
    ),
    "E in MPa": (
        "units", "speed of sound", lambda: beam(sized(210000.0, 7850.0)),
        lambda: beam(sized(2.1e6, 1000.0)), MOTION,
    ),
    "E in MPa, statics": (
        "units", "Young's modulus is 10 Pa", lambda: beam(sized(10.0, 7850.0)),
        lambda: beam(sized(210000.0, 7850.0)), STATICS,
    ),
    "density in t/mm^3": (
        "units", "density is 7.85e-09", lambda: beam(sized(2.1e11, 7.85e-9)), beam, None
    ),
    "E in N/m^2 times 1e6": (
        "units", "2.1e+17 Pa", lambda: beam(sized(2.1e17, 7850.0)), beam, STATICS
    ),
    "inertia in kg mm^2": (
        "units", "is that of a mass of 1 kg at 316 m",
        lambda: body(inertia=(1e5, 1e5, 1e5)), body, None,
    ),
    "size": (
        "units", "its size is", lambda: beam(sized(2e11, 7850.0, 1e3), length=2e6),
        lambda: beam(sized(2e11, 7850.0, 1e3), length=2e5), None,
    ),
    "mesh in millimetres": (
        "units", 'Shell "sheet": 141 m long, other bodies have 0.173 m',
        lambda: beside_a_ball(100.0), lambda: beside_a_ball(10.0), None,
    ),
    "solid in MPa": (
        "units", 'Solid "cube": its Young', lambda: rubber(0.2, ff.laws.NeoHookean(1, 2)),
        lambda: rubber(0.2, ff.laws.NeoHookean(1e6, 2e6)), MOTION,
    ),
    "solid in millimetres": (
        "units", 'Solid "cube": 173 m long', lambda: rubber(100.0, ff.laws.NeoHookean(1e6, 2e6)),
        lambda: rubber(10.0, ff.laws.NeoHookean(1e6, 2e6)), None,
    ),
    "gap": (
        "gaps", "0.5 m from", lambda: body(ground=(0.3, 0.4, 0.0)), body, None
    ),
    "tilt": ("gaps", "0.09983 rad", lambda: turned(0.1), lambda: turned(0.0), None),
    "two hinges": (
        "redundant", "5 of 10", lambda: door(ff.Revolute, ff.Revolute),
        lambda: door(ff.Spherical, ff.PointOnLine), None,
    ),
    "moving pin": (
        "velocities", "differ by 2 m/s", lambda: body(velocity=(0, 2, 0)),
        lambda: body(velocity=(-2, 0, 0), angular_velocity=(0, 2, 0)), None,
    ),
    "drive": (
        "velocities", "its drive and the initial velocities differ by 3 rad/s",
        lambda: driven(3.0, 0.0), lambda: driven(3.0, 3.0), MOTION,
    ),
    "switch": (
        "drives", "jumps by 1 rad in the step to t = 0.501 s", lambda: switched(0.5009),
        lambda: switched(0.51), MOTION,
    ),
    "aliased load": (
        "unresolved", 'PointMoment "push": within a step it is', lambda: shaken(990.0),
        lambda: shaken(250.0), MOTION,
    ),
    "aliased drive": (
        "unresolved", 'PrescribedAngle "shaker": within a step it is',
        lambda: shaken(400.0, drive=True), lambda: shaken(200.0, drive=True), MOTION,
    ),
    "aliased, or told": (
        "unresolved", "the only values that the integrator uses", lambda: shaken(1000.0),
        lambda: shaken(1000.0, told=True), MOTION,
    ),
    "pulses": (
        "unresolved", "within a step it is", lambda: shaken(500.0), lambda: bursts(0.1), MOTION
    ),
    "pulse in a spline": (
        "unresolved", "within a step it is 1 at t = 0.2505 s", lambda: splined(1e-4),
        lambda: splined(0.01), MOTION,
    ),
    "jump along a beam": (
        "line_loads", "between 0.25 and 0.5 that 5", lambda: loaded_from(0.3),
        lambda: loaded_from(0.3, 0.3), None,
    ),
    "short waves along a beam": (
        "line_loads", "shorter elements", lambda: waves(8.0), lambda: waves(1.0), None
    ),
    "nothing acts": ("loads", "no gravity", lambda: still(False), lambda: still(True), None),
    "statics": (
        "statics", '"rod": free rigid-body motion in 3 ways',
        lambda: hinged(ff.Spherical("pin", ff.Ground(), START)), beam, STATICS,
    ),
    "statics on a spring": (
        "statics", "in one way", lambda: hinged(ff.Revolute("pin", ff.Ground(), START, axis=Y)),
        spring_held, STATICS,
    ),
    "statics of a straight wire, which has no rotation about itself": (
        "statics", '"wire": free rigid-body motion in 2 ways', lambda: wire("left"),
        lambda: wire("left", "right"), STATICS,
    ),
    "fast": (
        "steps", "1 rad in a step", lambda: driven(1000.0, 1000.0), lambda: driven(100.0, 100.0),
        MOTION,
    ),
    "mesh without beam": (
        "mesh_use", 'whose lines are "rod"', lambda: unused(False), lambda: unused(True), None
    ),
    "gravity across a plane body": (
        "across", "gravity along z has no effect", lambda: flag(gravity=(0.0, 0.0, -9.81)),
        lambda: flag(gravity=(0.0, -9.81, 0.0)), None,
    ),
    "traction across a plane body": (
        "across", 'SurfaceTraction "pull": its force along z', lambda: flag(force=(1.0, 0.0, 2.0)),
        lambda: flag(force=(1.0, 0.0, 0.0)), None,
    ),
    "gravity along radii": (
        "across", "acts outwards all around",
        lambda: flag("axisymmetric", gravity=(9.81, 0.0, 0.0)),
        lambda: flag("axisymmetric", gravity=(0.0, 9.81, 0.0)), None,
    ),
    "massless": ("massless", 'Beam "rod"', lambda: beam(MASSLESS), beam, MOTION),
    "tolerance": (
        "tolerance", "is below the round-off of its positions, 1.8e-11",
        lambda: beam(length=1e4), beam, RunOptions(dt=1e-3, t_end=1.0, tolerance=1e-12),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", FINDINGS)
def test_findings(case: str) -> None:
    name, words, wrong, right, options = FINDINGS[case]
    found = [finding for finding in ff.check(wrong(), options) if finding.check == name]
    assert len(found) == 1
    assert words in str(found[0])
    assert found[0].hint
    assert "\n" not in str(found[0])
    assert not [finding for finding in ff.check(right(), options) if finding.check == name]


def test_free_motions_of_many_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted by pivots, they are as many as by singular values."""
    model = hinged(ff.Revolute("pin", ff.Ground(), START, axis=Y))
    few = ff.check(model, STATICS)
    monkeypatch.setattr("flexfem.inspection.mobility._FEW", 0)
    assert ff.check(model, STATICS) == few
    assert "in one way" in few[0].what


def test_every_check_has_a_model() -> None:
    files = {path.stem for path in Path(checks.__path__[0]).glob("[a-z]*.py")}
    files -= {"memory"}  # its model is in test_memory
    assert files == {name for name, *_ in FINDINGS.values()}


def test_options_say_what_is_looked_for() -> None:
    """Steps, masses and free motions concern one analysis; least_norm takes dependent rows."""
    assert not ff.check(driven(1000.0, 1000.0))
    assert not ff.check(beam(MASSLESS), STATICS)
    for tolerance, count in ((1e-14, 0), (1e-16, 1)):  # of the size of the model, in statics
        assert len(ff.check(beam(length=10.0), StaticOptions(tolerance=tolerance))) == count
    assert [one.check for one in ff.check(door(ff.Revolute, ff.Revolute), MOTION)] == ["redundant"]
    chosen = RunOptions(dt=1e-3, t_end=1.0, redundant_constraints="least_norm")
    assert not ff.check(door(ff.Revolute, ff.Revolute), chosen)
    with pytest.raises(TypeError, match="options must be"):
        ff.check(beam(), {"dt": 1.0})


def test_heaviest_of_floating_groups_is_the_model() -> None:
    model = ff.Model()
    model.add(
        *(
            ff.RigidBody(f"b{i}", 1.0 + i, (1, 1, 1), position=(i, 0, 0), velocity=X)
            for i in range(3)
        )
    )
    (first, second) = ff.check(model)
    assert "b2" not in first.where + second.where
