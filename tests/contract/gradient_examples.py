# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models of numbers, for derivatives of their motions: one of each family, one of each joint."""

import numpy as np

import flexfem as ff
from tests.contract.joint_examples import EXAMPLES

#: Values of the numbers of the bodies.
NUMBERS = {"youngs": 5e6, "density": 1100.0, "mass": 0.3, "gravity": 9.81, "stiffness": 40.0}
LENGTH = 0.5
KINDS = ("se3", "damped", "nurbs", "director", "rotation_free", "solid", "slider")


def body(kind: str, *, youngs, density, mass, gravity, stiffness) -> ff.Model:
    """A body hinged or clamped at one end, and a bob or a spring at the other, or a bead on it."""
    rubber = ff.Material(youngs, 0.3, density)
    model, thing, root, tip = _thing(kind, rubber)
    model.add(ff.Gravity((0.0, 0.0, -gravity)), thing)
    if root is not None:
        model.add(ff.Revolute("hinge", ff.Ground(), root, axis=(0.0, 1.0, 0.0)))
    held = tip
    if kind == "slider":  # which passes from an element to the next one
        bead = ff.Marker("bead")
        model.add(
            ff.RigidBody(
                "bead", mass, (1e-4,) * 3, position=(0.12, 0.0, 0.0), velocity=(1.5, 0.0, 0.0)
            ),
            ff.Sliding("slide", ff.Carrier("rod"), bead),
            ff.PositionProbe("bead_place", bead),
        )
    elif kind not in ("solid", "rotation_free"):
        held = ff.Marker("bob", offset=(0.01, 0.02, 0.0))
        model.add(
            ff.RigidBody("bob", mass, (1e-3, 2e-3, 1.5e-3), position=(LENGTH + 0.05, 0.0, 0.0)),
            ff.Spherical("pin", tip, ff.Marker("bob", offset=(-0.05, 0.0, 0.0))),
        )
    model.add(
        ff.SpringDamper(
            "spring", ff.Ground((LENGTH, 0.0, 0.3)), held, stiffness=stiffness, damping=0.5,
            rest_length=0.2,
        ),
        ff.PositionProbe("tip", tip),
        ff.Probe("speed", tip, ("speed",), lambda t, end: (end.velocity @ end.velocity,)),
    )  # fmt: skip
    return model


def _thing(kind: str, rubber: ff.Material):
    """An empty model with its mesh, the body, and its markers at both ends."""
    if kind in ("director", "rotation_free"):
        surface = ff.SurfaceMesh.rectangle("rod", (LENGTH, 0.1), (4, 2))
        section = ff.ShellSection.isotropic(0.01, rubber)
        shell = ff.Shell("rod", section, element=kind, edges={"rod_left": "clamped"})
        return ff.Model("strip", surface=surface), shell, None, ff.Marker("rod", "rod_bottom_right")
    if kind == "solid":
        mesh = ff.SolidMesh.box((LENGTH, 0.03, 0.02), (4, 1, 1))
        mesh = mesh.with_surfaces(left=lambda x: x[:, 0] == 0.0)
        law = ff.laws.NeoHookean(rubber.youngs_modulus / 2.6, rubber.youngs_modulus / 1.2)
        solid = ff.Solid("rod", law, mesh, density=rubber.density, degree=1, fixed={"left": "xyz"})
        return ff.Model("bar"), solid, None, ff.Marker("rod", (LENGTH, 0.03, 0.02))
    x = np.linspace(0.0, LENGTH, 5)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.array([[i, i + 1] for i in range(4)])
    section = ff.Section.rectangle(0.03, 0.02, rubber)
    beam = ff.Beam(
        "rod", section, damping=1e-3 if kind == "damped" else 0.0,
        formulation="nurbs" if kind == "nurbs" else "se3",
    )  # fmt: skip
    model = ff.Model("rod", mesh=ff.LineMesh(x, cells, {"rod": np.arange(4)}))
    return model, beam, ff.Marker("rod", "start"), ff.Marker("rod", "end")


def jointed(name: str, *, mass, gravity, kick) -> ff.Model:
    """Rigid bodies with the joint of an example, each on a spring, thrown by ``kick``."""
    example, random = EXAMPLES[name], np.random.default_rng(5)
    places = [np.zeros(3), example.gap, np.array([2.0, 0.5, 1.0]), example.gap + 2.0]
    arm, model, markers = np.array([0.11, -0.07, 0.05]), ff.Model(name), []
    model.add(ff.Gravity((0.3, -0.2, -gravity)))
    for i, place in enumerate(places[: example.markers]):
        own = ff.Marker(f"body_{i}", offset=(0.02, 0.01, 0.03))
        model.add(
            ff.RigidBody(
                f"body_{i}", mass + 0.2 * i, (0.02, 0.03, 0.025), position=place + arm,
                velocity=kick * random.standard_normal(3),
                angular_velocity=kick * random.standard_normal(3),
            ),
            ff.SpringDamper(
                f"spring_{i}", ff.Ground(place + np.array([0.3, 0.2, 1.0])), own, stiffness=55.0,
                damping=0.7, rest_length=0.5,
            ),
            ff.PositionProbe(f"p{i}", ff.Marker(f"body_{i}", offset=(0.1, 0.2, 0.3))),
        )  # fmt: skip
        markers.append(ff.Marker(f"body_{i}", offset=-arm))
    model.add(example.cls("joint", *markers, **example.arguments))
    return model


#: Values of numbers of all parts of a mechanism.
PARTS = {
    "rest_length": 0.4, "rest_angle": 0.2, "stiffness": 30.0, "damping": 0.3, "drive": 2.0,
    "pull": 3.0, "arm": 0.1, "inertia": 0.02, "offset": 0.5, "spin": 0.7, "sideways": 0.4,
}  # fmt: skip


def mechanism(
    *, rest_length, rest_angle, stiffness, damping, drive, pull, arm, inertia, offset, spin,
    sideways,
) -> ff.Model:  # fmt: skip
    """Two bodies between springs, a drive and a force: a number of each."""
    first, second = ff.Marker("first", offset=(-offset, 0.0, 0.0)), ff.Marker("second")
    model = ff.Model("mechanism")
    model.add(
        ff.Gravity((0.0, sideways, -9.81)),
        ff.RigidBody(
            "first", 1.0, (inertia, 0.02, 0.03), position=(offset, 0.0, 0.0),
            angular_velocity=(spin, 0.0, 0.0),
        ),
        ff.RigidBody("second", 1.0, (0.01, 0.02, 0.025), position=(1.2, 0.0, 0.0)),
        ff.Spherical("pin", ff.Ground(), first),
        ff.Distance("rod", ff.Marker("first", offset=(0.1, 0.0, 0.0)), second),
        ff.TorsionalSpringDamper(
            "twist", ff.Ground(), first, axis=(0.0, 1.0, 0.0), stiffness=3.0, rest_angle=rest_angle
        ),
        ff.PrescribedDistance(
            "winch", ff.Ground((1.2, 0.0, 1.0)), second, elongation=lambda t: drive * t**3
        ),
        ff.SpringDamper(
            "spring", ff.Ground((0.0, 0.0, 1.0)), ff.Marker("second", offset=(arm, 0.05, 0.0)),
            stiffness=stiffness, damping=damping, rest_length=rest_length,
        ),
        ff.PointForce(
            "push", ff.Marker("first", offset=(0.0, arm, 0.0)), (0.0, 0.0, pull), follower=True
        ),
        # columns that depend on numbers by themselves
        ff.PositionProbe("p", ff.Marker("second", offset=(arm, 0.1, 0.0))),
        ff.Probe("own", second, ("own",), lambda t, s: (stiffness * s.position[2] + drive * t,)),
    )  # fmt: skip
    return model


#: Values of numbers of a hinge that rubs.
RUBBING = {"coefficient": 0.3, "mass": 1.2, "gravity": 9.81, "spin": 2.0}


def rubbing(*, coefficient, mass, gravity, spin) -> ff.Model:
    """A pendulum whose hinge has friction by the force that it carries."""
    hinge = ff.Revolute(
        "hinge", ff.Ground(), ff.Marker("bob", offset=(-0.3, 0.0, 0.0)), axis=(0.0, 1.0, 0.0)
    )
    model = ff.Model("rubbing")
    model.add(
        ff.Gravity((0.0, 0.5, -gravity)),
        ff.RigidBody(
            "bob", mass, (0.01, 0.02, 0.03), position=(0.3, 0.0, 0.0),
            velocity=(0.0, 0.0, -0.3 * spin), angular_velocity=(0.0, spin, 0.0),
        ),
        hinge,
        ff.JointFriction("friction", hinge, coefficient=coefficient, radius=0.1, velocity=0.05),
        ff.PositionProbe("tip", ff.Marker("bob", offset=(0.1, 0.1, 0.0))),
    )  # fmt: skip
    return model


def _plane(strain, p):
    """Energy of a plate that stretches and bends."""
    parts = ((p.A, *(strain[i] for i in range(3))), (p.D, *(strain[i] for i in range(3, 6))))
    return sum(
        0.5 * size * (a**2 + b**2 + 0.6 * a * b + 0.35 * c**2) for size, a, b, c in parts
    )  # fmt: skip


def damped_shell(element: str, how: str = "shell", *, gravity, damping) -> ff.Model:
    """A clamped strip that swings far sideways as well, damped by itself, its law or its modes."""
    section = ff.ShellSection.isotropic(0.01, ff.Material(5e6, 0.3, 1100.0))
    if how == "law":
        numbers = {"A": 5e4, "D": 5e4 * 0.01**2 / 12.0, "tau": damping}
        section = section.with_law(
            ff.ShellLaw(
                _plane, dissipation=lambda e, rate, p: p.tau * _plane(rate, p), parameters=numbers
            )
        )
    tip = ff.Marker("rod", "rod_bottom_right")
    model = ff.Model("damped", surface=ff.SurfaceMesh.rectangle("rod", (LENGTH, 0.1), (4, 2)))
    model.add(
        ff.Gravity((0.0, 3.0, -gravity)),
        ff.Shell(
            "rod", section, element=element, damping=damping if how == "shell" else 0.0,
            edges={"rod_left": "clamped"},
        ),
        ff.PositionProbe("tip", tip),
    )  # fmt: skip
    if how == "modes":
        model.add(ff.ModalDamping("damping", [40.0 * damping] * 4))
    return model


#: Sizes of a strip, and its fixed edge that grows with its width.
STRIP = {"length": 0.5, "width": 0.1}
NET = {"axial": 60.0, "damping": 2e-2, "speed": 1.0, "mass": 0.1}


def strip(element: str, *, length, width) -> ff.Model:
    """A strip of solid elements or of a shell, clamped at one end."""
    model = ff.Model("strip")
    rubber = ff.Material(5e6, 0.3, 1100.0)
    if element == "solid":
        mesh = ff.SolidMesh.box((length, width, 0.02), (4, 2, 1))
        mesh = mesh.with_surfaces(left=lambda x: x[:, 0] == 0.0)
        law = ff.laws.NeoHookean(2e6, 4e6)
        thing = ff.Solid("rod", law, mesh, density=1100.0, degree=1, fixed={"left": "xyz"})
        tip, root = (ff.Marker("rod", (x, width, 0.02)) for x in (length, 0.0))
    else:
        surface = ff.SurfaceMesh.rectangle("rod", (length, width), (4, 2))
        model = ff.Model("strip", surface=surface)
        section = ff.ShellSection.isotropic(0.01, rubber)
        thing = ff.Shell("rod", section, element=element, edges={"rod_left": "clamped"})
        tip, root = (ff.Marker("rod", f"rod_top_{side}") for side in ("right", "left"))
    model.add(ff.Gravity((0.0, 3.0, -9.81)), thing)
    model.add(ff.PositionProbe("tip", tip), ff.PositionProbe("root", root))
    return model


def netted(*, axial, damping, speed, mass, catch=False) -> ff.Model:
    """A free net that shrinks, some of whose cables become slack or taut."""
    ticks = np.linspace(0.0, 1.0, 3)
    points = np.array([[x, y, 0.1 * x * y] for y in ticks for x in ticks])
    cells = [[0, 1], [1, 2], [3, 4], [4, 5], [6, 7], [7, 8], [0, 3], [3, 6], [1, 4], [4, 7],
             [2, 5], [5, 8], [0, 4], [4, 8]]  # fmt: skip
    rest = np.linspace(0.47, 0.51, len(cells))
    mesh = ff.ElementMesh(points, cells, "interval", nodes={"edge": [2]})
    model = ff.Model("netted")
    model.add(
        ff.CableNet(
            "net", mesh, axial, mass_per_length=mass, rest_length=rest, damping=damping,
            slack_damping=0.1 * damping, dissipating_catch=catch, velocity=(speed, 0.0, 0.0),
            angular_velocity=(0.0, 3.0, 1.0),
        ),
        ff.PositionProbe("at", ff.Marker("net", "edge")),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model
