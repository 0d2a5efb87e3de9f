# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frequencies of beams at rest: Euler-Bernoulli and Timoshenko closed forms."""

import numpy as np

import flexfem as ff
from tests.verification.benchmarks.straight_beam import (
    angular_frequencies,
    beam_model,
    slender,
)
from tests.verification.result import Result

BLEVINS = "Euler-Bernoulli beam (Blevins 1979)"


def results() -> list[Result]:
    """All frequencies of this file."""
    return [*_ends(), *_timoshenko(), *_tip_mass(), *_column(), *_damped()]


def _hold(model: ff.Model, ends: str) -> None:
    root, tip = ff.Marker("beam", "start"), ff.Marker("beam", "end")
    if ends == "clamped-free":
        model.add(ff.Rigid("clamp", ff.Ground(), root))
    elif ends == "pinned-pinned":
        model.add(ff.Revolute("pin", ff.Ground(), root, axis=(0, 0, 1)))
        model.add(ff.PointOnLine("roller", ff.Ground(), tip, axis=(1, 0, 0)))
    elif ends == "clamped-pinned":
        model.add(ff.Rigid("clamp", ff.Ground(), root))
        model.add(ff.PointOnLine("roller", ff.Ground(), tip, axis=(1, 0, 0)))


def _ends() -> list[Result]:
    """Bending in the plane z = 0, the stiff direction being ten times as fast."""
    known = {
        "clamped-free": (3.516015, 22.034492, 61.697214),
        "pinned-pinned": tuple((n * np.pi) ** 2 for n in (1, 2, 3)),
        "clamped-pinned": (15.418206, 49.964862, 104.247696),
        "free-free": (22.373285, 61.672823, 120.903392),
    }
    found = []
    for ends, references in known.items():
        model = beam_model(slender(flap=1e4, chord=1.0), 60)
        _hold(model, ends)
        rigid = 6 if ends == "free-free" else 0
        values = angular_frequencies(model, rigid + 3)
        flat = values[values > 0.0]
        for number, reference in enumerate(references):
            ours = float(flat[np.argmin(np.abs(flat - reference))])
            found.append(Result(
                f"{ends} beam", f"omega {number + 1} [sqrt(EI/mL^4)]", reference, BLEVINS, ours,
                "60", 4e-3,
            ))  # fmt: skip
        if rigid:
            zeros = float(np.sum(values == 0.0))
            found.append(Result("free-free beam", "rigid modes", 6.0, "6", zeros, "60", 0.0))
    return found


def _timoshenko() -> list[Result]:
    """Pinned thick beam: the biquadratic of Timoshenko (1921)."""
    m, EI, GA, J = 1.0, 1.0, 40.0, 0.01
    section = ff.Section.general((1e4, GA, GA, 1e3, 1e3, EI), (m, m, m, 0.5, J, J))
    model = beam_model(section, 60)
    root, tip = ff.Marker("beam", "start"), ff.Marker("beam", "end")
    model.add(ff.Revolute("pin", ff.Ground(), root, axis=(0, 0, 1)))
    model.add(ff.PointOnLine("roller", ff.Ground(), tip, axis=(1, 0, 0)))
    values = angular_frequencies(model, 6)
    found = []
    for n in (1, 2, 3):
        k = n * np.pi
        middle = m + k**2 * (J + m * EI / GA)
        square = np.roots([J * m / GA, -middle, k**4 * EI]).min()
        reference = float(np.sqrt(square))
        ours = float(values[np.argmin(np.abs(values - reference))])
        found.append(Result(
            "pinned thick beam", f"omega {n} [rad/s]", reference, "Timoshenko (1921)", ours, "60",
            2e-3,
        ))  # fmt: skip
    return found


def _tip_mass() -> list[Result]:
    """Cantilever with its own mass at the tip."""
    model = beam_model(slender(flap=1e4, chord=1.0), 30)
    model.add(ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")))
    model.add(ff.PointMass("tip", 1.0, ff.Marker("beam", "end")))
    root = 1.2479174  # of 1 + cos x cosh x + x (cos x sinh x - sin x cosh x)
    values = angular_frequencies(model, 4)
    return [Result(
        "cantilever, tip mass mL", "omega 1 [sqrt(EI/mL^4)]", root**2, "transcendental equation",
        float(values[0]), "30", 1e-3,
    )]  # fmt: skip


def _column() -> list[Result]:
    """Pinned column under a dead axial load: (omega/omega_0)^2 = 1 - P/P_cr."""
    found = []
    for share in (-1.0, 0.0, 0.5, 0.9):
        model = beam_model(slender(flap=1e4, chord=1.0), 40)
        _hold(model, "pinned-pinned")
        load = -share * np.pi**2
        model.add(ff.PointForce("load", ff.Marker("beam", "end"), (load, 0, 0)))
        value = angular_frequencies(model, 1, start="equilibrium")[0]
        found.append(Result(
            "column under axial load", f"(omega/omega_0)^2 at P = {share:g} P_cr", 1.0 - share,
            "1 - P/P_cr (Blevins 1979)", float(value**2 / np.pi**4), "40", 1e-2,
        ))  # fmt: skip
    return found


def _damped() -> list[Result]:
    """Stiffness-proportional damping: zeta = omega tau/2 with the undamped omega."""
    plain, damped = (
        beam_model(slender(flap=1e4, chord=1.0), 20, damping=tau) for tau in (0.0, 2e-3)
    )
    for model in (plain, damped):
        model.add(ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")))
    omega = angular_frequencies(plain, 3)
    outcome = ff.find_modes(damped, ff.ModeOptions(modes=3, quiet=True))
    return [
        Result(
            "damped cantilever", f"damping ratio {k + 1}", float(omega[k]) * 1e-3,
            "omega tau/2", float(outcome.modes.damping[k]), "20", 1e-6,
        )
        for k in range(3)
    ]  # fmt: skip
