# SPDX-License-Identifier: LGPL-3.0-or-later
"""Deployment of a solar array blanket: panels folded in zigzag, pulled up along guide wires.

Panels of 0.45 x 2.4 m, 0.8 mm thick, E = 8e9 N/m^2, nu = 0.3, rho = 2314.8 kg/m^3 and a damping of
1e-3 s times their stiffness (``--panel-damping``) are joined to one another along their long sides,
which run along X: by hinges, or with ``--hinges clamped`` as if they were folded of one sheet,
whose folds then spring back to the angles that they have in the pile. Folded they lie on one
another with a pitch of 10 mm along Z (``--pitch``). The bottom side of panel 1 is hinged to the
container. The top side of the last one hangs on a rigid beam of 1 kg, and this on a tensioning
spring (200 N/m and 5 N s/m) whose other end, of 0.1 kg, the mast lifts along Z: the speed rises
within 2 s (``--ramp``) to 0.1 m/s (``--speed``) by a fifth-order polynomial, stays, and falls the
same way, so that the flat blanket has the tension ``--tension`` at the end, and is fixed there. An
odd number of panels ends on the other side, and leans. No gravity.

Two guide wires of steel (2 mm, E = 210e9 N/m^2, nu = 0.25, rho = 7850 kg/m^3) stand at y = 0, 0.3 m
from the sides of the panels, clamped 0.2 m below the container and pulled up by 10 N
(``--wire-tension``) 0.2 m above the deployed blanket. The hinges that lie at y = 0 in the folded
blanket, every second one, slide along both wires through grommets; the others lie 0.45 m away and
have none.

Contact of all panels with one another and with the floor of the container, a pitch below them
(``--no-contact`` leaves it out), has the automatic stiffness unless ``--contact-stiffness`` gives
one. Neighbours are closer than their thickness beside a fold; there, and wherever they are closer
than twice that, they touch once half of their distance at the start is left.
``--mesh`` counts nodes of a panel along its short and long side.

History: ``lift`` of the beam, m;
``mast_force_fx, mast_force_fy, mast_force_fz, mast_force_mx, mast_force_my, mast_force_mz``, the
wrench of the drive on the spring, N and N m: the tension; ``panel_1_vz, panel_2_vz, ...``,
velocities of the centres of the panels along Z, m/s; ``grommet_2_y, grommet_4_y, ...``,
displacements of the hinges on the first wire along Y, m;
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``,
J; ``panels_membrane, panels_bending, panels_shear``, the strain energy of the panels by kind, J;
``contact_gap, contact_penetration``, m, ``contact_fx, contact_fy, contact_fz``,
``contact_normal``, N, and
``contact_closed``, the number of points that touch.

Results count the contacts: points that touch ``contacts_at_start`` and ``most_contacts`` at a time,
the time ``first_contact`` (s) and the number of steps with any, ``contact_steps``.

Expected (Shi, Liu, Hong, Acta Mech. Sinica 34 (2018); pitch, ramps, spring, damping and contact are
our choice): velocities jump while the folded panels touch, then panels are drawn out one after the
other, the top ones first; the drive is at 0.1 m/s from 2 s on; tension comes at the end, and the
more of it, the faster the blanket oscillates: 4 panels of 5x13 nodes sway with 0.52, 0.78 and
1.30 Hz under 5, 20 and 80 N (a string of their mass and that of the wires, under both tensions:
0.66, 0.83, 1.31 Hz). Of these 4 panels the first touch at 1.47 s, 65 points at most. Hinges or
clamps make two systems: at 6 s free ones have stored 0.0004 J and the mast feels 0.02 N; the paper
clamps its hinge lines, and then it is 1.21 J, of which 0.53 J in the panels and the rest in the
folds, and 6.4 N.
Run: ``mpirun -n 2 python cases/solar_array.py --panels 4 --t-end 30``. Figures of its results:
``flexfem plot results/solar_array --columns panel_1_vz,panel_2_vz,panel_3_vz,panel_4_vz`` or
``grommet_2_y``, or ``panels_bending,panels_membrane``, or ``contact_closed``; pictures:
``flexfem render results/solar_array --colour bending_energy --range 0,0.01
--time 0,6,12,18,24,30``.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

import flexfem as ff

Z = (0.0, 0.0, 1.0)
HINGES = {"free": ff.HingeLine, "clamped": ff.ClampedLine}
Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Numbers:
    """Lengths (m), materials and forces of panels, wires and mast: the options of these names."""

    width: float
    length: float
    thickness: float
    youngs_modulus: float
    poisson_ratio: float
    density: float
    panel_damping: float
    pitch: float
    tension: float
    speed: float
    ramp: float
    spring: float
    damper: float
    beam_mass: float
    mast_mass: float
    wire_overhang: float
    wire_tension: float
    wire_inset: float
    wire_diameter: float
    wire_modulus: float
    wire_poisson_ratio: float
    wire_density: float

    def __post_init__(self) -> None:
        """Raise for inconsistent lengths."""
        if self.pitch >= 0.5 * self.width:
            raise ValueError(
                f"the pitch must be below {0.5 * self.width:g} m, half a panel, got {self.pitch:g}"
            )
        if self.wire_inset >= 0.5 * self.length:
            raise ValueError(
                f"wire-inset must be below {0.5 * self.length:g} m, half the length of a panel, "
                f"got {self.wire_inset:g}"
            )

    @property
    def wires(self) -> dict[str, float]:
        """Positions of the wires along X."""
        return {"left": self.wire_inset, "right": self.length - self.wire_inset}


def blanket(panels: int, nodes: tuple[int, int], numbers: Numbers) -> ff.SurfaceMesh:
    """Folded panels, bottom and top of each along X."""
    pitch = numbers.pitch
    along, depth = _along(nodes[1], numbers), math.sqrt(numbers.width**2 - pitch**2)

    def folded(parameters: Points) -> Points:
        x, way = parameters.T
        turn = np.abs((way + 1.0) % 2.0 - 1.0)
        return np.column_stack([x, depth * turn, pitch * way])

    return ff.SurfaceMesh.join(
        [
            ff.SurfaceMesh.grid(f"panel_{i + 1}", along, i + np.linspace(0, 1, nodes[0]), folded)
            for i in range(panels)
        ]
    )


def _along(nodes: int, numbers: Numbers) -> Points:
    """Places of nodes along a long side: evenly spaced between the ends and the guide wires."""
    inset, length = numbers.wire_inset, numbers.length
    outer = max(round(inset / length * (nodes - 1)), 1)
    if nodes <= 2 * outer + 1:
        raise ValueError(f"mesh: too few nodes along the long side for both wires: {nodes}")
    ends = [0, outer, nodes - 1 - outer, nodes - 1]
    return np.interp(np.arange(nodes), ends, [0.0, inset, length - inset, length])


class Lift:
    """Displacement of the mast (m) over time (s), with a ramp of speed at either end.

    Attributes:
        way: whole displacement, m.
        speed: between the ramps, m/s.
        ramp: duration of each, s; the displacement is at least that of both.
        end: time of the whole displacement, s.
    """

    def __init__(self, way: float, speed: float, ramp: float) -> None:
        """Plan the displacement.

        Raises:
            ValueError: The ramps alone lead beyond it.
        """
        if way < speed * ramp:
            raise ValueError(
                f"the way of the mast, {way:g} m, must be at least that of both ramps, "
                f"{speed * ramp:g} m: take a smaller ramp or speed"
            )
        self.way, self.speed, self.ramp = way, speed, ramp
        self.end = way / speed + ramp

    def __call__(self, t: float) -> float:
        """Displacement at time t."""
        if t > self.end - self.ramp:
            return self.way - self(self.end - min(t, self.end))
        tau = min(t / self.ramp, 1.0)
        begun = self.ramp * tau**4 * (2.5 - 3.0 * tau + tau**2)
        return self.speed * (begun + max(t - self.ramp, 0.0))


def add_wires(model: ff.Model, panels: int, elements: int, numbers: Numbers) -> None:
    """Guide wires with the grommets that slide on them."""
    material = ff.Material(numbers.wire_modulus, numbers.wire_poisson_ratio, numbers.wire_density)
    section = ff.Section.circle(numbers.wire_diameter, material)
    beyond = numbers.wire_overhang
    top, pull = panels * numbers.width + beyond, ff.SmoothStep(0.0, numbers.ramp)
    for side, x in numbers.wires.items():
        wire, ends = f"wire_{side}", ((x, 0.0, -beyond), (x, 0.0, top))
        curve = ff.NurbsCurve.line(*ends, elements=elements)
        start, end = ff.Marker(wire, "start"), ff.Marker(wire, "end")
        force = (0.0, 0.0, numbers.wire_tension)
        model.add(
            ff.Beam(wire, section, curve=curve, orientation=(1.0, 0.0, 0.0)),
            ff.Rigid(f"{wire}_clamp", ff.Ground(ends[0]), start),
            ff.PointOnLine(f"{wire}_guide", ff.Ground(ends[1]), end, axis=Z),
            ff.PointForce(f"{wire}_tension", end, force, amplitude=pull),
        )
        for i in range(2, panels, 2):
            grommet = ff.Marker(f"panel_{i}", (x, 0.0, i * numbers.pitch))
            model.add(ff.Sliding(f"grommet_{i}_{side}", ff.Carrier(wire), grommet))


def add_mast(model: ff.Model, panels: int, numbers: Numbers) -> None:
    """Beam on the last panel, spring and drive."""
    surface, last = model.surface, f"panel_{panels}_top"
    assert surface is not None
    y = surface.points[surface.lines[last][0, 0], 1]
    top = ff.Ground((0.5 * numbers.length, y, panels * numbers.pitch))
    # an odd number of panels ends on the other side: the flat blanket leans
    flat = math.sqrt((panels * numbers.width) ** 2 - y**2)
    way = flat - panels * numbers.pitch + numbers.tension / numbers.spring
    lift = Lift(way, numbers.speed, numbers.ramp)
    shape = ff.Cylinder(0.01, numbers.length)
    for name, mass in (("beam", numbers.beam_mass), ("mast", numbers.mast_mass)):
        model.add(
            ff.RigidBody(name, mass, (mass, 0.01 * mass, mass), position=top.position, shape=shape),
            ff.Prismatic(f"{name}_guide", top, ff.Marker(name), axis=Z),
        )
    stiffness, damping = (0, 0, numbers.spring, 0, 0, 0), (0, 0, numbers.damper, 0, 0, 0)
    beam, mast = ff.Marker("beam"), ff.Marker("mast")
    model.add(
        ff.HingeLine("hanger", ff.ShellLine(f"panel_{panels}", last), beam),
        ff.PrescribedTranslation("drive", top, mast, axis=Z, displacement=lift),
        ff.Bushing("spring", mast, beam, stiffness, damping),
    )


def build(
    *, panels: int, mesh: str, element: str, hinges: str, wire_elements: int, contact: bool,
    contact_stiffness: float, **values: float,
) -> ff.Model:  # fmt: skip
    """Model of a folded blanket; ``values`` are those of :class:`Numbers`."""
    numbers = Numbers(**values)
    pitch = numbers.pitch
    surface = blanket(panels, ff.grid_nodes(mesh), numbers)
    material = ff.Material(numbers.youngs_modulus, numbers.poisson_ratio, numbers.density)
    section = ff.ShellSection.isotropic(numbers.thickness, material)
    names = [f"panel_{i + 1}" for i in range(panels)]
    model = ff.Model("solar_array", surface=surface)
    for name in names:
        edges = {"panel_1_bottom": "hinged"} if name == "panel_1" else {}
        model.add(
            ff.Shell(name, section, element=element, edges=edges, damping=numbers.panel_damping)
        )
    for i, (lower, upper) in enumerate(pairwise(names)):
        line = ff.ShellLine(lower, f"{lower}_top"), ff.ShellLine(upper, f"{upper}_bottom")
        model.add(HINGES[hinges](f"hinge_{i + 1}", *line))
    add_mast(model, panels, numbers)
    add_wires(model, panels, wire_elements, numbers)
    if contact:
        floor = ff.RigidPlane(ff.Ground((0.0, 0.0, -pitch)))
        model.add(
            ff.Contact("blanket", names, names, floor, stiffness=contact_stiffness or None),
            ff.ContactProbe("contact", "blanket"),
        )
    model.add(
        ff.Probe(
            "lift", ff.Marker("beam"), ("lift",), lambda t, s: s.position[2:] - panels * pitch
        ),
        ff.ReactionProbe("mast_force", "drive"),
        *_probes(surface, names, numbers),
        ff.EnergyProbe(),
        ff.ShellEnergyProbe("panels"),
    )
    return model


def _probes(surface: ff.SurfaceMesh, names: list[str], numbers: Numbers) -> list[ff.Probe]:
    """Velocities of the panels, displacements of the grommets."""
    probes = []
    for name in names:
        middle = surface.points[surface.body_nodes(name)].mean(axis=0)
        probes.append(
            ff.Probe(
                name + "_v", ff.Marker(name, middle), (f"{name}_vz",), lambda t, s: s.velocity[2:]
            )
        )
    for i in range(2, len(names), 2):
        grommet = ff.Marker(f"panel_{i}", (numbers.wire_inset, 0.0, i * numbers.pitch))
        column = f"grommet_{i}_y"
        probes.append(ff.Probe(column, grommet, (column,), lambda t, s: s.position[1:2]))
    return probes


def results(history: Mapping[str, Points]) -> dict[str, float]:
    """Lift, tension, energies and sway at the end, and counts of contacts."""
    found = {
        "lift": history["lift"][-1],
        "tension": history["mast_force_fz"][-1],
        "largest_strain_energy": history["energy_strain"].max(),
        "final_strain_energy": history["energy_strain"][-1],
        "largest_bending_energy": history["panels_bending"].max(),
        "sway_frequency": _sway(history),
    }
    if "contact_closed" in history:
        closed = history["contact_closed"]
        touching = np.flatnonzero(closed)
        found["largest_penetration"] = history["contact_penetration"].max()
        found["contacts_at_start"], found["most_contacts"] = closed[0], closed.max()
        found["contact_steps"] = len(touching)
        if len(touching):
            found["first_contact"] = history["t"][touching[0]]
    return {name: float(value) for name, value in found.items()}


def _sway(history: Mapping[str, Points]) -> float:
    """Frequency (Hz) of the middle grommet in the second half of the time after the lift, or 0."""
    grommets = [name for name in history if name.startswith("grommet_")]
    lifted = np.flatnonzero(history["lift"] < 0.99 * history["lift"].max())
    first = (len(history["t"]) + (lifted[-1] if len(lifted) else 0)) // 2
    if not grommets or len(history["t"]) - first < 100:
        return 0.0
    t, y = history["t"][first:], history[grommets[len(grommets) // 2]][first:]
    crossings = np.count_nonzero(np.diff(np.sign(y - y.mean())))
    return crossings / (2.0 * (t[-1] - t[0]))


CASE = ff.Case(
    name="solar_array",
    summary="deployment of a folded solar array blanket along guide wires",
    description=__doc__,
    build=build,
    options=(
        ff.Option("panels", int, 20, "number of panels", minimum=2, maximum=1000),
        ff.GridOption("mesh", "11x41", "nodes of a panel along its short and long side"),
        ff.Option(
            "element", str, "rotation_free", "formulation of the panels", choices=ff.SHELL_ELEMENTS
        ),
        ff.Option("hinges", str, "free", "between panels", choices=tuple(HINGES)),
        ff.Option("width", float, 0.45, "short side of a panel", unit="m", above=0.0),
        ff.Option("length", float, 2.4, "long side of a panel", unit="m", above=0.0),
        ff.Option("thickness", float, 0.8e-3, "of a panel", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 8e9, "of the panels", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the panels", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 2314.8, "of the panels", unit="kg/m^3", above=0.0),
        ff.Option(
            "panel_damping", float, 1e-3, "times the stiffness of the panels", unit="s", minimum=0.0
        ),
        ff.Option("pitch", float, 0.01, "distance of folded panels", unit="m", above=0.0),
        ff.Option("tension", float, 20.0, "of the deployed blanket", unit="N", minimum=0.0),
        ff.Option("speed", float, 0.1, "of the mast between its ramps", unit="m/s", above=0.0),
        ff.Option("ramp", float, 2.0, "in which the speed rises, and falls", unit="s", above=0.0),
        ff.Option("spring", float, 200.0, "that tensions", unit="N/m", above=0.0),
        ff.Option("damper", float, 5.0, "beside the spring", unit="N s/m", minimum=0.0),
        ff.Option("beam_mass", float, 1.0, "of the beam on top", unit="kg", above=0.0),
        ff.Option("mast_mass", float, 0.1, "of what the drive moves", unit="kg", above=0.0),
        ff.Option("wire_elements", int, 40, "elements of a guide wire", minimum=1),
        ff.Option("wire_tension", float, 10.0, "force at its top", unit="N", minimum=0.0),
        ff.Option("wire_overhang", float, 0.2, "beyond the blanket", unit="m", above=0.0),
        ff.Option("wire_inset", float, 0.3, "from the short sides", unit="m", above=0.0),
        ff.Option("wire_diameter", float, 2e-3, "of a guide wire", unit="m", above=0.0),
        ff.Option("wire_modulus", float, 210e9, "Young's, of the wires", unit="Pa", above=0.0),
        ff.Option("wire_poisson_ratio", float, 0.25, "of the wires", minimum=0.0, maximum=0.5),
        ff.Option("wire_density", float, 7850.0, "of the wires", unit="kg/m^3", above=0.0),
        ff.Option("contact", bool, True, "contact of the panels"),
        ff.Option("contact_stiffness", float, 0.0, "0: automatic", unit="N/m^3", minimum=0.0),
    ),
    dt=0.01,
    t_end=95.0,
    every=50,
    rho_inf=0.5,
    smoke={"panels": 2, "mesh": "3x9", "wire_elements": 4, "t_end": 0.02},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
