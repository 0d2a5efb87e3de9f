# SPDX-License-Identifier: LGPL-3.0-or-later
"""The strongest column: similar sections of a given volume, by the gradient of its buckling load.

A pinned column may be thick where it bends most and thin at its ends. Of all columns with similar
sections and the same volume the strongest one carries 4/3 of the load of the uniform one (J. B.
Keller, Arch. Rational Mech. Anal. 5 (1960) 275-285), with the area ``4/3 sin^2(a)`` of the uniform
one's at ``x / length = (a - sin(2 a) / 2) / pi``.

A small change of the area of each element, which costs the same volume everywhere, changes the load
of the best column by the same amount; areas are multiplied by a power of the gradient until it
does. The exponent 1/3 is that of elements whose bending moments stay: their share of the load is as
the third power of one over the area, per volume. Each iteration takes one gradient for the areas of
all elements, which are shorter near both ends by ``--grading``. ``iterations.csv`` has the load and
the largest over the least derivative by volume, ``parameters.csv`` the areas of the lower half.

The column is then shown under ``--t-end`` of Euler's load of the uniform column, with its buckling
mode; the uniform one in the folder ``start``.

History: ``load`` over Euler's load; ``shortening`` of the column, m.

Expected: 1.3323 of Euler's load with 40 elements after six gradients, 4/3 to 8e-4. Run:
``mpirun -n 2 python cases/optimal_column.py``.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import numpy.typing as npt

import flexfem as ff

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """Dimensions of a column and its elements, m, m^2."""

    length: float
    area: float
    width: float
    material: ff.Material
    elements: int
    grading: float

    @property
    def euler(self) -> float:
        """Buckling load of the uniform column, N: the rectangle bends over its height."""
        inertia = self.area**2 / (12.0 * self.width)
        return float(np.pi**2 * self.material.youngs_modulus * inertia / self.length**2)

    @property
    def ends(self) -> Array:
        """Ends of elements over the length."""
        half = 0.5 * np.linspace(0.0, 1.0, self.elements // 2 + 1) ** self.grading
        return np.concatenate([half, 1.0 - half[-2::-1]])

    @property
    def volumes(self) -> Array:
        """Shares of the volume by the areas of the lower half."""
        return 2.0 * np.diff(self.ends[: self.elements // 2 + 1])

    def model(self, areas: Array) -> ff.Model:
        """The column under Euler's load, by the areas of its lower half (m^2)."""
        own, ends = np.concatenate([areas, areas[::-1]]), self.ends
        points = np.outer(self.length * ends, (0.0, 0.0, 1.0))
        cells = np.array([[i, i + 1] for i in range(len(own))])
        mesh = ff.LineMesh(points, cells, {"column": np.arange(len(own))})

        def along(s: float) -> ff.Section:
            number = int(np.searchsorted(ends, s / self.length, side="right")) - 1
            return section(float(own[min(number, len(own) - 1)]), self.width, self.material)

        foot, head = ff.Marker("column", "start"), ff.Marker("column", "end")
        model = ff.Model("optimal_column", mesh=mesh)
        model.add(
            ff.Beam("column", along, orientation=(0.0, 1.0, 0.0)),
            ff.Revolute("foot", ff.Ground(), foot, axis=(0.0, 1.0, 0.0)),
            ff.PrescribedDisplacement("beside", ff.Ground(), head, axis=(1.0, 0.0, 0.0)),
            ff.PrescribedDisplacement("across", ff.Ground(), head, axis=(0.0, 1.0, 0.0)),
            ff.PointForce("push", head, (0.0, 0.0, -self.euler)),
            ff.Probe(
                "head", head, ("load", "shortening"),
                lambda t, s: (t, self.length - s.position[2]),
            ),
        )  # fmt: skip
        return model


@cache
def section(area: float, width: float, material: ff.Material) -> ff.Section:
    """A rectangle, ``width`` times as wide as high, which bends over its height."""
    height = (area / width) ** 0.5
    return ff.Section.rectangle(width * height, height, material)


def strongest(
    column: Column, iterations: int, search: ff.ParameterSearch, options: ff.StaticOptions,
    report: Callable[[Mapping[str, float]], None],
) -> ff.FoundParameters:  # fmt: skip
    """Areas of the strongest column."""
    options = replace(options, t_end=1.0, load_steps=1, buckling_modes=1)
    volumes, areas = column.volumes, np.asarray(search.start["areas"])
    for _ in range(iterations):
        found = ff.gradient(search.build, "buckling:1", {"areas": areas}, options)
        by_volume = np.asarray(found.gradient["buckling:1"]["areas"]) / volumes
        report({
            "load": found.value["buckling:1"],
            "largest_over_least": float(by_volume.max() / by_volume.min()),
        })  # fmt: skip
        areas = areas * np.cbrt(by_volume)
        areas *= column.area / (areas @ volumes)
    outcome = ff.solve_static(search.model({"areas": areas}), options)
    load = float(outcome.summary["buckling"][0])
    return ff.FoundParameters({"areas": areas}, {"load": load, "load_over_keller": 0.75 * load})


def build(
    *, elements: int, iterations: int, length: float, area: float, width: float,
    youngs_modulus: float, poisson_ratio: float, density: float, grading: float,
) -> ff.ParameterSearch:  # fmt: skip
    """The search for the areas of ``elements`` beam elements, an even number."""
    if elements % 2:
        raise ValueError(f"optimal_column: elements must be even, got {elements}")
    material = ff.Material(youngs_modulus, poisson_ratio, density)
    column = Column(length, area, width, material, elements, grading)
    return ff.ParameterSearch(
        "optimal_column", column.model, {"areas": np.full(elements // 2, area)},
        partial(strongest, column, iterations), analysis="statics",
    )  # fmt: skip


CASE = ff.Case(
    name="optimal_column",
    summary="the strongest column of a volume, by the gradient of its buckling load (Keller 1960)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 40, "beam elements, even", minimum=4),
        ff.Option("iterations", int, 6, "of the search, one gradient each", minimum=1),
        ff.Option("length", float, 1.0, "of the column", unit="m", above=0.0),
        ff.Option("area", float, 1e-4, "of the uniform column", unit="m^2", above=0.0),
        ff.Option("width", float, 2.0, "of the sections over their height", minimum=1.0),
        ff.Option("youngs_modulus", float, 2.1e11, "of the column", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the column", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 7850.0, "of the column", unit="kg/m^3", above=0.0),
        ff.Option("grading", float, 1.7, "exponent by which elements shorten to the ends",
                  minimum=1.0, maximum=4.0),
    ),
    analysis=ff.STATICS,
    t_end=0.9,
    load_steps=3,
    buckling_modes=1,
    smoke={"elements": 8, "iterations": 1, "buckling_modes": 0},
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
