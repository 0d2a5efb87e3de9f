# SPDX-License-Identifier: LGPL-3.0-or-later
"""Four formalisms of analytical mechanics on finite elements in floating frames, and their costs.

Positions of material points and strain energies are written in UFL; Lagrange's, Gibbs and Appell's,
Maggi's and Hamilton's equations of motion are derived from them by automatic differentiation, for
Timoshenko beams (1D), plane stress (2D) and solids (3D), all of second degree. ``--motion planar``
is a slider-crank of two flexible links (0.3 and 0.6 m, 20 x 10 mm, aluminium), released at a crank
angle of 60 degrees with 20 rad/s; ``spatial`` a double pendulum of two links (0.3 m each) on
spherical joints. Frames are fixed to the first end of a link. Gravity 9.81 m/s^2.

The first of the chosen mechanisms is simulated by all chosen formalisms side by side; all of them
go into a table: derivative operators, expression nodes, multiplied-out terms, floating-point
operations per cell, unknowns, times per evaluation and per step. It is printed, with what it says
of the claims that Gibbs-Appell takes fewer operations than Lagrange, Maggi no multipliers and
Hamilton the most of all (Vlase, Marin, Negrean 2022), and written to ``table.csv``.

History: position of the slider (planar) or the tip (spatial), m, and energy, J, of the formalisms:
``lagrange_x, lagrange_y, lagrange_z, lagrange_energy``; ``gibbs_appell_x, gibbs_appell_y,
gibbs_appell_z, gibbs_appell_energy``; ``maggi_x, maggi_y, maggi_z, maggi_energy``; ``hamilton_x,
hamilton_y, hamilton_z, hamilton_energy``.

Expected: the four histories differ by the error of their schemes, of second order in the step, and
the energy stays, to the same error. Run: ``python cases/formalisms.py --element beam``.
"""

import math
import sys
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

import flexfem as ff

ELEMENTS, MOTIONS = ("beam", "plane", "solid"), ("planar", "spatial")
ALUMINIUM = ff.Material(youngs_modulus=7e10, poisson_ratio=0.33, density=2700.0)
WIDTH, HEIGHT = 0.02, 0.01
GRAVITY = (0.0, -9.81, 0.0)


def link_mesh(element: str, length: float, elements: int) -> Callable[[Any], Any]:
    """Function that makes the mesh of a link along the first axis."""

    def make(comm: Any) -> Any:
        from dolfinx.mesh import create_box, create_interval, create_rectangle

        if element == "beam":
            return create_interval(comm, elements, (0.0, length))
        b, h = 0.5 * WIDTH, 0.5 * HEIGHT
        if element == "plane":
            return create_rectangle(comm, [(0.0, -h), (length, h)], (elements, 1))
        return create_box(comm, [(0.0, -h, -b), (length, h, b)], (elements, 1, 1))

    return make


def link(
    name: str, element: str, motion: str, elements: int, length: float, **start: Any
) -> ff.EnergyBody:
    """A link of the given element in the given kind of frame."""
    matter = {
        "beam": ff.BeamMatter(ALUMINIUM, WIDTH, HEIGHT, spatial=motion == "spatial"),
        "plane": ff.PlaneStress(ALUMINIUM, WIDTH),
        "solid": ff.Solid(ALUMINIUM),
    }[element]
    frame = ff.PlanarFrame() if motion == "planar" else ff.SpatialFrame()
    return ff.EnergyBody(name, matter, frame, link_mesh(element, length, elements), **start)


def turned(angle: float) -> npt.NDArray[np.float64]:
    """Rotation about the third axis."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def slider_crank(element: str, elements: int) -> ff.Mechanism:
    """Crank on a hinge, rod on the crank, end of the rod on the first axis."""
    short, long, rate, first = 0.3, 0.6, 20.0, math.radians(60.0)
    second = -math.asin(short * math.sin(first) / long)
    pin = np.array([short * math.cos(first), short * math.sin(first), 0.0])
    back = -rate * pin[0] / (long * math.cos(second))
    crank = link(
        "crank", element, "planar", elements, short,
        rotation=turned(first), angular_velocity=(0.0, 0.0, rate),
    )  # fmt: skip
    rod = link(
        "rod", element, "planar", elements, long, origin=pin, rotation=turned(second),
        velocity=np.cross((0.0, 0.0, rate), pin), angular_velocity=(0.0, 0.0, back),
    )  # fmt: skip
    axes = 3 if element == "solid" else 2
    normal = (0.0, 1.0, 0.0)[:axes]
    slider = ff.End("rod", (long, 0.0, 0.0))
    pins = (ff.End("crank", (short, 0.0, 0.0)), ff.End("rod"))
    if element == "solid":  # positions of nodes have three components
        pins = (pins[0], ff.End("rod", (0.0, 0.0, 0.0)))
    return ff.Mechanism(
        f"slider_crank_{element}",
        (crank, rod),
        (
            ff.Constraint("hinge", (ff.End("crank"),), ff.end_position, (0.0, 0.0, 0.0)),
            ff.Constraint("pin", pins, ff.coincidence),
            ff.Constraint("slide", (slider,), ff.on_line, (0.0,) * axes + normal),
        ),
        gravity=GRAVITY,
        observed=slider,
    )


def double_pendulum(element: str, elements: int) -> ff.Mechanism:
    """Two links on spherical joints, with an initial rotation."""
    length, spin = 0.3, np.array([0.0, 4.0, 6.0])
    pin = np.array([length, 0.0, 0.0])
    upper = link("upper", element, "spatial", elements, length, angular_velocity=spin)
    lower = link(
        "lower", element, "spatial", elements, length, origin=pin, rotation=turned(-0.5),
        velocity=np.cross(spin, pin), angular_velocity=(0.0, -4.0, 2.0),
    )  # fmt: skip
    pins = (ff.End("upper", (length, 0.0, 0.0)), ff.End("lower"))
    return ff.Mechanism(
        f"double_pendulum_{element}",
        (upper, lower),
        (
            ff.Constraint("suspension", (ff.End("upper"),), ff.end_position, (0.0, 0.0, 0.0)),
            ff.Constraint("ball", pins, ff.coincidence),
        ),
        gravity=GRAVITY,
        observed=ff.End("lower", (length, 0.0, 0.0)),
    )


def build(*, formalism: str, element: str, motion: str, elements: int) -> ff.FormalismStudy:
    """The mechanisms of the chosen elements and motions."""
    pairs = product(
        ELEMENTS if element == "all" else (element,), MOTIONS if motion == "all" else (motion,)
    )
    makers = {"planar": slider_crank, "spatial": double_pendulum}
    return ff.FormalismStudy(
        {(kind, moves): makers[moves](kind, elements) for kind, moves in pairs},
        labels=("element", "motion"),
        formalisms=ff.FORMALISMS if formalism == "all" else (formalism,),
    )


def results(history: Mapping[str, npt.NDArray[np.float64]]) -> dict[str, float]:
    """Last place, largest change of energy, and the largest distance between the formalisms."""
    names = [name.removesuffix("_energy") for name in history if name.endswith("_energy")]
    paths = [np.array([history[f"{name}_{axis}"] for axis in "xyz"]) for name in names]
    values = {f"{axis}_end": float(paths[0][k, -1]) for k, axis in enumerate("xyz")}
    for name in names:
        energy = history[f"{name}_energy"]
        values[f"{name}_energy_change"] = float(np.abs(energy - energy[0]).max())
    apart = [np.linalg.norm(path - paths[0], axis=0).max() for path in paths]
    return values | {"largest_distance": float(max(apart))}


CASE = ff.Case(
    name="formalisms",
    summary="equations of motion by Lagrange, Gibbs-Appell, Maggi and Hamilton, and their costs",
    description=__doc__,
    build=build,
    options=(
        ff.Option(
            "formalism", str, "all", "which sets up the equations",
            choices=("all", *ff.FORMALISMS),
        ),
        ff.Option(
            "element", str, "all", "finite elements of the links", choices=("all", *ELEMENTS)
        ),
        ff.Option("motion", str, "all", "kind of motion", choices=("all", *MOTIONS)),
        ff.Option("elements", int, 4, "elements along each link", minimum=1),
    ),
    dt=5e-4,
    t_end=0.2,
    rho_inf=1.0,
    tolerance=1e-10,
    smoke={"element": "beam", "motion": "planar", "elements": 2, "t_end": 2e-3},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
