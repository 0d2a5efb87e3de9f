# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every force law of rows: force, slope and energy at rest, and equilibria under it."""

from collections.abc import Callable
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import brentq

import flexfem as ff
from flexfem.constraints.rows.laws import elastic_part, static_forces
from flexfem.constraints.terms.compiled_functions import address
from flexfem.core.joint import Joint
from flexfem.core.laws import Law, LawKind, capstan, curve, friction, limit, press, spring
from flexfem.core.row import Row, RowKind, Term
from flexfem.core.user_function import FunctionKind, UserFunction

#: Force on the body (N), stiffness of the spring that holds it (N/m), and its mass (kg).
PUSH, HOLD, MASS = 3.0, 50.0, 2.0


def _cubic(x, v, t):
    return 4e3 * x * x * x + 5.0 * v


@dataclass(frozen=True, eq=False)
class Along(Joint):
    """A law for the displacement along x, friction on the guide's forces."""

    law: Law | None = None
    guide: ff.Prismatic | None = None

    @property
    def partner(self) -> Joint | None:
        return self.guide

    def rows(self, poses, t):
        return (Row((Term(RowKind.ALONG, u=np.array([1.0, 0.0, 0.0])),), 0.0, self.law),)


@dataclass(frozen=True)
class Example:
    """A law with its force at rest (N) and its energy (J) as functions of the value (m)."""

    law: Law
    force: Callable[[float], float] = lambda x: 0.0
    energy: Callable[[float], float] = lambda x: 0.0


def _hardening(x, v):
    return 20.0 * x + 5e3 * x * x * x + 5.0 * v


def _beyond(x, slack):
    return x - min(max(x, -slack), slack)


CUBIC = UserFunction.checked("cubic", "force", _cubic, FunctionKind.FORCE, ())
EXAMPLES = {
    LawKind.RIGID: Example(Law(LawKind.RIGID)),
    LawKind.SPRING: Example(spring(30.0, 7.0), lambda x: 30.0 * x, lambda x: 15.0 * x * x),
    LawKind.LIMIT: Example(
        limit(-0.01, 0.02, 400.0, 20.0),
        lambda x: 400.0 * (max(x - 0.02, 0.0) + min(x + 0.01, 0.0)),
        lambda x: 200.0 * (max(x - 0.02, 0.0) ** 2 + min(x + 0.01, 0.0) ** 2),
    ),
    # functions of the user's count as work
    LawKind.FUNCTION: Example(Law(LawKind.FUNCTION, function=CUBIC), lambda x: 4e3 * x**3),
    LawKind.FRICTION: Example(friction(2.0, 1e-3, 4.0)),
    LawKind.NORMAL_FRICTION: Example(friction(0.3, 1e-3, 4.0, normal=True)),
    LawKind.CURVE: Example(
        curve("curve", "force", _hardening, backlash=0.02),
        lambda x: 20.0 * _beyond(x, 0.01) + 5e3 * _beyond(x, 0.01) ** 3,
        lambda x: 10.0 * _beyond(x, 0.01) ** 2 + 1250.0 * _beyond(x, 0.01) ** 4,
    ),
    LawKind.PRESS: Example(
        press("stop", "force", lambda d: 300.0 * d * d, -0.01, 0.01),
        lambda x: 300.0 * _beyond(x, 0.01) * abs(_beyond(x, 0.01)),
        lambda x: 100.0 * abs(_beyond(x, 0.01)) ** 3,
    ),
    LawKind.CAPSTAN: Example(capstan(0.3, 1e-3, 2.0)),
    LawKind.POTENTIAL: Example(Law(LawKind.POTENTIAL, first=2.0), lambda x: 2.0, lambda x: 2.0 * x),
}


def test_every_law_has_an_example() -> None:
    # laws of whole elements are tried in tests/verification/test_forces.py
    assert set(EXAMPLES) == set(LawKind) - {LawKind.ELEMENT}


def _slack(body: ff.Marker) -> ff.Cable:
    """A cable without tension through an eyelet with friction."""
    eyelet = ff.Eyelet(ff.Ground((0.0, 1.0, 0.0)), 0.3)
    path = [ff.Ground((1.0, 0.0, 0.0)), eyelet, body]
    return ff.Cable("law", path, stiffness=30.0, rest_length=9.0)


def model_of(kind: LawKind) -> ff.Model:
    """A body on a guide along x that a force and its weight push, a spring and the law hold."""
    model = ff.Model("law")
    here, body = ff.Ground(), ff.Marker("body")
    guide = ff.Prismatic("guide", here, body, axis=(1.0, 0.0, 0.0))
    law = None if kind is LawKind.RIGID else EXAMPLES[kind].law
    model.add(
        ff.RigidBody("body", MASS, (0.1, 0.1, 0.1)),
        guide,
        Along("hold", here, body, spring(HOLD, 0.0)),
        _slack(body)
        if kind is LawKind.CAPSTAN
        else Along("law", here, body, law, guide if kind is LawKind.NORMAL_FRICTION else None),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.PointForce("push", body, (PUSH, 0.0, 0.0)),
        ff.PositionProbe("at", body),
    )
    return model


def resting_place(kind: LawKind) -> float:
    """Root of ``HOLD x + F(x) = PUSH``, metres."""
    if kind is LawKind.RIGID:
        return 0.0
    force = EXAMPLES[kind].force
    return float(brentq(lambda x: HOLD * x + force(x) - PUSH, -1.0, 1.0, xtol=1e-14))


def place(outcome: ff.Outcome) -> float:
    """Last place of the body, on all ranks."""
    world = MPI.COMM_WORLD
    return world.bcast(float(outcome.history["at_x"][-1]) if world.rank == 0 else 0.0)


#: All but that of cables with weight, see ``tests/verification/test_cable_systems.py``.
RESTING = [kind for kind in EXAMPLES if kind is not LawKind.POTENTIAL]


@pytest.mark.parametrize("kind", RESTING)
def test_statics(kind: LawKind) -> None:
    """A law taken for another one, or left out, moves the body by millimetres."""
    outcome = ff.solve_static(model_of(kind), ff.StaticOptions(load_steps=2, quiet=True))
    assert outcome.status == "ok"
    assert place(outcome) == pytest.approx(resting_place(kind), abs=1e-8)


@pytest.mark.parametrize("kind", RESTING)
def test_relaxation(kind: LawKind) -> None:
    """Its tolerance is on residuals: 1e-6 of the largest force is 1e-7 m here."""
    options = ff.RelaxationOptions(max_iterations=5000, tolerance=1e-8, quiet=True)
    outcome = ff.relax(model_of(kind), options)
    assert outcome.status == "ok"
    assert place(outcome) == pytest.approx(resting_place(kind), abs=1e-6)


@pytest.mark.parametrize("kind", EXAMPLES)
@pytest.mark.parametrize("value", [-0.03, 0.0, 0.015, 0.05])
def test_force_slope_and_energy(kind: LawKind, value: float) -> None:
    """The force is what its example says, its slope the difference, its energy the integral."""
    example, step = EXAMPLES[kind], 1e-6
    law = example.law
    laws = np.array([[law.kind, law.stiffness, law.damping, law.first, law.second]] * 3)
    functions = np.array([address(law.function) if law.function is not None else 0] * 3)
    values, out = np.array([value - step, value, value + step]), np.empty((3, 2))
    static_forces(laws, functions, np.zeros((3, 9)), values, out)
    assert out[:, 0] == pytest.approx([example.force(x) for x in values], abs=1e-12)
    slope = (example.force(values[2]) - example.force(values[0])) / (2.0 * step)
    assert out[1, 1] == pytest.approx(slope, rel=1e-6, abs=1e-6)
    energies, pulls = np.empty((2, 3))
    active, data = np.ones(3, dtype=np.bool_), np.zeros((3, 9))
    elastic_part(laws, functions, data, active, values, energies, pulls)
    assert energies == pytest.approx([example.energy(x) for x in values], abs=1e-13)
    if example.energy(1.0):
        assert pulls == pytest.approx(out[:, 0], abs=1e-12)


def test_a_number_without_a_law_is_not_silent() -> None:
    laws = np.array([[max(LawKind) + 1.0, 1.0, 0.0, 0.0, 0.0]])
    out, energy, pull = np.zeros((1, 2)), np.zeros(1), np.zeros(1)
    functions = np.zeros(1, dtype=np.int64), np.zeros((1, 9))
    static_forces(laws, *functions, np.ones(1), out)
    elastic_part(laws, *functions, np.ones(1, dtype=np.bool_), np.ones(1), energy, pull)
    assert np.isnan(out).all()
    assert np.isnan(energy).all()
