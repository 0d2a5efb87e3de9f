# SPDX-License-Identifier: LGPL-3.0-or-later
"""A straight beam of unit mass and length, the subject of many closed forms."""

from collections.abc import Sequence

import numpy as np

import flexfem as ff
from flexfem.mesh.line_mesh import LineMesh

__all__ = ["angular_frequencies", "beam_model", "slender", "spun_frequencies"]

STIFF = 1e6  # EA, GA and GJ of a beam that only bends


def slender(flap: float = 1.0, chord: float = 100.0, inertia: float = 1e-7) -> ff.Section:
    """Section with unit mass, bending stiffnesses about e2 and e3, no shear, little inertia."""
    mass = (1.0, 1.0, 1.0, 2.0 * inertia, inertia, inertia)
    return ff.Section.general((STIFF, STIFF, STIFF, 1.0, flap, chord), mass)


def beam_model(
    section: ff.Section, elements: int, *, start: float = 0.0, length: float = 1.0,
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0), damping: float = 0.0,
) -> ff.Model:  # fmt: skip
    """Beam "beam" along a direction, e2 along y (along x if the beam is along z)."""
    along = start + length * np.linspace(0.0, 1.0, elements + 1)
    numbers = np.arange(elements)
    mesh = LineMesh(
        np.outer(along, direction), np.stack([numbers, numbers + 1], axis=1), {"beam": numbers}
    )
    model = ff.Model("beam", mesh=mesh)
    orientation = (1.0, 0.0, 0.0) if direction[2] else (0.0, 1.0, 0.0)
    model.add(ff.Beam("beam", section, orientation=orientation, damping=damping))
    return model


def angular_frequencies(model: ff.Model, count: int, **options: object) -> np.ndarray:
    """Lowest frequencies, rad/s, on every rank; raises unless the analysis is fine."""
    outcome = ff.find_modes(model, ff.ModeOptions(modes=count, quiet=True, **options))
    if outcome.status != "ok":
        raise RuntimeError(outcome.status)
    return 2.0 * np.pi * outcome.modes.frequencies


def spun_frequencies(model: ff.Model, count: int, spins: Sequence[float]) -> list[np.ndarray]:
    """Lowest frequencies at several speeds of rotation about z, rad/s, on every rank."""
    from flexfem.core.status import Status
    from flexfem.simulation.equilibria.operating_point import OperatingPoint
    from flexfem.simulation.modes import modes_at

    options = ff.ModeOptions(modes=count, quiet=True)
    point, found = OperatingPoint(model, options), []
    for spin in spins:
        status = point.settle(spin)
        if status is not Status.OK:
            raise RuntimeError(f"{status.value} at {spin} rad/s")
        found.append(2.0 * np.pi * modes_at(point, options).frequencies)
    return found
