# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strains and resultants differentiated along motions of the nodes."""

from collections.abc import Callable

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.probes.measured import ShellStrainProbe, StrainProbe
from flexfem.system.measure.sensors import create_sensor
from flexfem.system.system import System

__all__ = ["strain_rates"]

#: Step of central differences along a motion whose largest entry is 1.
_STEP = 1e-6


def strain_rates(
    system: System, serial: NumberedModel, split: Callable[[FloatArray], list[FloatArray]],
    motions: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Columns of strain probes and their derivatives by coordinates of motions (collective).

    Nodes are moved by ``sum_j motion_j q_j`` and the strains measured on both sides.

    Args:
        system: in the state the motions belong to, which is restored.
        serial: serial data of its model.
        split: from an array of this rank's unknowns to (n_owned, width) of each part.
        motions: (k, n_local) local twists of this rank's nodes.

    Returns:
        Values (p,) and derivatives (p, k), on every rank, in the order of the model's probes.
    """
    probes = [p for p in serial.model.probes if isinstance(p, StrainProbe | ShellStrainProbe)]
    if not probes:
        return np.zeros(0), np.zeros((0, len(motions)))
    sensors = [create_sensor(probe, system, serial) for probe in probes]
    blocks = [part.block for part in system.parts]
    frames = [block.frames.copy() for block in blocks]

    def measured() -> FloatArray:
        return np.concatenate([sensor.update() for sensor in sensors if sensor is not None])

    values = measured()
    slopes = np.zeros((len(values), len(motions)))
    for k, motion in enumerate(motions):
        largest = np.abs(motion).max(initial=0.0)
        size = _STEP / (system.comm.allreduce(float(largest), op=MPI.MAX) or 1.0)
        for block, own in zip(blocks, split(motion), strict=True):
            block.step[:] = 0.0  # nodes may have fewer than six unknowns
            block.owned_step[:] = size * own
            block.spread_step()
        for sign in (1.0, -1.0):
            for block, still in zip(blocks, frames, strict=True):
                block.frames[:] = se3.retract(still, sign * block.step)
            slopes[:, k] += sign / (2.0 * size) * measured()
    for block, still in zip(blocks, frames, strict=True):
        block.frames[:], block.step[:] = still, 0.0
    return system.comm.allreduce(values), system.comm.allreduce(slopes)
