# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ropes that fall on the ground and on one another, in a heap.

``--ropes`` round ropes of ``--elements`` beam elements each, 1 m long and 10 mm thick (E = 1e7
N/m^2, nu = 0.45, rho = 1000 kg/m^3), hang horizontally above one another at first, at rest and free
of stress. They point in random directions about Z, are inclined by up to ``--tilt`` and off the
vertical axis by up to ``--scatter``. Then they fall on the plane z = 0. Everything touches
everything: ropes the ground, each other and themselves.

Ropes are damped in proportion to their stiffness (``--damping``); contact has Coulomb's friction
(``--friction``) and gives back the part ``--restitution`` of the speed of approach.

History: ``contact_gap`` (m), the least distance of surfaces that are near each other, and
``contact_penetration`` (m), how far they overlap: not at all; ``contact_fx, contact_fy,
contact_fz`` (N), the force on the ropes; ``contact_normal`` (N), the sum of the sizes of all normal
forces, and ``contact_closed``, the number of pairs that push; ``height`` (m), the mean of the
ropes' middles; ``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation,
energy_balance`` (J).

Expected: the gap stays positive whatever the step is, and the energy never rises above that of the
start, ``energy_gained`` of the results (J): with the defaults by 1e-14 J. At rest the ground bears
the weight, ``weight`` of the results (N), 9.25 N: ``last_force``, the mean of the last tenth of the
time, is 9.23 N, and still goes up and down between 6 and 18 N (9.33 N on two ranks: roundings grow
in a heap). Of 3.24 J that are dissipated until then the balance misses 1e-7 J. Without damping the
energy is constant, to 4e-8 J within 0.4 s in which 2.3 J become kinetic.
With ``--integrator generalized_alpha`` ropes that turn and bend by large angles in a step gain or
lose energy: 6 ropes that fall from 3 m with steps of 2 ms end with 0.7 J of 14 J too much, and the
run says so; with ``energy_momentum`` it is 2e-8 J.
Run: ``mpirun -n 2 python cases/rope_heap.py --ropes 100 --elements 50 --t-end 10``, and
``flexfem render results/rope_heap``.
"""

import math
import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import flexfem as ff

Points = npt.NDArray[np.float64]


def hanging(
    ropes: int, length: float, height: float, spacing: float, tilt: float, scatter: float, seed: int
) -> dict[str, Points]:
    """Both ends (2, 3) of each rope by its name; the lowest one is at ``height``, m.

    Angles are in degrees.
    """
    random = np.random.default_rng(seed)
    way = random.uniform(0.0, 2.0 * np.pi, ropes)
    rise = np.radians(tilt) * random.uniform(-1.0, 1.0, ropes)
    along = np.column_stack([np.cos(rise) * np.cos(way), np.cos(rise) * np.sin(way), np.sin(rise)])
    middle = np.column_stack(
        [scatter * random.uniform(-1.0, 1.0, (ropes, 2)), height + spacing * np.arange(ropes)]
    )
    half = 0.5 * length * along
    ends = np.stack([middle - half, middle + half], axis=1)
    return {f"rope_{k + 1}": ends[k] for k in range(ropes)}


def build(
    *, ropes: int, elements: int, length: float, diameter: float, youngs_modulus: float,
    poisson_ratio: float, density: float, damping: float, height: float, spacing: float,
    tilt: float, scatter: float, seed: int, friction: float, restitution: float, reach: float,
    gravity: float,
) -> ff.Model:  # fmt: skip
    """Model of so many ropes above the ground."""
    apart = length * math.sin(math.radians(tilt)) + (1.0 + reach) * diameter
    if spacing <= apart or height <= apart:
        raise ValueError(
            f"height and spacing must be above {apart:g} m, or ropes that are inclined by "
            f"{tilt:g} degrees may overlap, got {height:g} and {spacing:g}"
        )
    lines = hanging(ropes, length, height, spacing, tilt, scatter, seed)
    rubber = ff.Material(youngs_modulus, poisson_ratio, density)
    section = ff.Section.circle(diameter, rubber)
    model = ff.Model("rope_heap", mesh=ff.LineMesh.straight(lines, elements))
    model.add(*(ff.Beam(name, section, damping=damping) for name in lines))
    middles = [ff.Marker(name, 0.5) for name in lines]
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.Contact(
            "all", surfaces=ff.RigidPlane(ff.Ground()), friction=friction,
            restitution=restitution, reach=reach * diameter,
        ),
        ff.ContactProbe("contact", "all"),
        ff.Probe("middles", middles, ("height",), mean_height),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def mean_height(t: float, *middles: ff.MarkerState) -> list[float]:
    """Mean height of markers, m."""
    return [sum(float(middle.position[2]) for middle in middles) / len(middles)]


def results(
    history: Mapping[str, Points], *, ropes: int, length: float, diameter: float, density: float,
    gravity: float,
) -> dict[str, float]:  # fmt: skip
    """Least gap, most energy over that of the start, and what the ground bears in the end."""
    weight = ropes * 0.25 * math.pi * diameter**2 * length * density * gravity
    last = history["t"] >= 0.9 * history["t"][-1]
    energy = history["energy_kinetic"] + history["energy_strain"] + history["energy_gravity"]
    return {
        "least_gap": float(history["contact_gap"].min()),
        "energy_gained": float((energy - energy[0]).max()),
        "weight": weight,
        "last_force": float(history["contact_fz"][last].mean()),
        "last_height": float(history["height"][-1]),
    }


CASE = ff.Case(
    name="rope_heap",
    summary="ropes that fall in a heap: contact of beams with each other and the ground",
    description=__doc__,
    build=build,
    options=(
        ff.Option("ropes", int, 12, "number of ropes", minimum=1),
        ff.Option("elements", int, 20, "beam elements of each", minimum=1),
        ff.Option("length", float, 1.0, "of a rope", unit="m", above=0.0),
        ff.Option("diameter", float, 0.01, "of a rope", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 1e7, "of the ropes", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.45, "of the ropes", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 1000.0, "of the ropes", unit="kg/m^3", above=0.0),
        ff.Option("damping", float, 1e-3, "stiffness-proportional", unit="s", minimum=0.0),
        ff.Option("height", float, 0.1, "of the lowest rope", unit="m", above=0.0),
        ff.Option("spacing", float, 0.05, "from one rope up to the next", unit="m", above=0.0),
        ff.Option("tilt", float, 1.0, "largest angle of a rope to the horizontal", unit="deg",
                  minimum=0.0, maximum=45.0),
        ff.Option("scatter", float, 0.1, "largest distance of the middles from the axis, along X "
                  "and Y", unit="m", minimum=0.0),
        ff.Option("seed", int, 0, "of the random numbers", minimum=0),
        ff.Option("friction", float, 0.0, "Coulomb's coefficient", minimum=0.0),
        ff.Option("restitution", float, 1.0, "speed after over speed before impacts", minimum=0.0,
                  maximum=1.0),
        ff.Option("reach", float, 0.05, "gap below which surfaces repel each other, in diameters",
                  above=0.0),
        ff.Option("gravity", float, 9.81, "along -Z", unit="m/s^2"),
    ),
    dt=1e-3,
    t_end=1.5,
    integrator="energy_momentum",
    rho_inf=1.0,
    smoke={"ropes": 2, "elements": 3, "height": 0.021, "spacing": 0.03, "tilt": 0.1,
           "scatter": 0.0, "dt": 5e-3, "t_end": 0.075},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
