# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stiffnesses of all elements of a swinging rod from the path of its tip, as echoes tell them.

A rod swings on a hinge, and is tapped at its tip when it starts. The stiffness of each element is
another one, all of its numbers by the same factor: 1 - ``--off`` or 1 + ``--off`` by chance. They
are sought, from the mean for all. What is measured is the path of the tip, which is computed here
(a twin), with a noise of ``--noise`` if one likes.

Waves of the tap run along the rod, and each change of its stiffness sends a part of them back: the
last of n elements is heard after the time of a wave over 2 n of them. A tap as short as a wave over
``--duration`` elements, and two steps an element, tell neighbours apart.

Unknown is for each element 1 + log(factor), its ``level``: stiffnesses remain positive. In motions
of wrong stiffnesses waves come too early or late by more than their length, and a fit to the whole
path at once ends in a wrong minimum. Therefore the fit (``flexfem.identify``: all derivatives of
the path from the linearised motion) advances: the first motion is so short that echoes of
``--advance`` elements at the tip are heard, and each further one hears as many more. Levels of all
elements heard are corrected after each, and a prior, with the deviation ``--off``, holds the others
at the mean.
A motion with all derivatives costs what a step of the fit costs; there are ``--motions`` at most.

``iterations.csv`` has a row for each motion, which is printed as it comes: its end (``t_end``, s),
what is ``left`` (the root of the mean square over the path, m, and the prior in the same measure)
and the largest ``change`` of a level since the one before; ``parameters.csv`` the levels, their
standard errors and the true ones; the summary the largest error of a stiffness. The folder
``start`` has the motion of equal elements. Where the truth is not known, ``left`` tells whether it
was found: it is then no more than the noise.

History: tip_x, tip_z (path of the tip, m).

Expected: all 20 stiffnesses to 1e-10 after 14 motions, which take 20 s; with ``--elements 40
--seed 2 --dt 2.07e-4`` all 40 to 1e-9 after 21, in a minute; with ``--elements 100 --dt 8.3e-5``
all 100 to 4.8e-7 after 44, in 23 minutes of one processor, the path to 3.3e-10 m. With n elements
``--dt`` is 0.0083 s / n. Run: ``mpirun -n 2 python cases/identification_twin.py``.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

import flexfem as ff

Array = npt.NDArray[np.float64]
PATH = ("tip_x", "tip_z")
#: Errors of the computed path, m: its noise at least.
COMPUTED = 1e-9


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

    def model(self, levels: Array) -> ff.Model:
        """The rod by levels of its elements."""
        mesh = ff.LineMesh.straight(
            {"rod": [(0.0, 0.0, 0.0), (self.length, 0.0, 0.0)]}, len(levels)
        )
        sections = [self._section(float(np.exp(one - 1.0))) for one in levels]
        root, tip = ff.Marker("rod", "start"), ff.Marker("rod", "end")
        model = ff.Model("identification_twin", mesh=mesh)
        model.add(
            ff.Gravity((0.0, 0.0, -9.81)),
            ff.Beam(
                "rod", lambda s: sections[min(int(s / self.length * len(levels)), len(levels) - 1)],
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
    off: float
    advance: float
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
    """Levels that fit the path of the tip."""
    noise = max(fit.noise, COMPUTED)
    found = ff.identify(
        search.build, fit.measured(rod, options), search.start, options,
        noise=dict.fromkeys(PATH, noise), prior={"levels": (1.0, fit.off)},
        advance=max(2.0 * fit.advance * rod.passage, options.dt), most=fit.motions,
        report=lambda row: report({**row, "left": row["left"] * noise}),
    )  # fmt: skip
    levels = np.asarray(found.values["levels"])
    largest = float(np.abs(np.expm1(levels - fit.truth)).max())
    low, high = found.interval("levels")
    within = (low <= fit.truth) & (fit.truth <= high)
    return ff.FoundParameters(
        {"levels": levels},
        {
            "largest_error": largest,
            "left": found.noise * noise,
            "motions": float(found.motions),
            "within_intervals": float(within.sum()),
        },
        {"error": {"levels": found.errors["levels"]}, "truth": {"levels": fit.truth}},
    )


def build(
    *, elements: int, advance: float, motions: int, off: float, noise: float, seed: int,
    length: float, height: float, youngs_modulus: float, density: float, speed: float,
    tap: float, duration: float,
) -> ff.ParameterSearch:  # fmt: skip
    """The search for the levels of all elements."""
    rod = Rod(elements, length, height, youngs_modulus, density, speed, tap, duration)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], elements)
    fit = Fit(1.0 + np.log1p(off * signs), max(off, 1e-3), advance, motions, 1e-6 * noise, seed)
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
        ff.Option("advance", float, 3.0, "elements that each motion hears more", above=0.0),
        ff.Option("motions", int, 60, "most motions, with all derivatives each", minimum=1),
        ff.Option("off", float, 0.3, "relative error of each stiffness at the start", minimum=0.0,
                  maximum=0.9),
        ff.Option("noise", float, 0.0, "standard deviation of the path", unit="um", minimum=0.0),
        ff.Option("seed", int, 1, "of the stiffnesses and the noise", minimum=0),
        ff.Option("length", float, 1.0, "of the rod", unit="m", above=0.0),
        ff.Option("height", float, 0.02, "of its square section", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 4e6, "mean", unit="Pa", above=0.0),
        ff.Option("density", float, 1100.0, "of the rod", unit="kg/m^3", above=0.0),
        ff.Option("speed", float, 0.3, "with which it swings at the start", unit="rad/s"),
        ff.Option("tap", float, 10.0, "largest force along the rod at its tip", unit="N"),
        ff.Option("duration", float, 3.0, "of the tap, in elements that a wave passes", above=0.0),
    ),
    dt=4e-4,
    t_end=0.0416,
    rho_inf=1.0,
    tolerance=1e-10,
    smoke={"elements": 4, "motions": 1, "t_end": 4e-3},
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
