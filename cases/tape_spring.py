# SPDX-License-Identifier: LGPL-3.0-or-later
"""A tape spring, as of a carpenter's tape, folds until its layers touch, is let go, and snaps open.

The tape is a shell, straight along X and curved across: an arc of ``--radius`` 15 mm and
``--angle`` 110 degrees, 0.2 m long and 0.1 mm thick, of copper-beryllium (E = 131e9 N/m^2,
nu = 0.3, rho = 8300 kg/m^3). Its ends are clamped in caps of mass ``--cap``, which are turned about
Y by half of ``--fold`` each, in the time ``--fold-time``; that of the left end stays in its place,
the other one slides along X. A negative fold is one against the curvature: the edges are outside,
and the layers touch with their backs. At ``--release`` the right cap is let go, and
``--damping`` alone calms the tape. The left cap stays turned. Layers repel each other when they are
nearer than ``--reach`` thicknesses, with friction if there is a coefficient. ``--mesh`` counts
nodes of the grid along and across the tape.

History: ``gap`` (m), the least distance of layers, that of the reach if they are farther apart;
``contact_penetration`` (m), zero; ``contact_fx, contact_fy, contact_fz`` (N), the force of the tape
on itself, zero; ``contact_normal`` (N), the sum of the sizes of all normal forces, and
``contact_closed``, the number of pairs that push; ``turn_fx, turn_fy, turn_fz, turn_mx, turn_my,
turn_mz`` (N, N m), the wrench of the drive on the left cap, of which ``turn_my`` bends the tape;
``angle`` (rad), by which it is bent between its caps, from -pi/2 to 3 pi/2 in the sense of the
fold; position of the right cap ``end_x, end_y, end_z`` (m); ``energy_kinetic, energy_strain,
energy_gravity, energy_work, energy_dissipation, energy_balance`` (J), the strain energy with that
of the contact.

Expected: the tape is stiff until its section flattens in the middle, and snaps at ``peak_moment``;
that of a long tape is ``peak_of_long_tape`` (W. Wuest, "Einige Anwendungen der Theorie der
Zylinderschale", Z. angew. Math. Mech. 34, 1954, in the form of K. A. Seffen, Z. You, S. Pellegrino,
Int. J. Mech. Sci. 42, 2000), for shallow sections. This one takes 0.63 N m instead of 0.43: it is
short, and its caps keep the ends from flattening; how much of the difference is theirs was not
found out. From there on the fold has the radius of the
section, and its moment stays the same, ``steady_moment``: (1 + nu) D times the angle of the
section, with the stiffness D of a plate, or (1 - nu) along the curvature (K. A. Seffen, S.
Pellegrino, "Deployment dynamics of tape springs", Proc. R. Soc. Lond. A 455, 1999), 0.0299 N m.
``fold_moment`` is the strain energy that the tape takes over the angle, between a sixth and a half
of the fold: 0.0305 N m; beyond a right angle it grows, to 0.043 N m. The gap is
positive in every row, 0.41 mm at least, and after the release the mechanical energy does not grow:
``energy_made``, its largest growth over that at the release, is 0. With less damping and longer
steps it was 2 %: look at it.
Run: ``mpirun -n 2 python cases/tape_spring.py``, then ``flexfem view results/tape_spring``.
"""

import math
import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import flexfem as ff

Points = npt.NDArray[np.float64]
#: Length of the caps along the tape, and height over their width.
CAP, HEIGHT = 0.003, 0.4


def strip(nodes: tuple[int, int], length: float, radius: float, angle: float) -> ff.SurfaceMesh:
    """Grid along X on an arc of an ``angle`` (rad), the centre of which is the origin."""
    along = np.linspace(-0.5, 0.5, nodes[0]) * length
    across = np.linspace(-0.5, 0.5, nodes[1]) * angle
    centre = 2.0 * radius * math.sin(0.5 * angle) / angle

    def surface(parameters: Points) -> Points:
        x, turn = parameters.T
        return np.column_stack([x, radius * np.sin(turn), centre - radius * np.cos(turn)])

    return ff.SurfaceMesh.grid("tape", along, across, surface)


def cap(name: str, mass: float, chord: float, x: float) -> ff.RigidBody:
    """Box around an end of the tape."""
    sides = (CAP, chord, HEIGHT * chord)
    squares = [side**2 for side in sides]
    inertia = (squares[1] + squares[2], squares[0] + squares[2], squares[0] + squares[1])
    return ff.RigidBody(
        name, mass, tuple(mass / 12.0 * value for value in inertia), position=(x, 0.0, 0.0),
        shape=ff.Box(sides),
    )  # fmt: skip


def bent(fold: float) -> ff.Probe:
    """Angle between the caps about Y, of a fold in the sense of the sign of ``fold``."""
    sense = math.copysign(1.0, fold)

    def angle(t: float, left: ff.MarkerState, right: ff.MarkerState) -> list[float]:
        between = right.rotation.T @ left.rotation
        turn = sense * math.atan2(between[0, 2], between[0, 0])
        return [sense * (turn + 2.0 * math.pi * (turn < -0.5 * math.pi))]

    return ff.Probe("bend", (ff.Marker("left"), ff.Marker("right")), ("angle",), angle)


def build(
    *, mesh: str, length: float, radius: float, angle: float, thickness: float,
    youngs_modulus: float, poisson_ratio: float, density: float, damping: float, cap_mass: float,
    fold: float, fold_time: float, release: float, friction: float, reach: float,
    contact_stiffness: float,
) -> ff.Model:  # fmt: skip
    """Model of the tape between its caps."""
    section = ff.ShellSection.isotropic(
        thickness, ff.Material(youngs_modulus, poisson_ratio, density)
    )
    arc, middle = math.radians(angle), 0.5 * length
    surface = strip(ff.grid_nodes(mesh), length, radius, arc)
    chord = 2.0 * radius * math.sin(min(0.5 * arc, 0.5 * math.pi))
    turn = ff.SmoothStep(0.0, fold_time, 0.0, 0.5 * math.radians(fold))
    left, right = ff.Marker("left"), ff.Marker("right")
    here, there = ff.Ground((-middle, 0.0, 0.0)), ff.Ground((middle, 0.0, 0.0))
    model = ff.Model("tape_spring", surface=surface)
    model.add(
        ff.Shell("tape", section, element="director", damping=damping),
        cap("left", cap_mass, chord, -middle),
        cap("right", cap_mass, chord, middle),
        ff.ClampedLine("left clamp", ff.ShellLine("tape", "tape_left"), left),
        ff.ClampedLine("right clamp", ff.ShellLine("tape", "tape_right"), right),
        ff.Spherical("pin", here, left),
        ff.PointOnLine("slide", there, right, axis=(1.0, 0.0, 0.0)),
        ff.PrescribedRotation("left turn", here, left, rotation=lambda t: (0.0, turn(t), 0.0)),
        ff.PrescribedRotation("right turn", there, right, rotation=lambda t: (0.0, -turn(t), 0.0)),
        ff.Event("let go", (), lambda t: t - release,
                 (ff.ReleaseJoint("right turn"), ff.ReleaseJoint("slide"))),
        ff.Contact("layers", "tape", "tape", friction=friction, reach=reach * thickness,
                   stiffness=contact_stiffness),
        ff.ContactProbe("contact", "layers", names={"gap": "gap"}),
        ff.ReactionProbe("turn", "left turn"),
        bent(fold),
        ff.PositionProbe("end", right),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def moment_of_long_tape(
    curvature: Points, radius: float, angle: float, thickness: float, youngs_modulus: float,
    poisson_ratio: float,
) -> Points:  # fmt: skip
    """Moments (N m) of a shallow tape that is bent evenly by curvatures (1/m) against its own."""
    nu, width = poisson_ratio, radius * angle
    plate = youngs_modulus * thickness**3 / (12.0 * (1.0 - nu**2))
    size = (3.0 * (1.0 - nu**2)) ** 0.25 * width * np.sqrt(curvature / thickness)
    total = np.sinh(size) + np.sin(size)
    first = 2.0 / size * (np.cosh(size) - np.cos(size)) / total
    second = 0.25 * first - np.sinh(size) * np.sin(size) / total**2
    across = 1.0 / radius + nu * curvature
    moment: Points = curvature + nu / radius - nu * across * first + across**2 / curvature * second
    return width * plate * moment


def results(
    history: Mapping[str, Points], *, radius: float, angle: float, thickness: float,
    youngs_modulus: float, poisson_ratio: float, fold: float, release: float,
) -> dict[str, float]:  # fmt: skip
    """Least gap, moments beside those of theory, and growth of energy after the release."""
    arc, sense = math.radians(angle), math.copysign(1.0, fold)
    t, turned = history["t"], sense * history["angle"]
    apart = (t < release) & (np.cumsum(history["contact_closed"]) == 0)
    found = {"least_gap": float(history["gap"].min())}
    found["peak_moment"] = float((sense * history["turn_my"][apart]).max())
    if fold < 0.0:
        # the fold's own curvature is far behind the maximum
        curvature = np.linspace(1e-4, 1.0, 10000) / radius
        found["peak_of_long_tape"] = float(_first_peak(moment_of_long_tape(
            curvature, radius, arc, thickness, youngs_modulus, poisson_ratio
        )))  # fmt: skip
    whole = abs(math.radians(fold))
    steady = np.flatnonzero(apart & (turned >= whole / 6.0) & (turned <= 0.5 * whole))
    if len(steady) > 1:
        ends = steady[[0, -1]]
        found["fold_moment"] = float(
            np.diff(history["energy_strain"][ends])[0] / np.diff(turned[ends])[0]
        )
    plate = youngs_modulus * thickness**3 / (12.0 * (1.0 - poisson_ratio**2))
    found["steady_moment"] = plate * arc * (1.0 - sense * poisson_ratio)
    free = (history["energy_kinetic"] + history["energy_strain"])[t >= release]
    if len(free) > 0:
        found["energy_made"] = float((free - np.minimum.accumulate(free)).max() / free[0])
    return found


def _first_peak(values: Points) -> float:
    """The first local maximum, or the last value if there is none."""
    falls = np.flatnonzero(np.diff(values) < 0.0)
    return float(values[falls[0] if len(falls) else -1])


CASE = ff.Case(
    name="tape_spring",
    summary="a tape spring folds until its layers touch, and snaps open (Seffen, Pellegrino 1999)",
    description=__doc__,
    build=build,
    options=(
        ff.GridOption("mesh", "25x5", "nodes along the tape and across"),
        ff.Option("length", float, 0.2, "of the tape", unit="m", above=0.0),
        ff.Option("radius", float, 0.015, "of its section", unit="m", above=0.0),
        ff.Option("angle", float, 110.0, "of its section", unit="deg", above=0.0, maximum=300.0),
        ff.Option("thickness", float, 1e-4, "of the tape", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 131e9, "of the tape", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the tape", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 8300.0, "of the tape", unit="kg/m^3", above=0.0),
        ff.Option("damping", float, 3e-3, "stiffness-proportional", unit="s", minimum=0.0),
        ff.Option("cap_mass", float, 0.002, "of each cap", unit="kg", above=0.0),
        ff.Option("fold", float, -183.5, "angle between the ends, negative against the curvature",
                  unit="deg", minimum=-260.0, maximum=260.0),
        ff.Option("fold_time", float, 0.5, "in which the ends are turned", unit="s", above=0.0),
        ff.Option("release", float, 0.52, "time at which the right end is let go", unit="s",
                  above=0.0),
        ff.Option("friction", float, 0.0, "Coulomb's coefficient", minimum=0.0),
        ff.Option("reach", float, 5.0, "gap below which layers repel each other, in thicknesses",
                  above=0.0),
        ff.Option("contact_stiffness", float, 1e9, "of the layers: scale of pressure per gap",
                  unit="N/m^3", above=0.0),
    ),
    dt=1e-3,
    t_end=0.6,
    rho_inf=0.6,
    every=4,
    smoke={"mesh": "5x3", "fold": -0.02, "fold_time": 8e-3, "release": 8e-3, "dt": 1e-3,
           "tolerance": 1e-10, "t_end": 0.01},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
