# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress display of a run, evaluated only when it is shown."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexfem.model.model import Model
from flexfem.system.measure.energies import EnergyMeter, refresh_rows
from flexfem.system.measure.probes import ProbeRecorder
from flexfem.system.system import System

__all__ = ["Monitor"]


class Monitor:
    """Energies and contacts of the accepted state, as text."""

    def __init__(
        self, system: System, model: Model, probes: ProbeRecorder, moving: bool
    ) -> None:  # fmt: skip
        """Store the system without evaluating it.

        Args:
            system: system whose accepted state is shown.
            model: its model.
            probes: its probes, one of which may have evaluated the energies already.
            moving: True if there is kinetic energy.
        """
        self._system, self._model, self._moving = system, model, moving
        self._probed = probes.energies
        self._meter: EnergyMeter | None = None

    def words(self) -> list[str]:
        """Return the text to be shown, the same on every rank (collective)."""
        system = self._system
        kinetic, strain, balance = self._energies()
        contacts = float(sum(group.closed for group in system.contacts))
        shares = np.array([kinetic, strain, balance, contacts])
        system.comm.Allreduce(MPI.IN_PLACE, shares)
        kinetic, strain, balance, contacts = shares.tolist()
        words = [f"kinetic {kinetic:.4g} J"] if self._moving else []
        words.append(f"strain {strain:.4g} J")
        if self._probed is not None and self._moving:
            words.append(f"balance {balance:.2g} J")
        if system.contacts:
            words.append(f"{contacts:.0f} contacts")
        return words

    def _energies(self) -> tuple[float, float, float]:
        """Shares of this rank in kinetic and strain energy and in the balance, J."""
        if self._probed is not None:
            kinetic, strain, *_, balance = self._probed.latest.tolist()
            return kinetic, strain, balance
        if self._meter is None:
            self._meter = EnergyMeter(self._system, self._model)
        refresh_rows(self._system)
        kinetic, strain, _ = self._meter.stored().tolist()
        return kinetic, strain, 0.0
