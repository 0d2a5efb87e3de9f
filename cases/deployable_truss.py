# SPDX-License-Identifier: LGPL-3.0-or-later
"""Deployable truss with sliding joints.

Square frames of side 2 m stand parallel to the Y-Z plane, the first one fixed to the ground. Each
bay joins two of them by four cross-bars of 4 m at the corners and four diagonals of sqrt(20) m; all
are tubes of 0.055 and 0.060 m diameter, E = 2.1e11 N/m^2, nu = 0.3, rho = 7850 kg/m^3. The truss
folds by shear: cross-bars turn about axes parallel to Y at both ends, and beta is the angle between
cross-bar and frame. The next frame is displaced by 4 sin(beta) along X and 4 cos(beta) along Z.
The diagonals of the top and bottom faces turn with the cross-bars, on the same axes. Those of the
side faces are hinged at the lower corners of a frame and slide on the vertical members of the next
one, at the height sqrt(4 + 16 cos^2 beta) - 4 cos(beta): 0.474 m at 5 degrees, 2 m, the top end, at
90 degrees.

``--control gravity``: 0.005 g along X deploys the truss from rest at 5 degrees; latches lock each
slider when it arrives, and the run ends when all are locked. The bays have one degree of freedom
each and do not move in the same way. The others drive the angles at the roots of the two lower
cross-bars of every bay from 5 to 90 degrees within 20 s along the profile named, without gravity
and without latches (``--latch``), because the rails continue beyond the posts' ends. Members of a
frame are welded at the corners, where everything else is hinged to the vertical ones. Contact
between frames is not modelled.

``--formulation``: members are beams of NURBS or SE(3) elements, rigid bodies, or bodies in floating
frames, of so many beam elements reduced to their ends and four modes, the frame at the start. The
joints of rigid members are redundant and carried with least norm.

History: ``D_x, D_z``, lower corner of the last frame at y = 0, m; with drives ``beta``, the angle
that they prescribe (rad), and ``error_x, error_z``, the deviation of D from its place with rigid
members, m; ``beta_1, beta_2, ...``, angles (rad) between frame and lower cross-bar at y = 0, at the
first and the second end of every bay.

Expected (Wu et al., Appl. Sci. 10 (2020) 1231): the linear profile leaves visible vibration, the
cosine the least. From 21 s on D_z moves by 429 mm, polynomial 3.8, cycloid 2.8, cosine 0.54 mm: the
truss swings at 0.6 Hz on the driven bars. On the way D_z is off by up to 159, 13.2, 13.5 and 17.0
mm: there the cosine, whose acceleration is the largest, is the worst of the smooth ones. Bodies in
floating frames give 504, 4.9, 3.4, 0.43 and 167, 13.1, 13.5, 17.0 mm. With latches diagonals
vibrate from 8.4 Hz on: D_z moves by 8.9 mm, polynomial 0.12, cycloid 0.09, cosine 0.014 mm; small
swings decide when a latch closes, and other meshes change the last three by factors. Under gravity
rigid members (``tests/data/deployable_truss.csv``) lock the second bay at 18.538 s and the first at
19.345 s, with ``--formulation rigid`` at 18.539 s and 19.345 s. Pictures:
``flexfem sweep deployable_truss --vary control=linear,polynomial,cycloid,cosine --plot D_x,D_z``
runs and compares the laws; of its folders ``flexfem plot`` with ``--after 20`` shows the residual
vibration; ``flexfem plot results/deployable_truss --columns D_x,D_z`` draws one run. Run:
``mpirun -n 2 python cases/deployable_truss.py --control cosine``.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

import flexfem as ff

Y = (0.0, 1.0, 0.0)
SIDES = ("left", "right")
REST = 1.0  # after the end of a driven deployment, until the rest counts as vibration, s
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Truss:
    """Geometry of a truss, and how its members are modelled; m, rad."""

    bays: int
    side: float
    bar: float
    start: float
    end: float
    section: ff.Section
    radius: float
    formulation: str
    elements: int
    degree: int
    modes: int

    def height(self, beta: float) -> float:
        """Height of a slider above the lower end of its post when its bay stands at an angle."""
        rise = self.bar * math.cos(beta)
        return math.hypot(self.side, rise) - rise

    def members(self, beta: float) -> dict[str, tuple[Array, Array]]:
        """Ends of all members when all bays stand at an angle."""
        y, z = self.side * np.eye(3)[1:]
        step, up = self.bar * direction(beta), self.height(beta) * np.eye(3)[2]
        lines: dict[str, tuple[Array, Array]] = {}
        for i in range(1, self.bays + 2):
            low = (i - 1) * step
            lines[f"bottom_{i}"], lines[f"top_{i}"] = (low, low + y), (low + z, low + y + z)
            for side, corner in zip(SIDES, (low, low + y), strict=True):
                lines[f"post_{side}_{i}"] = corner, corner + z
                if i <= self.bays:
                    lines[f"lower_{side}_{i}"] = corner, corner + step
                    lines[f"upper_{side}_{i}"] = corner + z, corner + z + step
                    lines[f"brace_{side}_{i}"] = corner, corner + step + up
            if i <= self.bays:
                lines[f"floor_{i}"] = low, low + y + step
                lines[f"roof_{i}"] = low + y + z, low + z + step
        return lines

    @cached_property
    def lines(self) -> dict[str, tuple[Array, Array]]:
        """Ends of all members at the start."""
        return self.members(self.start)

    def length(self, member: str) -> float:
        """Length of a member, m."""
        first, last = self.lines[member]
        return float(np.linalg.norm(last - first))

    def model(self) -> ff.Model:
        """All members, not joined."""
        meshed = self.formulation in ("nurbs", "se3")
        mesh = ff.LineMesh.straight(self.lines, self.elements) if meshed else None
        model, reduced = ff.Model("deployable_truss", mesh=mesh), {}
        for name, (first, last) in self.lines.items():
            if meshed:
                degree = self.degree if self.formulation == "nurbs" else None
                model.add(ff.Beam(name, self.section, formulation=self.formulation, degree=degree))
            elif self.formulation == "rigid":
                model.add(self._rod(name, 0.5 * (first + last), axes(last - first)))
            else:
                length = round(self.length(name), 9)
                if length not in reduced:
                    reduced[length] = self._reduced(length)
                turn = axes(last - first)
                model.add(ff.FloatingBody(name, reduced[length], position=first, rotation=turn))
        return model

    def _rod(self, name: str, middle: Array, turn: Array) -> ff.RigidBody:
        """A rigid member."""
        length = self.length(name)
        mass = self.section.mass_per_length * length
        inertia = length * np.diag(self.section.inertia)[3:]
        inertia = inertia + mass * length**2 / 12.0 * np.array([0.0, 1.0, 1.0])
        shape = ff.Cylinder(self.radius, length)
        return ff.RigidBody(name, mass, inertia, position=middle, rotation=turn, shape=shape)

    def _reduced(self, length: float) -> ff.ReducedBody:
        """Members of a length as beam elements, reduced to their ends and some modes."""
        nodes = np.linspace([0.0, 0.0, 0.0], [length, 0.0, 0.0], self.elements + 1)
        return ff.reduce_body(
            ff.beam_body(nodes, self.section, orientation=Y), {"start": nodes[0], "end": nodes[-1]},
            modes=self.modes, lines={"axis": nodes},
        )  # fmt: skip

    def place(self, member: str, point: str) -> ff.Marker:
        """Marker at the "start" or "end" of a member."""
        if self.formulation != "rigid":
            return ff.Marker(member, point)
        half = 0.5 * self.length(member)
        return ff.Marker(member, offset=(half if point == "end" else -half, 0.0, 0.0))

    def rail(self, post: str) -> ff.Carrier:
        """Line of a post, on which a slider runs."""
        if self.formulation == "rigid":
            half = 0.5 * self.side
            return ff.Carrier(post, [(-half, 0.0, 0.0), (half, 0.0, 0.0)])
        return ff.Carrier(post, "axis" if self.formulation == "floating" else None)


def direction(beta: float) -> Array:
    """Direction of the cross-bars when their bay stands at an angle."""
    return np.array([math.sin(beta), 0.0, math.cos(beta)])


def axes(along: Array) -> Array:
    """Axes of a member: the first along it."""
    x = along / np.linalg.norm(along)
    z = np.cross(x, Y if abs(x[1]) < 0.9 else (0.0, 0.0, 1.0))
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def build(
    *, control: str, bays: int, formulation: str, elements: int, degree: int, modes: int,
    latch: bool, overrun: float, side: float, bar_length: float, inner_diameter: float,
    outer_diameter: float, youngs_modulus: float, poisson_ratio: float, density: float,
    start_angle: float, end_angle: float, deployment: float, gravity: float,
) -> ff.Model:  # fmt: skip
    """The truss with its joints and drives."""
    if start_angle >= end_angle:
        raise ValueError(f"start_angle must be less than end_angle {end_angle}, got {start_angle}")
    metal = ff.Material(youngs_modulus, poisson_ratio, density)
    tube = ff.Section.tube(1e-3 * inner_diameter, 1e-3 * outer_diameter, metal)
    start, end = math.radians(start_angle), math.radians(end_angle)
    truss = Truss(
        bays, side, bar_length, start, end, tube, 5e-4 * outer_diameter, formulation, elements,
        degree, modes,
    )  # fmt: skip
    model = truss.model()
    for rail, at in zip(SIDES, (0.0, side), strict=True):
        for point, z in (("start", 0.0), ("end", side)):
            corner = truss.place(f"post_{rail}_1", point)
            model.add(ff.Rigid(f"support_{rail}_{point}", ff.Ground((0.0, at, z)), corner))
    for i in range(1, bays + 2):
        _weld(model, truss, i)
    for i in range(1, bays + 1):
        _hinge(model, truss, i)
    if control == "gravity":
        _slide(model, truss, latch, 0.0, stop=True)
        model.add(ff.Gravity((gravity, 0.0, 0.0)))
        _measure(model, truss, None)
        return model
    _slide(model, truss, latch, overrun, stop=False)
    turn = ff.SmoothStep(0.0, deployment, 0.0, end - start, profile=control)
    for i in range(1, bays + 1):
        for rail in SIDES:
            post = truss.place(f"post_{rail}_{i}", "start")
            bar = truss.place(f"lower_{rail}_{i}", "start")
            model.add(ff.PrescribedAngle(f"drive_{rail}_{i}", post, bar, axis=Y, angle=turn))
    _measure(model, truss, turn)
    return model


def _weld(model: ff.Model, truss: Truss, i: int) -> None:
    """Join the four members of frame ``i``."""
    for level, point in (("bottom", "start"), ("top", "end")):
        for side, end in zip(SIDES, ("start", "end"), strict=True):
            post, rail = truss.place(f"post_{side}_{i}", point), truss.place(f"{level}_{i}", end)
            model.add(ff.Rigid(f"corner_{level}_{side}_{i}", post, rail))


def _hinge(model: ff.Model, truss: Truss, i: int) -> None:
    """Hinge bars and diagonals of bay ``i`` to the posts, all about Y."""
    ends = [
        (f"{level}_{side}_{i}", f"post_{side}_{i}", f"post_{side}_{i + 1}", point)
        for level, point in (("lower", "start"), ("upper", "end"))
        for side in SIDES
    ]
    ends.append((f"floor_{i}", f"post_left_{i}", f"post_right_{i + 1}", "start"))
    ends.append((f"roof_{i}", f"post_right_{i}", f"post_left_{i + 1}", "end"))
    for member, first, second, point in ends:
        for end, post in (("start", first), ("end", second)):
            corner, hinge = truss.place(post, point), f"hinge_{member}_{end}"
            model.add(ff.Revolute(hinge, corner, truss.place(member, end), axis=Y))
    for side in SIDES:
        corner, brace = truss.place(f"post_{side}_{i}", "start"), f"brace_{side}_{i}"
        model.add(ff.Revolute(f"hinge_{brace}", corner, truss.place(brace, "start"), axis=Y))


def _slide(model: ff.Model, truss: Truss, latch: bool, beyond: float, *, stop: bool) -> None:
    """Let the side diagonals slide, and latch them or stop the run when they have arrived."""
    sliders = [(side, i) for i in range(1, truss.bays + 1) for side in SIDES]
    end, latches = truss.height(truss.end), [f"latch_{side}_{i}" for side, i in sliders]
    for side, i in sliders:
        name, brace = f"slide_{side}_{i}", truss.place(f"brace_{side}_{i}", "end")
        slide = ff.Sliding(name, truss.rail(f"post_{side}_{i + 1}"), brace, beyond=beyond)
        model.add(slide)
        actions: list[ff.LockJoint | ff.Stop] = []
        if latch:
            model.add(ff.Lock(f"lock_{side}_{i}", slide, locked=False))
            actions.append(ff.LockJoint(f"lock_{side}_{i}"))
        if stop:
            actions.append(ff.Stop(after=latches) if latch else ff.Stop())
        if actions:
            event, arrived = f"latch_{side}_{i}", ff.SlidingMarker(name)
            model.add(ff.Event(event, arrived, lambda t, at: at.arc - end, actions, direction=1))


def _measure(model: ff.Model, truss: Truss, turn: ff.SmoothStep | None) -> None:
    """Add the probes."""
    corner = truss.place(f"post_left_{truss.bays + 1}", "start")
    model.add(ff.Probe("D", corner, ("D_x", "D_z"), lambda t, at: at.position[[0, 2]]))
    if turn is not None:

        def error(t: float, at: ff.MarkerState) -> list[float]:
            beta = truss.start + turn(t)
            rigid = truss.bays * truss.bar * direction(beta)
            return [beta, *(at.position - rigid)[[0, 2]]]

        model.add(ff.Probe("path", corner, ("beta", "error_x", "error_z"), error))
    for i in range(1, truss.bays + 1):
        for k, end in ((0, "start"), (1, "end")):
            post = truss.place(f"post_left_{i + k}", "start")
            name, bar = f"beta_{2 * i - 1 + k}", truss.place(f"lower_left_{i}", end)
            model.add(ff.Probe(name, (post, bar), (name,), _angle(direction(truss.start))))


def _angle(along: Array):  # type: ignore[no-untyped-def]
    """Angle between the axes of a post and a bar in the X-Z plane."""

    def angle(t: float, post: ff.MarkerState, bar: ff.MarkerState) -> tuple[float]:
        p, b = post.rotation[:, 2], bar.rotation @ along
        return (math.atan2(p[2] * b[0] - p[0] * b[2], p[2] * b[2] + p[0] * b[0]),)

    return angle


def results(history: Mapping[str, Array]) -> dict[str, float]:
    """Time and place of the end; errors of a driven deployment and the residual motion of D."""
    t = history["t"]
    values = {"end_time": t[-1], "D_x": history["D_x"][-1], "D_z": history["D_z"][-1]}
    if "beta" not in history:
        return values
    deployed = t[np.argmax(history["beta"] >= history["beta"][-1])]
    for name in ("error_x", "error_z"):
        values[f"largest_{name}"] = np.abs(history[name][t <= deployed]).max()
    after = t >= deployed + REST - 1e-9
    if after.sum() > 2:
        for name in ("D_x", "D_z"):
            x, h = history[name][after], t[-1] - t[-2]
            values[f"{name}_residual"] = np.ptp(x)
            values[f"{name}_rms_acceleration"] = math.sqrt(np.mean(np.diff(x, 2) ** 2)) / h**2
    return values


CASE = ff.Case(
    name="deployable_truss",
    summary="truss that unfolds by shear, with sliding joints (Wu et al. 2020)",
    description=__doc__,
    build=build,
    options=(
        ff.Option(
            "control", str, "cosine", "what deploys it",
            choices=("linear", "polynomial", "cycloid", "cosine", "gravity"),
        ),
        ff.Option("bays", int, 2, "number of bays", minimum=1),
        ff.Option("formulation", str, "nurbs", "members: beam elements or bodies",
                  choices=("nurbs", "se3", "rigid", "floating")),
        ff.Option("elements", int, 4, "elements per member that is not rigid", minimum=1),
        ff.Option("degree", int, 2, "degree of NURBS elements", minimum=1),
        ff.Option("modes", int, 4, "internal modes of a member in a floating frame", minimum=0),
        ff.Option("latch", bool, False, "lock the sliders that arrive (default with gravity)"),
        ff.Option("overrun", float, 0.5, "how far rails go on beyond driven posts", unit="m",
                  minimum=0.0),
        ff.Option("side", float, 2.0, "of the frames", unit="m", above=0.0),
        ff.Option("bar_length", float, 4.0, "of the cross-bars", unit="m", above=0.0),
        ff.Option("inner_diameter", float, 55.0, "of the tubes", unit="mm", above=0.0),
        ff.Option("outer_diameter", float, 60.0, "of the tubes", unit="mm", above=0.0),
        ff.Option("youngs_modulus", float, 2.1e11, "of the tubes", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the tubes", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 7850.0, "of the tubes", unit="kg/m^3", above=0.0),
        ff.Option("start_angle", float, 5.0, "between frames and cross-bars", unit="deg",
                  above=0.0, maximum=90.0),
        ff.Option("end_angle", float, 90.0, "at which they are deployed", unit="deg", above=0.0,
                  maximum=90.0),
        ff.Option("deployment", float, 20.0, "time that drives take", unit="s", above=0.0),
        ff.Option("gravity", float, 0.04905, "along X, what deploys with --control gravity",
                  unit="m/s^2", above=0.0),
    ),
    presets={
        "control": {"gravity": {"elements": 1, "dt": 0.1, "latch": True}},
        "formulation": {"rigid": {"redundant_constraints": "least_norm"}},
    },
    dt=5e-3,
    t_end=30.0,
    smoke={"control": "linear", "bays": 1, "elements": 1, "dt": 5e-3, "t_end": 0.02},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
