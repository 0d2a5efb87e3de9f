# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stiffnesses of all elements of a swinging rod from the path of its tip, as echoes tell them.

A rod swings on a hinge, and is tapped at its tip when it starts. The stiffness of each element is
another one, all of its numbers by the same factor: 1 - ``--off`` or 1 + ``--off`` by chance. They
are sought, from the mean for all. What is measured is the path of the tip, which is computed here
(a twin), with a noise of ``--noise`` if one likes.

Waves of the tap, and those of the centrifugal force that sets in, run along the rod, and each
change of its stiffness sends a part of them back: the last of n elements is heard after the time of
a wave over 2 n of them. A tap as short as a wave over ``--duration`` elements, and two steps an
element, tell neighbours apart: at the true stiffnesses the singular values of the derivatives of
the path lie within a factor of 150 with 20 elements, of 12,000 with 100.

Unknown is for each element 1 + log(factor), its ``level``: stiffnesses remain positive. The fit
(``flexfem.identify``: all derivatives of the path from the linearised motion) goes along the rod:
the first of ``--windows`` ends when waves come back from the elements next to the tip, which alone
are unknown in it, and each further one adds as many. So waves never come too early or late by their
own length, as they would in a fit of all at once, which may then end in a wrong minimum.

``iterations.csv`` has the unknown elements of each window, its motions, what is left of the path
(the root of the mean square, m) and the largest error of a stiffness; ``parameters.csv`` the
levels, their standard errors and the true ones. The folder ``start`` has the motion of equal
elements.

History: tip_x, tip_z (path of the tip, m).

Expected: all 20 stiffnesses to 1e-11 after 14 motions, which take 20 s. With ``--noise 0.1`` they
are off by 3e-4 at most, all within their intervals of 95 %. 40 and more are not found from 30 %
aside: windows end in wrong minima, which ``largest_error`` shows here, and ``left`` where the truth
is not known. Run:
``mpirun -n 2 python cases/identification_twin.py``.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

import flexfem as ff

Array = npt.NDArray[np.float64]
PATH = ("tip_x", "tip_z")


@dataclass(frozen=True)
class Rod:
    """What is given of a rod and its tap, SI units."""

    elements: int
    length: float
    height: float
    youngs_modulus: float
    density: float
    speed: float
    tap: float
    duration: float

    @property
    def passage(self) -> float:
        """Time of a wave along a mean element, s."""
        speed = (self.youngs_modulus / self.density) ** 0.5
        return self.length / self.elements / float(speed)

    def model(self, levels: Array, others: Array | None = None) -> ff.Model:
        """The rod by levels of its elements, behind those of ``others`` next to the hinge."""
        every = levels if others is None else np.concatenate([others, levels])
        mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (self.length, 0.0, 0.0)]}, len(every))
        sections = [self._section(float(np.exp(one - 1.0))) for one in every]
        root, tip = ff.Marker("rod", "start"), ff.Marker("rod", "end")
        model = ff.Model("identification_twin", mesh=mesh)
        model.add(
            ff.Gravity((0.0, 0.0, -9.81)),
            ff.Beam(
                "rod", lambda s: sections[min(int(s / self.length * len(every)), len(every) - 1)],
                angular_velocity=(0.0, self.speed, 0.0),
            ),
            ff.Revolute("hinge", ff.Ground(), root, axis=(0.0, 1.0, 0.0)),
            ff.PointForce(
                "tap", tip, (-self.tap, 0.0, 0.05 * self.tap), follower=True, amplitude=self._pulse
            ),
            ff.Probe("path", tip, PATH, lambda t, end: (end.position[0], end.position[2])),
        )  # fmt: skip
        return model

    def _section(self, factor: float) -> ff.Section:
        material = ff.Material(self.youngs_modulus * factor, 0.3, self.density)
        return ff.Section.rectangle(self.height, self.height, material)

    def _pulse(self, t: float) -> float:
        """The tap over time, of a wave over ``duration`` elements."""
        x = t / (self.duration * self.passage)
        return float(np.sin(np.pi * x) ** 2) if 0.0 < x < 1.0 else 0.0


@dataclass(frozen=True)
class Fit:
    """How the stiffnesses are sought."""

    truth: Array
    windows: int
    first_motions: int
    motions: int
    noise: float
    seed: int

    def measured(self, rod: Rod, options: ff.RunOptions) -> Mapping[str, Array]:
        """Path of the true rod's tip with noise, on all ranks (collective)."""
        from mpi4py import MPI

        random = np.random.default_rng(self.seed + 1)
        history = MPI.COMM_WORLD.bcast(ff.simulate(rod.model(self.truth), options).history)
        return {
            name: history[name] + self.noise * random.standard_normal(len(history["t"]))
            for name in PATH
        }


def identified(
    rod: Rod, fit: Fit, search: ff.ParameterSearch, options: ff.RunOptions,
    report: Callable[[Mapping[str, float]], None],
) -> ff.FoundParameters:  # fmt: skip
    """Levels that fit the path of the tip, window after window."""
    measured, levels = fit.measured(rod, options), np.array(search.start["levels"])
    noise = dict.fromkeys(PATH, fit.noise) if fit.noise else None
    motions, steps = 0, round(options.t_end / options.dt)
    for window in range(1, fit.windows + 1):
        count, last = round(rod.elements * window / fit.windows), window == fit.windows
        end = steps if last else min(steps, round(2 * count * rod.passage / options.dt))
        found = ff.identify(
            partial(rod.model, others=levels[:-count]),
            {name: column[: end + 1] for name, column in measured.items()},
            {"levels": levels[-count:]}, replace(options, t_end=end * options.dt),
            noise=noise, most=fit.motions if last else fit.first_motions,
        )  # fmt: skip
        levels[-count:], motions = found.values["levels"], motions + found.motions
        largest = float(np.abs(np.expm1(levels - fit.truth))[-count:].max())
        report({
            "unknown": count, "motions": found.motions, "left": found.noise * (fit.noise or 1.0),
            "largest_error": largest,
        })  # fmt: skip
    low, high = found.interval("levels")
    within = (low <= fit.truth) & (fit.truth <= high)
    return ff.FoundParameters(
        {"levels": levels},
        {
            "largest_error": largest,
            "motions": float(motions),
            "within_intervals": float(within.sum()),
        },
        {"error": {"levels": found.errors["levels"]}, "truth": {"levels": fit.truth}},
    )


def build(
    *, elements: int, windows: int, first_motions: int, motions: int, off: float, noise: float,
    seed: int, length: float, height: float, youngs_modulus: float, density: float, speed: float,
    tap: float, duration: float,
) -> ff.ParameterSearch:  # fmt: skip
    """The search for the levels of all elements."""
    rod = Rod(elements, length, height, youngs_modulus, density, speed, tap, duration)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], elements)
    fit = Fit(
        1.0 + np.log1p(off * signs), min(windows, elements), first_motions, motions, 1e-6 * noise,
        seed,
    )  # fmt: skip
    return ff.ParameterSearch(
        "identification_twin", rod.model, {"levels": np.ones(elements)},
        partial(identified, rod, fit),
    )  # fmt: skip


CASE = ff.Case(
    name="identification_twin",
    summary="stiffnesses of all elements of a swinging rod from the path of its tip",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 20, "of the rod, a stiffness each", minimum=1),
        ff.Option("windows", int, 2, "of time, each for more elements from the tip", minimum=1),
        ff.Option("first_motions", int, 6, "most motions of a window but the last", minimum=1),
        ff.Option("motions", int, 25, "most motions of the last window", minimum=1),
        ff.Option("off", float, 0.3, "relative error of each stiffness at the start", minimum=0.0,
                  maximum=0.9),
        ff.Option("noise", float, 0.0, "standard deviation of the path", unit="um", minimum=0.0),
        ff.Option("seed", int, 1, "of the stiffnesses and the noise", minimum=0),
        ff.Option("length", float, 1.0, "of the rod", unit="m", above=0.0),
        ff.Option("height", float, 0.02, "of its square section", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 4e6, "mean", unit="Pa", above=0.0),
        ff.Option("density", float, 1100.0, "of the rod", unit="kg/m^3", above=0.0),
        ff.Option("speed", float, 10.0, "with which it swings at the start", unit="rad/s"),
        ff.Option("tap", float, 10.0, "largest force along the rod at its tip", unit="N"),
        ff.Option("duration", float, 4.0, "of the tap, in elements that a wave passes", above=0.0),
    ),
    dt=4e-4,
    t_end=0.0416,
    rho_inf=1.0,
    tolerance=1e-10,
    smoke={"elements": 4, "windows": 1, "motions": 1, "t_end": 4e-3},
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
