# SPDX-License-Identifier: LGPL-3.0-or-later
"""Three flat half rings unfold on driven hinges.

The strips have a mean radius of 0.5 m, a width of 0.05 m and a thickness of 1 mm, E = 200e9 N/m^2,
nu = 0.3, rho = 7800 kg/m^3. They lie on one another in the plane z = 0 above the X axis; the first
is clamped at x = 0.5 m. Strip 2 hangs on strip 1 at x = -0.5 m, strip 3 on strip 2 at x = 0.5 m, by
hinges along the width. Both relative angles are driven from 0 to pi by
``pi (tau - sin(2 pi tau)/(2 pi))``, tau = t/T, T = 10 s, no gravity: the strips turn into a ring,
on which the third lies. ``--mesh`` counts nodes along and across a strip; ``--element beam`` has
geometrically exact beams instead of shells, as many elements as the mesh along a strip.

History: ``A_x, A_y, A_z``, middle of the free end, m;
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``,
J; of shells also ``shell_membrane, shell_bending, shell_shear``, the strain energy by kind, J:
bending and twist have nearly all of it.

Expected (after Das, Barut, Madenci 2010, geometry and drive are our choice): rigid strips would
bring A back to (-0.5, 0, 0). These are so slender that they lag behind: at t = 4 s A_z is 0.088 m
(beams 0.085), and when the drives stop, A is still 0.5 m above the plane and swings. Shells of both
kinds and beams agree, see ``tests/verification/TABLE.md``.
Run: ``python cases/circular_strips.py --mesh 61x5``. Figures of its results:
``flexfem plot results/circular_strips --columns A_x,A_y,A_z`` or ``shell_bending,shell_membrane``;
``flexfem render results/circular_strips --colour bending_energy
--range 0,2 --time 1.2,2.5,6.5,10``.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import flexfem as ff

X = (1.0, 0.0, 0.0)
#: ends of the strips, as angles on the ring: each begins where the one before it ends
ENDS = {"strip_1": (0.0, math.pi), "strip_2": (math.pi, 0.0), "strip_3": (0.0, math.pi)}
Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Numbers:
    """Lengths (m), material and drive of the strips: the options of these names."""

    radius: float
    width: float
    thickness: float
    youngs_modulus: float
    poisson_ratio: float
    density: float
    angle: float
    duration: float

    def __post_init__(self) -> None:
        """Raise for strips wider than their ring."""
        if self.width >= 2.0 * self.radius:
            raise ValueError(
                f"the width must be below twice the radius, {2.0 * self.radius:g} m, got "
                f"{self.width:g}"
            )

    @property
    def material(self) -> ff.Material:
        """That of the strips."""
        return ff.Material(self.youngs_modulus, self.poisson_ratio, self.density)

    def end(self, name: str, which: int) -> tuple[float, float, float]:
        """Middle of an end of a strip."""
        angle = ENDS[name][which]
        return self.radius * math.cos(angle), self.radius * math.sin(angle), 0.0


def strip(name: str, nodes: tuple[int, int], numbers: Numbers) -> ff.SurfaceMesh:
    """Half ring from its first end to its second, normals along +Z."""
    first, last = ENDS[name]

    def surface(parameters: Points) -> Points:
        way, across = parameters.T
        angle = first + way * (last - first)
        radius = numbers.radius + (across if last < first else -across)
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * way])

    along = np.linspace(0.0, 1.0, nodes[0])
    across = np.linspace(-0.5, 0.5, nodes[1]) * numbers.width
    return ff.SurfaceMesh.grid(name, along, across, surface)


def shells(nodes: tuple[int, int], element: str, numbers: Numbers) -> ff.Model:
    """Strips of shells with hinges along their ends."""
    strips = [strip(name, nodes, numbers) for name in ENDS]
    model = ff.Model("circular_strips", surface=ff.SurfaceMesh.join(strips))
    section = ff.ShellSection.isotropic(numbers.thickness, numbers.material)
    for name in ENDS:
        edges = {"strip_1_left": "clamped"} if name == "strip_1" else {}
        model.add(ff.Shell(name, section, element=element, edges=edges))
    for i in (1, 2):
        lines = (
            ff.ShellLine(f"strip_{i}", f"strip_{i}_right"),
            ff.ShellLine(f"strip_{i + 1}", f"strip_{i + 1}_left"),
        )
        model.add(ff.HingeLine(f"hinge_{i}", *lines))
    model.add(ff.ShellEnergyProbe())
    return model


def beams(elements: int, numbers: Numbers) -> ff.Model:
    """Strips of beams along the mean circle."""
    model = ff.Model("circular_strips")
    section = ff.Section.rectangle(numbers.width, numbers.thickness, numbers.material)
    for name in ENDS:
        first, last = ENDS[name]
        curve = ff.NurbsCurve.arc(
            (0.0, 0.0, 0.0), numbers.end(name, 0), (0.0, 0.0, 1.0), last - first, degree=3,
            elements=elements,
        )  # fmt: skip
        model.add(ff.Beam(name, section, curve=curve, orientation=lambda x: -x))
    start = ff.Ground(numbers.end("strip_1", 0))
    model.add(ff.Rigid("clamp", start, ff.Marker("strip_1", "start")))
    for i in (1, 2):
        a, b = ff.Marker(f"strip_{i}", "end"), ff.Marker(f"strip_{i + 1}", "start")
        model.add(ff.Revolute(f"hinge_{i}", a, b, axis=X))
    return model


def build(*, mesh: str, element: str, **values: float) -> ff.Model:
    """Model of three strips; ``values`` are those of :class:`Numbers`."""
    nodes, numbers = ff.grid_nodes(mesh), Numbers(**values)

    def marker(name: str, which: int) -> ff.Marker:
        """Middle of an end of a strip."""
        beam_end = ("start", "end")[which]
        return ff.Marker(name, beam_end if element == "beam" else numbers.end(name, which))

    if element == "beam":
        model = beams(nodes[0] - 1, numbers)
    else:
        model = shells(nodes, element, numbers)
    angle = math.radians(numbers.angle)
    drive = ff.SmoothStep(0.0, numbers.duration, 0.0, angle, profile="cycloid")
    for i in (1, 2):
        a, b = marker(f"strip_{i}", 1), marker(f"strip_{i + 1}", 0)
        model.add(ff.PrescribedAngle(f"angle_{i}", a, b, axis=X, angle=drive))
    model.add(ff.PositionProbe("A", marker("strip_3", 1)), ff.EnergyProbe())
    return model


def results(history: Mapping[str, Points]) -> dict[str, float]:
    """Last position of the end, its largest height, and the largest energy."""
    ends = {name: history[name][-1] for name in ("A_x", "A_y", "A_z")}
    return {
        **ends,
        "largest_A_z": float(np.abs(history["A_z"]).max()),
        "largest_strain_energy": float(history["energy_strain"].max()),
    }


CASE = ff.Case(
    name="circular_strips",
    summary="three half rings of shells unfold on driven hinges",
    description=__doc__,
    build=build,
    options=(
        ff.GridOption("mesh", "61x5", "nodes along and across a strip"),
        ff.Option(
            "element", str, "rotation_free", "formulation", choices=(*ff.SHELL_ELEMENTS, "beam")
        ),
        ff.Option("radius", float, 0.5, "of the middle of the strips", unit="m", above=0.0),
        ff.Option("width", float, 0.05, "of the strips", unit="m", above=0.0),
        ff.Option("thickness", float, 1e-3, "of the strips", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 200e9, "of the strips", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the strips", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 7800.0, "of the strips", unit="kg/m^3", above=0.0),
        ff.Option("angle", float, 180.0, "of both drives at their end", unit="deg"),
        ff.Option("duration", float, 10.0, "of the drives", unit="s", above=0.0),
    ),
    dt=0.01,
    t_end=10.0,
    every=10,
    smoke={"mesh": "9x3", "t_end": 0.03},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
