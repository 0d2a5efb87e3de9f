# SPDX-License-Identifier: LGPL-3.0-or-later
"""Deployment of a solar array blanket: panels folded in zigzag, pulled up along guide wires.

Panels of 0.45 x 2.4 m, 0.8 mm thick, E = 8e9 N/m^2, nu = 0.3, rho = 2314.8 kg/m^3 and a damping of
1e-3 s times their stiffness (``--damping``) are hinged to one another along their long sides, which
run along X. Folded they lie on one another with a pitch of 10 mm along Z (``--pitch``). The bottom
side of panel 1 is held by the container. The top side of the last one hangs on a rigid beam of
1 kg, and this on a tensioning spring (200 N/m and 5 N s/m) whose other end the mast lifts along Z:
the speed rises within 2 s to 0.1 m/s by a fifth-order polynomial, stays, and falls the same way, so
that the flat blanket has the tension ``--tension`` at the end, and is held there. An odd number of
panels ends on the other side, and leans. No gravity.

Two guide wires of steel (2 mm, E = 210e9 N/m^2, nu = 0.25, rho = 7850 kg/m^3) stand at y = 0, 0.3 m
from the sides of the panels, clamped 0.2 m below the container and pulled up by 10 N
(``--wire-tension``) 0.2 m above the deployed blanket. The hinges that lie at y = 0 in the folded
blanket, every second one, slide along both wires through grommets; the others lie 0.45 m away and
have none.

The folded panels touch: contact of all of them with one another and with the floor of the
container, a pitch below them (``--no-contact`` leaves it out), with the automatic stiffness unless
``--stiffness`` gives one. ``--mesh`` counts nodes of a panel along its short and long side.

History: ``lift`` of the beam, m; ``mast_force_fx, mast_force_fy, mast_force_fz, mast_force_mx,
mast_force_my, mast_force_mz``, what the drive does to the spring, N and N m: the tension;
``panel_1_vz, panel_2_vz, ...``, velocities of the middles of the panels along Z, m/s;
``grommet_2_y, grommet_4_y, ...``, displacements of the hinges on the first wire along Y, m;
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``,
J; ``contact_penetration``, m, ``contact_fx, contact_fy, contact_fz``, ``contact_normal``, N.

Expected (Shi, Liu, Hong, Acta Mech. Sinica 34 (2018); pitch, ramps, spring, damping and contact are
our choice): velocities jump while the folded panels touch, then panels are drawn out one after the
other, the top ones first; the drive is at 0.1 m/s from 2 s on; tension comes at the end, and the
more of it, the faster the blanket oscillates: 4 panels of 5x13 nodes sway with 0.52, 0.78 and
1.30 Hz under 5, 20 and 80 N (a string of their mass and that of the wires, under both tensions:
0.66, 0.83, 1.31 Hz).
Run: ``mpirun -n 2 python cases/solar_array.py --panels 4 --t-end 30``.
"""

import math
import sys
from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt

import flexfem as ff

SHORT, LONG, THICKNESS = 0.45, 2.4, 0.8e-3
PANEL = ff.Material(8e9, 0.3, 2314.8)
WIRE, DIAMETER, INSET, BEYOND = ff.Material(210e9, 0.25, 7850.0), 2e-3, 0.3, 0.2
SPEED, RAMP = 0.1, 2.0
SPRING, DAMPER = 200.0, 5.0
Z = (0.0, 0.0, 1.0)
SIDES = {"left": INSET, "right": LONG - INSET}
Points = npt.NDArray[np.float64]


def blanket(panels: int, nodes: tuple[int, int], pitch: float) -> ff.SurfaceMesh:
    """Folded panels, bottom and top of each along X."""
    along, depth = _along(nodes[1]), math.sqrt(SHORT**2 - pitch**2)

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


def _along(nodes: int) -> Points:
    """Places of nodes along a long side: evenly spaced between the ends and the guide wires."""
    outer = max(round(INSET / LONG * (nodes - 1)), 1)
    if nodes <= 2 * outer + 1:
        raise ValueError(f"mesh: too few nodes along the long side for both wires: {nodes}")
    ends = [0, outer, nodes - 1 - outer, nodes - 1]
    return np.interp(np.arange(nodes), ends, [0.0, INSET, LONG - INSET, LONG])


class Lift:
    """Way of the mast (m) over time (s): each ramp covers the way of half its time.

    Attributes:
        way: in all, m.
        end: when it is covered, s.
    """

    def __init__(self, way: float) -> None:
        """Plan the way."""
        self.way, self.end = way, way / SPEED + RAMP

    def __call__(self, t: float) -> float:
        """Way at time t."""
        if t > self.end - RAMP:
            return self.way - self(self.end - min(t, self.end))
        tau = min(t / RAMP, 1.0)
        return SPEED * (RAMP * tau**4 * (2.5 - 3.0 * tau + tau**2) + max(t - RAMP, 0.0))


def add_wires(model: ff.Model, panels: int, pitch: float, elements: int, tension: float) -> None:
    """Guide wires with the grommets that slide on them."""
    section, top = ff.Section.circle(DIAMETER, WIRE), panels * SHORT + BEYOND
    pull = ff.SmoothStep(0.0, RAMP)
    for side, x in SIDES.items():
        wire, ends = f"wire_{side}", ((x, 0.0, -BEYOND), (x, 0.0, top))
        curve = ff.NurbsCurve.line(*ends, elements=elements)
        start, end = ff.Marker(wire, "start"), ff.Marker(wire, "end")
        model.add(
            ff.Beam(wire, section, curve=curve, orientation=(1.0, 0.0, 0.0)),
            ff.Rigid(f"{wire}_clamp", ff.Ground(ends[0]), start),
            ff.PointOnLine(f"{wire}_guide", ff.Ground(ends[1]), end, axis=Z),
            ff.PointForce(f"{wire}_tension", end, (0.0, 0.0, tension), amplitude=pull),
        )
        for i in range(2, panels, 2):
            grommet = ff.Marker(f"panel_{i}", (x, 0.0, i * pitch))
            model.add(ff.Sliding(f"grommet_{i}_{side}", ff.Carrier(wire), grommet))


def build(
    *, panels: int, mesh: str, element: str, pitch: float, tension: float, wire_elements: int,
    wire_tension: float, damping: float, contact: bool, stiffness: float,
) -> ff.Model:  # fmt: skip
    """Model of a folded blanket."""
    if pitch >= 0.5 * SHORT:
        raise ValueError(f"the pitch must be below {0.5 * SHORT} m, half a panel, got {pitch:g}")
    surface = blanket(panels, ff.grid_nodes(mesh), pitch)
    section = ff.ShellSection.isotropic(THICKNESS, PANEL)
    names = [f"panel_{i + 1}" for i in range(panels)]
    model = ff.Model("solar_array", surface=surface)
    for name in names:
        edges = {"panel_1_bottom": "hinged"} if name == "panel_1" else {}
        model.add(ff.Shell(name, section, element=element, edges=edges, damping=damping))
    for i, (lower, upper) in enumerate(pairwise(names)):
        line = ff.ShellLine(lower, f"{lower}_top"), ff.ShellLine(upper, f"{upper}_bottom")
        model.add(ff.HingeLine(f"hinge_{i + 1}", *line))
    last = f"{names[-1]}_top"
    y = surface.points[surface.lines[last][0, 0], 1]
    top = ff.Ground((0.5 * LONG, y, panels * pitch))
    # an odd number of panels ends on the other side: the flat blanket leans
    flat = math.sqrt((panels * SHORT) ** 2 - y**2)
    lift = Lift(flat - panels * pitch + tension / SPRING)
    shape = ff.Cylinder(0.01, LONG)
    for name, mass in (("beam", 1.0), ("mast", 0.1)):
        model.add(
            ff.RigidBody(name, mass, (mass, 0.01 * mass, mass), position=top.position, shape=shape),
            ff.Prismatic(f"{name}_guide", top, ff.Marker(name), axis=Z),
        )
    model.add(
        ff.HingeLine("hanger", ff.ShellLine(names[-1], last), ff.Marker("beam")),
        ff.PrescribedTranslation("drive", top, ff.Marker("mast"), axis=Z, displacement=lift),
        ff.Bushing("spring", ff.Marker("mast"), ff.Marker("beam"), (0, 0, SPRING, 0, 0, 0),
                   (0, 0, DAMPER, 0, 0, 0)),
    )  # fmt: skip
    add_wires(model, panels, pitch, wire_elements, wire_tension)
    if contact:
        floor = ff.RigidPlane(ff.Ground((0.0, 0.0, -pitch)))
        model.add(
            ff.Contact("panels", names, names, floor, stiffness=stiffness or None),
            ff.ContactProbe("contact", "panels"),
        )
    model.add(
        ff.Probe(
            "lift", ff.Marker("beam"), ("lift",), lambda t, s: s.position[2:] - panels * pitch
        ),
        ff.ReactionProbe("mast_force", "drive"),
        *_probes(surface, names, pitch),
        ff.EnergyProbe(),
    )
    return model


def _probes(surface: ff.SurfaceMesh, names: list[str], pitch: float) -> list[ff.Probe]:
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
        grommet = ff.Marker(f"panel_{i}", (INSET, 0.0, i * pitch))
        column = f"grommet_{i}_y"
        probes.append(ff.Probe(column, grommet, (column,), lambda t, s: s.position[1:2]))
    return probes


def results(history: Mapping[str, Points]) -> dict[str, float]:
    """How far the blanket is deployed, and what it took."""
    found = {
        "lift": history["lift"][-1],
        "tension": history["mast_force_fz"][-1],
        "largest_strain_energy": history["energy_strain"].max(),
        "sway_frequency": _sway(history),
    }
    if "contact_penetration" in history:
        found["largest_penetration"] = history["contact_penetration"].max()
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
        ff.Option("panels", int, 20, "number of panels", minimum=2),
        ff.GridOption("mesh", "11x41", "nodes of a panel along its short and long side"),
        ff.Option(
            "element", str, "rotation_free", "formulation of the panels", choices=ff.SHELL_ELEMENTS
        ),
        ff.Option("pitch", float, 0.01, "distance of folded panels", unit="m", above=0.0),
        ff.Option("tension", float, 20.0, "of the deployed blanket", unit="N", minimum=0.0),
        ff.Option("wire_elements", int, 40, "elements of a guide wire", minimum=1),
        ff.Option("wire_tension", float, 10.0, "force at its top", unit="N", minimum=0.0),
        ff.Option(
            "damping", float, 1e-3, "of the panels, times their stiffness", unit="s", minimum=0.0
        ),
        ff.Option("contact", bool, True, "contact of the panels"),
        ff.Option("stiffness", float, 0.0, "of contact, 0: automatic", unit="N/m^3", minimum=0.0),
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
