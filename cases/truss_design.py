# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tubes of the lightest deployable truss: a bound on stresses of all members at all times.

The tubes of ``deployable_truss`` are all alike. Here members of a kind in a bay, or each of them
(``--groups members``), have outer diameters of their own, of which the inner one is the same part
everywhere. The mass is least while two largest values of the deployment stay below ``--stressed``
and ``--loosest`` times those of equal tubes (0 for any): von Mises' stress at the most stressed
fibre of each element, and the deviation of the lower corner D of the last frame from its place with
rigid members. Stresses of all elements are one smooth maximum (``ff.AggregateProbe``), over time
there is another one, and each gradient by all diameters takes one motion and its adjoint. Smooth
maxima lie below the largest values: by how much is measured before each of two rounds, of which the
second one is closer to them.

Members are NURBS beams: along posts of SE(3) elements the motion jumps with the diameters, as the
lines on which braces slide have kinks at their nodes. There are no latches, which have no
derivatives. The other options are those of ``deployable_truss``.

``iterations.csv`` has the mass over that of equal tubes, the smooth maximum of logarithms of
stresses over the limit, and that of the square of the deviation over its own one;
``parameters.csv`` the diameters (mm), the folder ``start`` the results of equal tubes.

History: ``stress``, the largest one of all members, and ``stress_post, stress_rung, stress_lower,
stress_upper, stress_brace, stress_deck`` of those of a kind, Pa; and that of ``deployable_truss``:
``D_x, D_z``, lower corner of the last frame at y = 0, m; ``beta``, the angle that the drives
prescribe (rad), and ``error_x, error_z``, the deviation of D from its place with rigid members, m;
``beta_1, beta_2, ...``, angles (rad) between frame and lower cross-bar at y = 0, at the first and
the second end of every bay.

Expected: two bays with the cosine profile, of two elements in each member, are lighter by 69 %
after ten gradients, in five minutes on two ranks: the driven cross-bars have 47.7 and 41.2 mm, the
upper ones of the second bay 39.7 mm, all other tubes the least diameter, 30 mm. The deviation is as
large as that of equal tubes, and the largest stress 0.58 of theirs. One bay is lighter by 70 %.
Run: ``mpirun -n 2 python cases/truss_design.py``.
"""

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

import flexfem as ff

Array = npt.NDArray[np.float64]
BASE = ff.load_case("deployable_truss")
#: Kinds of members by the first words of their names.
KINDS = {
    "post": "post", "bottom": "rung", "top": "rung", "lower": "lower", "upper": "upper",
    "brace": "brace", "floor": "deck", "roof": "deck",
}  # fmt: skip
#: Exponents of the smooth maxima, one after the other: the larger, the closer to the largest value,
#: and the harder to follow.
SHARP = (20.0, 60.0)
#: Part of the limit at which stresses by a pull and by bending are rounded off, which have kinks at
#: zero: members at rest, and those in which a pull becomes a push.
SMALL = 1e-3
#: Columns of the deviation of D.
ERRORS = ("error_x", "error_z")
#: Options of ``deployable_truss`` that are not here.
FIXED = {"formulation": "nurbs", "modes": 0, "latch": False, "gravity": 1.0}


@dataclass(frozen=True)
class Design:
    """A truss of tubes whose outer diameters are to be found, SI units.

    Attributes:
        base: the truss with equal tubes.
        members: names of all members.
        group: (members,) number of the diameter of each.
        lines: (members, 2, 3) their ends at the start.
        outer: diameter of the tubes of ``base``.
        inner: inner over outer diameter of all tubes.
        metal: of all tubes.
    """

    base: ff.Model
    members: list[str]
    group: npt.NDArray[np.int64]
    lines: Array
    outer: float
    inner: float
    metal: ff.Material

    @property
    def count(self) -> int:
        """Number of diameters."""
        return int(self.group.max()) + 1

    def mass(self, sizes: Array) -> tuple[float, Mapping[str, Array]]:
        """Mass over that of equal tubes, with its derivatives; see :meth:`model`."""
        lengths = np.linalg.norm(self.lines[:, 1] - self.lines[:, 0], axis=1)
        parts = np.bincount(self.group, lengths / lengths.sum()) * np.exp(2.0 * sizes)
        return float(parts.sum()), {"sizes": 2.0 * parts}

    def model(self, sizes: Array) -> ff.Model:
        """The truss with columns of the largest stresses of all members and of each kind.

        Args:
            sizes: logarithms of outer diameters over ``outer``, (count,).
        """
        model = self._truss(sizes)
        stress = partial(self.stress, sizes)
        kinds = dict.fromkeys(KINDS.values())
        model.add(ff.AggregateProbe("stress", self.members, stress))
        for kind in kinds:
            own = [name for name in self.members if KINDS[name.split("_")[0]] == kind]
            model.add(ff.AggregateProbe(f"stress_{kind}", own, stress))
        return model

    def lean(self, sizes: Array, *, rho: float, limit: float) -> ff.Model:
        """The truss with the columns of a search.

        ``used`` is a smooth maximum over all members of logarithms of stresses over the limit, in
        which they are nearly linear in the sizes.
        """

        def used(*given: Array) -> Array:
            found: Array = np.log(self.stress(sizes, *given, least=SMALL * limit) / limit)
            return found

        model = self._truss(sizes, lean=True)
        model.add(
            ff.AggregateProbe("used", self.members, used, rho),
            ff.AggregateProbe("stress", self.members, partial(self.stress, sizes)),
        )
        return model

    def stress(
        self, sizes: Array, strains: Array, resultants: Array, places: Array, least: float = 0.0
    ) -> Array:
        """Von Mises' stress (m,) at the most stressed fibre of elements, Pa.

        With ``least`` (Pa) it is a smooth function.
        """
        outer = self.outer * np.exp(sizes[self.group[self._member(places)]])
        area = 0.25 * math.pi * outer**2 * (1.0 - self.inner**2)
        modulus = math.pi / 32.0 * outer**3 * (1.0 - self.inner**4)
        pull, _, _, torque, *bending = resultants.T
        normal = np.hypot(pull / area, least)
        normal += np.hypot(np.hypot(*bending) / modulus, least)
        found: Array = np.sqrt(normal**2 + 3.0 * (0.5 * torque / modulus) ** 2)
        return found

    def _member(self, places: Array) -> npt.NDArray[np.int64]:
        """Numbers of the members on whose lines places (m, 3) are."""
        first, last = self.lines[:, 0], self.lines[:, 1]
        along = last - first
        from_first = places[:, np.newaxis] - first
        share = (from_first * along).sum(axis=2) / (along**2).sum(axis=1)
        beside = from_first - np.clip(share, 0.0, 1.0)[..., np.newaxis] * along
        found: npt.NDArray[np.int64] = (beside**2).sum(axis=2).argmin(axis=1)
        return found

    def _truss(self, sizes: Array, *, lean: bool = False) -> ff.Model:
        """The truss with its probes, or with that of the deviations alone."""
        tubes = [
            ff.Section.tube(self.inner * outer, outer, self.metal)
            for outer in (self.outer * np.exp(sizes)).tolist()
        ]
        of = dict(zip(self.members, self.group, strict=True))
        model = ff.Model("truss_design", mesh=self.base.mesh)
        for thing in self.base.things:
            if isinstance(thing, ff.Beam):
                model.add(replace(thing, section=tubes[of[thing.name]]))
            elif not lean or thing.name == "path" or not hasattr(thing, "columns"):
                model.add(thing)
        return model


def largest(values: Array, rho: float) -> float:
    """Smooth maximum over time, as "ks" of a column."""
    top = float(values.max())
    return top + math.log(np.exp(rho * (values - top)).mean()) / rho


def square(history: Mapping[str, Array]) -> Array:
    """Square of the deviation of D over time, m^2."""
    found: Array = history["error_x"] ** 2 + history["error_z"] ** 2
    return found


def deviation(rho: float, scale: float) -> ff.Functional:
    """Smooth maximum over time of the square of the deviation of D over a scale, m^2."""

    def derivative(history: Mapping[str, Array]) -> Array:
        values = square(history) / scale
        weights = np.exp(rho * (values - values.max()))
        weights *= 2.0 / scale / weights.sum()
        return np.array([weights * history[name] for name in ERRORS])

    return ff.Functional(
        "deviation", ERRORS, lambda history: largest(square(history) / scale, rho), derivative
    )


@dataclass(frozen=True)
class Bounds:
    """What holds the diameters back.

    Attributes:
        thinnest, thickest: least and largest diameter over that of equal tubes.
        stressed: largest stress over that of equal tubes.
        loosest: largest deviation over that of equal tubes; 0 for any.
        most: largest number of gradients.
        tolerance: relative change of the mass at which a round ends.
    """

    thinnest: float
    thickest: float
    stressed: float
    loosest: float
    most: int
    tolerance: float


def lightest(
    design: Design, bounds: Bounds, search: ff.ParameterSearch, options: ff.RunOptions,
    report: Callable[[Mapping[str, float]], None],
) -> ff.FoundParameters:  # fmt: skip
    """Diameters of the lightest truss.

    Smooth maxima lie below the largest values: by how much is measured before each round, and their
    bounds are lowered accordingly (Le et al., Struct. Multidisc. Optim. 41 (2010) 605-620).
    """
    from mpi4py import MPI

    sizes, count = np.asarray(search.start["sizes"]), 0

    def measured(rho: float, limit: float) -> Mapping[str, Array]:
        outcome = ff.simulate(design.lean(sizes, rho=rho, limit=limit), options)
        history: Mapping[str, Array] = MPI.COMM_WORLD.bcast(outcome.history)
        return history

    equal = measured(SHARP[0], 1.0)
    limit, scale = float(equal["stress"].max()), float(square(equal).max())
    for rho in SHARP:
        now = measured(rho, limit)
        below = largest(now["used"], rho) - math.log(now["stress"].max() / limit)
        limits: list[tuple[str | ff.Functional, None, float]] = [
            ("ks:used", None, math.log(bounds.stressed) + below)
        ]
        if bounds.loosest:
            off = square(now) / scale
            below = largest(off, rho) - float(off.max())
            limits.append((deviation(rho, scale), None, bounds.loosest**2 + below))
        found = ff.minimize(
            partial(design.lean, rho=rho, limit=limit), None, {"sizes": sizes}, options,
            cost=design.mass, constraints=limits, ks_rho=rho,
            bounds={"sizes": (math.log(bounds.thinnest), math.log(bounds.thickest))},
            most=max(bounds.most - count, 1), tolerance=bounds.tolerance, report=report,
        )  # fmt: skip
        sizes, count = np.asarray(found.values["sizes"]), count + found.gradients
    now = measured(SHARP[-1], limit)
    outer = 1e3 * design.outer
    return ff.FoundParameters(
        {"sizes": sizes},
        {
            "mass_over_start": design.mass(sizes)[0],
            "stress_over_start": float(now["stress"].max()) / limit,
            "deviation_over_start": math.sqrt(square(now).max() / scale),
            "gradients": float(count),
        },
        {"diameter_start": {"sizes": outer * np.exp(np.asarray(search.start["sizes"]))},
         "diameter_found": {"sizes": outer * np.exp(sizes)}},
    )  # fmt: skip


def build(
    *, groups: str, thinnest: float, thickest: float, stressed: float, loosest: float,
    gradients: int, accuracy: float, **given: Any,
) -> ff.ParameterSearch:  # fmt: skip
    """The search for the diameters of groups of members."""
    base = BASE.build(**given, **FIXED)
    assert base.mesh is not None
    members = [thing.name for thing in base.things if isinstance(thing, ff.Beam)]
    keys = [name if groups == "members" else kind(name) for name in members]
    order = list(dict.fromkeys(keys))
    cells = [base.mesh.group_cells(name) for name in members]
    design = Design(
        base, members, np.array([order.index(key) for key in keys]),
        np.array([base.mesh.points[[one[0, 0], one[-1, 1]]] for one in cells]),
        1e-3 * given["outer_diameter"], given["inner_diameter"] / given["outer_diameter"],
        ff.Material(given["youngs_modulus"], given["poisson_ratio"], given["density"]),
    )  # fmt: skip
    bounds = Bounds(thinnest, thickest, stressed, loosest, gradients, accuracy)
    return ff.ParameterSearch(
        "truss_design", design.model, {"sizes": np.zeros(len(order))},
        partial(lightest, design, bounds),
    )  # fmt: skip


def kind(member: str) -> str:
    """Kind of a member, with the number of its frame or bay."""
    first, *_, number = member.split("_")
    return f"{KINDS[first]}_{number}"


CASE = ff.Case(
    name="truss_design",
    summary="tubes of the lightest deployable truss of the same stress, by their gradients",
    description=__doc__,
    build=build,
    options=(
        ff.Option("groups", str, "kinds", "members of one diameter: those of a kind in a bay, or "
                  "each its own", choices=("kinds", "members")),
        ff.Option("thinnest", float, 0.5, "least diameter over that of equal tubes", above=0.0,
                  maximum=1.0),
        ff.Option("thickest", float, 2.0, "largest diameter over it", minimum=1.0),
        ff.Option("stressed", float, 1.0, "largest stress over that of equal tubes", above=0.0),
        ff.Option("loosest", float, 1.0, "largest deviation over that of equal tubes, 0 for any",
                  minimum=0.0),
        ff.Option("gradients", int, 40, "most gradients of the search", minimum=1),
        ff.Option("accuracy", float, 1e-3, "change of the mass at which a round of it ends",
                  above=0.0),
        *(
            replace(
                one, default={"elements": 2}.get(one.name, one.default),
                choices=tuple(x for x in one.choices or () if x != "gravity") or None,
            )
            for one in BASE.options
            if one.name not in FIXED
        ),
    ),
    dt=0.2,
    t_end=20.0,
    smoke={"bays": 1, "elements": 1, "control": "cycloid", "gradients": 1, "dt": 0.1, "t_end": 0.2},
    results=BASE.results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
