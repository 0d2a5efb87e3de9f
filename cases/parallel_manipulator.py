# SPDX-License-Identifier: LGPL-3.0-or-later
"""Planar flexible parallel manipulator 3-RRR with redundant actuation.

Three chains of two links each join the corners A1 (top), A2 (left) and A3 (right) of an equilateral
triangle of side 0.5 m with the end effector P, common to all of them, in the X-Y plane without
gravity. All links are 0.244 m long, of aluminium (E = 70e9 N/m^2, nu = 0.33, rho = 2700 kg/m^3)
with a section of 40 mm^2, ``--in-plane-height`` mm high in the plane. Links 1, 3, 5 are driven at
A1, A2, A3, links 2, 4, 6 follow them; the elbows are turned anticlockwise from the lines A_i P.
Links are given in a rough position and assembled with P at the origin.

P is to move to (-14.42, 36.15) mm within ``--duration`` (give the same ``--t-end``) on a spiral of
one turn or on the straight line, with s = 10 tau^3 - 15 tau^4 + 6 tau^5 of the way after the part
tau of the time, or with a speed that rises to the end, s = tau^2. The torques of rigid links for
this are fed forward: ``--mode 1`` with two drives, A1 and A2; with three ``--mode 2`` (least
Euclidean norm of the forces at elbows and end effector), ``--mode 3`` (least norm of the drives'
powers) and ``--mode torque`` (least norm of the torques). ``--flexible`` links are SE(3) beams,
``--links segments`` makes them of 8 rigid segments with torsion springs between them, and
``--links floating`` bodies in floating frames, of ``--elements`` beam elements (three as published)
reduced to their ends and four modes; with ``--no-stiffening`` they do not get shorter as they bend.

Elbows are revolute joints and the chains meet in joints that hold two points together in the
plane only, so that no constraint is redundant. ``--closure reduced`` integrates independent
velocities without multipliers.

History: ``P_x, P_y`` and ``error_x, error_y``, what they are off the path, m; ``tau_1, tau_2,
tau_3``, N m; ``angle_1, angle_2, angle_3, angle_4, angle_5, angle_6`` of the links' first sections
from the X axis, rad, and ``rate_1, rate_2, rate_3, rate_4, rate_5, rate_6``, rad/s; of the ends of
links 1, 3, 5 in the axes of the first section ``axial_1, axial_3, axial_5`` and ``transverse_1,
transverse_3, transverse_5``, m, and their rotation against it ``rotation_1, rotation_3,
rotation_5``, rad.

Expected (Liu et al., Math. Biosci. Eng. 20 (2023) 807, in words only): axial deflections three
orders of magnitude below transverse ones, redundant drives better than two, mode 2 the smoothest,
errors that grow with time, those of mode 1 the most. Here the largest ends' deflections are 0.82,
0.48, 0.72 mm in modes 1, 2, 3 and 1.7, 0.6, 1.3 um along the links, all of the latter from bending,
-0.6 w^2/l; P ends off by 24.7, 0.5, 1.7 um and is off by 24.7, 16.4, 16.5 um at most. Only with
``--speed rising`` do the errors of all modes grow to the end, to 40, 30, 30 um. Segments give 24.5,
1.0, 1.5 um at the end. Within 0.05 s deflections reach 87, 50, 85 mm, a third of the links' length,
and the axial ones 20, 6, 19 mm. Rigid links follow the path up to the error of the integration,
below 0.2 um with the default step.
Run: ``mpirun -n 2 python cases/parallel_manipulator.py --mode 2`` or, ten times as fast,
``python cases/parallel_manipulator.py --duration 0.05 --t-end 0.05 --dt 2.5e-5``.
"""

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

import flexfem as ff

LENGTH, AREA, SIDE = 0.244, 40e-6, 0.5
ALUMINIUM = ff.Material(70e9, 0.33, 2700.0)
RADIUS, ANGLE = 0.03892, math.radians(111.75)
SEGMENTS = 8
CHAINS = (1, 2, 3)
Z = (0.0, 0.0, 1.0)
PINNED = ("z", "rx", "ry", "rz")  # two points together in the plane
Array = npt.NDArray[np.float64]


def corner(chain: int) -> Array:
    """Place of a drive, m."""
    angle = math.radians(90.0 + 120.0 * (chain - 1))
    return SIDE / math.sqrt(3.0) * np.array([math.cos(angle), math.sin(angle), 0.0])


@dataclass(frozen=True)
class Path:
    """Way of P in the plane as a function of time."""

    shape: str
    speed: str
    duration: float

    def __call__(self, t: float) -> Array:
        """Position at time t, m."""
        tau = min(max(t / self.duration, 0.0), 1.0)
        s = tau**2 if self.speed == "rising" else tau**3 * (10.0 + tau * (6.0 * tau - 15.0))
        angle = ANGLE + (2.0 * math.pi * (s - 1.0) if self.shape == "spiral" else 0.0)
        return RADIUS * s * np.array([math.cos(angle), math.sin(angle)])


def turn(angle: float) -> Array:
    """Rotation matrix about Z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class Link:
    """A link of the manipulator: its bodies, and markers at its ends along it."""

    def __init__(self, number: int, start: Array, angle: float, height: float, kind: str) -> None:
        """Place it roughly; ``kind`` is "rigid", "segments", "se3" or "floating"."""
        self.name, self.kind, self.height = f"link_{number}", kind, height
        self.axes, self.start = turn(angle), start
        self.end = start + LENGTH * self.axes[:, 0]
        self.straight: list[ff.Rigid] = []
        if kind in ("se3", "floating"):
            self.root, self.tip = (self._marker(self.name, point=p) for p in ("start", "end"))
        else:
            pieces = SEGMENTS if kind == "segments" else 1
            names = [f"{self.name}_{i + 1}" for i in range(pieces)] if pieces > 1 else [self.name]
            self.pieces, half = names, 0.5 * LENGTH / pieces
            self.root = self._marker(names[0], offset=(-half, 0.0, 0.0))
            self.tip = self._marker(names[-1], offset=(half, 0.0, 0.0))

    def _marker(self, body: str, **place: object) -> ff.Marker:
        return ff.Marker(body, rotation=self.axes, **place)  # type: ignore[arg-type]

    def add_to(self, model: ff.Model, reduced: ff.ReducedBody | None) -> None:
        """Add its bodies; ``reduced`` is what all links in floating frames have in common."""
        width = AREA / self.height
        section = ff.Section.rectangle(self.height, width, ALUMINIUM)
        if self.kind == "floating":
            assert reduced is not None
            model.add(
                ff.FloatingBody(
                    self.name, reduced, position=self.start, rotation=self.axes,
                    stiffening=reduced.interface_stiffness is not None,
                )
            )  # fmt: skip
            return
        if self.kind == "se3":
            model.add(ff.Beam(self.name, section, orientation=tuple(self.axes[:, 1])))
            return
        piece = LENGTH / len(self.pieces)
        mass = section.mass_per_length * piece
        slender = mass * piece**2 / 12.0 * np.array([0.0, 1.0, 1.0])
        about = piece * np.diag(section.inertia)[3:] + slender
        shape = ff.Box((piece, self.height, width))
        for i, name in enumerate(self.pieces):
            middle = self.start + (i + 0.5) * piece * self.axes[:, 0]
            model.add(ff.RigidBody(name, mass, about, position=middle, rotation=self.axes,
                                   shape=shape))  # fmt: skip
        stiffness = ALUMINIUM.youngs_modulus * width * self.height**3 / 12.0 / piece
        for before, after in pairwise(self.pieces):
            a = self._marker(before, offset=(0.5 * piece, 0.0, 0.0))
            b = self._marker(after, offset=(-0.5 * piece, 0.0, 0.0))
            spring = ff.TorsionalSpringDamper(f"{after}_spring", a, b, axis=Z, stiffness=stiffness)
            model.add(ff.Revolute(f"{after}_pin", a, b, axis=Z), spring)
            self.straight.append(ff.Rigid(f"{after}_straight", a, b))


def reduced_link(height: float, elements: int, stiffening: bool) -> ff.ReducedBody:
    """A link as beam elements, reduced to the motion of its ends and four modes (collective)."""
    section = ff.Section.rectangle(height, AREA / height, ALUMINIUM)
    line = np.linspace([0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0], elements + 1)
    return ff.reduce_body(
        ff.beam_body(line, section, orientation=(0.0, 1.0, 0.0)),
        {"start": line[0], "end": line[-1]}, modes=4, geometric_stiffness=stiffening,
    )  # fmt: skip


def manipulator(
    height: float, kinds: tuple[str, str], elements: int, stiffening: bool = True
) -> tuple[ff.Model, list[Link]]:
    """Bodies and joints of six links in rough positions; kinds of driven and following links."""
    reduced = reduced_link(height, elements, stiffening) if "floating" in kinds else None
    links = []
    for chain in CHAINS:
        start = corner(chain)
        to_centre = math.atan2(-start[1], -start[0])
        active = Link(2 * chain - 1, start, to_centre + 1.0, height, kinds[0])
        links += [active, Link(2 * chain, active.end, to_centre - 0.8, height, kinds[1])]
    lines = {link.name: [link.start, link.end] for link in links if link.kind == "se3"}
    mesh = ff.LineMesh.straight(lines, elements) if lines else None
    model = ff.Model("parallel_manipulator", mesh=mesh)
    for link in links:
        link.add_to(model, reduced)
    for chain in CHAINS:
        active, follower = links[2 * chain - 2 : 2 * chain]
        model.add(
            ff.Revolute(f"A{chain}", ff.Ground(corner(chain)), active.root, axis=Z),
            ff.Revolute(f"B{chain}", active.tip, follower.root, axis=Z),
        )
        if chain > 1:
            model.add(ff.Generic(f"P{chain}", links[1].tip, follower.tip, free=PINNED))
    return model, links


def torques(height: float, mode: str, path: Path, samples: int) -> dict[int, ff.Spline]:
    """Torques of the drives that move rigid links along the path, by chain."""
    model, links = manipulator(height, ("rigid", "rigid"), 1)
    model = assembled(model, links)
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
            f"path_{'xy'[i]}", ff.Ground(), tips[0], lambda t, i=i: path(t)[i], axis=np.eye(3)[i]
        )
        for i in range(2)
    ]
    found = ff.inverse_dynamics(
        model, outputs, drives, np.linspace(0.0, path.duration, samples), least
    )
    return {
        chain: found.amplitude(drive.name) for chain, drive in zip(CHAINS, drives, strict=False)
    }


def assembled(model: ff.Model, links: list[Link]) -> ff.Model:
    """The model with its joints closed and P at the origin."""
    centre = ff.PointOnLine("centre", ff.Ground(), links[1].tip, axis=Z)
    return ff.assemble(model, also=[centre, *(joint for link in links for joint in link.straight)])


def build(
    *, mode: str, links: str, flexible: str, in_plane_height: float, elements: int,
    duration: float, path: str, speed: str, samples: int, closure: str, stiffening: bool,
) -> ff.Model:  # fmt: skip
    """Model with the torques fed forward."""
    height, way = 1e-3 * in_plane_height, Path(path, speed, duration)
    kinds = {
        "active": (links, "rigid"), "all": (links, links), "none": ("rigid", "rigid"),
    }[flexible]  # fmt: skip
    model, parts = manipulator(height, kinds, elements, stiffening)
    drives = torques(height, mode, way, samples)
    for chain, torque in drives.items():
        joint = model[f"A{chain}"]
        model.add(ff.Actuator(f"drive_{chain}", joint.a, joint.b, axis=Z, force=torque))
    nothing: Callable[[float], float] = lambda t: 0.0  # noqa: E731
    model.add(
        ff.Probe("end_effector", parts[1].tip, ("P_x", "P_y", "error_x", "error_y"),
                 lambda t, s: [*s.position[:2], *(s.position[:2] - way(t))]),
        ff.Probe("torques", (), ("tau_1", "tau_2", "tau_3"),
                 lambda t: [drives.get(chain, nothing)(t) for chain in CHAINS]),
    )  # fmt: skip
    for i, link in enumerate(parts, start=1):
        model.add(ff.Probe(f"joint_{i}", link.root, (f"angle_{i}", f"rate_{i}"), _angle,
                           unwrap=(f"angle_{i}",)))  # fmt: skip
    for i, link in list(enumerate(parts, start=1))[::2]:
        columns = (f"axial_{i}", f"transverse_{i}", f"rotation_{i}")
        model.add(ff.Probe(f"end_{i}", (link.root, link.tip), columns, _deflection))
    return assembled(model, parts)


def _angle(t: float, s: ff.MarkerState) -> tuple[float, float]:
    return math.atan2(s.rotation[1, 0], s.rotation[0, 0]), s.angular_velocity[2]


def _deflection(t: float, root: ff.MarkerState, tip: ff.MarkerState) -> tuple[float, float, float]:
    """Axial and transverse displacement of the end, and its rotation, from the first section."""
    u = root.rotation.T @ (tip.position - root.position)
    R = root.rotation.T @ tip.rotation
    return u[0] - LENGTH, u[1], math.atan2(R[1, 0], R[0, 0])


def results(history: Mapping[str, Array]) -> dict[str, float]:
    """Errors and deflections of the whole motion."""
    error = np.hypot(history["error_x"], history["error_y"])
    found = {"largest_error": error.max(), "final_error": error[-1]}
    for name in ("axial", "transverse", "rotation"):
        found[f"largest_{name}"] = max(np.abs(history[f"{name}_{i}"]).max() for i in (1, 3, 5))
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
        ff.Option("links", str, "se3", "flexible links", choices=("se3", "segments", "floating")),
        ff.Option("flexible", str, "active", "which links are flexible",
                  choices=("active", "all", "none")),
        ff.Option("in_plane_height", float, 5.0, "of the section", unit="mm", above=0.0),
        ff.Option("elements", int, 8, "beam elements of a flexible link", minimum=1),
        ff.Option("stiffening", bool, True, "of links in floating frames by forces and speed"),
        ff.Option("duration", float, 0.5, "of the path", unit="s", above=0.0),
        ff.Option("path", str, "spiral", "way of P", choices=("spiral", "line")),
        ff.Option("speed", str, "smooth", "along it: from rest to rest, or rising to the end",
                  choices=("smooth", "rising")),
        ff.Option("samples", int, 501, "times at which torques are computed", minimum=6),
        ff.Option("closure", str, "multipliers", "of the loops",
                  choices=("multipliers", "reduced")),
    ),
    dt=2.5e-4,
    t_end=0.5,
    presets={
        "closure": {"reduced": {"integrator": "independent_coordinates"}},
        "links": {"floating": {"elements": 3}},
    },
    smoke={"elements": 2, "samples": 21, "t_end": 1e-3},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
