# SPDX-License-Identifier: LGPL-3.0-or-later
"""A twisted rod whose ends approach: it throws a loop, and winds up to a plectoneme.

The rod is round, straight where it is free of stress but for a bow of a thousandth of its length
(``--bow``), 1 m long and 8 mm thick (E = 1e7 N/m^2, nu = 0.45, rho = 1000 kg/m^3). Both ends are
clamped; one is turned about X, the line of the ends, by ``--turns``, and then pushed towards the
other by ``--approach``. The rod bends to a helix, throws a loop at about 3.75 s, and lies on
itself: the loop turns, and two strands wind about each other, as cables and telephone cords do.

History: ``contact_gap`` (m), the least distance of surfaces that are near each other, and
``contact_penetration`` (m), how far they overlap: not at all; ``contact_fx, contact_fy,
contact_fz`` (N), that of the rod on itself, zero; ``contact_normal`` (N), the sum of the sizes of
all normal forces, and ``contact_closed``, the number of pairs that push; ``drive_fx, drive_fy,
drive_fz`` (N), the force of the drive on the end that moves, of which ``drive_fx`` is the tension,
and ``drive_mx, drive_my, drive_mz`` (N m), its moment, zero; ``clamp_fx, clamp_fy, clamp_fz`` (N),
zero, and ``clamp_mx, clamp_my, clamp_mz`` (N m), the moment that turns the end; ``turned``,
``twist`` and ``writhe`` (turns), by how much the end is turned, the rod twisted and its axis
coiled; ``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation,
energy_balance`` (J).

Expected: twist and writhe together are what the end has been turned by, their link (G. Calugareanu,
1961; F. B. Fuller, 1971), at all times, as long as nothing passes through the rod: each passage
would change the sum by two (without contact there are three, and the rod unwinds). The largest
difference, ``link_error``, is a rounding whatever the mesh, as both are those of the chords between
the nodes. In the plectoneme the strands lie on each other under the angle alpha to its axis.
Tension T and moment M at the ends depend on this angle alone: with the bending stiffness EI and the
distance 2r of the strands' axes,

    T = EI/r^2 sin(alpha)^4 (1/2 + 1/cos(2 alpha))
    M = 2 EI/r sin(alpha)^3 cos(alpha)/cos(2 alpha)

(N. Clauvelin, B. Audoly, S. Neukirch, "Mechanical response of plectonemic DNA: an analytical
solution", Macromolecules, 2008). The results compare the moment with that by the tension,
``torque`` 0.01673 N m and ``torque_of_plectoneme`` 0.01674 N m, and tell the ``angle`` by the
tension, 14.4 degrees; with ``--turns 8 --approach 0.6`` 0.02291 N m, 0.02302 N m and 15.9 degrees.
The balance of the energies never rises; it falls by 2.3e-3 J of 1 J, which the scheme dissipates.
Run: ``mpirun -n 2 python cases/plectoneme.py``, then ``flexfem render results/plectoneme``.
"""

import math
import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

import flexfem as ff

Numbers = npt.NDArray[np.float64]


def directions(vectors: Numbers) -> Numbers:
    """Unit vectors (k, 3) of vectors (k, 3), zero of zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)


def writhe_of(points: Numbers) -> float:
    """Writhe, in turns, of a polyline (n, 3) whose ends go on straight along -X and X, far away.

    Twice the mean number of signed crossings over all views: each pair of segments is seen to cross
    from a part of the sphere (K. Klenin, J. Langowski, Biopolymers 54, 2000, method 1a).
    """
    far = [1e3 * float(np.ptp(points[:, 0])), 0.0, 0.0]
    whole = np.vstack([points[0] - far, points, points[-1] + far])
    one, other = np.triu_indices(len(whole) - 1, 2)
    a, b, c, d = whole[one], whole[one + 1], whole[other], whole[other + 1]
    sides = (c - a, d - a, d - b, c - b)
    normals = [
        directions(np.cross(x, y)) for x, y in zip(sides, sides[1:] + sides[:1], strict=True)
    ]
    area = sum(
        np.arcsin(np.clip(np.einsum("ij,ij->i", x, y), -1.0, 1.0))
        for x, y in zip(normals, normals[1:] + normals[:1], strict=True)
    )
    hand = np.sign(np.einsum("ij,ij->i", np.cross(d - c, b - a), c - a))
    return float(np.sum(area * hand)) / (2.0 * math.pi)


def twist_of(points: Numbers, frames: Numbers) -> float:
    """Twist, in turns, of a rod about the chords of its nodes (n, 3), whose axes are (n, 3, 3).

    What the second axes, across the chords, turn by from chord to chord beyond what is carried
    along by the least rotation; straight pieces along X are at both ends, as for the writhe. So
    twist and writhe make up the link exactly, whatever the mesh and the shear of the sections.
    """
    half = Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).as_rotvec()
    middle = frames[:-1] @ Rotation.from_rotvec(0.5 * half).as_matrix()
    chords = np.vstack([[1.0, 0.0, 0.0], directions(np.diff(points, axis=0)), [1.0, 0.0, 0.0]])
    across = np.concatenate([frames[:1], middle, frames[-1:]])[:, :, 1]
    across = across - np.einsum("ij,ij->i", across, chords)[:, np.newaxis] * chords
    axis = np.cross(chords[:-1], chords[1:])
    share = 1.0 / (1.0 + np.einsum("ij,ij->i", chords[:-1], chords[1:]))[:, np.newaxis]
    bent = np.cross(axis, across[:-1])
    carried = across[:-1] + bent + share * np.cross(axis, bent)
    sine = np.einsum("ij,ij->i", np.cross(carried, across[1:]), chords[1:])
    return float(np.arctan2(sine, np.einsum("ij,ij->i", carried, across[1:])).sum() / (2 * math.pi))


def plectoneme(tension: float, bending: float, radius: float) -> tuple[float, float]:
    """Angle (rad) and moment (N m) of a plectoneme under a tension (N), zero without tension."""
    if tension <= 0.0:
        return 0.0, 0.0
    # with c = cos(2 alpha), T = EI/r^2 (1 - c)^2 (2 + c)/(8 c)
    load = 8.0 * tension * radius**2 / bending
    roots = np.roots([1.0, 0.0, -3.0 - load, 2.0])
    c = float(np.sort(roots.real)[1])
    angle = 0.5 * math.acos(c)
    return angle, 2.0 * bending / radius * math.sin(angle) ** 3 * math.cos(angle) / c


def build(
    *, elements: int, length: float, diameter: float, youngs_modulus: float, poisson_ratio: float,
    density: float, damping: float, turns: float, turning_time: float, approach: float,
    approach_time: float, bow: float, friction: float, restitution: float, reach: float,
    gravity: float,
) -> ff.Model:  # fmt: skip
    """Model of the rod with so many elements."""
    if approach >= length:
        raise ValueError(f"approach must be below the length, {length:g} m, got {approach:g}")
    x = np.linspace(0.0, length, elements + 1)
    rise = 0.5 * bow * length * (1.0 - np.cos(2.0 * np.pi * x / length))
    points = np.column_stack([x, np.zeros_like(x), rise])
    cells = np.column_stack([np.arange(elements), np.arange(1, elements + 1)])
    rubber = ff.Material(youngs_modulus, poisson_ratio, density)
    model = ff.Model("plectoneme", mesh=ff.LineMesh(points, cells, {"rod": np.arange(elements)}))
    turned = ff.SmoothStep(0.0, turning_time, 0.0, turns)
    way = ff.SmoothStep(turning_time, turning_time + approach_time, 0.0, -approach)
    start, end, place = ff.Marker("rod", "start"), ff.Marker("rod", "end"), ff.Ground(points[-1])

    def link(t: float, *sections: ff.MarkerState) -> list[float]:
        axis = np.array([section.position for section in sections])
        frames = np.array([section.rotation for section in sections])
        return [turned(t), twist_of(axis, frames), writhe_of(axis)]

    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.Beam("rod", ff.Section.circle(diameter, rubber), orientation=(0.0, 1.0, 0.0),
                damping=damping),
        ff.Rigid("hold", ff.Ground(), start),
        ff.PrescribedTranslation("push", place, end, displacement=lambda t: (way(t), 0.0, 0.0)),
        ff.PrescribedRotation("turn", place, end,
                              rotation=lambda t: (2.0 * math.pi * turned(t), 0.0, 0.0)),
        ff.Contact("self", "rod", "rod", friction=friction, restitution=restitution,
                   reach=reach * diameter),
        ff.ContactProbe("contact", "self"),
        ff.ReactionProbe("drive", "push"),
        ff.ReactionProbe("clamp", "turn"),
        ff.Probe("link", [ff.Marker("rod", i / elements) for i in range(elements + 1)],
                 ("turned", "twist", "writhe"), link),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def results(
    history: Mapping[str, Numbers], *, diameter: float, youngs_modulus: float
) -> dict[str, float]:
    """Least gap; link; in the end tension, moment and that of a plectoneme under this tension."""
    bending = youngs_modulus * math.pi * diameter**4 / 64.0
    tension = float(history["drive_fx"][-1])
    radius = 0.5 * (diameter + float(history["contact_gap"][-1]))
    angle, torque = plectoneme(tension, bending, radius)
    moment = float(history["clamp_mx"][-1])
    error = history["twist"] + history["writhe"] - history["turned"]
    return {
        "least_gap": float(history["contact_gap"].min()),
        "twist": float(history["twist"][-1]),
        "writhe": float(history["writhe"][-1]),
        "link_error": float(np.abs(error).max()),
        "tension": tension,
        "torque": moment,
        "torque_of_plectoneme": math.copysign(torque, moment),
        "angle": math.degrees(angle),
    }


CASE = ff.Case(
    name="plectoneme",
    summary="a twisted rod whose ends approach winds up with itself (Clauvelin et al. 2008)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 150, "beam elements", minimum=2),
        ff.Option("length", float, 1.0, "of the rod", unit="m", above=0.0),
        ff.Option("diameter", float, 0.008, "of the rod", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 1e7, "of the rod", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.45, "of the rod", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 1000.0, "of the rod", unit="kg/m^3", above=0.0),
        ff.Option("damping", float, 2e-2, "stiffness-proportional", unit="s", minimum=0.0),
        ff.Option("turns", float, 6.0, "by which one end is turned"),
        ff.Option("turning_time", float, 2.0, "in which it is turned", unit="s", above=0.0),
        ff.Option("approach", float, 0.55, "of the ends", unit="m", minimum=0.0),
        ff.Option("approach_time", float, 4.0, "in which they approach", unit="s", above=0.0),
        ff.Option("bow", float, 1e-3, "of the rod without stress, in its length", minimum=0.0,
                  maximum=0.1),
        ff.Option("friction", float, 0.0, "Coulomb's coefficient", minimum=0.0),
        ff.Option("restitution", float, 1.0, "speed after over speed before impacts", minimum=0.0,
                  maximum=1.0),
        ff.Option("reach", float, 0.03, "gap below which surfaces repel each other, in diameters",
                  above=0.0),
        ff.Option("gravity", float, 0.0, "along -Z", unit="m/s^2"),
    ),
    dt=2e-3,
    t_end=7.0,
    integrator="energy_momentum",
    smoke={"elements": 24, "turns": 1.0, "turning_time": 0.2, "approach": 0.01,
           "approach_time": 0.1, "dt": 2e-3, "t_end": 1e-2},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
