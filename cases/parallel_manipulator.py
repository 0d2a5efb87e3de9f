# SPDX-License-Identifier: LGPL-3.0-or-later
"""Planar flexible parallel manipulator 3-RRR with redundant actuation.

Three chains of two links each join the corners A1 (top), A2 (left) and A3 (right) of an equilateral
triangle with the end effector P, common to all of them, in the X-Y plane without gravity. Links 1,
3, 5 are driven at A1, A2, A3, links 2, 4, 6 follow them; the elbows are rotated anticlockwise from
the lines A_i P. Links are given in a rough position and assembled with P where its path begins.

P is to move from the origin to ``--end-x``, ``--end-y`` within ``--duration`` (give the same
``--t-end``) on a spiral of ``--turns`` or on the straight line, with s = 10 tau^3 - 15 tau^4 + 6
tau^5 of the way after the part tau of the time, or with a speed that rises to the end, s = tau^2;
with ``--path file`` along the columns t (s), x, y (m) of ``--path-file``, a table of commas that
begins at rest at t = 0. The torques of rigid links for this are fed forward: ``--mode 1`` with two
drives, A1 and A2; with three ``--mode 2`` (least Euclidean norm of the forces at elbows and end
effector), ``--mode 3`` (least norm of the drives' powers) and ``--mode torque`` (least norm of the
torques). Of the ``--flexible`` links ``--links`` makes

- ``se3``: geometrically exact beams of ``--elements``;
- ``fem``: the published discretisation, Euler-Bernoulli elements in a floating frame that is
  clamped to the link's first node, with all their coordinates; linear, so that they do not get
  shorter as they bend;
- ``floating``: elements with shear in a floating frame, reduced to their ends and ``--modes``; they
  get shorter as they bend except with ``--no-stiffening``;
- ``segments``: ``--segments`` rigid ones with torsion springs between them.

Elbows are revolute joints and the chains meet in joints that hold two points together in the
plane only, so that no constraint is redundant. ``--closure reduced`` integrates independent
velocities without multipliers.

History: position, velocity, acceleration and error (off the path) of P, P_x, P_y, P_vx, P_vy, P_ax,
P_ay, error_x, error_y, m, m/s, m/s^2; tau_1, tau_2, tau_3, N m; of each link's first section angle
from the X axis, rate and acceleration, rad, rad/s, rad/s^2, angle_1, angle_2, angle_3, angle_4,
angle_5, angle_6, rate_1, rate_2, rate_3, rate_4, rate_5, rate_6, acceleration_1, acceleration_2,
acceleration_3, acceleration_4, acceleration_5, acceleration_6, and their deviations from those of
rigid links with P on its path, angle_error_1, angle_error_2, angle_error_3, angle_error_4,
angle_error_5, angle_error_6, rate_error_1, rate_error_2, rate_error_3, rate_error_4, rate_error_5,
rate_error_6, acceleration_error_1, acceleration_error_2, acceleration_error_3,
acceleration_error_4, acceleration_error_5, acceleration_error_6. Of the ends of links 1, 3, 5 in
the axes of the first section: transverse_1, transverse_3, transverse_5, m; rotation_1, rotation_3,
rotation_5, rad; axial_1, axial_3, axial_5, m, where the end is along the axis, shortening by
bending (0.6 w^2/l) included; and elongation_1, elongation_3, elongation_5, m, the stretch of
the axis by normal forces: the axial deflection of linear elements, which the source means (with
``--links fem`` both are the same).

Expected (Liu et al., Math. Biosci. Eng. 20 (2023) 807, in words only): axial deflections three
orders of magnitude below transverse ones, redundant drives better than two, mode 2 the smoothest,
errors that grow with time, those of mode 1 the most. Here the largest ends' deflections are 0.826,
0.485, 0.724 mm in modes 1, 2, 3 (fem; se3 and floating within 0.5 %), normal forces stretch by 24,
11, 23 nm, 2.8e-5 of that, and ends come 1.7, 0.6, 1.3 um nearer by bending, 2e-3 of it; P ends off
by 24.3, 1.0, 1.1 um and is off by 24.3, 16.6, 16.7 um at most. Rates of mode 3 are off the most.
Only with ``--speed rising`` do the errors of all modes grow to the end, to 42, 31, 31 um. Segments
are 18 % too stiff. Within 0.05 s deflections reach 87, 50, 85 mm (se3), a third of the length.
Rigid links follow the path up to the error of the integration, below 0.2 um with the default step.
Steps take two iterations in both closures.
Run: ``mpirun -n 2 python cases/parallel_manipulator.py --mode 2`` or, ten times as fast,
``python cases/parallel_manipulator.py --duration 0.05 --t-end 0.05 --dt 2.5e-5``.
"""

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path as File

import numpy as np
import numpy.typing as npt

import flexfem as ff

CHAINS = (1, 2, 3)
Z = (0.0, 0.0, 1.0)
PINNED = ("z", "rx", "ry", "rz")  # two points together in the plane
ALUMINIUM = ff.Material(70e9, 0.33, 2700.0)
LINK_COLUMNS = [f"{what}{off}" for off in ("", "_error") for what in
                ("angle", "rate", "acceleration")]  # fmt: skip
Array = npt.NDArray[np.float64]
#: Position, velocity and acceleration as complex numbers, m, s.
Motion = tuple[complex, complex, complex]


@dataclass(frozen=True)
class Design:
    """Dimensions and discretisation: side of the base, lengths of driven and following links, m."""

    side: float = 0.5
    lengths: tuple[float, float] = (0.244, 0.244)
    height: float = 5e-3
    area: float = 40e-6
    material: ff.Material = ALUMINIUM
    elements: int = 8
    segments: int = 8
    modes: int = 4
    stiffening: bool = True

    @property
    def section(self) -> ff.Section:
        """Section with its height in the plane."""
        return ff.Section.rectangle(self.height, self.area / self.height, self.material)

    def corner(self, chain: int) -> complex:
        """Place of a drive, m."""
        return self.side / math.sqrt(3.0) * np.exp(1j * math.radians(90.0 + 120.0 * (chain - 1)))

    def rigid_motion(self, way: Callable[[float], Motion], t: float) -> Array:
        """Angles, rates and accelerations (6, 3) of rigid links with P on its path."""
        P, v, a = way(t)
        first, second = self.lengths
        out = np.zeros((6, 3))
        for chain in CHAINS:
            d = P - self.corner(chain)
            cosine = (first**2 + abs(d) ** 2 - second**2) / (2.0 * first * abs(d))
            if not abs(cosine) < 1.0:
                raise ValueError(
                    f"parallel_manipulator: the path must be in reach of all links, but at {t:g} s "
                    f"P is {abs(d):.6g} m from A{chain}"
                )
            one = np.exp(1j * (np.angle(d) + math.acos(cosine)))
            two = (d - first * one) / second
            arms = np.array([[z.real, z.imag] for z in (1j * first * one, 1j * second * two)]).T
            rates = np.linalg.solve(arms, [v.real, v.imag])
            a_chain = a + first * rates[0] ** 2 * one + second * rates[1] ** 2 * two
            more = np.linalg.solve(arms, [a_chain.real, a_chain.imag])
            rows = slice(2 * chain - 2, 2 * chain)
            out[rows] = np.stack([np.angle([one, two]), rates, more], axis=1)
        return out


@dataclass(frozen=True)
class Path:
    """Path of P from the origin in the plane: its motion as a function of time."""

    end: complex
    turns: float
    speed: str
    duration: float

    def __call__(self, t: float) -> Motion:
        """Motion at time t."""
        T = self.duration
        tau = min(max(t / T, 0.0), 1.0)
        if self.speed == "rising":
            s, ds, dds = tau**2, 2.0 * tau / T, 2.0 / T**2
        else:
            s = tau**3 * (10.0 + tau * (6.0 * tau - 15.0))
            ds = 30.0 * tau**2 * (1.0 - tau) ** 2 / T
            dds = 60.0 * tau * (1.0 - tau) * (1.0 - 2.0 * tau) / T**2
        if t > T:
            ds = dds = 0.0
        c = 2.0 * math.pi * self.turns
        there = self.end * np.exp(1j * c * (s - 1.0))
        first, second = there * (1.0 + 1j * c * s), there * (2j * c - c**2 * s)
        return there * s, first * ds, second * ds**2 + first * dds


class TablePath:
    """Path of P through the rows of a file."""

    def __init__(self, file: str) -> None:
        """Read it."""
        owner, table = f"parallel_manipulator: path file '{file}'", ff.read_history(File(file))
        missing = [name for name in ("t", "x", "y") if name not in table]
        if missing:
            raise ValueError(f"{owner} must have the columns t, x, y, but has no {missing[0]}")
        if len(table["t"]) < 6 or table["t"][0] != 0.0:
            raise ValueError(f"{owner} must have six rows or more and begin at t = 0")
        self._x, self._y = (ff.Spline(table["t"], table[name]) for name in "xy")
        self.duration = float(table["t"][-1])
        speeds = [abs(self(t)[1]) for t in np.linspace(0.0, self.duration, 101)]
        if speeds[0] > 1e-2 * max(speeds):
            raise ValueError(f"{owner} must begin at rest, but does with {speeds[0]:.3g} m/s")

    def __call__(self, t: float) -> Motion:
        """Motion at time t."""
        x, y = ([s(t), s.derivative(t), s.derivative(t, 2)] for s in (self._x, self._y))
        return complex(x[0], y[0]), complex(x[1], y[1]), complex(x[2], y[2])


def turn(angle: float) -> Array:
    """Rotation matrix about Z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def plane(z: complex) -> Array:
    """Point of the plane in space."""
    return np.array([z.real, z.imag, 0.0])


class Link:
    """A link of the manipulator: its bodies, and markers at its ends along it."""

    def __init__(self, number: int, start: Array, angle: float, design: Design, kind: str) -> None:
        """Place it roughly; ``kind`` is "rigid", "segments", "se3", "fem" or "floating"."""
        self.name, self.kind, self.design = f"link_{number}", kind, design
        self.length = design.lengths[(number - 1) % 2]
        self.axes, self.start = turn(angle), start
        self.end = start + self.length * self.axes[:, 0]
        self.straight: list[ff.Rigid] = []
        if kind in ("se3", "fem", "floating"):
            self.root, self.tip = (self._marker(self.name, point=p) for p in ("start", "end"))
        else:
            pieces = design.segments if kind == "segments" else 1
            names = [f"{self.name}_{i + 1}" for i in range(pieces)] if pieces > 1 else [self.name]
            self.pieces, half = names, 0.5 * self.length / pieces
            self.root = self._marker(names[0], offset=(-half, 0.0, 0.0))
            self.tip = self._marker(names[-1], offset=(half, 0.0, 0.0))

    def _marker(self, body: str, **place: object) -> ff.Marker:
        return ff.Marker(body, rotation=self.axes, **place)  # type: ignore[arg-type]

    def add_to(self, model: ff.Model) -> None:
        """Add its bodies."""
        design, section = self.design, self.design.section
        if self.kind in ("fem", "floating"):
            body = (fem_link if self.kind == "fem" else reduced_link)(design, self.length)
            model.add(ff.FloatingBody(self.name, body, position=self.start, rotation=self.axes,
                                      stiffening=design.stiffening))  # fmt: skip
            return
        if self.kind == "se3":
            model.add(ff.Beam(self.name, section, orientation=tuple(self.axes[:, 1])))
            return
        piece, width = self.length / len(self.pieces), design.area / design.height
        mass = section.mass_per_length * piece
        slender = mass * piece**2 / 12.0 * np.array([0.0, 1.0, 1.0])
        about = piece * np.diag(section.inertia)[3:] + slender
        shape = ff.Box((piece, design.height, width))
        for i, name in enumerate(self.pieces):
            middle = self.start + (i + 0.5) * piece * self.axes[:, 0]
            model.add(ff.RigidBody(name, mass, about, position=middle, rotation=self.axes,
                                   shape=shape))  # fmt: skip
        stiffness = design.material.youngs_modulus * width * design.height**3 / 12.0 / piece
        for before, after in pairwise(self.pieces):
            a = self._marker(before, offset=(0.5 * piece, 0.0, 0.0))
            b = self._marker(after, offset=(-0.5 * piece, 0.0, 0.0))
            spring = ff.TorsionalSpringDamper(f"{after}_spring", a, b, axis=Z, stiffness=stiffness)
            model.add(ff.Revolute(f"{after}_pin", a, b, axis=Z), spring)
            self.straight.append(ff.Rigid(f"{after}_straight", a, b))

    def elongation(self, name: str) -> ff.Probe | ff.ElongationProbe:
        """Stretch of its axis by normal forces; zero where it is rigid."""
        if self.kind in ("rigid", "segments"):
            return ff.Probe(name, (), (name,), lambda t: (0.0,))
        return ff.ElongationProbe(name, self.name)


@cache
def reduced_link(design: Design, length: float) -> ff.ReducedBody:
    """A link as beam elements, reduced to the motion of its ends and some modes (collective)."""
    line = np.linspace([0.0, 0.0, 0.0], [length, 0.0, 0.0], design.elements + 1)
    return ff.reduce_body(
        ff.beam_body(line, design.section, orientation=(0.0, 1.0, 0.0)),
        {"start": line[0], "end": line[-1]}, modes=design.modes,
        geometric_stiffness=design.stiffening,
    )  # fmt: skip


@cache
def fem_link(design: Design, length: float) -> ff.ReducedBody:
    """A link as Euler-Bernoulli elements with all their coordinates."""
    if design.stiffening:
        raise ValueError(
            "parallel_manipulator: links of linear elements (fem) must be without stiffening"
        )
    line = np.linspace([0.0, 0.0, 0.0], [length, 0.0, 0.0], design.elements + 1)
    return ff.euler_bernoulli_body(
        line, design.section, {"start": 0, "end": design.elements}, orientation=(0.0, 1.0, 0.0)
    )


def manipulator(design: Design, kinds: tuple[str, str]) -> tuple[ff.Model, list[Link]]:
    """Bodies and joints of six links in rough positions; kinds of driven and following links."""
    links = []
    for chain in CHAINS:
        start = plane(design.corner(chain))
        to_centre = math.atan2(-start[1], -start[0])
        active = Link(2 * chain - 1, start, to_centre + 1.0, design, kinds[0])
        links += [active, Link(2 * chain, active.end, to_centre - 0.8, design, kinds[1])]
    lines = {link.name: [link.start, link.end] for link in links if link.kind == "se3"}
    mesh = ff.LineMesh.straight(lines, design.elements) if lines else None
    model = ff.Model("parallel_manipulator", mesh=mesh)
    for link in links:
        link.add_to(model)
    for chain in CHAINS:
        active, follower = links[2 * chain - 2 : 2 * chain]
        model.add(
            ff.Revolute(f"A{chain}", ff.Ground(active.start), active.root, axis=Z),
            ff.Revolute(f"B{chain}", active.tip, follower.root, axis=Z),
        )
        if chain > 1:
            model.add(ff.Generic(f"P{chain}", links[1].tip, follower.tip, free=PINNED))
    return model, links


def torques(
    design: Design, mode: str, way: Path | TablePath, samples: int
) -> dict[int, ff.Spline]:  # fmt: skip
    """Torques of the drives that move rigid links along the path, by chain."""
    model, links = manipulator(design, ("rigid", "rigid"))
    model = assembled(model, links, way(0.0)[0])
    ends = [model[f"P{chain}"] for chain in CHAINS[1:]]
    tips = [ends[0].a, *(joint.b for joint in ends)]
    elbows = [model[f"B{chain}"].b for chain in CHAINS]
    least = {
        "2": ff.LeastJointForces([*elbows, *tips]),
        "3": ff.LeastPower(),
    }.get(mode, ff.LeastEffort())
    drives = [
        ff.Actuator(f"drive_{chain}", model[f"A{chain}"].a, model[f"A{chain}"].b, axis=Z)
        for chain in CHAINS[: 2 if mode == "1" else 3]
    ]
    outputs = [
        ff.PrescribedTranslation(
            f"path_{'xy'[i]}", ff.Ground(), tips[0], lambda t, i=i: plane(way(t)[0])[i],
            axis=np.eye(3)[i],
        )
        for i in range(2)
    ]  # fmt: skip
    found = ff.inverse_dynamics(
        model, outputs, drives, np.linspace(0.0, way.duration, samples), least
    )
    return {
        chain: found.amplitude(drive.name) for chain, drive in zip(CHAINS, drives, strict=False)
    }


def assembled(model: ff.Model, links: list[Link], start: complex) -> ff.Model:
    """The model with its joints closed and P where it starts."""
    centre = ff.PointOnLine("centre", ff.Ground(plane(start)), links[1].tip, axis=Z)
    return ff.assemble(model, also=[centre, *(joint for link in links for joint in link.straight)])


def build(
    *, mode: str, links: str, flexible: str, in_plane_height: float, area: float,
    active_length: float, follower_length: float, base: float, youngs_modulus: float,
    poisson_ratio: float, density: float, elements: int, modes: int, segments: int,
    stiffening: bool, duration: float, path: str, turns: float, end_x: float, end_y: float,
    path_file: str, speed: str, samples: int, closure: str,
) -> ff.Model:  # fmt: skip
    """Model with the torques fed forward."""
    design = Design(
        1e-3 * base, (1e-3 * active_length, 1e-3 * follower_length), 1e-3 * in_plane_height,
        1e-6 * area, ff.Material(1e9 * youngs_modulus, poisson_ratio, density), elements, segments,
        modes, stiffening,
    )  # fmt: skip
    if (path == "file") is not bool(path_file):
        raise ValueError("parallel_manipulator: --path file and --path-file must go together")
    way: Path | TablePath = TablePath(path_file) if path == "file" else Path(
        1e-3 * complex(end_x, end_y), turns if path == "spiral" else 0.0, speed, duration
    )  # fmt: skip
    rigid = cache(lambda t: design.rigid_motion(way, t))
    for t in np.linspace(0.0, way.duration, samples):
        rigid(float(t))  # in reach along the whole path
    kinds = {
        "active": (links, "rigid"), "all": (links, links), "none": ("rigid", "rigid"),
    }[flexible]  # fmt: skip
    model, parts = manipulator(design, kinds)
    drives = torques(design, mode, way, samples)
    for chain, torque in drives.items():
        joint = model[f"A{chain}"]
        model.add(ff.Actuator(f"drive_{chain}", joint.a, joint.b, axis=Z, force=torque))
    nothing: Callable[[float], float] = lambda t: 0.0  # noqa: E731
    P = [f"P_{what}{axis}" for what in ("", "v", "a") for axis in "xy"]
    model.add(
        ff.Probe("end_effector", parts[1].tip, (*P, "error_x", "error_y"),
                 lambda t, s: [*s.position[:2], *s.velocity[:2], *s.acceleration[:2],
                               *(s.position - plane(way(t)[0]))[:2]]),
        ff.Probe("torques", (), ("tau_1", "tau_2", "tau_3"),
                 lambda t: [drives.get(chain, nothing)(t) for chain in CHAINS]),
    )  # fmt: skip

    def angles(t: float, s: ff.MarkerState, i: int) -> tuple[float, ...]:
        angle = math.atan2(s.rotation[1, 0], s.rotation[0, 0])
        known, rate, more = rigid(t)[i]
        w, e = s.angular_velocity[2], s.angular_acceleration[2]
        return angle, w, e, math.remainder(angle - known, 2.0 * math.pi), w - rate, e - more

    for i, link in enumerate(parts):
        columns = [f"{column}_{i + 1}" for column in LINK_COLUMNS]
        model.add(ff.Probe(f"joint_{i + 1}", link.root, columns, lambda t, s, i=i: angles(t, s, i),
                           unwrap=columns[:1]))  # fmt: skip
    for i, link in list(enumerate(parts, start=1))[::2]:
        columns = [f"axial_{i}", f"transverse_{i}", f"rotation_{i}"]
        length = link.length
        model.add(
            ff.Probe(f"end_{i}", (link.root, link.tip), columns,
                     lambda t, root, tip, length=length: _deflection(root, tip, length)),
            link.elongation(f"elongation_{i}"),
        )  # fmt: skip
    return assembled(model, parts, way(0.0)[0])


def _deflection(
    root: ff.MarkerState, tip: ff.MarkerState, length: float
) -> tuple[float, float, float]:
    """Axial and transverse displacement of the end, and its rotation, from the first section."""
    u = root.rotation.T @ (tip.position - root.position)
    R = root.rotation.T @ tip.rotation
    return u[0] - length, u[1], math.atan2(R[1, 0], R[0, 0])


def results(history: Mapping[str, Array]) -> dict[str, float]:
    """Errors and deflections of the whole motion."""
    error = np.hypot(history["error_x"], history["error_y"])
    found = {"largest_error": error.max(), "final_error": error[-1]}
    for name in ("axial", "elongation", "transverse", "rotation"):
        found[f"largest_{name}"] = max(np.abs(history[f"{name}_{i}"]).max() for i in (1, 3, 5))
    for name in ("angle", "rate", "acceleration"):
        columns = [history[f"{name}_error_{i}"] for i in range(1, 7)]
        found[f"largest_{name}_error"] = max(np.abs(values).max() for values in columns)
    found["largest_torque"] = max(np.abs(history[f"tau_{i}"]).max() for i in CHAINS)
    return {name: float(value) for name, value in found.items()}


CASE = ff.Case(
    name="parallel_manipulator",
    summary="planar flexible parallel manipulator 3-RRR with redundant drives (Liu et al. 2023)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("mode", str, "1", "drives and distribution of their torques",
                  choices=("1", "2", "3", "torque")),
        ff.Option("links", str, "se3", "flexible links",
                  choices=("se3", "fem", "floating", "segments")),
        ff.Option("flexible", str, "active", "which links are flexible",
                  choices=("active", "all", "none")),
        ff.Option("active_length", float, 244.0, "of links 1, 3, 5", unit="mm", above=0.0),
        ff.Option("follower_length", float, 244.0, "of links 2, 4, 6", unit="mm", above=0.0),
        ff.Option("base", float, 500.0, "side of the triangle A1 A2 A3", unit="mm", above=0.0),
        ff.Option("in_plane_height", float, 5.0, "of the section", unit="mm", above=0.0),
        ff.Option("area", float, 40.0, "of the section", unit="mm^2", above=0.0),
        ff.Option("youngs_modulus", float, 70.0, "of the links", unit="GPa", above=0.0),
        ff.Option("poisson_ratio", float, 0.33, "of the links", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 2700.0, "of the links", unit="kg/m^3", above=0.0),
        ff.Option("elements", int, 8, "beam elements of a flexible link", minimum=1),
        ff.Option("modes", int, 4, "of a floating link beside its ends' motions", minimum=0),
        ff.Option("segments", int, 8, "rigid ones of a link", minimum=2),
        ff.Option("stiffening", bool, True, "of links in floating frames by forces and speed"),
        ff.Option("duration", float, 0.5, "of the path", unit="s", above=0.0),
        ff.Option("path", str, "spiral", "way of P", choices=("spiral", "line", "file")),
        ff.Option("turns", float, 1.0, "of the spiral, anticlockwise"),
        ff.Option("end_x", float, -14.42, "where the way ends", unit="mm"),
        ff.Option("end_y", float, 36.15, "where the way ends", unit="mm"),
        ff.Option("path_file", str, "", "table of the way, columns t, x, y [s, m]"),
        ff.Option("speed", str, "smooth", "along it: from rest to rest, or rising to the end",
                  choices=("smooth", "rising")),
        ff.Option("samples", int, 501, "times at which torques are computed", minimum=6),
        ff.Option("closure", str, "multipliers", "of the loops",
                  choices=("multipliers", "reduced")),
    ),
    dt=2.5e-4,
    t_end=0.5,
    tolerance=1e-9,
    presets={
        "closure": {"reduced": {"integrator": "independent_coordinates"}},
        "links": {"floating": {"elements": 3}, "fem": {"elements": 3, "stiffening": False}},
    },
    smoke={"elements": 2, "samples": 21, "t_end": 1e-3},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
