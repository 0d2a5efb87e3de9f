# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of energies and momenta, against differences of whole motions."""

from functools import partial

from mpi4py import MPI

import pytest

import flexfem as ff
from tests.contract.gradient_examples import KINDS, NUMBERS, body
from tests.contract.test_gradients import compare

#: All columns but those of the centre of mass along axes on which little happens.
OF = ["E_kinetic", "E_strain", "E_gravity", "M_px", "M_pz", "M_ly", "M_cz"]


def metered(kind, bodies=None, **numbers):
    """A body with probes of energies and momenta."""
    model = body(kind, **numbers)
    model.add(ff.EnergyProbe("E", bodies), ff.MomentumProbe("M", bodies))
    return model


OTHERS = [pytest.param(kind, None, marks=pytest.mark.slow) for kind in KINDS]


@pytest.mark.serial
@pytest.mark.parametrize(("kind", "bodies"), [("se3", ["rod"]), *OTHERS])
def test_energies_and_momenta(kind, bodies):
    """Gravity's potential depends on gravity, mass and density by themselves: 1e-1 and more."""
    options = ff.RunOptions(dt=1e-3, t_end=3e-3, tolerance=1e-13)
    compare(partial(metered, kind, bodies), NUMBERS, [f"mean:{one}" for one in OF], options, 1e-6)


@pytest.mark.three_ranks
def test_ranks_agree_on_energies():
    """The energy of a spring counts once, on whichever rank it is."""
    options = ff.RunOptions(dt=1e-3, t_end=2e-3, tolerance=1e-13, split_above=1)
    of, build = [f"final:{one}" for one in OF], partial(metered, "se3")
    alone, together = (
        ff.gradient(build, of, NUMBERS, options, accuracy=1e-13, comm=comm).gradient
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    for one in of:
        largest = max(abs(value * NUMBERS[name]) for name, value in alone[one].items())
        for name, value in alone[one].items():
            # a share that is missing, or counted twice, is a tenth and more
            bound = 1e-9 * largest / NUMBERS[name]
            assert together[one][name] == pytest.approx(value, abs=bound)
