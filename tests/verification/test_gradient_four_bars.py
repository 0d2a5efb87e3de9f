# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradient of a four-bar mechanism with a misaligned joint: the example of TACS, by its widths.

Bars of Bauchau, Betsch, Cardona and others (2016), with weight, driven at -0.6 rad/s. The
functional is that of the example ``four_bar_mechanism`` of TACS (Boopathy, Kennedy, AIAA J. 57
(2019) 3159-3172): the Kreisselmeier-Steinhauser function, with rho = 100, of ``E w^2 |e0| / 1e4``
over all elements and steps, ``e0`` the axial strain. It prints no value to compare with.
"""

from dataclasses import replace
from functools import partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.core.differences import STENCIL
from tests.histories import columns
from tests.verification.benchmarks.flexible_four_bars import build

COMM = MPI.COMM_WORLD
STEEL = ff.Material(207e9, 0.3, 7800.0)
WIDTHS = {"wide": 0.016, "narrow": 0.008}
RHO = 100.0


def bars(elements: int, wide: float, narrow: float) -> ff.Model:
    """Bars 1 and 2 of one width, and bar 3 of another."""
    base = build(elements)
    sections = {
        name: ff.Section.rectangle(width, width, STEEL, shear_factor=0.8282)
        for name, width in (("bar_1", wide), ("bar_2", wide), ("bar_3", narrow))
    }

    def used(strains: np.ndarray, resultants: np.ndarray, places: np.ndarray) -> np.ndarray:
        width = np.where(places[:, 0] > 0.2399, narrow, wide)  # the third one is at x = 0.24
        return STEEL.youngs_modulus * width**2 * np.abs(strains[:, 0]) / 1e4

    model = ff.Model("four_bars", mesh=base.mesh)
    for thing in base.things:
        if isinstance(thing, ff.Beam):
            model.add(replace(thing, section=sections[thing.name]))
        elif not isinstance(thing, ff.StrainProbe):
            model.add(thing)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.AggregateProbe("used", sections, used, rho=RHO),
    )
    return model


def smooth(history: dict[str, np.ndarray]) -> float:
    """Of ``used`` over all rows, "ks" of a gradient."""
    used = history["used"]
    return float(used.max() + np.log(np.exp(RHO * (used - used.max())).mean()) / RHO)


def compared(elements: int, options: ff.RunOptions, accuracy: float) -> None:
    """The gradient by both widths against differences of motions."""
    model = partial(bars, elements)
    found = ff.gradient(
        model, "ks:used", WIDTHS, options, ks_rho=RHO, accuracy=1e-12, check=True
    )  # fmt: skip
    by = found.gradient["ks:used"]
    # the tangent is the transposed adjoint: what one of them lacks is 1e-6 and more
    assert found.check["ks:used"] < 1e-9
    for name, width in WIDTHS.items():
        slope = 0.0
        for part, weight in STENCIL:
            values = {**WIDTHS, name: width * (1.0 + 1e-3 * part)}
            history = columns(ff.simulate(model(**values), options))
            slope += weight / (1e-3 * width) * smooth(history)
        # a width that is missed in the elements that are not the most strained ones is off by half
        assert by[name] == pytest.approx(slope, rel=accuracy)


@pytest.mark.slow
@pytest.mark.slow_on_ranks
def test_gradient_by_widths_of_bars() -> None:
    """The first half second with coarse bars; the same on any number of ranks."""
    options = ff.RunOptions(dt=0.02, t_end=0.5, tolerance=1e-12, quiet=True)
    compared(4, options, 1e-6)
    model = partial(bars, 4)
    own, alone = (
        ff.gradient(model, "ks:used", WIDTHS, options, ks_rho=RHO, accuracy=1e-12, comm=comm)
        for comm in (COMM, MPI.COMM_SELF)
    )
    by, expected = own.gradient["ks:used"], alone.gradient["ks:used"]
    for name in WIDTHS:
        # elements or ghosts that are counted twice change the second digit
        assert by[name] == pytest.approx(expected[name], rel=1e-9)


@pytest.mark.slow
@pytest.mark.serial
def test_gradient_of_two_turns() -> None:
    """The example as it is: 12 s in 1200 steps."""
    compared(8, ff.RunOptions(dt=0.01, t_end=12.0, tolerance=1e-12, quiet=True), 1e-3)
