# SPDX-License-Identifier: LGPL-3.0-or-later
"""A wind turbine in wind: three flexible blades, drive train, nacelle and tower, with aerodynamics.

Structure: the IEA 15 MW reference turbine on its tower. Blades are beams with the shipped file of
6x6 matrices (see ``turbine_blade``), the tower is a beam, hub, nacelle and generator are rigid
bodies; the shaft is a torsional spring. X is downwind, Z up; the rotor is upwind, tilted and coned.

Aerodynamics: blade elements at the nodes of the blades. Lift follows ``2 pi sin(alpha - alpha_0)``
up to a smooth stall, drag is constant. Each element has the axial induction of its annulus as a
state, which approaches that of momentum theory (with Buhl's correction, 2005, and Prandtl's loss at
the tip) in the time ``--wake``. The chord is a few numbers near those of the reference turbine, so
that powers are near its own, not equal to them. The generator's torque is ``gain Omega^2``, at most
``--torque``.

History: ``rate`` of the rotor (rad/s), ``power`` of the generator (W), ``azimuth`` (rad);
``out_1, out_2, out_3`` and ``in_1, in_2, in_3``, displacements of the tips out of the plane of
rotation and in it, relative to the unloaded blade (m); ``top_x, top_y, top_z``, those of the
tower's top (m).

Expected at 9 m/s: 0.646 rad/s and 8.9 MW after a minute, tips bent by 11 m. With the step of 0.1 s
the rate is off by 7e-4 of its largest value from 15 to 30 s, the power and ``out`` by 2e-3, while
the vibrations of the start, of the tower's top and in the plane of rotation, lag by 1.5 and 3 %;
with 0.05 s by a fourth of this. At 60 s these two differ by 3e-6 in the rate and by 1e-4 in
``out``. ``--tolerance`` is that of forces times ``beta h^2``: 1e-3 are 0.4 N, and change the
history by 2e-7.

``--analysis campbell``: modes over the speed of the rotor in this wind, in multiblade coordinates,
about its steady states without tilt, shear and gravity; ``--air 0`` for those of the structure
alone. The shares of support, drive and blades in their energies name them, see ``sweep_rotor``;
modes of the induction are left out. Where ``torque``, that of a drive beside the generator, is
zero, the rotor turns by itself: at 0.65 rad/s with 9 m/s. Picture: ``flexfem plot
results/turbine_campbell --campbell``.

Run: ``mpirun -n 2 python cases/turbine.py --wind 9``.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import flexfem as ff

#: Tower: fraction of its height, mass (kg/m) and bending stiffness (N m^2), from the file
#: IEA-15-240-RWT-Monopile_ElastoDyn_tower.dat; geometry and masses from that of ElastoDyn (IEA Wind
#: Task 37, Apache License 2.0, see meshes/LICENSE.Apache-2.0).
TOWER = np.array([
    (0.0, 10314.84, 3.065447e12), (0.1004782, 9919.33, 2.948765e12),
    (0.2009530, 9107.20, 2.668808e12), (0.3014275, 8138.42, 2.158697e12),
    (0.4019020, 7257.85, 1.684190e12), (0.5023767, 6367.64, 1.257977e12),
    (0.6028511, 5435.00, 8.823415e11), (0.7033257, 4622.22, 6.560101e11),
    (0.8038003, 3953.10, 5.356115e11), (0.9042748, 3848.71, 4.945348e11),
    (1.0, 4074.84, 5.119079e11),
])  # fmt: skip
#: Planform: fraction of the blade's length, chord (m), and thickness over chord for pictures.
PLANFORM = np.array([
    (0.0, 5.20, 1.0), (0.1, 5.30, 0.80), (0.2, 5.65, 0.51), (0.27, 5.77, 0.42), (0.35, 5.35, 0.36),
    (0.45, 4.75, 0.32), (0.55, 4.20, 0.28), (0.65, 3.75, 0.25), (0.75, 3.30, 0.23),
    (0.85, 2.85, 0.21), (0.93, 2.40, 0.21), (1.0, 0.80, 0.21),
])  # fmt: skip
BASE, HEIGHT, HUB_RADIUS, OVERHANG, SHAFT_ABOVE_TOP = 15.0, 129.386, 3.97, 12.0975718, 4.3494594
HUB, NACELLE, YAW_BEARING = (69131.0, 969952.0), (644857.0, 1.599e7), 28249.0
# the file has the mass of the armature in that of the nacelle
NACELLE_PLACE, ARMATURE = np.array([-5.125, 0.0, 4.315]), (1.4e5, 1836784.0)
SHAFT_STIFFNESS, SHAFT_DAMPING = 6.97376449e10, 4.9418406e7
BLADES = ("blade_1", "blade_2", "blade_3")
STEEL, POISSON = 2.1e11, 0.3


def about(axis: int, angle: float) -> np.ndarray:
    """Rotation about a coordinate axis."""
    c, s, i, j = np.cos(angle), np.sin(angle), (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = -s, s
    return R


def tower_sections() -> ff.SectionTable:
    """Sections of a thin tube with the given mass and bending stiffness."""
    fraction, mass, bending = TOWER.T
    radius = np.sqrt(2.0 * bending / STEEL / (mass / 8500.0))
    area, shear = mass / 8500.0, STEEL / (2.0 * (1.0 + POISSON))
    stiffness, inertia = np.zeros((2, len(TOWER), 6, 6))
    for k in range(6):
        part = [STEEL * area, 0.5 * shear * area, 0.5 * shear * area]
        stiffness[:, k, k] = [*part, 2.0 * bending * shear / STEEL, bending, bending][k]
        inertia[:, k, k] = [mass, mass, mass, mass * radius**2, *(2 * [0.5 * mass * radius**2])][k]
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return ff.SectionTable(
        fraction, stiffness, inertia, relative=True, outlines=radius[:, None, None] * rim
    )


def drawn(table: ff.SectionTable) -> ff.SectionTable:
    """The table with ellipses of the planform as outlines."""
    place, chord, thickness = PLANFORM.T
    length = np.interp(table.stations, place, chord)
    height = length * np.interp(table.stations, place, thickness)
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    y, z = np.outer(0.5 * height, np.cos(angle)), np.outer(0.5 * length, np.sin(angle))
    return replace(table, outlines=np.stack([y, z], axis=-1))


def aerodynamics(
    t: float, ends: ff.Ends, z: np.ndarray, parameters: np.ndarray
) -> tuple[np.ndarray, None, np.ndarray]:
    """Forces on blade elements, and rates of their inductions, the states.

    Loops that numba compiles. Numbers of each element, in this order: chord and width (m);
    wind (m/s) at the height of the hub and the exponent of its profile; radius of the tips (m);
    time constant of the induction (s); slope of the lift, angle of zero lift (rad), largest lift
    coefficient, drag; density of the air (kg/m^3); unit vector of the shaft, downwind, and a point
    on it (m).
    """
    forces, rates = np.empty((len(z), 3)), np.empty((len(z), 1))
    across, along, flow, arm = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(z)):
        chord, width, wind, shear, radius, wake, slope, zero, most, drag, air = parameters[k, :11]
        axis, centre = parameters[k, 11:14], parameters[k, 14:17]
        speed = wind * (max(ends.positions[k, 2], 1.0) / centre[2]) ** shear
        normal_flow = back_flow = through = outwards = 0.0
        for i in range(3):
            across[i], along[i] = ends.rotations[k, i, 0], ends.rotations[k, i, 1]
            flow[i] = -ends.velocities[k, i] - z[k, 0] * speed * axis[i]
            arm[i] = ends.positions[k, i] - centre[i]
        flow[0] += speed
        for i in range(3):
            normal_flow += flow[i] * across[i]
            back_flow += flow[i] * along[i]
            through += flow[i] * axis[i]
            outwards += arm[i] * axis[i]
        lift = most * np.tanh(slope * np.sin(np.arctan2(normal_flow, back_flow) - zero) / most)
        size = np.sqrt(normal_flow**2 + back_flow**2)
        pressure, thrust, square = 0.5 * chord * size, 0.0, 0.0  # over the density
        for i in range(3):
            up = (back_flow * across[i] - normal_flow * along[i]) * lift
            down = drag * (normal_flow * across[i] + back_flow * along[i])
            forces[k, i] = pressure * (up + down)
            thrust += forces[k, i] * axis[i]
            forces[k, i] *= air * width
            square += (arm[i] - outwards * axis[i]) ** 2
        # momentum theory of the annulus, with the loss at the tips of three blades
        r, sine = np.sqrt(square), max(abs(through) / size, 0.02)
        room = max(radius - r, 0.005 * radius)
        loss = 2.0 / np.pi * np.arccos(np.exp(-1.5 * room / (r * sine)))
        load = min(max(3.0 * thrust / (np.pi * r * speed**2), -2.0), 1.9)
        if load < 0.96 * loss:
            steady = 0.5 * (1.0 - np.sqrt(1.0 - load / loss))
        else:
            inner = max(load * (50.0 - 36.0 * loss) + 12.0 * loss * (3.0 * loss - 4.0), 0.0)
            heavy = (18.0 * loss - 20.0 - 3.0 * np.sqrt(inner)) / (36.0 * loss - 50.0)
            steady = min(heavy, 0.9)
        rates[k, 0] = (steady - z[k, 0]) / wake
    return forces, None, rates


def braking(rate: float, gain: float, most: float) -> float:
    """Torque of the generator at a rate: ``gain rate^2``, smoothly limited (N m)."""
    wanted = gain * rate * abs(rate)
    return wanted / (1.0 + (abs(wanted) / most) ** 8) ** 0.125


def generator(
    t: float, ends: ff.Ends, z: np.ndarray, parameters: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Torque between armature and nacelle against their relative rotation about the shaft."""
    axis = ends.rotations[1, :, 0]
    rate = float((ends.angular_velocities[0] - ends.angular_velocities[1]) @ axis)
    moment = braking(rate, *parameters.tolist()) * axis
    return np.zeros((2, 3)), np.stack([-moment, moment])


@dataclass(frozen=True)
class Layout:
    """Places and axes of the turbine at the start.

    Attributes:
        rotor: axes of the rotor as columns, the first one downwind along the shaft.
        top, centre: top of the tower, centre of the hub, m.
        blades: the blades in their places, and ``axes`` of each, as columns: downwind, across to
            the trailing edge, outwards.
        spin: angular velocity at the start, rad/s.
    """

    rotor: np.ndarray
    top: np.ndarray
    centre: np.ndarray
    blades: list[ff.BeamData]
    axes: list[np.ndarray]
    spin: np.ndarray

    @classmethod
    def of(cls, tilt: float, cone: float, pitch: float, rate: float) -> "Layout":
        """Layout with these angles (degrees) and this rate."""
        rotor, top = about(1, np.radians(tilt)), np.array([0.0, 0.0, BASE + HEIGHT])
        centre = top + np.array([0.0, 0.0, SHAFT_ABOVE_TOP]) - OVERHANG * rotor[:, 0]
        axes = [
            rotor @ about(0, 2.0 * np.pi * k / 3.0) @ about(1, -np.radians(cone))
            @ about(2, -np.radians(pitch))
            for k in range(3)
        ]  # fmt: skip
        shipped = ff.read_windio(ff.shipped_data("iea15_blade.yaml"))
        from_hub = shipped.points + np.array([0.0, 0.0, HUB_RADIUS])
        blades = [
            replace(shipped, points=centre + from_hub @ R.T, across=R @ shipped.across)
            for R in axes
        ]
        return cls(rotor, top, centre, blades, axes, rate * rotor[:, 0])


def add_tower_and_drive(
    model: ff.Model, at: Layout, gain: float, torque: float, damping: float
) -> None:
    """Tower, nacelle, hub, generator and shaft."""
    axis = at.rotor[:, 0]
    nacelle, hub, armature = (
        ff.Marker(name, rotation=at.rotor) for name in ("nacelle", "hub", "armature")
    )
    bearings = ff.Marker("nacelle", offset=at.centre - at.top - NACELLE_PLACE)
    turning = {"position": at.centre, "rotation": at.rotor, "angular_velocity": at.spin}
    model.add(
        ff.Beam("tower", tower_sections(), damping=damping),
        ff.Rigid("foundation", ff.Ground((0.0, 0.0, BASE)), ff.Marker("tower", "start")),
        ff.RigidBody(
            "nacelle",
            NACELLE[0] - ARMATURE[0],
            np.full(3, NACELLE[1]),
            position=at.top + NACELLE_PLACE,
        ),
        ff.Rigid("yaw", ff.Marker("tower", "end"), ff.Marker("nacelle", offset=-NACELLE_PLACE)),
        ff.PointMass("yaw_bearing", YAW_BEARING, ff.Marker("tower", "end")),
        ff.RigidBody("hub", HUB[0], np.full(3, HUB[1]), **turning),
        ff.RigidBody("armature", ARMATURE[0], np.full(3, ARMATURE[1]), **turning),
        ff.Revolute("bearing", bearings, hub, axis=axis),
        ff.Revolute("stator", bearings, armature, axis=axis),
        ff.TorsionalSpringDamper(
            "shaft", armature, hub, axis=axis, stiffness=SHAFT_STIFFNESS, damping=SHAFT_DAMPING
        ),
        ff.Force("generator", [armature, nacelle], generator, parameters=(gain, torque)),
    )


def add_blades(
    model: ff.Model, at: Layout, elements: int, chord: float, damping: float
) -> tuple[list[ff.Marker], list[tuple[float, float]]]:
    """Blades on the hub; markers of their blade elements, with chords and widths (m)."""
    stations, sizes = [], []
    fractions = np.linspace(0.0, 1.0, elements + 1)
    chords = chord * np.interp(fractions, *PLANFORM.T[:2])
    ends = np.where(np.isin(fractions, (0.0, 1.0)), 0.5, 1.0)
    moving = {"velocity": -np.cross(at.spin, at.centre), "angular_velocity": at.spin}
    for name, blade, axes in zip(BLADES, at.blades, at.axes, strict=True):
        root = model.mesh.points[model.mesh.point_groups[f"{name}_start"]]
        place = ff.Marker("hub", offset=at.rotor.T @ (root - at.centre))
        model.add(
            blade.beam(
                name, section=drawn(blade.sections), damping=damping * blade.damping, **moving
            ),
            ff.Rigid(f"root_{name}", place, ff.Marker(name, "start")),
        )
        assert callable(blade.sections.twist)  # that of a windIO file is a spline
        twist = np.asarray(blade.sections.twist(fractions))
        stations += [
            ff.Marker(name, float(f), rotation=axes @ about(2, float(angle)))
            for f, angle in zip(fractions, twist, strict=True)
        ]
        sizes += zip(chords.tolist(), (blade.length / elements * ends).tolist(), strict=True)
    return stations, sizes


def build(
    *, wind: float, shear: float, rate: float, pitch: float, tilt: float, cone: float,
    elements: int, tower_elements: int, gain: float, torque: float, wake: float, lift_slope: float,
    zero_lift: float, most_lift: float, drag: float, air: float, chord: float,
    blade_damping: float, tower_damping: float, gravity: float,
) -> ff.Model:  # fmt: skip
    """Model of the whole turbine; angles in degrees."""
    at = Layout.of(tilt, cone, pitch, rate)
    mast = ff.LineMesh.straight({"tower": [(0.0, 0.0, BASE), at.top]}, tower_elements)
    parts = [one.mesh(name, elements) for name, one in zip(BLADES, at.blades, strict=True)]
    model = ff.Model("turbine", mesh=ff.LineMesh.join([mast, *parts]))
    model.add(ff.Gravity((0.0, 0.0, -gravity)))
    add_tower_and_drive(model, at, gain, torque, tower_damping)
    stations, sizes = add_blades(model, at, elements, chord, blade_damping)
    radius = float(np.linalg.norm(parts[0].points[-1] - at.centre))
    common = (
        wind, shear, radius, wake, lift_slope, np.radians(zero_lift), most_lift, drag, air,
        *at.rotor[:, 0], *at.centre,
    )  # fmt: skip
    model.add(
        ff.Force(
            "wind",
            stations,
            aerodynamics,
            states=1,
            initial=(0.3,),
            each=1,
            compiled=True,
            parameters=[(*own, *common) for own in sizes],
        ),
        *probes(model, at, (gain, torque)),
    )
    return model


def turning(axis: np.ndarray) -> Callable[..., list[float]]:
    """Angle and rate of the first marker against the second about an axis of it."""

    def values(t: float, hub: ff.MarkerState, nacelle: ff.MarkerState) -> list[float]:
        R, shaft = nacelle.turn.T @ hub.turn, nacelle.turn @ axis
        sine = 0.5 * (np.array([R[2, 1], R[0, 2], R[1, 0]]) - [R[1, 2], R[2, 0], R[0, 1]]) @ axis
        rate = (hub.angular_velocity - nacelle.angular_velocity) @ shaft
        return [float(np.arctan2(sine, 0.5 * (np.trace(R) - 1.0))), float(rate)]

    return values


def moved(arm: np.ndarray) -> Callable[..., list[float]]:
    """Way of a tip out of the plane of rotation and along it, ``arm`` (m) from the hub at first."""
    along = np.cross([1.0, 0.0, 0.0], arm)
    along /= np.linalg.norm(along)

    def values(t: float, tip: ff.MarkerState, hub: ff.MarkerState) -> list[float]:
        way = hub.rotation.T @ (tip.position - hub.position) - arm
        return [float(way[0]), float(way @ along)]

    return values


def probes(model: ff.Model, at: Layout, law: tuple[float, float]) -> list[ff.Probe]:
    """Rotor, generator, tips and tower."""
    rate = turning(at.rotor[:, 0])

    def power(t: float, armature: ff.MarkerState, nacelle: ff.MarkerState) -> list[float]:
        speed = rate(t, armature, nacelle)[1]
        return [speed * braking(speed, *law)]

    hub, nacelle = ff.Marker("hub", rotation=at.rotor), ff.Marker("nacelle")
    found = [
        ff.Probe("rotor", [hub, nacelle], ("azimuth", "rate"), rate, unwrap=["azimuth"]),
        ff.Probe("generated", [ff.Marker("armature"), nacelle], ("power",), power),
        ff.Probe(
            "top", ff.Marker("tower", "end"), ("top_x", "top_y", "top_z"),
            lambda t, state: (state.position - at.top).tolist(),
        ),
    ]  # fmt: skip
    for k, name in enumerate(BLADES, start=1):
        tip = model.mesh.points[model.mesh.point_groups[f"{name}_end"]]
        way = moved(at.rotor.T @ (tip - at.centre))
        pair = [ff.Marker(name, "end"), hub]
        found.append(ff.Probe(f"tip_{k}", pair, (f"out_{k}", f"in_{k}"), way))
    return found


CASE = ff.Case(
    name="turbine",
    summary="wind turbine with flexible blades, tower, drive train and aerodynamics",
    description=__doc__,
    build=build,
    options=(
        ff.Option("wind", float, 9.0, "speed at the height of the hub", unit="m/s", minimum=0.1),
        ff.Option("shear", float, 0.12, "exponent of the wind's profile over the height"),
        ff.Option("rate", float, 0.6, "of the rotor at the start", unit="rad/s"),
        ff.Option("pitch", float, 0.0, "of the blades, towards feather", unit="deg"),
        ff.Option("tilt", float, 6.0, "of the shaft, the rotor upwards", unit="deg"),
        ff.Option("cone", float, 4.0, "of the blades, upwind", unit="deg"),
        ff.Option("elements", int, 10, "beam elements of a blade", minimum=2),
        ff.Option("tower_elements", int, 8, "beam elements of the tower", minimum=1),
        ff.Option("gain", float, 3.34e7, "torque over the square of the rate", unit="N m s^2"),
        ff.Option("torque", float, 19.62e6, "largest torque of the generator", unit="N m"),
        ff.Option("wake", float, 5.0, "time constant of the induction", unit="s", minimum=1e-6),
        ff.Option("lift_slope", float, 6.0, "of the lift coefficient", unit="1/rad"),
        ff.Option("zero_lift", float, -4.0, "angle of attack without lift", unit="deg"),
        ff.Option("most_lift", float, 1.5, "largest lift coefficient", minimum=0.01),
        ff.Option("drag", float, 0.009, "drag coefficient", minimum=0.0),
        ff.Option("air", float, 1.225, "density of the air", unit="kg/m^3", minimum=0.0),
        ff.Option("chord", float, 1.0, "factor of the chord", minimum=0.0),
        ff.Option("blade_damping", float, 1.0, "factor of the damping in the blade's file"),
        ff.Option("tower_damping", float, 0.004, "stiffness-proportional", unit="s", minimum=0.0),
        ff.Option("gravity", float, 9.81, "downwards", unit="m/s^2"),
    ),
    dt=0.1,
    t_end=60.0,
    tolerance=1e-3,
    smoke={"elements": 3, "tower_elements": 2, "t_end": 0.2},
    others={
        ff.ROTOR: {
            "blades": ",".join(BLADES),
            "rotor": "hub,armature",
            "axis": "x",
            "centre": f"{-OVERHANG},0,{BASE + HEIGHT + SHAFT_ABOVE_TOP}",
            "spin": 0.1,
            "spin_end": 0.8,
            "speeds": 8,
            "modes": 12,
            "target": 0.5,
            "variation": 5e-3,
            # derivatives of the blade elements are differences, with noise of about 1e-7
            "accuracy": 1e-6,
            "tilt": 0.0,
            "shear": 0.0,
            "gravity": 0.0,
        }
    },
    results=lambda history: {name: history[name][-1] for name in ("rate", "power", "out_1")},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
