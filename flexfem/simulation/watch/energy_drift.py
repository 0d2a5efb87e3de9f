# SPDX-License-Identifier: LGPL-3.0-or-later
"""Detection of energy from nowhere or lost nowhere by the energy balance: too large steps."""

from collections.abc import Iterator, Mapping

import numpy as np

from flexfem._types import FloatArray
from flexfem.model.model import Model
from flexfem.model.probes.measured import EnergyProbe

__all__ = ["energy_drift"]

#: Part of the largest energy above which growth is reported, and a fall where the scheme takes
#: nothing. Sound runs stay below a quarter of this; impacts and jumps in coarse steps give some
#: times as much.
_PART = 0.02
#: Energies, J, below which a value is round-off.
_NOTHING = 1e-12
_ENERGIES = ("kinetic", "strain", "gravity", "work")


def energy_drift(
    model: Model, history: Mapping[str, FloatArray], *, lossless: bool = False
) -> list[str]:
    """A line for each energy probe of the whole model whose balance has grown, or fallen.

    Args:
        model: the model.
        history: columns of the motion.
        lossless: True if neither the scheme nor an event takes energy: the balance may not fall.
    """
    return list(_found(model, history, lossless)) if len(history.get("t", ())) else []


def _found(model: Model, history: Mapping[str, FloatArray], lossless: bool) -> Iterator[str]:
    for probe in model.probes:
        if not isinstance(probe, EnergyProbe) or probe.bodies is not None:
            continue
        balance = history[f"{probe.name}_balance"]
        largest = max(float(np.abs(history[f"{probe.name}_{e}"]).max()) for e in _ENERGIES)
        gained, lost = float(balance.max()), -float(balance.min()) if lossless else 0.0
        bound = max(_PART * largest, _NOTHING)
        if not max(gained, lost) > bound or len(balance) < 2:
            continue
        if not gained > bound:
            fall = int(np.argmin(np.diff(balance))) + 1
            yield (
                f"energy is missing: the balance has fallen by {lost:.3g} J ({probe.name}_balance) "
                f"with energies of at most {largest:.3g} J, most of it at t = "
                f"{history['t'][fall]:.4g} s, although rho_inf = 1 dissipates nothing; reduce dt "
                "or tolerance"
            )
            continue
        jump = int(np.argmax(np.diff(balance))) + 1
        yield (
            f"spurious energy: the balance has grown by {gained:.3g} J ({probe.name}_balance) with "
            f"energies of at most {largest:.3g} J, most of it at t = {history['t'][jump]:.4g} s; "
            "reduce dt or tolerance, or use smoother initial velocities, drives and contacts"
        )
