# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small motions of rigid mechanisms."""

import numpy as np

import flexfem as ff
from tests.verification.benchmarks.straight_beam import angular_frequencies
from tests.verification.result import Result

G = 9.81
TINY = (1e-12, 1e-12, 1e-12)


def results() -> list[Result]:
    """All frequencies of this file."""
    return [*_pendulum(), *_double(), *_masses(), *_springs(), *_settled()]


def _pendulum() -> list[Result]:
    m, arm, J = 2.0, 0.7, 0.3
    model = ff.Model("pendulum")
    model.add(
        ff.Gravity((0, -G, 0)),
        ff.RigidBody("bob", m, (J, J, J), position=(0, -arm, 0)),
        ff.Revolute("pin", ff.Ground(), ff.Marker("bob", offset=(0, arm, 0)), axis=(0, 0, 1)),
    )
    reference = float(np.sqrt(m * G * arm / (J + m * arm**2)))
    return [Result(
        "physical pendulum", "omega [rad/s]", reference, "closed form",
        float(angular_frequencies(model, 1)[0]), "rigid", 1e-12,
    )]  # fmt: skip


def _double() -> list[Result]:
    """Two equal point masses on massless rods of length one: omega^2 = g (2 -+ sqrt 2)."""
    model = ff.Model("double")
    model.add(
        ff.Gravity((0, -G, 0)),
        ff.RigidBody("upper", 1.0, TINY, position=(0, -1, 0)),
        ff.RigidBody("lower", 1.0, TINY, position=(0, -2, 0)),
        ff.Revolute("pin", ff.Ground(), ff.Marker("upper", offset=(0, 1, 0)), axis=(0, 0, 1)),
        ff.Revolute(
            "link", ff.Marker("upper"), ff.Marker("lower", offset=(0, 1, 0)), axis=(0, 0, 1)
        ),
    )
    found = angular_frequencies(model, 2)
    return [
        Result(
            "double pendulum", f"omega {k + 1} [rad/s]", float(np.sqrt(G * (2 + sign * 2**0.5))),
            "closed form", float(found[k]), "rigid", 1e-9,
        )
        for k, sign in enumerate((-1.0, 1.0))
    ]  # fmt: skip


def _masses() -> list[Result]:
    """A body on a spring and a damper, on a guide."""
    m, k, c = 3.0, 75.0, 6.0
    model = ff.Model("oscillator")
    model.add(
        ff.RigidBody("body", m, (1, 1, 1), position=(1, 0, 0)),
        ff.Prismatic("guide", ff.Ground(), ff.Marker("body"), axis=(1, 0, 0)),
        ff.SpringDamper("spring", ff.Ground(), ff.Marker("body"), k, c),
    )
    outcome = ff.find_modes(model, ff.ModeOptions(modes=1, quiet=True))
    value = outcome.modes.eigenvalues[0]
    omega, zeta = np.sqrt(k / m), c / (2 * np.sqrt(k * m))
    return [
        Result(
            "mass, spring, damper", "damped omega [rad/s]", float(omega * np.sqrt(1 - zeta**2)),
            "closed form", float(value.imag), "rigid", 1e-12,
        ),
        Result(
            "mass, spring, damper", "damping ratio", float(zeta), "closed form",
            float(-value.real / abs(value)), "rigid", 1e-12,
        ),
    ]  # fmt: skip


def _springs() -> list[Result]:
    """Two masses between three equal springs: omega^2 = k/m and 3 k/m; a stiff pair that floats."""
    m, k = 2.0, 5e4
    model = ff.Model("springs")
    model.add(
        ff.RigidBody("left", m, (1, 1, 1), position=(1, 0, 0)),
        ff.RigidBody("right", m, (1, 1, 1), position=(2, 0, 0)),
        ff.Prismatic("guide", ff.Ground(), ff.Marker("left"), axis=(1, 0, 0)),
        ff.Prismatic("rail", ff.Ground(), ff.Marker("right"), axis=(1, 0, 0)),
        ff.SpringDamper("first", ff.Ground(), ff.Marker("left"), k),
        ff.SpringDamper("between", ff.Marker("left"), ff.Marker("right"), k),
        ff.SpringDamper("last", ff.Marker("right"), ff.Ground((3, 0, 0)), k),
    )
    found = angular_frequencies(model, 2)
    pair = ff.Model("pair")
    pair.add(
        ff.RigidBody("left", m, (1, 1, 1)),
        ff.RigidBody("right", m, (1, 1, 1), position=(2, 0, 0)),
        ff.SpringDamper("between", ff.Marker("left"), ff.Marker("right"), k),
    )
    floating = angular_frequencies(pair, 12)
    known = {
        "masses and springs": (float(np.sqrt(k / m)), found[0]),
        "masses and springs, second": (float(np.sqrt(3 * k / m)), found[1]),
        "floating pair": (float(np.sqrt(2 * k / m)), floating[11]),
        "floating pair, rigid motions": (11.0, float(np.sum(floating == 0.0))),
    }
    return [
        Result(case, "omega [rad/s]", reference, "closed form", float(ours), "rigid", 1e-9)
        for case, (reference, ours) in known.items()
    ]


def _settled() -> list[Result]:
    """A pendulum that is given to the side has its equilibrium below the pin."""
    m, arm, J = 2.0, 0.7, 0.3
    model = ff.Model("settled")
    angle = 0.6
    place = arm * np.array([np.sin(angle), -np.cos(angle), 0.0])
    model.add(
        ff.Gravity((0, -G, 0)),
        ff.RigidBody("bob", m, (J, J, J), position=place),
        ff.Revolute("pin", ff.Ground(), ff.Marker("bob", offset=-place), axis=(0, 0, 1)),
    )
    reference = float(np.sqrt(m * G * arm / (J + m * arm**2)))
    ours = float(angular_frequencies(model, 1, start="equilibrium")[0])
    return [Result(
        "pendulum in its equilibrium", "omega [rad/s]", reference, "closed form", ours, "rigid",
        1e-9,
    )]  # fmt: skip
