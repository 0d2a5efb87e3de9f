# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions: a double pendulum, the best damper of an oscillator, an identified rod."""

from collections.abc import Iterator

from mpi4py import MPI

import numpy as np
from scipy.integrate import solve_ivp

import flexfem as ff
from tests.verification.result import Result

#: Masses, kg, arms to the mass centres and lengths, m, inertia, kg m^2, gravity, m/s^2.
PENDULUM = {"mass_1": 1.0, "mass_2": 0.6, "length": 0.5, "gravity": 9.81}
ARMS, INERTIAS = (0.25, 0.3), (0.02, 0.015)
#: Angles at the start, rad, and the end, s.
START, END = (1.2, 0.7), 1.0
#: Mass, kg, stiffness, N/m, and deflection at the start, m.
MASS, STIFFNESS, DEFLECTION = 2.0, 400.0, 0.2


def pendulum(*, mass_1, mass_2, length, gravity) -> ff.Model:
    """Two rigid bodies that swing in the plane of x and z."""
    model = ff.Model("double_pendulum")
    model.add(ff.Gravity((0.0, 0.0, -gravity)))
    joint = np.zeros(3)
    bodies = ((mass_1, START[0], length), (mass_2, START[1], ARMS[1]))
    markers = [ff.Ground()]
    for i, (mass, angle, reach) in enumerate(bodies):
        down = np.array([np.sin(angle), 0.0, -np.cos(angle)])
        model.add(
            ff.RigidBody(
                f"body_{i}", mass, (INERTIAS[i],) * 3, position=joint + ARMS[i] * down
            ),
            ff.Spherical(f"pin_{i}", markers[-1], ff.Marker(f"body_{i}", offset=-ARMS[i] * down)),
        )  # fmt: skip
        joint = joint + reach * down
        markers.append(ff.Marker(f"body_{i}", offset=(reach - ARMS[i]) * down))
    model.add(ff.PositionProbe("end", markers[-1]))
    return model


def height(*, mass_1, mass_2, length, gravity) -> float:
    """The same height by Lagrange's equations in both angles."""
    m = np.array([
        INERTIAS[0] + mass_1 * ARMS[0] ** 2 + mass_2 * length**2,
        INERTIAS[1] + mass_2 * ARMS[1] ** 2, mass_2 * length * ARMS[1],
    ])  # fmt: skip

    def rates(t, y):
        c, s = np.cos(y[0] - y[1]), np.sin(y[0] - y[1])
        matrix = np.array([[m[0], m[2] * c], [m[2] * c, m[1]]])
        weight = (mass_1 * ARMS[0] + mass_2 * length) * gravity * np.sin(y[0])
        other = mass_2 * ARMS[1] * gravity * np.sin(y[1])
        right = np.array([-m[2] * s * y[3] ** 2 - weight, m[2] * s * y[2] ** 2 - other])
        return np.concatenate([y[2:], np.linalg.solve(matrix, right)])

    done = solve_ivp(rates, (0.0, END), [*START, 0.0, 0.0], "DOP853", rtol=1e-13, atol=1e-14)
    return float(-length * np.cos(done.y[0, -1]) - ARMS[1] * np.cos(done.y[1, -1]))


def _pendulums(full: bool) -> Iterator[Result]:
    for step, tolerance in ((4e-3, 2e-3), (1e-3, 1.3e-4))[: 2 if full else 1]:
        options = ff.RunOptions(dt=step, t_end=END, rho_inf=0.9)
        found = ff.gradient(pendulum, "final:end_z", PENDULUM, options)
        for name, value in PENDULUM.items():
            e = 1e-4 * value
            moved = [height(**{**PENDULUM, name: value + k * e}) for k in (-2, -1, 1, 2)]
            exact = (8.0 * (moved[2] - moved[1]) - (moved[3] - moved[0])) / (12.0 * e)
            yield Result(
                "double pendulum, gradient", f"d(height after 1 s)/d({name})", exact,
                "differences of DOP853 in two angles", found.gradient["final:end_z"][name],
                f"h = {step:g} s, adjoint", tolerance,
            )  # fmt: skip


def oscillator(damping: float) -> ff.Model:
    """A mass on a spring with a damper."""
    model = ff.Model("oscillator")
    bob = ff.Marker("bob")
    model.add(
        ff.RigidBody("bob", MASS, (0.1, 0.1, 0.1), position=(1.0 + DEFLECTION, 0.0, 0.0)),
        ff.Prismatic("slide", ff.Ground(), bob, axis=(1.0, 0.0, 0.0)),
        ff.SpringDamper(
            "buffer", ff.Ground(), bob, stiffness=STIFFNESS, damping=damping, rest_length=1.0
        ),
        ff.Probe("path", bob, ("deflection",), lambda t, s: (s.position[0] - 1.0,)),
        ff.Probe("square", bob, ("square",), lambda t, s: ((s.position[0] - 1.0) ** 2,)),
    )
    return model


def _oscillators(full: bool) -> Iterator[Result]:
    options = ff.RunOptions(dt=4e-3, t_end=1.6, rho_inf=1.0)
    c = 20.0
    found = ff.gradient(oscillator, "integral:square", {"damping": c}, options)
    exact = DEFLECTION**2 * (0.5 / STIFFNESS - 0.5 * MASS / c**2)
    yield Result(
        "damped oscillator, gradient", "d(integral of x^2)/dc, m^2 s/(N s/m)", exact,
        "x0^2 (1/(2 k) - m/(2 c^2))", found.gradient["integral:square"]["damping"], "h = 4 ms",
        2e-3,
    )  # fmt: skip
    if not full:
        return
    best = ff.minimize(
        oscillator, "integral:square", {"damping": c}, options, bounds={"damping": (1.0, None)}
    )
    yield Result(
        "damped oscillator, minimize", "best damping, N s/m", (STIFFNESS * MASS) ** 0.5,
        "sqrt(k m)", float(best.values["damping"]), f"h = 4 ms, {best.gradients} gradients", 2e-3,
    )  # fmt: skip


def rod(stiffness) -> ff.Model:
    """A hinged rod whose elements have bending stiffnesses of their own."""
    count, length = len(stiffness), 0.5
    x = np.linspace(0.0, length, count + 1)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.array([[i, i + 1] for i in range(count)])
    model = ff.Model("rod", mesh=ff.LineMesh(x, cells, {"rod": np.arange(count)}))
    base = ff.Section.rectangle(0.03, 0.01, ff.Material(5e6, 0.3, 1100.0))

    def section(s):
        own = np.array(base.stiffness)
        own[4:, 4:] *= float(stiffness[min(int(s / length * count), count - 1)])
        return ff.Section(own, base.inertia)

    model.add(
        ff.Gravity((0.0, 0.0, -9.81)), ff.Beam("rod", section),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("rod", "start"), axis=(0.0, 1.0, 0.0)),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
    )  # fmt: skip
    return model


def _rods() -> Iterator[Result]:
    options = ff.RunOptions(dt=4e-3, t_end=0.24)
    truth = np.array([1.1, 0.8, 1.2, 0.9])
    seen = ff.gradient(rod, "final:tip_z", {"stiffness": truth}, options).history
    wanted = {name: values for name, values in seen.items() if name in ("tip_x", "tip_z")}
    measured = MPI.COMM_WORLD.bcast(wanted)
    found = ff.identify(
        rod, measured, {"stiffness": np.full(4, 1.3)}, options, bounds={"stiffness": (0.2, 5.0)}
    )
    yield Result(
        "identified rod", "largest error of four stiffnesses", 0.0, "the rod that was measured",
        float(np.abs(found.values["stiffness"] / truth - 1.0).max()),
        f"4 elements, h = 4 ms, {found.motions} motions", 1e-6,
    )  # fmt: skip


def results(full: bool = True) -> list[Result]:
    """All lines; the pendulum's derivatives converge with the square of the step."""
    return [*_pendulums(full), *_oscillators(full), *(_rods() if full else ())]
