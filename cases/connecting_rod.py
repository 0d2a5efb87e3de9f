# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slider-crank with a solid connecting rod.

Crank, slider and gravity are those of ``slider_crank.py``: a steel crank of 0.3 m (section
0.03 x 0.03 m, SE(3) beams), a mass of 0.1 kg that moves on the X axis, 9.81 m/s^2 along -Y
(E = 2.1e11 N/m^2, nu = 0.3, rho = 7850 kg/m^3). The rod, 0.6 m from axis to axis with a shank of
the same section, has eyes: bores of 25 mm and 15 mm radius in walls of 12 mm. Pins fill the bores
and are rigid. A constant moment about Z drives the crank from rest. Hinges about Z at ground and
crank pin leave no motion out of the plane.

``--rod solid`` is a body in a floating frame: quadratic tetrahedra (``--size``), reduced to the
motions of the pins, of a band around the middle of the shank and to ``--internal-modes`` others.
``--reduced FILE`` keeps the reduction: the file is read if it is there, and else written. A file
that was made with other numbers is refused.
``--rod nonlinear`` reduces the same mesh with Saint Venant and Kirchhoff's law and as many modal
derivatives as internal modes, in the frame of the big end: forces of third order, which stiffen by
themselves.
``--rod full`` is the same mesh as a nonlinear solid of Saint Venant and Kirchhoff's law with all
of its nodes; pins of 1e-6 kg are bonded to the bores.
``--rod beam`` has SE(3) beams along the shank and the eyes as rigid bodies with their mass and
inertia: within a wall of 12 mm around a rigid pin little can bend. ``--frame``, ``--stiffening``,
``--size``, ``--internal-modes`` and ``--reduced`` say nothing about it.

History: ``crank_angle`` (rad) and ``crank_rate`` (rad/s) of the chord of the crank, ``slider_x``
(m) and ``rod_deflection``, the distance of the rod's middle from the line through both pins over
0.6 m, without unit, positive to the left as seen from the crank pin.

Expected: the rod bends by 0.7 % of its length (4 mm; 0.02 rad at the pins), which a linear solid in
a floating frame can. With 130,170 unknowns and 48 beam elements the largest deflection is 0.691 %
of the length, on the beam rod 0.688 %, at 0.2993 s; their difference stays below 0.010 %. The crank
has then turned by 19.28 rad and passed 155 rad/s. Mean axes give 0.697 %, the frame of the small
end 0.720 %, without stiffening it is 0.800 %: the rod's own inertia pulls it straight. With
``--size 0.03 --dt 2e-4 --tolerance 1e-7`` all nodes (``full``) bend by 0.702 %, their reduction by
0.703 %; they differ by less than 0.002 % throughout. With ``--size 0.02`` the nonlinear rod has
0.684 %, the linear one with stiffening (4 modes) 0.685 %. In the first 0.04 s they stay within 0.4
and 1.9 % of the largest deflection of the full rod so far.
Run: ``mpirun -n 2 python cases/connecting_rod.py --size 0.005 --reduced rod.h5``, once more with
``--rod beam --output results/beam``; ``flexfem render --colour von_mises`` shows the stress.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

import flexfem as ff

Z = (0.0, 0.0, 1.0)
#: Mass of pins and gauge of the full solid, kg; those of the others have none.
_PIN_MASS = 1e-6


@dataclass(frozen=True)
class Dimensions:
    """Lengths of the linkage, m, as the options have them."""

    crank_length: float
    rod_length: float
    side: float
    big_bore: float
    small_bore: float
    wall: float
    gauge: float

    @property
    def pins(self) -> dict[str, tuple[float, float, float]]:
        """Interfaces of the solid rod and their places in it."""
        along = {"big_end": 0.0, "small_end": self.rod_length, "middle": 0.5 * self.rod_length}
        return {name: (x, 0.0, 0.0) for name, x in along.items()}

    def neck(self, bore: float) -> float:
        """Distance of the shank's end from the axis of an eye."""
        return math.sqrt((bore + self.wall) ** 2 - (0.5 * self.side) ** 2)


def build(
    *, rod: str, moment: float, elements: int, size: float, internal_modes: int, frame: str,
    stiffening: bool, reduced: str, youngs_modulus: float, poisson_ratio: float, density: float,
    slider_mass: float, gravity: float, **lengths: float,
) -> ff.Model:  # fmt: skip
    """Model with the rod as a reduced solid, or as a beam between rigid eyes."""
    at = Dimensions(**lengths)
    if 2.0 * (min(at.big_bore, at.small_bore) + at.wall) <= at.side:
        raise ValueError(
            f"connecting_rod: side {at.side:g} m is not less than the eyes' outer diameters"
        )
    steel = ff.Material(youngs_modulus, poisson_ratio, density)
    lines = {"crank": np.linspace(0.0, at.crank_length, elements + 1)}
    if rod == "beam":
        lines["shank"] = _shank(at, elements)
    model = ff.Model("connecting_rod", mesh=_mesh(at, lines))
    section = ff.Section.rectangle(at.side, at.side, steel)
    model.add(*(ff.Beam(name, section, orientation=(0.0, 1.0, 0.0)) for name in lines))
    if rod == "beam":
        pin, slider, middle = _add_eyes(model, at, density)
    elif rod == "full":
        pin, slider, middle = _add_solid(model, at, steel, size)
    else:
        nonlinear = rod == "nonlinear"
        if nonlinear and frame != "big_end":
            raise ValueError(
                f"connecting_rod: the nonlinear rod has the frame big_end, got {frame}"
            )
        stiffening = stiffening and not nonlinear
        body = _reduced(reduced, at, steel, size, internal_modes, stiffening, nonlinear)
        model.add(
            ff.FloatingBody(
                "rod",
                body,
                frame=frame,
                position=(at.crank_length, 0.0, 0.0),
                stiffening=stiffening,
            )
        )
        pin, slider, middle = (ff.Marker("rod", name) for name in at.pins)
    root, tip = ff.Marker("crank", "start"), ff.Marker("crank", "end")
    model.add(
        ff.Gravity((0.0, -gravity, 0.0)),
        ff.PointMass("slider", slider_mass, slider),
        ff.Revolute("bearing", ff.Ground(), root, axis=Z),
        ff.Revolute("crank_pin", tip, pin, axis=Z),
        ff.PointOnLine("guide", ff.Ground(), slider, axis=(1.0, 0.0, 0.0)),
        ff.PointMoment("drive", root, (0.0, 0.0, moment)),
        ff.Probe(
            "motion", (root, tip), ("crank_angle", "crank_rate"), _motion, unwrap=("crank_angle",)
        ),
        ff.Probe("guide_position", slider, ("slider_x",), lambda t, s: (s.position[0],)),
        ff.Probe("shape", (pin, middle, slider), ("rod_deflection",), partial(_deflection, at)),
    )
    return model


def _reduced(
    file: str,
    at: Dimensions,
    steel: ff.Material,
    size: float,
    modes: int,
    stiffening: bool,
    nonlinear: bool,
) -> ff.ReducedBody:
    """The solid rod, from a file if it is there."""
    made_with = {
        **asdict(at), "youngs_modulus": steel.youngs_modulus, "density": steel.density,
        "poisson_ratio": steel.poisson_ratio, "size": size, "internal_modes": modes,
        "stiffening": stiffening, "nonlinear": nonlinear,
    }  # fmt: skip
    if file and Path(file).exists():
        return ff.load_reduced_body(file, made_with=made_with)
    if file and not Path(file).absolute().parent.is_dir():
        raise ValueError(f"--reduced {file}: there is no such folder")
    mesh = _body_mesh(at, size)
    material, extra = steel, {}
    if nonlinear:
        material = ff.laws.SaintVenantKirchhoff(steel.youngs_modulus, steel.poisson_ratio)
        extra = {"density": steel.density}
    body = ff.reduce_body(
        ff.solid_body(mesh.mesh, material, name="rod", **extra),
        {name: mesh.facets(name) for name in at.pins},
        modes=modes,
        ties={"middle": "average"},
        positions=at.pins,
        geometric_stiffness=stiffening,
        derivatives=modes if nonlinear else None,
    )
    if file:
        ff.save_reduced_body(file, body, made_with=made_with)
    return body


def _body_mesh(at: Dimensions, size: float) -> ff.BodyMesh:
    """Quadratic tetrahedra of the rod, whose big end is at the origin."""
    return ff.build_body_mesh(
        "connecting_rod", length=at.rod_length, width=at.side, thickness=at.side, size=size,
        big_bore=at.big_bore, small_bore=at.small_bore, wall=at.wall, gauge=at.gauge,
    )  # fmt: skip


def _add_solid(
    model: ff.Model, at: Dimensions, steel: ff.Material, size: float
) -> tuple[ff.Marker, ff.Marker, ff.Marker]:
    """The solid with all of its nodes, bonded to pins, its middle to a gauge; their markers."""
    made = _body_mesh(at, size)
    mesh = ff.SolidMesh.from_dolfinx(made.mesh, made.cell_tags, made.facet_tags, made.groups)
    law = ff.laws.SaintVenantKirchhoff(steel.youngs_modulus, steel.poisson_ratio)
    shift = np.array([at.crank_length, 0.0, 0.0])
    solid = ff.Solid("rod", law, mesh.moved(mesh.points + shift), density=steel.density)
    model.add(solid)
    pins = {name: ff.Marker(f"{name}_pin") for name in at.pins}
    for name, pin in pins.items():
        inertia = (_PIN_MASS * at.side**2,) * 3
        model.add(ff.RigidBody(pin.body, _PIN_MASS, inertia, position=shift + at.pins[name]))
        if name == "middle":
            model.add(ff.Rigid("gauge", solid.surface_marker(name), pin))
        else:
            model.add(ff.RigidPoints(f"{name}_bond", pin, nodes=solid.node_markers(name)))
    return pins["big_end"], pins["small_end"], pins["middle"]


def _shank(at: Dimensions, elements: int) -> npt.NDArray[np.float64]:
    """Nodes of the shank between the eyes, one of them in the rod's middle."""
    first, last = at.neck(at.big_bore), at.rod_length - at.neck(at.small_bore)
    before = np.linspace(first, 0.5 * at.rod_length, elements // 2 + 1)
    after = np.linspace(0.5 * at.rod_length, last, elements - elements // 2 + 1)
    return at.crank_length + np.concatenate([before, after[1:]])


def _mesh(at: Dimensions, lines: Mapping[str, npt.NDArray[np.float64]]) -> ff.LineMesh:
    """Lines along X, each with nodes of its own."""
    counts = np.cumsum([0, *(len(x) for x in lines.values())])
    x = np.concatenate(list(lines.values()))
    nodes = np.delete(np.arange(len(x) - 1), counts[1:-1] - 1)
    groups = {name: np.arange(counts[i] - i, counts[i + 1] - i - 1) for i, name in enumerate(lines)}
    from_middle = np.abs(x - at.crank_length - 0.5 * at.rod_length)
    points = {"middle": int(np.argmin(from_middle))} if "shank" in lines else {}
    return ff.LineMesh(
        np.stack([x, 0.0 * x, 0.0 * x], axis=1),
        np.stack([nodes, nodes + 1], axis=1),
        groups,
        points,
    )


def _add_eyes(
    model: ff.Model, at: Dimensions, density: float
) -> tuple[ff.Marker, ff.Marker, ff.Marker]:
    """Rigid eyes at the ends of the shank; the markers of pins and middle."""
    eyes = (
        ("big_end", at.crank_length, at.big_bore, 1.0, "start"),
        ("small_end", at.crank_length + at.rod_length, at.small_bore, -1.0, "end"),
    )
    for name, x, bore, side, end in eyes:
        mass, centre, inertia = _eye(at, bore, density)
        body = ff.RigidBody(
            name, mass, inertia, position=(x, 0.0, 0.0), centre=(side * centre, 0.0, 0.0),
            shape=ff.Cylinder(bore + at.wall, at.side, axis=Z),
        )  # fmt: skip
        neck = ff.Marker(name, offset=(side * at.neck(bore), 0.0, 0.0))
        model.add(body, ff.Rigid(f"{name}_neck", neck, ff.Marker("shank", end)))
    return ff.Marker("big_end"), ff.Marker("small_end"), ff.Marker("shank", "middle")


def _eye(
    at: Dimensions, bore: float, density: float
) -> tuple[float, float, tuple[float, float, float]]:
    """Mass, mass centre along X and moments of inertia of a round eye up to the shank."""
    outer, density = bore + at.wall, density * at.side  # of the eye, per area
    points, weights = np.polynomial.legendre.leggauss(40)
    reach = math.acos(-at.neck(bore) / outer)
    angle, weights = 0.5 * reach * (points + 1.0), 0.5 * reach * weights
    x, half = -outer * np.cos(angle), outer * np.sin(angle)
    strip = 2.0 * half**2 * weights  # dx = outer sin(angle) d angle
    hole = math.pi * bore**2
    mass = density * (strip.sum() - hole)
    centre = density * (strip @ x) / mass
    xx = density * (strip @ x**2 - 0.25 * hole * bore**2) - mass * centre**2
    yy = density * (strip @ half**2 / 3.0 - 0.25 * hole * bore**2)
    zz = mass * at.side**2 / 12.0
    return mass, centre, (yy + zz, xx + zz, xx + yy)


def _motion(t: float, root: ff.MarkerState, tip: ff.MarkerState) -> tuple[float, float]:
    """Angle and rate of the chord of the crank in the plane of motion."""
    x, y, _ = tip.position - root.position
    u, v, _ = tip.velocity - root.velocity
    return math.atan2(y, x), (x * v - y * u) / (x * x + y * y)


def _deflection(
    at: Dimensions, t: float, pin: ff.MarkerState, middle: ff.MarkerState, slider: ff.MarkerState
) -> tuple[float]:
    """Distance of the rod's middle from the line through the pins, relative to its length."""
    x, y, _ = slider.position - pin.position
    u, v, _ = middle.position - pin.position
    return ((x * v - y * u) / math.hypot(x, y) / at.rod_length,)


def results(history: Mapping[str, npt.NDArray[np.float64]]) -> dict[str, float]:
    """Largest deflection and its time, largest rate, angle at the end."""
    size = np.abs(history["rod_deflection"])
    peak = int(np.argmax(size))
    return {
        "largest_rod_deflection": size[peak],
        "time_of_largest_deflection": history["t"][peak],
        "largest_crank_rate": history["crank_rate"].max(),
        "final_crank_angle": history["crank_angle"][-1],
    }


CASE = ff.Case(
    name="connecting_rod",
    summary="slider-crank with a solid connecting rod in a floating frame",
    description=__doc__,
    build=build,
    options=(
        ff.Option(
            "rod",
            str,
            "solid",
            "what the rod is made of",
            choices=("solid", "nonlinear", "full", "beam"),
        ),
        ff.Option("moment", float, 150.0, "on the crank", unit="N m"),
        ff.Option("elements", int, 24, "beam elements of the crank, and of a beam rod", minimum=2),
        ff.Option("size", float, 0.01, "edges of the tetrahedra", unit="m", above=0.0),
        ff.Option("internal_modes", int, 9, "internal modes of the solid", minimum=0),
        ff.Option(
            "frame", str, "big_end", "floating frame", choices=("big_end", "small_end", "mean_axes")
        ),
        ff.Option("stiffening", bool, True, "stress stiffens the solid"),
        ff.Option("crank_length", float, 0.3, "of the crank", unit="m", above=0.0),
        ff.Option("rod_length", float, 0.6, "of the rod, above that", unit="m", above=0.0),
        ff.Option("side", float, 0.03, "of crank, shank and eyes", unit="m", above=0.0),
        ff.Option("big_bore", float, 0.025, "radius of the bore at the crank", unit="m", above=0.0),
        ff.Option("small_bore", float, 0.015, "radius at the slider", unit="m", above=0.0),
        ff.Option("wall", float, 0.012, "of the eyes", unit="m", above=0.0),
        ff.Option("gauge", float, 0.01, "of the rod's measured middle", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 2.1e11, "of crank and rod", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of crank and rod", minimum=0.0, maximum=0.49),
        ff.Option("density", float, 7850.0, "of crank and rod", unit="kg/m^3", above=0.0),
        ff.Option("slider_mass", float, 0.1, "mass of the slider", unit="kg", above=0.0),
        ff.Option("gravity", float, 9.81, "along -Y", unit="m/s^2"),
        ff.Option("reduced", str, "", "file of the reduced solid: read if there, else written"),
    ),
    dt=1e-4,
    t_end=0.3,
    smoke={"elements": 2, "size": 0.03, "internal_modes": 3, "stiffening": False, "t_end": 1e-3},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
