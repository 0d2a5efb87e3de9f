# SPDX-License-Identifier: LGPL-3.0-or-later
"""The profile of a notch hinge of least stress, by the gradients of a solid.

A block with a notch on either side bends where it is thin: a hinge without play or friction. Round
notches, the usual ones, are thin at one place only, which takes all of the bending. The search
changes the half thickness at ``--numbers`` places along half the notch, between whose logarithms a
spline goes, until the largest of von Mises' stresses is least under a moment that is given, while
the hinge turns as far as the round one, and stretches no more than ``--stretching`` times as much
under ``--pull``: a thin long strip would bend with less stress yet, but is soft along its axis.

The hinge is a solid in plane stress, ``--width`` thick, of Saint Venant and Kirchhoff's law, on
curved quadrilaterals of second order that follow the profile, of which the outer layer is thin, so
that the mean stresses of its cells are nearly those of the surface. One end is fixed, the other one
bears the pull along the axis at the load factor 1/2, and the moment at the load factor 1. A smooth
maximum of the stresses of all cells is minimised (``ff.AggregateProbe`` with ``rho``;
``ff.minimize``, SLSQP); its gradient takes one transposed solve, whatever the numbers. Results with
the round notch are in the folder ``start``.

The moment is that by which J. M. Paros, L. Weisbord (Machine Design 37 (1965) 151-156) turn the
round notch by ``--rotation``. In the end both profiles are computed again on cells of half the
size. ``iterations.csv`` has the smooth maximum (Pa), the angle (rad) and the stretch (m),
``parameters.csv`` the logarithms of the half thicknesses over those of the round notch.

History: ``angle`` of the free end (rad); ``stretch`` of the hinge (m); ``stress``, the largest of
von Mises' stresses of all cells, and ``smooth``, its smooth maximum (Pa).

Expected: the round notch turns 1.04 times as far as by the formula, that of a thin beam. The found
profile has 0.59 times its stress, 0.53 times on the finer cells, which resolve the peak of the
round notch better, turns as far to 2e-3, and stretches 1.15 times as much, after 20 gradients.
Run: ``python cases/design_of_a_flexure.py``, then ``flexfem view results/design_of_a_flexure``.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

import flexfem as ff

Array = npt.NDArray[np.float64]

#: Ticks of cells over the half thickness, of which the last one is the surface layer's.
LAYER = 0.9
#: Largest logarithms of factors of the thickness, and changes of them that are alike.
LARGEST, CHANGE = 2.0, 0.3


@dataclass(frozen=True)
class Hinge:
    """Dimensions, loads and cells of a hinge, SI units."""

    radius: float
    thickness: float
    width: float
    ends: float
    youngs_modulus: float
    poisson_ratio: float
    density: float
    rotation: float
    pull: float
    rho: float
    along: int
    across: int

    @property
    def height(self) -> float:
        """Of the block."""
        return 2.0 * self.radius + self.thickness

    @property
    def moment(self) -> float:
        """Moment that turns the round notch by the rotation, of Paros and Weisbord."""
        b = self.thickness / (2.0 * self.radius)
        c = 2.0 * b + b**2
        most = np.arctan(np.sqrt((2.0 + b) / b)) * 6.0 * (1.0 + b) / c**1.5
        found = (1.0 / (1.0 + b) + (3.0 + c) / ((1.0 + b) * c)) + most
        compliance = 3.0 * found / (2.0 * self.youngs_modulus * self.width * self.radius**2 * c)
        return float(self.rotation / compliance)

    def half_thickness(self, turned: Array, growth: Array) -> Array:
        """Half thickness at angles of the round notch, that of this one times a factor.

        Logarithms (n,) of the factor are given at equal angles from the middle to the end of the
        notch, where it is 1; a spline goes between them.
        """
        knots = np.linspace(-0.5, 0.5, 2 * len(growth) + 1) * np.pi
        values = np.concatenate([[0.0], growth[:0:-1], growth, [0.0]])
        round_one = 0.5 * self.thickness + self.radius * (1.0 - np.cos(turned))
        found: Array = round_one * np.exp(CubicSpline(knots, values)(turned))
        return found

    def mesh(self, growth: Array) -> ff.SolidMesh:
        """Cells between the profile and its mirror image, curved like it."""
        ends = max(2, self.along // 6)
        counts = (self.along + 2 * ends, 2 * self.across)
        cells = ff.SolidMesh.box(counts, counts, "quadrilateral").raised(2)
        s = cells.points[:, 0] - 0.5 * counts[0]
        turned = np.clip(s / self.along, -0.5, 0.5) * np.pi
        beyond = np.maximum(np.abs(s) - 0.5 * self.along, 0.0) * self.ends / ends
        x = self.radius * np.sin(turned) + np.sign(s) * beyond
        ticks = np.append(np.linspace(0.0, LAYER, self.across), 1.0)
        u = cells.points[:, 1] - self.across
        y = np.sign(u) * np.interp(np.abs(u), np.arange(self.across + 1), ticks)
        y = y * self.half_thickness(turned, growth)
        end = s == s.max()
        made = cells.moved(np.column_stack([x, y, 0.0 * x]))
        return made.with_surfaces(
            fixed=lambda p: s == s.min(), upper=lambda p: end & (u > -0.1),
            lower=lambda p: end & (u < 0.1),
        )  # fmt: skip

    def model(self, growth: Array) -> ff.Model:
        """The hinge with a profile, see :meth:`half_thickness`."""
        mesh, h, b = self.mesh(growth), self.height, self.width
        law = ff.laws.SaintVenantKirchhoff(self.youngs_modulus, self.poisson_ratio)
        at = self.radius + self.ends
        corners = [ff.Marker("hinge", (at, side * 0.5 * h, 0.0)) for side in (1.0, -1.0)]
        bend = ff.Table((0.0, 0.5, 1.0), (0.0, 0.0, 1.0))
        tear = ff.Table((0.0, 0.5, 1.0), (0.0, 1.0, 0.0))
        couple = np.array([4.0 * self.moment / (b * h**2), 0.0, 0.0])
        along = np.array([self.pull / (b * h), 0.0, 0.0])
        model = ff.Model("design_of_a_flexure")
        model.add(
            ff.Solid(
                "hinge", law, mesh, density=self.density, plane="stress", thickness=b,
                fixed={"fixed": "xy"},
            ),
            ff.SurfaceTraction("couple_upper", "hinge", "upper", -couple, amplitude=bend),
            ff.SurfaceTraction("couple_lower", "hinge", "lower", couple, amplitude=bend),
            ff.SurfaceTraction("pull_upper", "hinge", "upper", along, amplitude=tear),
            ff.SurfaceTraction("pull_lower", "hinge", "lower", along, amplitude=tear),
            ff.Probe("end", corners, ("angle", "stretch"), partial(turned_and_stretched, at)),
            ff.AggregateProbe("stress", "hinge", von_mises),
            ff.AggregateProbe("smooth", "hinge", von_mises, rho=self.rho),
        )  # fmt: skip
        return model


def turned_and_stretched(
    at: float, t: float, upper: ff.MarkerState, lower: ff.MarkerState
) -> tuple[float, float]:
    """Angle and displacement along the axis of the end at ``at``."""
    side = upper.position - lower.position
    return float(np.arctan2(-side[0], side[1])), 0.5 * (upper.position + lower.position)[0] - at


def von_mises(strains: Array, stresses: Array, places: Array) -> Array:
    """Von Mises' stresses (m,) of stresses (m, 6)."""
    normal, shear = stresses[:, :3], stresses[:, 3:]
    around = normal - np.roll(normal, 1, axis=1)
    found: Array = np.sqrt(0.5 * (around**2).sum(axis=1) + 3.0 * (shear**2).sum(axis=1))
    return found


def least_stress(
    hinge: Hinge, stretching: float, gradients: int, search: ff.ParameterSearch,
    options: ff.StaticOptions, report: Callable[[Mapping[str, float]], None],
) -> ff.FoundParameters:  # fmt: skip
    """The profile of least stress."""
    options = replace(options, t_end=1.0, load_steps=2)
    before = figures(hinge, np.asarray(search.start["growth"]), options)
    found = ff.minimize(
        search.build, "final:smooth", search.start, options,
        bounds={"growth": (-LARGEST, LARGEST)}, scale={"growth": CHANGE},
        constraints=[
            ("final:angle", before["angle"], None),
            ("max:stretch", None, stretching * before["stretch"]),
        ],
        most=gradients, tolerance=3e-4, report=report,
    )  # fmt: skip
    growth = np.asarray(found.values["growth"])
    finer = replace(hinge, along=2 * hinge.along, across=2 * hinge.across)
    names = {"": hinge, "_on_finer_cells": finer}
    after = {name: figures(one, growth, options) for name, one in names.items()}
    round_one = {name: figures(one, 0.0 * growth, options) for name, one in names.items()}
    results = {
        f"{key}_ratio{name}": after[name][key] / round_one[name][key]
        for name in names for key in before
    }  # fmt: skip
    results["angle_of_round_over_formula"] = round_one["_on_finer_cells"]["angle"] / hinge.rotation
    return ff.FoundParameters(found.values, results)


def figures(hinge: Hinge, growth: Array, options: ff.StaticOptions) -> dict[str, float]:
    """Angle and stress under the moment, and stretch under the pull, on all ranks (collective)."""
    from mpi4py import MPI

    history = MPI.COMM_WORLD.bcast(ff.solve_static(hinge.model(growth), options).history)
    found = {
        "angle": history["angle"][-1], "stress": history["stress"][-1],
        "stretch": max(history["stretch"]),
    }  # fmt: skip
    return {name: float(value) for name, value in found.items()}


def build(
    *, numbers: int, gradients: int, stretching: float, radius: float, thickness: float,
    width: float, ends: float, youngs_modulus: float, poisson_ratio: float, density: float,
    rotation: float, pull: float, rho: float, along: int, across: int,
) -> ff.ParameterSearch:  # fmt: skip
    """The search for the half thicknesses."""
    hinge = Hinge(
        radius, thickness, width, ends, youngs_modulus, poisson_ratio, density, rotation, pull,
        rho, along, across,
    )  # fmt: skip
    return ff.ParameterSearch(
        "design_of_a_flexure", hinge.model, {"growth": np.zeros(numbers)},
        partial(least_stress, hinge, stretching, gradients), analysis="statics",
    )  # fmt: skip


CASE = ff.Case(
    name="design_of_a_flexure",
    summary="the profile of a notch hinge of least stress, by the gradients of a solid",
    description=__doc__,
    build=build,
    options=(
        ff.Option("numbers", int, 6, "half thicknesses along half the notch", minimum=4),
        ff.Option("gradients", int, 20, "most gradients of the search", minimum=1),
        ff.Option("stretching", float, 1.25, "most stretch over that of the round notch",
                  minimum=1.0),
        ff.Option("radius", float, 5e-3, "of the round notch, half the length of any",
                  unit="m", above=0.0),
        ff.Option("thickness", float, 5e-4, "of the round notch where it is thin", unit="m",
                  above=0.0),
        ff.Option("width", float, 1e-2, "of the block", unit="m", above=0.0),
        ff.Option("ends", float, 4e-3, "length of the block on either side of the notch",
                  unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 7.1e10, "of the block", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.33, "of the block", minimum=0.0, maximum=0.49),
        ff.Option("density", float, 2800.0, "of the block", unit="kg/m^3", above=0.0),
        ff.Option("rotation", float, 0.03, "of the round notch by its formula", unit="rad",
                  above=0.0),
        ff.Option("pull", float, 100.0, "along the axis", unit="N", above=0.0),
        ff.Option("rho", float, 2e-7, "of the smooth maximum", unit="1/Pa", above=0.0),
        ff.Option("along", int, 20, "cells along the notch", minimum=4),
        ff.Option("across", int, 2, "cells over half the thickness", minimum=2),
    ),
    analysis=ff.STATICS,
    load_steps=2,
    smoke={"numbers": 4, "gradients": 1, "along": 4, "across": 2},
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
