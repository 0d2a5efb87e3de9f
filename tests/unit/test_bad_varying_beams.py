# SPDX-License-Identifier: LGPL-3.0-or-later
"""What varies along beams and is refused, in one line that names the beam."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

STEEL = ff.Material(2.1e11, 0.3, 7850.0)
ROD = ff.Section.circle(0.02, STEEL)
ENERGY = ff.BeamLaw(lambda e, p: 1e6 * e[0] ** 2 + e[1] ** 2 + e[2] ** 2 + e[3] ** 2
                    + e[4] ** 2 + e[5] ** 2)  # fmt: skip


def run(points: Any = None, cells: Any = None, dynamics: Any = None, **given: Any) -> None:
    """A step of a beam of two metres."""
    points = np.array(points or [(0, 0, 0), (1, 0, 0), (2, 0, 0)], dtype=float)
    cells = np.array(cells or [(0, 1), (1, 2)])
    model = ff.Model(
        "m", mesh=ff.LineMesh(points, cells, {"beam": np.arange(len(cells))}, {"root": 0})
    )
    section = given.pop("section", ROD)
    model.add(
        ff.Beam("beam", section, **given),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "root")),
    )  # fmt: skip
    ff.simulate(
        model, ff.RunOptions(**({"dt": 1e-3, "t_end": 1e-3, "quiet": True} | (dynamics or {})))
    )


def table(stations: Any = (0.0, 2.0), **given: Any) -> ff.SectionTable:
    return ff.SectionTable.of(stations, len(stations) * [ROD], **given)


def broken(s: np.ndarray) -> np.ndarray:
    raise RuntimeError("no data")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: table([0.0]), "stations must be at least two, got 1"),
        (lambda: table([0.0, 2.0, 1.0]), "stations must not decrease, got 2 before 1"),
        (lambda: table([0.0, 1.0, 1.0, 1.0, 2.0]), "1 occurs more than twice"),
        (lambda: table([0.0, 0.0, 2.0]), "the first and the last one must occur once"),
        (lambda: table(relative=True), "relative stations must go from 0 to 1, got 0 to 2"),
        (lambda: table(twist=[0.0]), "twist must hold 2 numbers"),
        (lambda: ff.SectionTable([0.0, 1.0], np.zeros((2, 6, 6)), np.zeros((2, 6, 6))),
         "station 0: stiffness must be positive definite"),
        (lambda: ff.SectionTable.of([0, 1], [ROD, ROD.with_law(ENERGY)]), "must be linear"),
        (lambda: ff.SectionTable.of([0, 1], [ROD, 3]), "each section must be a Section"),
        (lambda: ff.ThermalStrain("hot"), "expansion must be a number"),
        (lambda: ff.ThermalStrain(1e-5, change="hot"), "change must be a number"),
        (lambda: ff.Beam("beam", ROD, damping=(1, 2, 3)), "damping must hold 6 numbers"),
        (lambda: ff.Beam("beam", ROD, damping=(-1.0, 0, 0, 0, 0, 0)), "must not be negative"),
        (lambda: ff.Beam("beam", ROD, rest_curvature=1.0), "rest_curvature must hold 3 numbers"),
        (lambda: ff.Beam("beam", ROD, prestrain=(1, 2, 3)), "prestrain must hold 6 numbers"),
        (lambda: ff.Beam("beam", ROD, twist="steep"), "twist must hold  numbers"),
        *((lambda given=given: run(formulation="nurbs", degree=2, **given), what)
          for given, what in (
              ({"section": table([0.0, 2000.0])}, "go from 0 to 2000 m, the beam from 0 to 2 m"),
              ({"section": lambda s: ROD.with_law(ENERGY)}, "must be linear"),
              ({"section": broken}, "RuntimeError"),
              ({"twist": lambda s: 40.0 * s}, "its twist turns by 40 rad inside element 0"),
              ({"rest_curvature": lambda s: s}, "rest_curvature must return shape"),
              ({"prestrain": lambda s: np.zeros(6)}, "prestrain: "),
              ({"prestrain": lambda s, t: np.full(6, np.nan)}, "finite numbers for"))),
        (lambda: run(section=table([0.0, 2000.0])), "go from 0 to 2000 m, the beam from 0 to 2 m"),
        (lambda: run(section=lambda s: 3.0), r"section\(0.*\) must be a Section, got 3.0"),
        (lambda: run(section=lambda s: ROD.with_law(ENERGY)), "must be linear"),
        (lambda: run(section=broken), "RuntimeError"),
        (lambda: run(twist=broken), "RuntimeError"),
        (lambda: run(twist=lambda s: 3.2 * s), "its twist turns by 3.2 rad inside element 0"),
        (lambda: run(twist=lambda s: [1.0, 2.0, 3.0, 4.0, 5.0]), "twist must return shape"),
        (lambda: run(prestrain=lambda s, t: np.full(6, np.nan)), "finite numbers for"),
        (lambda: run(prestrain=lambda s: np.zeros(6)), "prestrain: "),
        (lambda: run(rest_curvature=lambda s: s), "rest_curvature must return shape"),
        (lambda: run(section=ROD.with_law(ENERGY), damping=np.ones(6)), "proportional to a stiff"),
        (lambda: run([(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0)], [(0, 1), (1, 2), (1, 3)],
                     section=table()), "branches or falls apart"),
        (lambda: run(dynamics={"integrator": "energy_momentum"}, damping=np.ones(6)),
         "does not support one damping for each strain"),
        (lambda: run(dynamics={"integrator": "energy_momentum"},
                     prestrain=lambda s, t: np.zeros(6)),
         "does not support a prestrain that changes with time"),
    ],
)  # fmt: skip
def test_what_varies_wrongly_is_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message) as raised:
        make()
    text = str(raised.value)
    assert "\n" not in text
    assert text.startswith(('Beam "beam"', "SectionTable", "ThermalStrain"))
    assert_on_page(text)


@pytest.mark.parametrize("formulation", ["se3", "nurbs"])
def test_a_prestrain_that_fails_in_a_run_ends_it_in_good_order(formulation: str) -> None:
    """Results until then are there; on several ranks nobody waits, as with loads."""

    def heat(s: np.ndarray, t: float) -> np.ndarray:
        return np.full(6, 1e-6 * t) if t < 0.0045 else np.zeros(5)

    with pytest.raises(
        ff.FunctionError, match=r"prestrain must return shape .*, from heat"
    ) as raised:
        run(prestrain=heat, formulation=formulation, dynamics={"t_end": 0.01})
    assert str(raised.value).startswith('Beam "beam": ')
    assert raised.value.outcome.history["t"][-1] == pytest.approx(0.004)


def test_contact_of_a_beam_that_varies_needs_a_radius() -> None:
    contact = ff.Contact("touch", "beam", surfaces=ff.RigidPlane(ff.Ground((0.0, 0.0, -1.0))))
    mesh = ff.LineMesh.straight({"beam": [(0, 0, 0), (2, 0, 0)]}, 2)
    model = ff.Model("m", mesh=mesh)
    model.add(ff.Beam("beam", table()), contact)
    with pytest.raises(ValueError, match="its section varies") as raised:
        ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=1e-3, quiet=True))
    assert_on_page(str(raised.value))


def test_reductions_refuse_by_name() -> None:
    with pytest.raises(TypeError, match=r'beam_body "beam": section must be a Section'):
        ff.beam_body([(0, 0, 0), (1, 0, 0)], table())
