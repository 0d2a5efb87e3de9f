# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two spur gears, rigid, whose teeth are triangles that touch: one is driven, the other braked.

Module 5 mm, 20 and 30 teeth with involute flanks (pressure angle 20 degrees) and addenda of one
module, on revolute joints at the standard distance of their axes, along Z. Flanks are ``--points``
chords of their involutes; below the base circle they are radial, which is clear of the other
gear's tips unless the teeth interfere, which is refused. The pinion, 1.2 times as wide as the
wheel, is turned at a speed that rises within ``--ramp`` to ``--speed``; the wheel turns against a
viscous brake (``--brake``). Nothing but contact carries the motion over: at the start the flanks
that are going to push are ``--clearance`` apart, so that they meet at hardly any speed.

History: ``pinion_angle, wheel_angle`` (rad, between -pi and pi), ``pinion_speed, wheel_speed``
(rad/s) about Z; ``contact_gap`` (m), the least distance of surfaces that are near each other, and
``contact_penetration`` (m), how far they overlap: not at all; ``contact_fx, contact_fy,
contact_fz`` (N), the force of the wheel on the pinion; ``contact_normal`` (N), the sum of the sizes
of all normal forces, and ``contact_closed``, the number of pairs that push; ``drive_fx, drive_fy,
drive_fz, drive_mx, drive_my, drive_mz`` (N, N m), the wrench of the drive on the pinion;
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``
(J).

Expected: the speeds have the ratio of the numbers of teeth, with the other sign, and so have the
torques without friction; the flanks push along the line of action, with the torque of the brake
over the radius of the wheel's base circle. The results compare means over the last half of the
motion: ``ratio`` of the speeds with ``ratio_of_teeth`` (1.50001 with 1.5), ``drive_torque`` with
``drive_torque_of_brake`` (4.47 N m with 4.44 N m), ``normal_force`` with ``normal_force_of_brake``
(95.1 N with 94.6 N: rows are instants, between which flanks of chords rattle, the more the fewer
``--points`` they have).
Run: ``python cases/gear_pair.py``, then ``flexfem render results/gear_pair``.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import flexfem as ff

Z = (0.0, 0.0, 1.0)
Points = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Gear:
    """Spur gear with involute teeth.

    Attributes:
        teeth: their number.
        module: diameter of the pitch circle over the number of teeth, m.
        pressure_angle: rad.
        backlash: of a pair along the pitch circles, m; half of it is taken off each gear's teeth.
        width: along the axis, m.
        bore: its radius, m.
    """

    teeth: int
    module: float
    pressure_angle: float
    backlash: float
    width: float
    bore: float

    def __post_init__(self) -> None:
        """Raise for a bore that leaves nothing, and teeth without tip."""
        if self.bore >= self.root:
            raise ValueError(
                f"bore: its radius must be below that of the roots of {self.teeth} teeth, "
                f"{self.root:g} m, got {self.bore:g}"
            )
        if self.half_angle(self.tip) <= 0.0:
            raise ValueError(
                f"teeth: {self.teeth} of them with a pressure angle of "
                f"{math.degrees(self.pressure_angle):g} degrees are pointed below their tips"
            )

    @property
    def pitch(self) -> float:
        """Radius of the pitch circle, m."""
        return 0.5 * self.module * self.teeth

    @property
    def base(self) -> float:
        """Radius of the base circle, m."""
        return self.pitch * math.cos(self.pressure_angle)

    @property
    def tip(self) -> float:
        """Radius of the tips, m."""
        return self.pitch + self.module

    @property
    def root(self) -> float:
        """Radius of the roots, m."""
        return self.pitch - 1.25 * self.module

    def half_angle(self, radius: float) -> float:
        """Half of the angle that a tooth takes at a radius, rad; below the base circle constant."""

        def involute(angle: float) -> float:
            return math.tan(angle) - angle

        thickness = 0.5 * (math.pi * self.module - self.backlash)
        turned = math.acos(min(self.base / radius, 1.0))
        at_pitch = 0.5 * thickness / self.pitch
        return at_pitch + involute(self.pressure_angle) - involute(turned)

    def flank(self, parts: int) -> Points:
        """Radii (m) and half angles of a flank from root to tip, (n, 2)."""
        roll = np.linspace(
            math.sqrt(max((self.root / self.base) ** 2 - 1.0, 0.0)),
            math.sqrt((self.tip / self.base) ** 2 - 1.0), parts + 1,
        )  # fmt: skip
        radii = self.base * np.sqrt(1.0 + roll**2)
        if self.root < self.base:
            radii = np.append(self.root, radii)
        return np.array([(radius, self.half_angle(radius)) for radius in radii])

    def shape(self, parts: int, slices: int, start: float) -> ff.SurfaceShape:
        """Closed surface about the axis Z, the middle of one tooth at the angle ``start``, rad."""
        outline, bore, faces = self._section(parts, start)
        flat = np.concatenate([outline, bore])
        layers = np.linspace(-0.5, 0.5, slices + 1) * self.width
        points = np.concatenate([np.column_stack([flat, np.full(len(flat), z)]) for z in layers])
        n, m, count = len(outline), len(bore), len(flat)
        ring, hole = np.arange(n), n + np.arange(m)[::-1]
        sides = [
            _quads(a + count * k, np.roll(a, -1) + count * k, count)
            for k in range(slices) for a in (ring, hole)
        ]  # fmt: skip
        return ff.SurfaceShape(
            points, np.concatenate([faces[:, ::-1], faces + count * slices, *sides])
        )

    def _section(self, parts: int, start: float) -> tuple[Points, Points, Rows]:
        """Outline (n, 2) and bore (m, 2), counterclockwise, and the triangles between them."""
        radii, half = self.flank(parts).T
        last = len(radii) - 1
        middle = start + 2.0 * np.pi * np.arange(self.teeth)[:, np.newaxis] / self.teeth
        angles = np.concatenate([middle - half, middle + half[::-1]], axis=1).ravel()
        radii = np.tile(np.concatenate([radii, radii[::-1]]), self.teeth)
        outline = radii[:, np.newaxis] * np.column_stack([np.cos(angles), np.sin(angles)])
        # two points of the bore at the feet of each tooth
        size = 2 * (last + 1)
        feet = (size * np.arange(self.teeth)[:, np.newaxis] + [0, size - 1]).ravel()
        bore = outline[feet] * self.bore / self.root
        inner = len(outline) + np.arange(len(feet))
        up = size * np.arange(self.teeth)[:, np.newaxis] + np.arange(last)
        down = size * np.arange(self.teeth)[:, np.newaxis] + size - 1 - np.arange(last)
        tooth = [up, up + 1, down - 1], [up, down - 1, down]
        after, within = np.roll(feet, -1), np.roll(inner, -1)
        rim = [inner, feet, after], [inner, after, within]
        corners = [np.stack([c.ravel() for c in one], axis=1) for one in (*tooth, *rim)]
        return outline, bore, np.concatenate(corners)


def _quads(start: Rows, end: Rows, up: int) -> Rows:
    """Triangles of rectangles from each start to its end, and ``up`` numbers further."""
    return np.concatenate(
        [np.stack([start, end, end + up], axis=1), np.stack([start, end + up, start + up], axis=1)]
    )


def check_mesh(pinion: Gear, wheel: Gear) -> None:
    """Raise if the tips of one gear reach the other one's flanks below its base circle."""
    line = (pinion.pitch + wheel.pitch) * math.sin(pinion.pressure_angle)
    for one, other in ((pinion, wheel), (wheel, pinion)):
        if math.sqrt(one.tip**2 - one.base**2) > line:
            raise ValueError(
                f"teeth: the tips of {one.teeth} teeth interfere with the feet of {other.teeth} "
                f"at a pressure angle of {math.degrees(one.pressure_angle):g} degrees: take more "
                "teeth or a larger angle"
            )


def wheel_of(
    name: str, gear: Gear, shape: ff.SurfaceShape, density: float, place: tuple[float, float, float]
) -> ff.RigidBody:
    """Rigid body of a gear with the inertia of its triangles."""
    x = shape.points[shape.triangles]
    # tetrahedra from the origin to the triangles
    volumes = np.einsum("mi,mi->m", x[:, 0], np.cross(x[:, 1], x[:, 2])) / 6.0
    sums = x.sum(axis=1)
    products = np.einsum("m,mci,mcj->ij", volumes, x, x)
    second = (products + np.einsum("m,mi,mj->ij", volumes, sums, sums)) / 20.0
    inertia = density * (np.trace(second) * np.eye(3) - second)
    mass = density * float(volumes.sum())
    return ff.RigidBody(name, mass, np.diag(inertia), position=place, shape=shape)


def build(
    *, pinion_teeth: int, wheel_teeth: int, module: float, pressure_angle: float, backlash: float,
    width: float, bore: float, points: int, slices: int, density: float, speed: float,
    ramp: float, brake: float, friction: float, restitution: float, reach: float,
    clearance: float,
) -> ff.Model:  # fmt: skip
    """Model of both gears."""
    if backlash <= 4.0 * reach:
        raise ValueError(
            f"backlash must be above four times the reach, {4.0 * reach:g} modules, got "
            f"{backlash:g}"
        )
    angle = math.radians(pressure_angle)
    half = 0.5 * backlash * math.cos(angle)
    if not reach < clearance <= half:
        raise ValueError(
            f"clearance must be above the reach, {reach:g} modules, and at most {half:g}, as in "
            f"the middle of the backlash, got {clearance:g}"
        )
    pinion, wheel = (
        Gear(teeth, module, angle, backlash * module, factor * width, bore)
        for teeth, factor in ((pinion_teeth, 1.2), (wheel_teeth, 1.0))
    )
    check_mesh(pinion, wheel)
    away = pinion.pitch + wheel.pitch
    # a tooth of the pinion points to a gap of the wheel, nearly: its base circle has unwound
    ahead = math.copysign((half - clearance) * module / pinion.base, speed)
    gap = math.pi + math.pi / wheel_teeth
    model = ff.Model("gear_pair")
    for name, gear, start, place in (
        ("pinion", pinion, ahead, (0.0, 0.0, 0.0)), ("wheel", wheel, gap, (away, 0.0, 0.0))
    ):  # fmt: skip
        model.add(
            wheel_of(name, gear, gear.shape(points, slices, start), density, place),
            ff.Revolute(f"{name}_axle", ff.Ground(place), ff.Marker(name), axis=Z),
            ff.Probe(f"{name}_turn", ff.Marker(name), (f"{name}_angle", f"{name}_speed"), turn),
        )
    model.add(
        ff.PrescribedAngle("turn", ff.Ground(), ff.Marker("pinion"), axis=Z,
                           angle=lambda t: spin(t, speed, ramp)),
        ff.TorsionalSpringDamper("brake", ff.Ground((away, 0.0, 0.0)), ff.Marker("wheel"), axis=Z,
                                 damping=brake),
        ff.Contact("teeth", "pinion", "wheel", friction=friction, restitution=restitution,
                   reach=reach * module),
        ff.ContactProbe("contact", "teeth"),
        ff.ReactionProbe("drive", "turn"),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def spin(t: float, speed: float, ramp: float) -> float:
    """Angle (rad) at time t, with a speed that rises smoothly from 0 to ``speed``."""
    tau = min(t / ramp, 1.0)
    return speed * (ramp * tau**4 * (2.5 - 3.0 * tau + tau**2) + max(t - ramp, 0.0))


def turn(t: float, state: ff.MarkerState) -> tuple[float, float]:
    """Angle since the start, rad, and speed of a gear."""
    turned = state.rotation @ state.start.T
    return math.atan2(turned[1, 0], turned[0, 0]), float(state.angular_velocity[2])


def results(
    history: Mapping[str, Points], *, pinion_teeth: int, wheel_teeth: int, module: float,
    pressure_angle: float, brake: float,
) -> dict[str, float]:  # fmt: skip
    """Least gap; ratio of speeds, torque and normal force, means over the last half."""
    half = len(history["t"]) // 2
    turned = {
        name: float(np.ptp(np.unwrap(history[f"{name}_angle"])[half:]))
        for name in ("pinion", "wheel")
    }
    base = 0.5 * module * wheel_teeth * math.cos(math.radians(pressure_angle))
    torque = brake * float(np.abs(history["wheel_speed"][half:]).mean())
    return {
        "least_gap": float(history["contact_gap"].min()),
        "ratio": turned["pinion"] / max(turned["wheel"], 1e-300),
        "ratio_of_teeth": wheel_teeth / pinion_teeth,
        "drive_torque": abs(float(history["drive_mz"][half:].mean())),
        "drive_torque_of_brake": torque * pinion_teeth / wheel_teeth,
        "normal_force": float(history["contact_normal"][half:].mean()),
        "normal_force_of_brake": torque / base,
    }


CASE = ff.Case(
    name="gear_pair",
    summary="two spur gears whose involute teeth touch: contact of rigid bodies",
    description=__doc__,
    build=build,
    options=(
        ff.Option("pinion_teeth", int, 20, "of the gear that is driven", minimum=4),
        ff.Option("wheel_teeth", int, 30, "of the other one", minimum=4),
        ff.Option("module", float, 0.005, "diameter over teeth", unit="m", above=0.0),
        ff.Option("pressure_angle", float, 20.0, "of the flanks", unit="deg", above=5.0,
                  maximum=40.0),
        ff.Option("backlash", float, 0.1, "along the pitch circles, in modules", minimum=0.0,
                  maximum=1.0),
        ff.Option("width", float, 0.01, "of the wheel", unit="m", above=0.0),
        ff.Option("bore", float, 0.01, "its radius", unit="m", above=0.0),
        ff.Option("points", int, 16, "chords of each flank", minimum=1),
        ff.Option("slices", int, 1, "layers of triangles along the axes", minimum=1),
        ff.Option("density", float, 7850.0, "of the gears", unit="kg/m^3", above=0.0),
        ff.Option("speed", float, 10.0, "of the pinion in the end", unit="rad/s"),
        ff.Option("ramp", float, 0.05, "time in which the speed rises", unit="s", above=0.0),
        ff.Option("brake", float, 1.0, "torque over the wheel's speed", unit="N m s/rad",
                  above=0.0),
        ff.Option("friction", float, 0.0, "Coulomb's coefficient", minimum=0.0),
        ff.Option("restitution", float, 0.0, "speed after over speed before impacts", minimum=0.0,
                  maximum=1.0),
        ff.Option("reach", float, 0.01, "gap below which surfaces repel each other, in modules",
                  above=0.0),
        ff.Option("clearance", float, 0.015, "of the flanks that are going to push, at the start, "
                  "in modules", above=0.0),
    ),
    dt=5e-4,
    t_end=0.4,
    smoke={"pinion_teeth": 8, "wheel_teeth": 9, "pressure_angle": 30.0, "points": 3, "ramp": 4e-3,
           "bore": 0.005, "t_end": 5e-3},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
