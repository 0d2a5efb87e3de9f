# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of energies and momenta, against differences of whole motions."""

from functools import partial

import pytest

import flexfem as ff
from tests.contract.gradient_examples import KINDS, NUMBERS, body
from tests.contract.test_gradient_contacts import ROD, balls, rod, sheet
from tests.contract.test_gradient_contacts import compare as compare_contacts
from tests.contract.test_gradients import agree_on_ranks, compare

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


def landing(kind, **numbers):
    """A rod that falls on the ground, balls that rub, or a sheet that meets an obstacle."""
    flat = partial(sheet, "penalty", radius=0.05)
    model = {"rod": rod, "balls": partial(balls, friction=0.3), "sheet": flat}[kind](**numbers)
    model.add(ff.EnergyProbe("E"))
    return model


@pytest.mark.serial
@pytest.mark.parametrize(
    ("kind", "numbers", "dt", "end"),
    [
        ("balls", {"height": 0.006, "speed": 1.0}, 5e-4, 7e-3),
        pytest.param("rod", ROD, 5e-4, 4e-3, marks=pytest.mark.slow),
        pytest.param("sheet", {"speed": 1.0}, 2e-4, 5e-3, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_energies_of_contacts(kind, numbers, dt, end):
    """Without the potentials of contacts, or with pairs of another state, a tenth and more."""
    options = ff.RunOptions(dt=dt, t_end=end, tolerance=1e-13)
    of, build = ["final:E_strain", "mean:E_strain"], partial(landing, kind)
    compare_contacts(build, numbers, of, options, step=1e-4)


def controlled(kind, column, sample, gain, **numbers):
    """The same, pushed in proportion to an energy while they touch."""
    model, body = landing(kind, **numbers), {"balls": "first", "rod": "bob", "sheet": "ball"}[kind]
    model.add(
        ff.PointForce("push", ff.Marker(body), (gain, 0.0, 0.3 * gain)),
        ff.Controller("servo", [column], ["push"], lambda t, y: 10.0 * y[0], sample_time=sample),
    )
    return model


@pytest.mark.serial
@pytest.mark.parametrize(
    ("kind", "column", "sample", "numbers", "dt", "end"),
    [
        ("balls", "E_strain", None, {"height": 0.006, "speed": 1.0}, 5e-4, 7e-3),
        *(
            pytest.param(*given, marks=pytest.mark.slow)
            for given in (
                ("balls", "E_kinetic", 1e-3, {"height": 0.006, "speed": 1.0}, 5e-4, 7e-3),
                ("rod", "E_strain", 1e-3, ROD, 5e-4, 4e-3),
                ("sheet", "E_strain", None, {"speed": 1.0}, 2e-4, 4e-3),
            )
        ),
    ],
)
def test_controllers_that_measure_energies_of_contacts(kind, column, sample, numbers, dt, end):
    """A quarter of the way of the ball is that of the push, up to 72 N."""
    options = ff.RunOptions(dt=dt, t_end=end, tolerance=1e-13)
    of, build = ["final:p_x", "mean:q_x"], partial(controlled, kind, column, sample)
    compare_contacts(build, {**numbers, "gain": 30.0}, of, options, step=1e-4)


@pytest.mark.several_ranks
@pytest.mark.three_ranks
@pytest.mark.parametrize("touching", [False, pytest.param(True, marks=pytest.mark.slow_on_ranks)])
def test_ranks_agree_on_energies(touching):
    """The energies of a spring and of a contact count once, on whichever rank they are."""
    options = ff.RunOptions(dt=1e-3, t_end=2e-3, tolerance=1e-13, split_above=1)
    of, build, numbers = [f"final:{one}" for one in OF], partial(metered, "se3"), NUMBERS
    if touching:
        of, build, numbers = ["final:E_strain"], partial(landing, "rod", height=1e-3), ROD
    agree_on_ranks(build, numbers, of, options, accuracy=1e-13)
