# SPDX-License-Identifier: LGPL-3.0-or-later
"""Statics of thin shells with large rotations: benchmarks of Sze, Liu and Lo (2004).

``--benchmark`` chooses one, ``--mesh 60x10`` the cells along its two parameters; each cell is cut
into two triangles. Any consistent units; the load factor t is 1 under the largest load. The numbers
below are options, which a benchmark that has no such number refuses.

- cantilever: strip 10 x 1, thickness 0.1, E = 1.2e6, nu = 0, force 4 across its end.
  A: deflection of the end, B: its shift towards the clamp.
- annulus: ring from radius 6 to 10, slit open, thickness 0.03, E = 21e6, nu = 0; one side of the
  slit is clamped, 0.8 per length lifts the other. A, B: its inner and outer corner.
- hemisphere: radius 10, thickness 0.04, E = 6.825e7, nu = 0.3, with a hole of 18 degrees; four
  radial forces of 400 at the equator, alternately out- and inwards; a quarter is computed.
  A, B: radial displacements of the outward and the inward one.
- pullout: cylinder with open ends, radius 4.953, length 10.35, thickness 0.094, E = 10.5e6,
  nu = 0.3125, pulled apart by two forces of 40000 at its middle; an eighth is computed.
  A: under the force, B, C: of the sides inwards, in the middle and at the ends.
- pinched: cylinder with diaphragms at its ends, radius 100, length 200, thickness 1, E = 3e4,
  nu = 0.3, pinched by two forces of 12000; an eighth is computed. The displacement under the force
  is prescribed, 90 t (2 - t), and the run ends where a quarter of the force, force_fz, is -3000.
  A: under the force inwards, B: of the sides outwards. Cells are smaller where the fold's corner
  moves. It needs directors, its default, and 64x16 cells, two minutes; or triangles without
  rotations and 128x32 cells.
- roof: cylindrical roof, radius 2540, 0.2 rad wide, 508 long, thickness 12.7, E = 3102.75,
  nu = 0.3, hinged along its straight edges, force 3000 on its middle; a quarter is computed, along
  its path through the snap. A: under the force. thin_roof: the same with a thickness of 6.35.

``--membrane smoothed`` takes means of the strains over neighbouring triangles: off by 0.4 per cent
on the annulus of 60x10 cells instead of 3.0, on the cantilever of 16x1 by 0.1 instead of 0.8; by
1.4 instead of 0.9 on the pullout of 24x16. Within 1 per cent of the values below, or of those of
refined meshes, are with constant strains cantilever 16x1, annulus 160x20, hemisphere 16x16, pullout
24x16, roof 8x8. Coarse meshes of the pinched cylinder hold the corner of the fold at their nodes:
the force rises and falls from cell to cell, and the shell may snap to another branch.

Load steps search stable equilibria (``--stabilise``): coarse meshes buckle locally, and the real
shell may snap.

History: ``A``, ``B``, ``C``: the displacements above, those of a benchmark only. ``force_fx`` to
``force_mz`` of the pinched cylinder: force and moment on its eighth.

``--element director`` needs fewer cells: 16x1, 40x6, 16x16, 36x24, 8x8, 8x8, and no
``--stabilise``. The pinched cylinder is softer than in the paper, with either element: A 84.02, B
35.87 with directors (80x24: 84.07, 35.90), 83.49, 35.34 without rotations (192x48: 83.85, 35.60).

Expected at t = 1 (Sze, Liu, Lo, Finite Elem. Anal. Des. 40 (2004) 1551-1569): cantilever 6.698,
3.286; annulus 13.891, 17.528; hemisphere 4.067, 8.178; pullout 2.768, 4.551, 3.269; pinched
83.102, 34.272; limit loads of the roof near 0.742 and 0.169, A = 29.374 at t = 1.0835. Run:
``mpirun -n 2 python cases/shell_statics.py --benchmark hemisphere``, then
``flexfem render results/shell_statics --colour displacement``.
"""

import re
import sys
from collections.abc import Callable, Mapping
from math import pi

import numpy as np
import numpy.typing as npt

import flexfem as ff

Points = npt.NDArray[np.float64]
Surface = Callable[[Points], Points]
#: Element and strains of its membrane.
Kind = tuple[str, str]
Numbers = Mapping[str, float]

#: Numbers of the benchmarks: the options of these names, with these defaults.
NUMBERS: dict[str, Numbers] = {
    "cantilever": {
        "length": 10.0, "width": 1.0, "thickness": 0.1, "youngs_modulus": 1.2e6,
        "poisson_ratio": 0.0, "load": 4.0,
    },
    "annulus": {
        "radius": 10.0, "inner_radius": 6.0, "thickness": 0.03, "youngs_modulus": 21e6,
        "poisson_ratio": 0.0, "load": 0.8,
    },
    "hemisphere": {
        "radius": 10.0, "hole": 18.0, "thickness": 0.04, "youngs_modulus": 6.825e7,
        "poisson_ratio": 0.3, "load": 400.0,
    },
    "pullout": {
        "radius": 4.953, "length": 10.35, "thickness": 0.094, "youngs_modulus": 10.5e6,
        "poisson_ratio": 0.3125, "load": 4e4,
    },
    "pinched": {
        "radius": 100.0, "length": 200.0, "thickness": 1.0, "youngs_modulus": 3e4,
        "poisson_ratio": 0.3, "displacement": 90.0,
    },
    "roof": {
        "radius": 2540.0, "width": 508.0, "length": 508.0, "thickness": 12.7,
        "youngs_modulus": 3102.75, "poisson_ratio": 0.3, "load": 3000.0,
    },
}  # fmt: skip
NUMBERS["thin_roof"] = {**NUMBERS["roof"], "thickness": 6.35}


def shell(
    name: str, cells: tuple[int, int], ranges: tuple[tuple[float, float], tuple[float, float]],
    surface: Surface | None, n: Numbers, element: Kind,
    edges: Mapping[str, str], fixed: Mapping[str, str] | None = None,
    growth: tuple[float, float] = (1.0, 1.0),
) -> ff.Model:  # fmt: skip
    """Model of a shell over a rectangle of two parameters, fixed along named sides.

    Cells grow by a factor over each range.
    """
    u, v = (graded(*r, n, g) for r, n, g in zip(ranges, cells, growth, strict=True))
    mesh = ff.SurfaceMesh.grid("shell", u, v, surface)
    material = ff.Material(n["youngs_modulus"], n["poisson_ratio"], density=1.0)
    section = ff.ShellSection.isotropic(n["thickness"], material)
    model = ff.Model(name, surface=mesh)
    rules = {f"shell_{side}": rule for side, rule in edges.items()}
    more = {f"shell_{side}": axes for side, axes in (fixed or {}).items()}
    model.add(
        ff.Shell("shell", section, element=element[0], membrane=element[1], edges=rules, fixed=more)
    )
    return model


def graded(start: float, end: float, cells: int, growth: float) -> Points:
    """Ends of cells whose lengths grow geometrically by a factor from start to end."""
    share = np.linspace(0.0, 1.0, cells + 1)
    if growth != 1.0:
        share = np.expm1(np.log(growth) * share) / (growth - 1.0)
    return start + (end - start) * share


def corner(name: str) -> ff.Marker:
    """Marker at a corner of the parameters."""
    return ff.Marker("shell", f"shell_{name}")


def watch(model: ff.Model, column: str, place: str, direction: tuple[float, float, float]) -> None:
    """Record the displacement of a corner along a direction."""
    assert model.surface is not None
    start = model.surface.points[model.surface.nodes[f"shell_{place}"]]
    model.add(
        ff.Probe(
            column,
            corner(place),
            (column,),
            lambda t, at: (float(np.dot(at.position - start, direction)),),
        )
    )


def cylinder(radius: float) -> Surface:
    """Cylinder along Y by its angle from Z and its length."""

    def surface(p: Points) -> Points:
        return np.column_stack([radius * np.sin(p[:, 0]), p[:, 1], radius * np.cos(p[:, 0])])

    return surface


def cantilever(cells: tuple[int, int], element: Kind, n: Numbers) -> ff.Model:
    """Strip under a force across its end."""
    model = shell("cantilever", cells, ((0.0, n["length"]), (0.0, n["width"])), None, n, element,
                  {"left": "clamped"})  # fmt: skip
    model.add(ff.EdgeLoad("load", "shell", "shell_right", (0.0, 0.0, n["load"] / n["width"])))
    watch(model, "A", "bottom_right", (0.0, 0.0, 1.0))
    watch(model, "B", "bottom_right", (-1.0, 0.0, 0.0))
    return model


def annulus(cells: tuple[int, int], element: Kind, n: Numbers) -> ff.Model:
    """Slit ring, lifted at one side of the slit."""

    def surface(p: Points) -> Points:
        angle, radius = p.T
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle])

    if n["inner_radius"] >= n["radius"]:
        raise ValueError(
            f"shell_statics: inner-radius must be below the radius {n['radius']:g}, "
            f"got {n['inner_radius']:g}"
        )
    ranges = (0.0, 2.0 * pi), (n["inner_radius"], n["radius"])
    model = shell("annulus", cells, ranges, surface, n, element, {"left": "clamped"})
    model.add(ff.EdgeLoad("load", "shell", "shell_right", (0.0, 0.0, n["load"])))
    watch(model, "A", "bottom_right", (0.0, 0.0, 1.0))
    watch(model, "B", "top_right", (0.0, 0.0, 1.0))
    return model


def hemisphere(cells: tuple[int, int], element: Kind, n: Numbers) -> ff.Model:
    """Quarter of a hemisphere with a hole under radial forces."""

    def surface(p: Points) -> Points:
        f, t = p.T
        unit = np.column_stack([np.cos(t) * np.cos(f), np.cos(t) * np.sin(f), np.sin(t)])
        return np.asarray(n["radius"] * unit)

    ranges = (0.0, pi / 2), (0.0, np.radians(90.0 - n["hole"]))
    edges = {"left": "symmetric y", "right": "symmetric x"}
    model = shell("hemisphere", cells, ranges, surface, n, element, edges, {"bottom_left": "z"})
    half = 0.5 * n["load"]  # of each force, on a quarter
    model.add(
        ff.PointForce("pull", corner("bottom_left"), (half, 0.0, 0.0)),
        ff.PointForce("push", corner("bottom_right"), (0.0, -half, 0.0)),
    )
    watch(model, "A", "bottom_left", (1.0, 0.0, 0.0))
    watch(model, "B", "bottom_right", (0.0, -1.0, 0.0))
    return model


#: Planes of symmetry of an eighth of a cylinder.
EIGHTH = {"left": "symmetric x", "right": "symmetric z", "bottom": "symmetric y"}


def pullout(cells: tuple[int, int], element: Kind, n: Numbers) -> ff.Model:
    """Eighth of a cylinder with open ends, pulled apart."""
    ranges = (0.0, pi / 2), (0.0, 0.5 * n["length"])
    model = shell("pullout", cells, ranges, cylinder(n["radius"]), n, element, EIGHTH)
    model.add(ff.PointForce("load", corner("bottom_left"), (0.0, 0.0, 0.25 * n["load"])))
    watch(model, "A", "bottom_left", (0.0, 0.0, 1.0))
    watch(model, "B", "bottom_right", (-1.0, 0.0, 0.0))
    watch(model, "C", "top_right", (-1.0, 0.0, 0.0))
    return model


def pinched(cells: tuple[int, int], element: Kind, n: Numbers) -> ff.Model:
    """Eighth of a cylinder with diaphragms, pinched by a displacement."""
    # the fold's sharp corner runs along the bottom, towards its right end
    ranges, largest = ((0.0, pi / 2), (0.0, 0.5 * n["length"])), n["displacement"]
    model = shell("pinched", cells, ranges, cylinder(n["radius"]), n, element, EIGHTH,
                  {"top": "xz"}, growth=(0.3, 4.0))  # fmt: skip
    model.add(
        ff.PrescribedTranslation(
            "push", ff.Ground(), corner("bottom_left"), lambda t: -largest * t * (2.0 - t),
            axis=(0.0, 0.0, 1.0),
        ),
        ff.ReactionProbe("force", "push"),
    )  # fmt: skip
    watch(model, "A", "bottom_left", (0.0, 0.0, -1.0))
    watch(model, "B", "bottom_right", (1.0, 0.0, 0.0))
    return model


def roof(cells: tuple[int, int], element: Kind, n: Numbers) -> ff.Model:
    """Quarter of a hinged cylindrical roof."""
    edges = {"left": "symmetric x", "right": "hinged", "bottom": "symmetric y"}
    ranges = (0.0, 0.5 * n["width"] / n["radius"]), (0.0, 0.5 * n["length"])
    model = shell("roof", cells, ranges, cylinder(n["radius"]), n, element, edges)
    model.add(ff.PointForce("load", corner("bottom_left"), (0.0, 0.0, -0.25 * n["load"])))
    watch(model, "A", "bottom_left", (0.0, 0.0, -1.0))
    return model


BENCHMARKS: dict[str, Callable[[tuple[int, int], Kind, Numbers], ff.Model]] = {
    "cantilever": cantilever,
    "annulus": annulus,
    "hemisphere": hemisphere,
    "pullout": pullout,
    "pinched": pinched,
    "roof": roof,
    "thin_roof": roof,
}
_PATH = {"arc_length": 0.05, "stabilise": False, "stop_column": "A"}


def build(*, benchmark: str, mesh: str, element: str, membrane: str, **numbers: float) -> ff.Model:
    """Model of a benchmark on a mesh such as "60x10"; ``numbers`` are those of its kind."""
    found = re.fullmatch(r"([1-9]\d*)x([1-9]\d*)", mesh)
    if found is None:
        raise ValueError(f"shell_statics: mesh must be two numbers of cells like 60x10, got {mesh}")
    for name, value in numbers.items():
        option, known = name.replace("_", "-"), name in NUMBERS[benchmark]
        if value and not known:
            raise ValueError(f"shell_statics: {benchmark} has no {option}, but {value:g} is given")
        if not value and known and name != "poisson_ratio":
            raise ValueError(f"shell_statics: {option} of {benchmark} must be above 0, got 0")
    return BENCHMARKS[benchmark]((int(found[1]), int(found[2])), (element, membrane), numbers)


#: Description, unit and largest value of the numbers.
KINDS = {
    "radius": ("of the shell, the outer one of the annulus", "", None),
    "inner_radius": ("of the annulus", "", None),
    "length": ("along the axis of a cylinder or the strip", "", None),
    "width": ("of the strip, of the roof along its arc", "", None),
    "hole": ("from the pole of the hemisphere to its edge", "deg", 89.0),
    "thickness": ("of the shell", "", None),
    "youngs_modulus": ("of the material", "", None),
    "poisson_ratio": ("of the material", "", 0.5),
    "load": ("at t = 1: force, of the annulus per length", "", None),
    "displacement": ("at t = 1, of the pinched cylinder", "", None),
}


def _numbers(benchmark: str) -> dict[str, float]:
    """Defaults of a benchmark; 0 for numbers that it does not have."""
    return {name: NUMBERS[benchmark].get(name, 0.0) for name in KINDS}


CASE = ff.Case(
    name="shell_statics",
    summary="thin shells with large rotations, statics (Sze, Liu, Lo 2004)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("benchmark", str, "annulus", "which one", choices=tuple(BENCHMARKS)),
        ff.Option("mesh", str, "60x10", "cells along the two parameters"),
        ff.Option("element", str, "rotation_free", "of the shell", choices=ff.SHELL_ELEMENTS),
        ff.Option(
            "membrane", str, "constant", "strains of the membrane", choices=("constant", "smoothed")
        ),
        *(
            ff.Option(name, float, NUMBERS["annulus"].get(name, 0.0), what, unit=unit, minimum=0.0,
                      maximum=largest)
            for name, (what, unit, largest) in KINDS.items()
        ),
    ),
    analysis=ff.STATICS,
    stabilise=True,
    presets={
        "benchmark": {
            "cantilever": {"mesh": "32x2", "load_steps": 5, **_numbers("cantilever")},
            "hemisphere": {"mesh": "24x24", **_numbers("hemisphere")},
            "pullout": {"mesh": "36x24", "load_steps": 20, **_numbers("pullout")},
            "pinched": {
                **_numbers("pinched"),
                "mesh": "64x16",
                "element": "director",
                "load_steps": 36,
                "stabilise": False,
                "stop_column": "force_fz",
                "stop_value": -3e3,
            },
            "roof": {"mesh": "16x16", "stop_value": 30.0, **_PATH, **_numbers("roof")},
            "thin_roof": {"mesh": "16x16", "stop_value": 30.0, **_PATH, **_numbers("thin_roof")},
        }
    },
    smoke={"benchmark": "cantilever", "mesh": "6x1", "load_steps": 2, "t_end": 0.2},
    results=lambda history: {name: float(history[name][-1]) for name in "ABC" if name in history},
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
