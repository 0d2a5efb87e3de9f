# SPDX-License-Identifier: LGPL-3.0-or-later
"""Four formalisms of analytical mechanics on finite elements in floating frames, and their costs.

Positions of material points and strain energies are written in UFL; Lagrange's, Gibbs and Appell's,
Maggi's and Hamilton's equations of motion are derived from them by automatic differentiation, for
Timoshenko beams (1D), plane stress (2D) and solids (3D), all of second degree. ``--motion planar``
is a slider-crank of two flexible links, released at ``--crank-angle`` with ``--crank-speed``;
``spatial`` a double pendulum of two links on spherical joints, thrown with the given angular
velocities. Frames are fixed to the first end of a link. ``--prescribed`` prescribes the motion of
the first link's frame: it keeps rotating as at the start, and does work.

The first of the chosen mechanisms is simulated by all chosen formalisms side by side; all of them
go into a table: derivative operators, expression nodes, multiplied-out terms, floating-point
operations per cell, unknowns, times per evaluation and per step. It is printed, with its findings
on the claims that Gibbs-Appell takes fewer operations than Lagrange, Maggi no multipliers and
Hamilton the most of all (Vlase, Marin, Negrean 2022), and written to ``table.csv``; the energy of
accelerations beside the kinetic energy goes to ``energies.csv``. Times are the least of repeats in
which the alternatives take turns, and called different only where the quartiles of their ratios
are.

``--matrices`` writes and prints, instead of a motion, the matrices m, c, k, k(eps), k(omega) and
the vectors q_i(eps), q_i(omega), m_Oi of the first element of the first link of each kind, for the
frame's angular velocity ``--omega-x``, ``-y``, ``-z`` and acceleration ``--epsilon-x``, ``-y``,
``-z`` in its own axes: ``matrices.csv`` has one entry a line, with the nodes' places and the
components of the displacements. Options of the steps and of the motion have no meaning then.

History: position of the slider (planar) or the tip (spatial), m, and energy, J, of the formalisms:
``lagrange_x, lagrange_y, lagrange_z, lagrange_energy``; ``gibbs_appell_x, gibbs_appell_y,
gibbs_appell_z, gibbs_appell_energy``; ``maggi_x, maggi_y, maggi_z, maggi_energy``; ``hamilton_x,
hamilton_y, hamilton_z, hamilton_energy``.

Expected: the four histories differ by the error of their schemes, of second order in the step, and
the energy stays, to the same error. Run: ``python cases/formalisms.py --element beam``, or
``python cases/formalisms.py --matrices --element beam``.
"""

import math
import sys
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

import flexfem as ff
from flexfem import research

ELEMENTS, MOTIONS = ("beam", "plane", "solid"), ("planar", "spatial")
Numbers = Mapping[str, Any]


def link_mesh(element: str, length: float, n: Numbers) -> Callable[[Any], Any]:
    """Function that makes the mesh of a link along the first axis."""

    def make(comm: Any) -> Any:
        from dolfinx.mesh import create_box, create_interval, create_rectangle

        elements = n["elements"]
        if element == "beam":
            return create_interval(comm, elements, (0.0, length))
        b, h = 0.5 * n["width"], 0.5 * n["height"]
        if element == "plane":
            return create_rectangle(comm, [(0.0, -h), (length, h)], (elements, 1))
        return create_box(comm, [(0.0, -h, -b), (length, h, b)], (elements, 1, 1))

    return make


def link(
    name: str, element: str, kind: str, length: float, n: Numbers, **start: Any
) -> research.EnergyBody:
    """A link of the given element in the given kind of frame."""
    material = ff.Material(
        youngs_modulus=n["youngs_modulus"], poisson_ratio=n["poisson_ratio"], density=n["density"]
    )
    width, more = n["width"], {"damping": n["damping"]}
    matter = {
        "beam": lambda: research.BeamMatter(
            material, width, n["height"], spatial=kind == "spatial", **more
        ),
        "plane": lambda: research.PlaneStress(material, width, **more),
        "solid": lambda: research.Solid(material, **more),
    }[element]()
    frame = research.PlanarFrame() if kind == "planar" else research.SpatialFrame()
    return research.EnergyBody(name, matter, frame, link_mesh(element, length, n), **start)


def first_motion(n: Numbers, spin: npt.NDArray[np.float64]) -> dict[str, Any]:
    """Initial rotation of the first link's frame, which continues if it is prescribed."""
    if not n["prescribed"]:
        return {"angular_velocity": spin}
    speed = float(np.linalg.norm(spin))
    axis = spin / speed if speed > 0.0 else (0.0, 0.0, 1.0)
    return {"motion": research.FrameMotion(rotations=[(axis, lambda t: (speed * t, speed, 0.0))])}


def on_ground(n: Numbers, name: str, body: str) -> tuple[research.Constraint, ...]:
    """The joint of the first link, which a prescribed motion of its frame makes superfluous."""
    if n["prescribed"]:
        return ()
    return (
        research.Constraint(name, (research.End(body),), research.end_position, (0.0, 0.0, 0.0)),
    )


def turned(angle: float) -> npt.NDArray[np.float64]:
    """Rotation about the third axis."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def slider_crank(element: str, n: Numbers) -> research.Mechanism:
    """Crank on a hinge, rod on the crank, end of the rod on the first axis."""
    short, long, rate = n["crank_length"], n["rod_length"], n["crank_speed"]
    first = math.radians(n["crank_angle"])
    height = abs(short * math.sin(first))
    if height >= long:
        raise ValueError(
            f"formalisms: --rod-length must be above {height:g} m, the height of the crank's pin, "
            f"got {long:g}"
        )
    second = -math.asin(short * math.sin(first) / long)
    pin = np.array([short * math.cos(first), short * math.sin(first), 0.0])
    back = -rate * pin[0] / (long * math.cos(second))
    spin = np.array([0.0, 0.0, rate])
    crank = link(
        "crank", element, "planar", short, n, rotation=turned(first), **first_motion(n, spin)
    )
    rod = link(
        "rod", element, "planar", long, n, origin=pin, rotation=turned(second),
        velocity=np.cross(spin, pin), angular_velocity=(0.0, 0.0, back),
    )  # fmt: skip
    slider = research.End("rod", (long, 0.0, 0.0))
    pins = (research.End("crank", (short, 0.0, 0.0)), research.End("rod"))
    axes = 2
    if element == "solid":  # positions of nodes have three components
        pins, axes = (pins[0], research.End("rod", (0.0, 0.0, 0.0))), 3
    line = (0.0,) * axes + (0.0, 1.0, 0.0)[:axes]
    return research.Mechanism(
        f"slider_crank_{element}",
        (crank, rod),
        (
            *on_ground(n, "hinge", "crank"),
            research.Constraint("pin", pins, research.coincidence),
            research.Constraint("slide", (slider,), research.on_line, line),
        ),
        gravity=(0.0, -n["gravity"], 0.0),
        observed=slider,
    )


def double_pendulum(element: str, n: Numbers) -> research.Mechanism:
    """Two links on spherical joints, with an initial rotation."""
    upper_length, lower_length = n["upper_length"], n["lower_length"]
    spin, other = (
        np.array([n[f"{name}_spin_{axis}"] for axis in "xyz"]) for name in ("upper", "lower")
    )
    pin = np.array([upper_length, 0.0, 0.0])
    upper = link("upper", element, "spatial", upper_length, n, **first_motion(n, spin))
    lower = link(
        "lower", element, "spatial", lower_length, n, origin=pin,
        rotation=turned(math.radians(n["lower_angle"])), velocity=np.cross(spin, pin),
        angular_velocity=other,
    )  # fmt: skip
    pins = (research.End("upper", (upper_length, 0.0, 0.0)), research.End("lower"))
    return research.Mechanism(
        f"double_pendulum_{element}",
        (upper, lower),
        (
            *on_ground(n, "suspension", "upper"),
            research.Constraint("ball", pins, research.coincidence),
        ),
        gravity=(0.0, -n["gravity"], 0.0),
        observed=research.End("lower", (lower_length, 0.0, 0.0)),
    )


def build(
    *, formalism: str, element: str, motion: str, matrices: bool, **n: Any
) -> research.FormalismStudy | research.ElementMatrixStudy:
    """The mechanisms of the chosen elements and motions."""
    pairs = product(
        ELEMENTS if element == "all" else (element,), MOTIONS if motion == "all" else (motion,)
    )
    makers = {"planar": slider_crank, "spatial": double_pendulum}
    mechanisms = {(kind, moves): makers[moves](kind, n) for kind, moves in pairs}
    labels = ("element", "motion")
    if matrices:
        omega, epsilon = ([n[f"{of}_{axis}"] for axis in "xyz"] for of in ("omega", "epsilon"))
        bodies = {key: mechanism.bodies[0] for key, mechanism in mechanisms.items()}
        return research.ElementMatrixStudy(bodies, labels, omega, epsilon)
    return research.FormalismStudy(
        mechanisms, labels, research.FORMALISMS if formalism == "all" else (formalism,)
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
            choices=("all", *research.FORMALISMS),
        ),
        ff.Option(
            "element", str, "all", "finite elements of the links", choices=("all", *ELEMENTS)
        ),
        ff.Option("motion", str, "all", "kind of motion", choices=("all", *MOTIONS)),
        ff.Option("elements", int, 4, "elements along each link", minimum=1),
        ff.Option("prescribed", bool, False, "whether the first link's frame turns as it starts"),
        ff.Option("matrices", bool, False, "whether element matrices are written, and no motion"),
        *(
            ff.Option(name, float, value, f"of the {what}", unit="m", above=0.0)
            for name, value, what in (
                ("crank_length", 0.3, "crank"), ("rod_length", 0.6, "rod"),
                ("upper_length", 0.3, "upper link"), ("lower_length", 0.3, "lower link"),
                ("width", 0.02, "links, along the third axis"),
                ("height", 0.01, "links, along the second axis"),
            )
        ),
        ff.Option("youngs_modulus", float, 7e10, "of the links", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.33, "of the links", minimum=0.0, maximum=0.49),
        ff.Option("density", float, 2700.0, "of the links", unit="kg/m^3", above=0.0),
        ff.Option(
            "damping", float, 0.0, "dissipation over strain energy of the rates", unit="s",
            minimum=0.0,
        ),
        ff.Option("gravity", float, 9.81, "along -Y", unit="m/s^2"),
        ff.Option("crank_angle", float, 60.0, "of the crank at the start", unit="deg"),
        ff.Option("crank_speed", float, 20.0, "of the crank at the start", unit="rad/s"),
        ff.Option(
            "lower_angle", float, math.degrees(-0.5), "of the lower link at the start", unit="deg"
        ),
        *(
            ff.Option(f"{link}_spin_{axis}", float, value, f"of the {link} link", unit="rad/s")
            for link, spin in (("upper", (0.0, 4.0, 6.0)), ("lower", (0.0, -4.0, 2.0)))
            for axis, value in zip("xyz", spin, strict=True)
        ),
        *(
            ff.Option(f"{name}_{axis}", float, value, "of the frame, with --matrices", unit=unit)
            for name, values, unit in (
                ("omega", (0.0, 0.0, 20.0), "rad/s"), ("epsilon", (0.0, 0.0, 100.0), "rad/s^2")
            )
            for axis, value in zip("xyz", values, strict=True)
        ),
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
