# SPDX-License-Identifier: LGPL-3.0-or-later
"""Square piece of fabric that drapes over a rigid sphere, by dynamic relaxation.

The sheet, 0.3 x 0.3 m, starts flat, a tenth of its thickness above the top of a sphere of diameter
0.1 m, centre at the origin; weight along -Z. The sphere is exact, or with ``--sphere mesh`` a rigid
surface of 13,448 triangles, whose edges are 3 mm long at most (``--sphere-size``) and whose
midpoints lie up to 0.03 mm inside. Fabric (Zhou, Sze 2011; Xie, Sze, Zhou 2015): rigidities along
warp and weft 1095.84 and 744.31 N/m, in shear 40.964 N/m, in bending 8.134e-6 and 6.174e-6 N m, in
twist 2.646e-6 N m, Poisson's ratio 0.01, thickness 0.593 mm, 320.4 kg/m^3; warp along X rotated by
``--warp-angle``. ``--mesh`` counts nodes along the sides.

Triangles that are cut along one diagonal, and heights of the nodes that are off at random by
``--imperfection`` thicknesses, decide where folds begin: there are several equilibria with 4 to 8
folds, and others come with another ``--seed``, mesh or ``--friction``. The heights are the same at
opposite places, which leaves the symmetry of half a turn that sheet, sphere and mesh have; with
``--no-symmetric`` the sheet, which slides without friction, comes to hang lower on one side.
Surfaces repel when they are nearer than a twentieth of the thickness, with ``--contact-stiffness``,
and never touch (with ``--friction`` nodes sink in, by a force of that stiffness times the
penetration). Corners that fold up pass through one another unless the sheet touches itself,
``--self-contact``.

History: ``residual, largest_step, pseudo_energy`` of the relaxation; heights of the corners
``corner_bottom_left_z, corner_bottom_right_z, corner_top_right_z, corner_top_left_z`` and of the
midpoints of the sides ``middle_bottom_z, middle_right_z, middle_top_z, middle_left_z``, m; the
outline seen from above, by 32 nodes, roots of mean squares: ``outline_radius`` (m), and relative to
it, its deviation from itself after half a turn, ``outline_half_turn``, a quarter turn,
``outline_quarter_turn``, and a mirror and rotation, ``outline_mirror``; ``contact_gap,
contact_penetration`` (m), force of the sphere ``contact_fx, contact_fy, contact_fz,
contact_normal`` (N) and number of contacts, ``contact_closed``; the same of the sheet with itself;
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``,
and the strain energy by kind, ``sheet_energy_membrane, sheet_energy_bending, sheet_energy_shear``
(J).

Equilibrium: forces out of balance are 1e-3 of the weight, both as root mean squares over nodes.
Expected: the force of the contact is the weight, 0.1677 N, within 0.1 %; the least gap is positive,
3 % of the thickness, also between folds; half a turn maps the outline onto itself.
Run: ``python cases/draping.py --mesh 61x61``, then ``flexfem render results/draping --colour
bending_energy --range 0,0.1 --time last`` for the shape, with ``--view z`` from above, and
``flexfem plot results/draping --outline``: outline seen from above, and folds.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import flexfem as ff

#: Parts of each side at whose ends the outline is measured.
PARTS = 8
Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Numbers:
    """Sheet and sphere: the options of these names."""

    side: float
    sphere_radius: float
    thickness: float
    density: float
    gravity: float
    membrane_warp: float
    membrane_weft: float
    membrane_shear: float
    bending_warp: float
    bending_weft: float
    bending_twist: float
    poisson_ratio: float

    @property
    def top(self) -> float:
        """Height of the flat sheet, a tenth of its thickness above the sphere, m."""
        return self.sphere_radius + 0.6 * self.thickness

    def section(self) -> ff.ShellSection:
        """Of the fabric."""
        return ff.ShellSection.orthotropic(
            (self.membrane_warp, self.membrane_weft, self.membrane_shear),
            (self.bending_warp, self.bending_weft, self.bending_twist),
            self.poisson_ratio, self.density * self.thickness, self.thickness,
        )  # fmt: skip


def sheet(
    nodes: tuple[int, int], diagonal: str, numbers: Numbers, imperfection: float, symmetric: bool,
    seed: int,
) -> ff.SurfaceMesh:  # fmt: skip
    """Flat grid above the sphere, heights off by up to ``imperfection`` (m) upwards."""

    def surface(parameters: Points) -> Points:
        random = np.random.default_rng(seed).random(len(parameters))
        if symmetric:  # nodes in reverse order are opposite ones
            random = 0.5 * (random + random[::-1])
        return np.column_stack([parameters, numbers.top + imperfection * random])

    along = [np.linspace(-0.5 * numbers.side, 0.5 * numbers.side, count) for count in nodes]
    return ff.SurfaceMesh.grid("sheet", *along, surface, diagonal=diagonal)


def ball(radius: float, size: float) -> ff.SurfaceMesh:
    """Sphere of triangles with edges of at most about ``size`` (m), nodes on it, one on top.

    Each side of an octahedron is divided evenly and its nodes are moved out to the sphere, so that
    a quarter turn about Z maps the mesh onto itself. Edges are longest in the middle of a side,
    sqrt(3) times as long as they were in the octahedron.
    """
    parts = max(math.ceil(math.sqrt(6.0) * radius / size), 1)
    if parts > 400:
        raise ValueError(
            f"sphere-size must be at least {math.sqrt(6.0) * radius / 400:.1e} m, got {size:g}"
        )
    numbers: dict[tuple[int, int, int], int] = {}
    triangles = []
    for signs in np.ndindex(2, 2, 2):
        x, y, z = (1 - 2 * sign for sign in signs)

        def node(i: int, j: int, at: tuple[int, int, int] = (x, y, z)) -> int:
            place = (at[0] * i, at[1] * j, at[2] * (parts - i - j))
            return numbers.setdefault(place, len(numbers))

        for i in range(parts):
            for j in range(parts - i):
                faces = [(node(i, j), node(i + 1, j), node(i, j + 1))]
                if i + j + 1 < parts:
                    faces.append((node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)))
                triangles += [face if x * y * z > 0 else face[::-1] for face in faces]
    points = np.array(list(numbers), dtype=np.float64)
    points *= radius / np.linalg.norm(points, axis=1)[:, np.newaxis]
    return ff.SurfaceMesh(points, triangles, {"sphere": np.arange(len(triangles))})


def rim(nodes: tuple[int, int]) -> list[int]:
    """Numbers of the 4 PARTS nodes of the outline that are measured, counterclockwise."""
    columns, rows = nodes
    along, up = (
        np.round(np.linspace(0, count - 1, PARTS + 1)).astype(int).tolist() for count in nodes
    )
    bottom, right = [(i, 0) for i in along[:-1]], [(columns - 1, j) for j in up[:-1]]
    top, left = [(i, rows - 1) for i in along[:0:-1]], [(0, j) for j in up[:0:-1]]
    return [i + columns * j for i, j in (*bottom, *right, *top, *left)]


def outline(t: float, *states: ff.MarkerState) -> list[float]:
    """Radius of the outline seen from above (m), and its deviations from its symmetries.

    The radius, and all distances, are roots of means of squares; a distance is that of each node
    from where its counterpart gets to by half a turn, a quarter turn, or a mirror that maps left
    to right and is then turned to fit best, over the radius: 0 where the outline is symmetric.
    """
    at = np.array([complex(*state.position[:2]) for state in states])
    at -= at.mean()
    radius = float(np.sqrt(np.mean(np.abs(at) ** 2)))
    turned = [
        float(np.sqrt(np.mean(np.abs(factor * at - np.roll(at, -parts)) ** 2)))
        for factor, parts in ((-1.0, 2 * PARTS), (1j, PARTS))
    ]
    mirrored = at[(PARTS - np.arange(len(at))) % len(at)]
    rest = max(radius**2 - abs(np.mean(at * mirrored)), 0.0)
    return [radius, *(value / radius for value in turned), float(np.sqrt(2.0 * rest)) / radius]


def build(
    *, mesh: str, element: str, sphere: str, sphere_size: float, diagonal: str, warp_angle: float,
    friction: float, contact_stiffness: float, self_contact: bool, imperfection: float,
    symmetric: bool, seed: int, **values: float,
) -> ff.Model:  # fmt: skip
    """Model with a number of nodes such as "61x61"; ``values`` are those of :class:`Numbers`."""
    nodes, numbers = ff.grid_nodes(mesh), Numbers(**values)
    height = imperfection * numbers.thickness
    surface = sheet(nodes, diagonal, numbers, height, symmetric, seed)
    support: ff.RigidSurface = ff.RigidSphere(ff.Ground(), numbers.sphere_radius)
    if sphere == "mesh":
        support = ff.RigidMesh(ff.Ground(), mesh=ball(numbers.sphere_radius, sphere_size))
    angle = np.radians(warp_angle)
    warp = (np.cos(angle), np.sin(angle), 0.0)
    # barriers have no friction in relaxations
    law = "penalty" if friction else "barrier"
    model = ff.Model("draping", surface=surface)
    model.add(
        ff.Gravity((0.0, 0.0, -numbers.gravity)),
        ff.Shell("sheet", numbers.section(), element=element, direction=warp),
        ff.Contact(
            "support",
            "sheet",
            surfaces=support,
            stiffness=contact_stiffness,
            friction=friction,
            law=law,
        ),
    )
    if self_contact:
        model.add(
            ff.Contact("folds", "sheet", "sheet", stiffness=contact_stiffness, law=law),
            ff.ContactProbe("folds_contact", "folds"),
        )
    half, top = 0.5 * numbers.side, numbers.top
    places = {
        f"{kind}_{name}": (half * x, half * y, top)
        for kind, name, x, y in (
            ("corner", "bottom_left", -1, -1), ("corner", "bottom_right", 1, -1),
            ("corner", "top_right", 1, 1), ("corner", "top_left", -1, 1),
            ("middle", "bottom", 0, -1), ("middle", "right", 1, 0), ("middle", "top", 0, 1),
            ("middle", "left", -1, 0),
        )
    }  # fmt: skip
    for name, place in places.items():
        model.add(
            ff.Probe(name, ff.Marker("sheet", place), (f"{name}_z",), lambda t, s: s.position[2:])
        )
    every = [ff.Marker("sheet", surface.points[node]) for node in rim(nodes)]
    columns = [f"outline_{name}" for name in ("radius", "half_turn", "quarter_turn", "mirror")]
    model.add(
        ff.Probe("outline", every, columns, outline),
        ff.ContactProbe("contact", "support"),
        ff.EnergyProbe(),
        ff.ShellEnergyProbe("sheet_energy"),
    )
    return model


def results(
    history: Mapping[str, Points], *, side: float, thickness: float, density: float, gravity: float
) -> dict[str, float]:
    """Balance of forces, least gap, outline, lowest and highest corners and midpoints."""
    weight = side**2 * thickness * density * gravity
    end = {name: float(values[-1]) for name, values in history.items()}
    corners = [value for name, value in end.items() if name.startswith("corner_")]
    middles = [value for name, value in end.items() if name.startswith("middle_")]
    return {
        "contact_force_over_weight": end["contact_fz"] / weight,
        "gap_over_thickness": end["contact_gap"] / thickness,
        **{name: value for name, value in end.items() if name.startswith("outline_")},
        "lowest_corner": min(corners),
        "highest_corner": max(corners),
        "lowest_middle": min(middles),
        "highest_middle": max(middles),
        "potential_energy": end["energy_strain"] + end["energy_gravity"],
    }


CASE = ff.Case(
    name="draping",
    summary="square fabric over a sphere: folds, contact, dynamic relaxation",
    description=__doc__,
    build=build,
    options=(
        ff.GridOption("mesh", "61x61", "nodes along the sides"),
        ff.Option("element", str, "rotation_free", "formulation", choices=ff.SHELL_ELEMENTS),
        ff.Option("sphere", str, "exact", "rigid surface", choices=("exact", "mesh")),
        ff.Option(
            "sphere_size", float, 3e-3, "longest edges of its triangles", unit="m", above=0.0
        ),
        ff.Option("side", float, 0.3, "of the sheet", unit="m", above=0.0),
        ff.Option("sphere_radius", float, 0.05, "of the sphere", unit="m", above=0.0),
        ff.Option("thickness", float, 0.593e-3, "of the fabric", unit="m", above=0.0),
        ff.Option("density", float, 320.4, "of the fabric", unit="kg/m^3", above=0.0),
        ff.Option("gravity", float, 9.81, "along -Z", unit="m/s^2", above=0.0),
        ff.Option("membrane_warp", float, 1095.84, "rigidity", unit="N/m", above=0.0),
        ff.Option("membrane_weft", float, 744.31, "rigidity", unit="N/m", above=0.0),
        ff.Option("membrane_shear", float, 40.964, "rigidity", unit="N/m", above=0.0),
        ff.Option("bending_warp", float, 8.134e-6, "rigidity", unit="N m", above=0.0),
        ff.Option("bending_weft", float, 6.174e-6, "rigidity", unit="N m", above=0.0),
        ff.Option("bending_twist", float, 2.646e-6, "rigidity", unit="N m", above=0.0),
        ff.Option("poisson_ratio", float, 0.01, "of warp and weft", minimum=0.0, maximum=0.5),
        ff.Option("diagonal", str, "right", "which way cells are cut", choices=("right", "left")),
        ff.Option("warp_angle", float, 0.0, "angle of the warp to X", unit="deg"),
        ff.Option("friction", float, 0.0, "Coulomb's coefficient on the sphere", minimum=0.0),
        ff.Option("contact_stiffness", float, 5e7, "of surfaces that repel", unit="N/m^3", above=0),
        ff.Option("self_contact", bool, False, "the sheet touches itself as well"),
        ff.Option(
            "imperfection", float, 0.01, "random heights of the nodes, in thicknesses", minimum=0.0
        ),
        ff.Option("symmetric", bool, True, "the random heights are the same at opposite places"),
        ff.Option("seed", int, 0, "of the random heights", minimum=0),
    ),
    analysis=ff.RELAXATION,
    tolerance=1e-3,
    smoke={
        "mesh": "9x9",
        "contact_stiffness": 1e6,
        "tolerance": 0.1,
        "step_tolerance": 0.1,
    },
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
