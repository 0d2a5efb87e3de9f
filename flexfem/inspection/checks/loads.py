# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models in which nothing acts."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexfem.analyses.modes import StateOptions
from flexfem.core.laws import LawKind
from flexfem.inspection.finding import Finding
from flexfem.inspection.inspection import Inspection


def find(inspection: Inspection) -> Iterator[Finding]:
    """No gravity, load, drive, force at the start or initial velocity, unless modes are wanted."""
    if isinstance(inspection.options, StateOptions):
        return
    model = inspection.model
    pulls = model.gravity is not None and bool(model.gravity.acceleration.any())
    if pulls or model.loads or any(joint.driven for joint in model.joints):
        return
    rows = inspection.rows.rows
    kinds = rows.elastic[:, 0]
    if np.isin(kinds, (LawKind.FUNCTION, LawKind.ELEMENT)).any():
        return
    spring = kinds == LawKind.SPRING
    force = rows.elastic[:, 1] * rows.values + rows.elastic[:, 3]
    if np.any(spring & rows.active & (np.abs(force) > 0.0)):
        return
    if any(_moving(body) for body in model.bodies):
        return
    if any(beam.strained for beam in model.beams) or any(s.strained for s in model.shells):
        return
    yield Finding(
        "loads", repr(model), "no gravity, load, drive, prestress or initial velocity acts on it",
        "add gravity, a load, a drive or an initial velocity",
    )  # fmt: skip


def _moving(body: Any) -> bool:
    """True if a body has initial velocities."""
    further = getattr(body, "start_velocities", None) is not None
    return bool(body.velocity.any() or body.angular_velocity.any() or further)
