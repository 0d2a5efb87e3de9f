# SPDX-License-Identifier: LGPL-3.0-or-later
"""Moment of a drive that rotates a rigid body by a smooth step: closed form, every integrator."""

from mpi4py import MPI

import numpy as np

import flexfem as ff
from flexfem.analyses.dynamics import INTEGRATORS
from tests.verification.motions import run
from tests.verification.result import Result

ANGLE, LENGTH = 10.0, 0.2
AXIS = (0.0, 0.0, 1.0)


def build() -> ff.Model:
    """A body with unit inertia about the axis of its drive."""
    model = ff.Model("drive")
    model.add(
        ff.RigidBody("rotor", 1.0, (1.0, 1.0, 1.0)),
        ff.Revolute("pin", ff.Ground(), ff.Marker("rotor"), axis=AXIS),
        ff.PrescribedAngle(
            "motor", ff.Ground(), ff.Marker("rotor"), AXIS, ff.SmoothStep(0.0, LENGTH, 0.0, ANGLE)
        ),
        ff.ReactionProbe("drive", "motor"),
    )
    return model


def results(full: bool = True) -> list[Result]:
    """Peak of the moment, the moment in the middle of either half, and what is left behind."""
    found = []
    for name in INTEGRATORS:
        if name == "independent_coordinates" and MPI.COMM_WORLD.size > 1:
            continue
        for steps in (20, 100) if full else (20,):
            history = run(build(), LENGTH / steps, 2.0 * LENGTH, integrator=name)
            t, moment = history["t"], history["drive_mz"]
            tau = np.clip(t / LENGTH, 0.0, 1.0)
            exact = 60.0 * ANGLE / LENGTH**2 * tau * (1.0 - tau) * (1.0 - 2.0 * tau)
            peak, rest = exact.max(), moment[t > 1.01 * LENGTH]
            values = {
                "largest moment at a step, N m": (peak, moment.max()),
                "largest error, part of the peak": (0.0, np.abs(moment - exact).max() / peak),
                "largest moment behind it, N m": (0.0, np.abs(rest).max()),
            }
            # multipliers of generalized_alpha miss by 1.4 (20 steps) and 0.3 (100) of the peak
            found += [
                Result(
                    f"drive by a smooth step, {name}", what, reference, "closed form", ours,
                    f"{steps} steps in the motion", 3e-3,
                )
                for what, (reference, ours) in values.items()
            ]  # fmt: skip
    return found
