# SPDX-License-Identifier: LGPL-3.0-or-later
"""Assumed modes of a beam on a steadily rotating base: dynamic stiffening."""

import numpy as np

from flexfem import research
from flexfem.research.moving_base.equations import PrescribedBaseEquations
from tests.verification.result import Result

SOURCE = "Wright et al. 1982"
#: first out-of-plane frequencies of the unit beam that is clamped and free
REFERENCE = {0: 3.5160, 1: 3.6816, 3: 4.7973, 6: 7.3604, 9: 10.2257, 12: 13.1702}


def lowest(spin: float, modes: int) -> float:
    """First out-of-plane frequency at a speed."""
    unit = research.BeamProperties(
        length=1.0, youngs_modulus=1.0, shear_modulus=1.0, mass_per_length=1.0, area=1e6,
        second_moment_2=1.0, second_moment_3=1.0, torsion_constant=1.0,
    )  # fmt: skip
    effects = research.Effects().without(
        "shear", "rotary_inertia", "extension", "torsion", "in_plane"
    )
    base = research.PrescribedBase(angular_velocity=lambda t: (0.0, 0.0, spin))
    source = research.MovingBaseBeam(properties=unit, base=base, effects=effects, modes=modes)
    equations = source.equations()
    assert isinstance(equations, PrescribedBaseEquations)
    return float(np.sqrt(np.linalg.eigvalsh(equations.matrices(0.0)[1])[0]))


def results(full: bool = True) -> list[Result]:
    """Frequencies at all speeds, or at the highest."""
    modes = 10 if full else 8
    mesh = f"{modes} modes of 24 cubic elements"
    # without the stiffening terms it would be 3.516 at every speed
    return [
        Result(
            "rotating beam, assumed modes", f"frequency at speed {spin}", value, SOURCE,
            lowest(spin, modes), mesh, 2e-5 if full else 1e-4,
        )
        for spin, value in REFERENCE.items()
        if full or spin == 12
    ]  # fmt: skip
