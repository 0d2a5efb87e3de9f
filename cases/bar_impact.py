# SPDX-License-Identifier: LGPL-3.0-or-later
"""An elastic bar hits a rigid wall end on, and leaves it without vibrations.

The bar, ``--length`` 0.2 m and ``--side`` 20 mm square, E = 2e11 N/m^2, nu = 0.3,
rho = 8000 kg/m^3, flies along -Z at ``--speed`` 100 m/s towards the wall z = 0 from a distance of
``--distance`` 2 mm (benchmark SDNV100 of code_aster). Its lateral motion is held, so that its
modulus is that of uniaxial strain, E (1 - nu)/((1 + nu)(1 - 2 nu)); with ``--lateral free`` it is
E. It is a line of ``--elements`` beam elements, whose first node touches the wall with a tip of
``--tip-radius``; the wall begins to repel where the gap is ``--reach``.

History: ``gap`` (m) between tip and wall; force of the wall on the bar, mean over the step,
``force`` (N), and ``contact_penetration`` (m), ``contact_fx, contact_fy, contact_normal`` (N),
``contact_closed``, the number of points within reach; ``com_velocity`` of the centre of mass (m/s),
positive away from the wall;
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``
(J), the strain energy with that of the contact.

Expected, in closed form: a wave of compression runs to the far end and comes back as one of relief.
With the speed of waves c, the bar touches the wall from distance/speed on, for the time 2 length/c;
meanwhile the force is constant, area rho c speed; then it leaves with its speed and no vibrations.
Here that is from 2.000e-5 to 8.895e-5 s with 1.85638e6 N and 128 N s. ``results`` has these beside
what the run gives: 1.91e-5 to 8.79e-5 s, 1.85638e6 N, 128.00 N s and 99.99 m/s. Times differ by
less than reach/speed, 3e-6 s.
Run: ``python cases/bar_impact.py``, then ``flexfem plot results/bar_impact --columns force``.
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
class Bar:
    """Bar and exact solution: the options of these names."""

    length: float
    side: float
    youngs_modulus: float
    poisson_ratio: float
    density: float
    speed: float
    distance: float
    lateral: str

    @property
    def modulus(self) -> float:
        """Stress over strain along the bar, N/m^2."""
        nu = self.poisson_ratio
        held = (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
        return self.youngs_modulus * (held if self.lateral == "held" else 1.0)

    @property
    def waves(self) -> float:
        """Speed of waves, m/s."""
        return math.sqrt(self.modulus / self.density)

    @property
    def force(self) -> float:
        """Of the wall while the bar touches it, N."""
        return self.density * self.side**2 * self.waves * self.speed

    @property
    def duration(self) -> float:
        """For which it touches, s."""
        return 2.0 * self.length / self.waves


def build(*, elements: int, tip_radius: float, reach: float, **values: object) -> ff.Model:
    """Model of bar and wall; ``values`` are those of :class:`Bar`."""
    bar = Bar(**values)  # type: ignore[arg-type]
    end = bar.distance + tip_radius
    line = [(0.0, 0.0, end), (0.0, 0.0, end + bar.length)]
    # the stress along the bar is the modulus times the strain: nothing contracts
    material = ff.Material(bar.modulus, 0.0, bar.density)
    section = ff.Section.rectangle(bar.side, bar.side, material)
    nodes = [ff.Marker("bar", float(s)) for s in np.linspace(0.0, 1.0, elements + 1)]
    model = ff.Model("bar_impact", mesh=ff.LineMesh.straight({"bar": line}, elements))
    model.add(
        ff.Beam("bar", section, orientation=(1.0, 0.0, 0.0), velocity=(0.0, 0.0, -bar.speed)),
        ff.Contact(
            "wall", "bar", surfaces=ff.RigidPlane(ff.Ground()), radius=tip_radius, reach=reach
        ),
        ff.ContactProbe("contact", "wall", names={"gap": "gap", "fz": "force"}),
        ff.Probe("centre", nodes, ("com_velocity",), mean_velocity),
        ff.EnergyProbe(),
    )
    return model


def mean_velocity(t: float, *nodes: ff.MarkerState) -> tuple[float]:
    """Velocity of the centre of mass: half of each element's mass is at each of its nodes."""
    rates = [float(node.velocity[2]) for node in nodes]
    return ((sum(rates) - 0.5 * (rates[0] + rates[-1])) / (len(rates) - 1),)


def results(
    history: Mapping[str, Points], *, length: float, side: float, youngs_modulus: float,
    poisson_ratio: float, density: float, speed: float, distance: float, lateral: str,
) -> dict[str, float]:  # fmt: skip
    """Contact and speed afterwards, each beside its value in closed form."""
    bar = Bar(length, side, youngs_modulus, poisson_ratio, density, speed, distance, lateral)
    time, force = history["t"], history["force"]
    steps = np.diff(time, prepend=time[0])
    energy = history["energy_kinetic"] + history["energy_strain"]
    found = {
        "impulse": float(force @ steps),
        "expected_impulse": bar.force * bar.duration,
        "expected_force": bar.force,
        "expected_first_contact": bar.distance / bar.speed,
        "expected_last_contact": bar.distance / bar.speed + bar.duration,
        "last_com_velocity": float(history["com_velocity"][-1]),
        "expected_com_velocity": bar.speed,
        "least_gap": float(history["gap"].min()),
        "energy_made": float((energy - energy[0]).max() / energy[0]),
    }
    touching = np.flatnonzero(force > 0.5 * bar.force)
    if len(touching):
        first, last = touching[0], touching[-1]
        middle = (time - time[first]) / (time[last] - time[first] or 1.0)
        plateau = force[(middle >= 0.25) & (middle <= 0.75)]
        found["first_contact"] = float(time[first] - steps[first])
        found["last_contact"] = float(time[last])
        found["force"] = float(plateau.mean()) if len(plateau) else float(force[first])
    return found


CASE = ff.Case(
    name="bar_impact",
    summary="elastic bar hits a rigid wall: force, time of contact and rebound in closed form",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 200, "beam elements", minimum=1),
        ff.Option("length", float, 0.2, "of the bar", unit="m", above=0.0),
        ff.Option("side", float, 0.02, "of its square section", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 2e11, "of the bar", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the bar", minimum=0.0, maximum=0.49),
        ff.Option("density", float, 8000.0, "of the bar", unit="kg/m^3", above=0.0),
        ff.Option("lateral", str, "held", "motion across the bar", choices=("held", "free")),
        ff.Option("speed", float, 100.0, "towards the wall at the start", unit="m/s", above=0.0),
        ff.Option("distance", float, 2e-3, "from the wall at the start", unit="m", above=0.0),
        ff.Option("tip_radius", float, 0.01, "of the end that touches", unit="m", above=0.0),
        ff.Option("reach", float, 3e-4, "gap below which the wall repels", unit="m", above=0.0),
    ),
    dt=1e-7,
    t_end=1.2e-4,
    tolerance=1e-11,
    every=20,
    smoke={"elements": 4, "distance": 5e-4, "dt": 2e-6, "t_end": 1e-5},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
