# SPDX-License-Identifier: LGPL-3.0-or-later
"""The lightest blade on a shaft: areas under a bound on stresses, by their gradients.

A straight blade with a mass at its tip spins about its root. The lightest one that nowhere exceeds
a stress has that stress everywhere: its area is ``A_0 exp(rho omega^2 (L^2 - x^2) / (2 sigma))``
at the distance x from the axis, with the area ``A_0`` that carries the mass at the tip.

The area of each element is a variable, its stress a constraint (``ff.minimize``, SLSQP). The blade
is in equilibrium with its centrifugal forces, those of places before it stretches by
``sigma / E``. Results with the uniform blade of the start are in the folder ``start``.

History: ``stress``, the largest of all elements, Pa; ``stretch`` of the blade, m.

Expected: areas within 1e-3 of the formula at the middles of 40 elements, after some ten gradients.
Run: ``mpirun -n 2 python cases/uniform_stress_blade.py``.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.special import erf

import flexfem as ff

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Blade:
    """What is given of a blade, SI units."""

    elements: int
    length: float
    speed: float
    density: float
    youngs_modulus: float
    limit: float
    tip_mass: float
    width: float

    @property
    def middles(self) -> Array:
        """Distances of the elements from the axis, m."""
        return (np.arange(self.elements) + 0.5) * self.length / self.elements

    @property
    def exponent(self) -> float:
        """Logarithm of the area of the root over that of the tip, of the best blade."""
        return self.density * (self.speed * self.length) ** 2 / (2.0 * self.limit)

    @property
    def tip_area(self) -> float:
        """Area that carries the mass at the tip."""
        return self.tip_mass * self.speed**2 * self.length / self.limit

    @property
    def best_areas(self) -> Array:
        """Those of the best blade at the middles of the elements."""
        along: Array = 1.0 - (self.middles / self.length) ** 2
        return self.tip_area * np.exp(self.exponent * along)

    @property
    def best_mass(self) -> float:
        """Mass of the best blade, without that at its tip."""
        c = self.exponent
        mean = np.exp(c) * np.sqrt(np.pi / c) * erf(np.sqrt(c)) / 2.0
        return float(self.density * self.length * self.tip_area * mean)

    def mass(self, areas: Array) -> tuple[float, Mapping[str, Array]]:
        """Mass with areas of the elements, with its derivatives."""
        each = self.density * self.length / self.elements
        return each * float(areas.sum()), {"areas": np.full(self.elements, each)}

    def model(self, areas: Array, *, each: bool = False) -> ff.Model:
        """The blade with its centrifugal forces, and a column for each element's stress."""
        points = np.linspace(0.0, self.length, self.elements + 1)[:, np.newaxis] * [[1.0, 0.0, 0.0]]
        cells = np.array([[i, i + 1] for i in range(self.elements)])
        mesh = ff.LineMesh(points, cells, {"blade": np.arange(self.elements)})
        steel = ff.Material(self.youngs_modulus, 0.3, self.density)
        sections = [self._section(float(area), steel) for area in areas]

        def number(x: npt.ArrayLike) -> npt.NDArray[np.int64]:
            found = np.floor(np.asarray(x) / self.length * self.elements).astype(np.int64)
            return np.clip(found, 0, self.elements - 1)

        def pull(x: float) -> tuple[float, float, float]:
            return (self.density * areas[int(number(x))] * self.speed**2 * x, 0.0, 0.0)

        def stress(strains: Array, resultants: Array, places: Array) -> Array:
            return resultants[:, 0] / areas[number(places[:, 0])]

        def of(which: int, strains: Array, resultants: Array, places: Array) -> Array:
            own = number(places[:, 0]) == which
            return np.where(own, stress(strains, resultants, places), 0.0)

        tip = ff.Marker("blade", "end")
        model = ff.Model("uniform_stress_blade", mesh=mesh)
        model.add(
            ff.Beam("blade", lambda s: sections[int(number(s))], orientation=(0.0, 1.0, 0.0)),
            ff.Rigid("hub", ff.Ground(), ff.Marker("blade", "start")),
            ff.LineLoad("centrifugal", "blade", pull, breakpoints=points[1:-1, 0].tolist()),
            ff.PointForce("tip", tip, (self.tip_mass * self.speed**2 * self.length, 0.0, 0.0)),
            ff.AggregateProbe("stress", "blade", stress),
            ff.Probe("tip_place", tip, ("stretch",), lambda t, s: (s.position[0] - self.length,)),
        )  # fmt: skip
        if each:
            model.add(
                *(ff.AggregateProbe(f"stress_{k}", "blade", partial(of, k))
                  for k in range(self.elements))
            )  # fmt: skip
        return model

    def _section(self, area: float, steel: ff.Material) -> ff.Section:
        """A rectangle, ``width`` times as wide as high."""
        height = (area / self.width) ** 0.5
        return ff.Section.rectangle(self.width * height, height, steel)


def lightest(
    blade: Blade, most: int, search: ff.ParameterSearch, options: ff.StaticOptions,
    report: Callable[[Mapping[str, float]], None],
) -> ff.FoundParameters:  # fmt: skip
    """Areas of the lightest blade."""
    found = ff.minimize(
        partial(blade.model, each=True), None, search.start, replace(options, load_steps=1),
        cost=blade.mass,
        bounds={"areas": (0.1 * blade.tip_area, None)},
        constraints=[(f"final:stress_{k}", None, blade.limit) for k in range(blade.elements)],
        most=most, tolerance=1e-7, report=report,
    )  # fmt: skip
    areas = np.asarray(found.values["areas"])
    off = float(np.abs(areas / blade.best_areas - 1.0).max())
    mass, _ = blade.mass(areas)
    return ff.FoundParameters(
        found.values, {"mass": mass, "mass_over_best": mass / blade.best_mass, "areas_off": off}
    )


def build(
    *, elements: int, gradients: int, length: float, speed: float, density: float,
    youngs_modulus: float, limit: float, tip_mass: float, width: float,
) -> ff.ParameterSearch:  # fmt: skip
    """The search for the areas of the elements."""
    blade = Blade(elements, length, speed, density, youngs_modulus, limit, tip_mass, width)
    uniform = np.full(elements, blade.tip_area * (1.0 + 2.0 * blade.exponent))
    return ff.ParameterSearch(
        "uniform_stress_blade", blade.model, {"areas": uniform},
        partial(lightest, blade, gradients), analysis="statics",
    )  # fmt: skip


CASE = ff.Case(
    name="uniform_stress_blade",
    summary="the lightest blade on a shaft under a bound on stresses, by their gradients",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 40, "of the blade", minimum=1),
        ff.Option("gradients", int, 40, "most gradients of the search", minimum=1),
        ff.Option("length", float, 0.8, "of the blade from the axis", unit="m", above=0.0),
        ff.Option("speed", float, 300.0, "of the shaft", unit="rad/s", above=0.0),
        ff.Option("density", float, 7850.0, "of the blade", unit="kg/m^3", above=0.0),
        ff.Option("youngs_modulus", float, 2.1e11, "of the blade", unit="Pa", above=0.0),
        ff.Option("limit", float, 2e8, "largest stress", unit="Pa", above=0.0),
        ff.Option("tip_mass", float, 0.15, "at the tip", unit="kg", above=0.0),
        ff.Option("width", float, 6.0, "of the sections over their height", above=0.0),
    ),
    analysis=ff.STATICS,
    load_steps=2,
    smoke={"elements": 4, "gradients": 2},
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
