# SPDX-License-Identifier: LGPL-3.0-or-later
"""Capstan: a rope is pulled over a fixed cylinder with friction.

The rope (diameter 0.5 mm, E = 10e9 N/m^2, nu = 0.3, rho = 1400 kg/m^3) lies around a cylinder of
``--radius`` 0.1 m over ``--angle`` pi, ``--elements`` beam elements there and as fine ones along
the free ends of ``--free-length``; it climbs by ``--pitch`` a turn, lest it meets itself.
``--tension`` 1 N pulls its light end, within ``--loading`` after the start; the other end is drawn
away with ``--pull-speed``, until all of the rope slides.

History: force that draws the heavy end, along the rope and across it, ``pull_fx, pull_fy, pull_fz``
(N), and its moments ``pull_mx, pull_my, pull_mz`` (N m); way of the light end along the rope,
``slip`` (m); least distance from the cylinder, ``gap`` (m), ``contact_penetration`` (m), force of
the cylinder ``contact_fx, contact_fy, contact_fz, contact_normal`` (N) and ``contact_closed``, the
number of points within reach;
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``
(J).

Expected: once the light end slides, the forces are as exp(friction angle) (Euler, Eytelwein);
``results`` has their ``ratio`` in the last tenth of the time beside ``expected_ratio``. Friction
acts at the surface of the rope, tension along its axis: that takes the radius of the rope over that
of the cylinder from the exponent, 0.25 % here; chords, which touch with their middles, take 0.15 %
from the ratio with 40 elements over half a turn, over a whole one 1.2 % and with 80 of them 0.35 %.
Run: ``python cases/capstan.py --friction 0.3 --angle 6.2832``, then ``flexfem plot results/capstan
--columns pull_fx``.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import flexfem as ff

Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Winding:
    """Line of the rope: around Z from the X axis on, with straight ends.

    Attributes:
        radius: Distance of the line from the Z axis, m.
        angle: Around the axis, rad.
        pitch: Rise in one turn, m.
        free_length: Of each straight end, m.
        elements: Of the wound part.
    """

    radius: float
    angle: float
    pitch: float
    free_length: float
    elements: int

    def at(self, angle: float, scale: float = 1.0) -> Points:
        """Point at an angle (rad), its distance from the axis times ``scale``."""
        x, y = self.radius * scale * math.cos(angle), self.radius * scale * math.sin(angle)
        return np.array((x, y, self.pitch * angle / (2.0 * math.pi)))

    def along(self, angle: float) -> Points:
        """Direction of the rope at an angle, towards larger ones."""
        slope = self.pitch / (2.0 * math.pi * self.radius)
        tangent = np.array((-math.sin(angle), math.cos(angle), slope))
        return tangent / np.linalg.norm(tangent)

    def points(self) -> Points:
        """Nodes (n, 3), whose chords touch the line from outside."""
        part = self.angle / self.elements
        scale = 1.0 / math.cos(0.5 * part)
        wound = [self.at(k * part, scale) for k in range(self.elements + 1)]
        count = max(math.ceil(self.free_length / (self.radius * part) - 1e-9), 1)
        away = np.arange(1, count + 1)[:, np.newaxis] * (self.free_length / count)
        light = wound[0] - away[::-1] * self.along(0.0)
        heavy = wound[-1] + away * self.along(self.angle)
        return np.vstack([light, wound, heavy])


def build(
    *, elements: int, angle: float, radius: float, diameter: float, pitch: float,
    free_length: float, youngs_modulus: float, poisson_ratio: float, density: float,
    damping: float, friction: float, tension: float, loading: float, pull_speed: float,
    reach: float,
) -> ff.Model:  # fmt: skip
    """Model of rope and cylinder."""
    if angle / elements > 1.0:
        raise ValueError(f"elements must be at least the angle, {angle:g} rad, got {elements}")
    winding = Winding(radius + 0.5 * diameter + reach, angle, pitch, free_length, elements)
    points = winding.points()
    cells = np.column_stack([np.arange(len(points) - 1), np.arange(1, len(points))])
    mesh = ff.LineMesh(points, cells, {"rope": np.arange(len(cells))})
    section = ff.Section.circle(diameter, ff.Material(youngs_modulus, poisson_ratio, density))
    light, heavy = ff.Marker("rope", "start"), ff.Marker("rope", "end")
    inwards, away = winding.along(0.0), winding.along(angle)
    across = np.cross((0.0, 0.0, 1.0), away)
    across /= np.linalg.norm(across)
    ahead = ff.Ground(points[-1], np.column_stack([away, across, np.cross(away, across)]))

    def slip(t: float, end: ff.MarkerState) -> tuple[float]:
        """Way of the light end along the rope."""
        return (float(inwards @ (end.position - points[0])),)

    model = ff.Model("capstan", mesh=mesh)
    model.add(
        ff.Beam("rope", section, orientation=(0.0, 0.0, 1.0), damping=damping),
        ff.Contact(
            "cylinder", "rope", surfaces=ff.RigidCylinder(ff.Ground(), radius), friction=friction,
            reach=reach,
        ),
        ff.PointForce("load", light, -tension * inwards, amplitude=ff.SmoothStep(0.0, loading)),
        ff.PrescribedTranslation("draw", ahead, heavy, displacement=Draw(pull_speed, loading)),
        ff.ReactionProbe("pull", "draw", axes="a"),
        ff.Probe("slip", light, ("slip",), slip),
        ff.ContactProbe("contact", "cylinder", names={"gap": "gap"}),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


@dataclass(frozen=True)
class Draw:
    """Way of the heavy end at a speed (m/s) that it reaches after some time (s)."""

    speed: float
    loading: float

    def __call__(self, t: float) -> tuple[float, float, float]:
        """Displacement along the rope and across it, m."""
        gained = min(t, self.loading)
        return self.speed * (t - gained + 0.5 * gained**2 / self.loading), 0.0, 0.0


def results(
    history: Mapping[str, Points], *, friction: float, angle: float, tension: float
) -> dict[str, float]:
    """Ratio of the forces at both ends in the last tenth of the time, and in closed form."""
    last = history["t"] >= 0.9 * history["t"][-1]
    return {
        "ratio": float(history["pull_fx"][last].mean()) / tension,
        "expected_ratio": math.exp(friction * angle),
        "slip": float(history["slip"][-1]),
        "least_gap": float(history["gap"].min()),
    }


CASE = ff.Case(
    name="capstan",
    summary="rope over a cylinder with friction: ratio of tensions against Euler's formula",
    description=__doc__,
    build=build,
    options=(
        ff.Option("friction", float, 0.3, "Coulomb's coefficient", minimum=0.0),
        ff.Option("angle", float, math.pi, "around the cylinder", unit="rad", above=0.0),
        ff.Option("elements", int, 40, "beam elements around the cylinder", minimum=2),
        ff.Option("radius", float, 0.1, "of the cylinder", unit="m", above=0.0),
        ff.Option("diameter", float, 5e-4, "of the rope", unit="m", above=0.0),
        ff.Option("pitch", float, 2e-3, "rise of the rope in one turn", unit="m", minimum=0.0),
        ff.Option("free_length", float, 0.02, "of each straight end", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 1e10, "of the rope", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the rope", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 1400.0, "of the rope", unit="kg/m^3", above=0.0),
        ff.Option("damping", float, 1e-3, "of the rope, by its stiffness", unit="s", minimum=0.0),
        ff.Option("tension", float, 1.0, "at the light end", unit="N", above=0.0),
        ff.Option("loading", float, 0.02, "time of loading", unit="s", above=0.0),
        ff.Option("pull_speed", float, 0.02, "of the heavy end", unit="m/s", above=0.0),
        ff.Option("reach", float, 2.5e-5, "gap below which they repel", unit="m", above=0.0),
    ),
    dt=1e-3,
    t_end=0.1,
    integrator="energy_momentum",
    rho_inf=0.5,
    tolerance=1e-9,
    every=10,
    smoke={"elements": 4, "t_end": 5e-3},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
