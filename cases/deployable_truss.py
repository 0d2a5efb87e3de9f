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
90 degrees, where a latch locks each slider when it arrives.

``--control gravity``: 0.005 g along X deploys the truss from rest at 5 degrees; the run ends when
all sliders are locked. The bays have a freedom each and do not move alike. The others drive the
angles at the roots of the two lower cross-bars of every bay from 5 to 90 degrees within 20 s along
the profile named, without gravity. Members of a frame are welded at the corners, where everything
else is hinged to the vertical ones. The frames are not kept from passing through one another.

History: ``D_x, D_z``, lower corner of the last frame at y = 0, m; ``beta_1, beta_2, ...``, angles
(rad) between frame and lower cross-bar at y = 0, at the first and the second end of every bay.

Expected (Wu et al., Appl. Sci. 10 (2020) 1231): the linear profile leaves visible vibration, the
cosine the least. From 21 s on D_z moves by 8.9 mm, polynomial 0.12, cycloid 0.09, cosine 0.014 mm;
small swings decide when a latch closes, and other meshes change the last three by factors. Open,
the truss swings at 0.6 Hz on the bars that its drives hold; latched, its diagonals vibrate from
8.4 Hz on. Rigid members under gravity (``tests/data/deployable_truss.csv``) lock the second bay at
18.54 s and the first at 19.35 s.
Run: ``mpirun -n 2 python cases/deployable_truss.py --control cosine``.
"""

import math
import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import flexfem as ff

SIDE, BAR = 2.0, 4.0
START, END, DEPLOYMENT = math.radians(5.0), math.radians(90.0), 20.0
SETTLED = DEPLOYMENT + 1.0  # all latches have closed
GRAVITY = 0.005 * 9.81
Y = (0.0, 1.0, 0.0)
SIDES = {"left": 0.0, "right": SIDE}
Point = npt.NDArray[np.float64]


def members(bays: int, beta: float) -> dict[str, tuple[Point, Point]]:
    """Ends of all members when all bays stand at ``beta`` (rad)."""
    y, z, step = SIDE * np.eye(3)[1], SIDE * np.eye(3)[2], BAR * _direction(beta)
    height = math.hypot(SIDE, step[2]) - step[2]
    lines: dict[str, tuple[Point, Point]] = {}
    for i in range(1, bays + 2):
        low = (i - 1) * step
        lines[f"bottom_{i}"], lines[f"top_{i}"] = (low, low + y), (low + z, low + y + z)
        for side, at in SIDES.items():
            corner = low + at / SIDE * y
            lines[f"post_{side}_{i}"] = corner, corner + z
            if i <= bays:
                lines[f"lower_{side}_{i}"] = corner, corner + step
                lines[f"upper_{side}_{i}"] = corner + z, corner + z + step
                lines[f"brace_{side}_{i}"] = corner, corner + step + height / SIDE * z
        if i <= bays:
            lines[f"floor_{i}"] = low, low + y + step
            lines[f"roof_{i}"] = low + y + z, low + z + step
    return lines


def _direction(beta: float) -> Point:
    return np.array([math.sin(beta), 0.0, math.cos(beta)])


def build(*, control: str, bays: int, formulation: str, elements: int, degree: int) -> ff.Model:
    """Truss of ``bays`` bays with ``elements`` elements per member."""
    lines = members(bays, START)
    model = ff.Model("deployable_truss", mesh=ff.LineMesh.straight(lines, elements))
    steel = ff.Material(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
    tube = ff.Section.tube(0.055, 0.060, steel)
    model.add(*(beam(name, tube, formulation, degree) for name in lines))
    for side, at in SIDES.items():
        for point, z in (("start", 0.0), ("end", SIDE)):
            corner = ff.Marker(f"post_{side}_1", point)
            model.add(ff.Rigid(f"support_{side}_{point}", ff.Ground((0.0, at, z)), corner))
    for i in range(1, bays + 2):
        _weld(model, i)
    for i in range(1, bays + 1):
        _hinge(model, i)
        _slide(model, i, bays if control == "gravity" else 0)
        if control != "gravity":
            _drive(model, i, control)
    if control == "gravity":
        model.add(ff.Gravity((GRAVITY, 0.0, 0.0)))
    _measure(model, bays)
    return model


def beam(name: str, section: ff.Section, formulation: str, degree: int) -> ff.Beam:
    """Member of the chosen formulation; SE(3) elements know no degree."""
    if formulation == "nurbs":
        return ff.Beam(name, section, formulation="nurbs", degree=degree)
    return ff.Beam(name, section)


def _weld(model: ff.Model, i: int) -> None:
    """Join the four members of frame ``i``."""
    for level, point in (("bottom", "start"), ("top", "end")):
        for side, end in (("left", "start"), ("right", "end")):
            post, rail = ff.Marker(f"post_{side}_{i}", point), ff.Marker(f"{level}_{i}", end)
            model.add(ff.Rigid(f"corner_{level}_{side}_{i}", post, rail))


def _hinge(model: ff.Model, i: int) -> None:
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
            corner, hinge = ff.Marker(post, point), f"hinge_{member}_{end}"
            model.add(ff.Revolute(hinge, corner, ff.Marker(member, end), axis=Y))
    for side in SIDES:
        corner, brace = ff.Marker(f"post_{side}_{i}", "start"), f"brace_{side}_{i}"
        model.add(ff.Revolute(f"hinge_{brace}", corner, ff.Marker(brace, "start"), axis=Y))


def _slide(model: ff.Model, i: int, stop_after: int) -> None:
    """Let the braces of bay ``i`` slide and be latched; the run stops after those of all bays."""
    latches = [f"latch_{side}_{k}" for k in range(1, stop_after + 1) for side in SIDES]
    stop = [ff.Stop(after=latches)] if latches else []
    for side in SIDES:
        name, end = f"slide_{side}_{i}", ff.Marker(f"brace_{side}_{i}", "end")
        model.add(
            slide := ff.Sliding(name, ff.Carrier(f"post_{side}_{i + 1}"), end),
            ff.Lock(f"lock_{side}_{i}", slide, locked=False),
            ff.Event(
                f"latch_{side}_{i}", ff.SlidingMarker(name), lambda t, at: at.arc - SIDE,
                [ff.LockJoint(f"lock_{side}_{i}"), *stop], direction=1,
            ),
        )  # fmt: skip


def _drive(model: ff.Model, i: int, control: str) -> None:
    """Drive the angles at the roots of the lower bars of bay ``i``."""
    turn = ff.SmoothStep(0.0, DEPLOYMENT, 0.0, END - START, profile=control)
    for side in SIDES:
        post, bar = ff.Marker(f"post_{side}_{i}", "start"), ff.Marker(f"lower_{side}_{i}", "start")
        model.add(ff.PrescribedAngle(f"drive_{side}_{i}", post, bar, axis=Y, angle=turn))


def _measure(model: ff.Model, bays: int) -> None:
    """Add the probes."""
    corner = ff.Marker(f"post_left_{bays + 1}", "start")
    model.add(ff.Probe("D", corner, ("D_x", "D_z"), lambda t, at: (at.position[0], at.position[2])))
    for i in range(1, bays + 1):
        for k, end in ((0, "start"), (1, "end")):
            post = ff.Marker(f"post_left_{i + k}", "start")
            name, bar = f"beta_{2 * i - 1 + k}", ff.Marker(f"lower_left_{i}", end)
            model.add(ff.Probe(name, (post, bar), (name,), _angle))


def _angle(t: float, post: ff.MarkerState, bar: ff.MarkerState) -> tuple[float]:
    """Angle between the axes of both members in the X-Z plane; markers start in inertial axes."""
    p, b = post.rotation[:, 2], bar.rotation @ _direction(START)
    return (math.atan2(p[2] * b[0] - p[0] * b[2], p[2] * b[2] + p[0] * b[0]),)


def results(history: Mapping[str, npt.NDArray[np.float64]]) -> dict[str, float]:
    """Time and place of the end; what D still moves after a driven deployment."""
    t, angles = history["t"], [c for name, c in history.items() if name.startswith("beta_")]
    values = {"end_time": t[-1], "D_x": history["D_x"][-1], "D_z": history["D_z"][-1]}
    after = t >= SETTLED
    if after.sum() > 2 and all(abs(c[after][0] - END) < 0.1 for c in angles):
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
        ff.Option("formulation", str, "nurbs", "beam elements", choices=("nurbs", "se3")),
        ff.Option("elements", int, 4, "elements per member", minimum=1),
        ff.Option("degree", int, 2, "degree of NURBS elements", minimum=1),
    ),
    presets={"control": {"gravity": {"elements": 1, "dt": 0.1}}},
    dt=5e-3,
    t_end=30.0,
    smoke={"control": "linear", "bays": 1, "elements": 1, "t_end": 0.02},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
