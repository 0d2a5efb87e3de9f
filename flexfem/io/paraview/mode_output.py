# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes as ParaView series that show one period each."""

from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.io.paraview.field_output import FieldOutput
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.system.bounding_box import model_extent
from flexfem.system.system import System

__all__ = ["write_modes"]


def write_modes(
    folder: Path, system: System, serial: NumberedModel, shapes: Sequence[Sequence[FloatArray]],
    frequencies: FloatArray, amplitude: float, frames: int,
) -> None:  # fmt: skip
    """Write one series of files per mode into ``mode_01``, ``mode_02``, ... (collective).

    The time of each series runs over one period of its mode (over 1 s without oscillation). The
    state of the system is left as it was found.

    Args:
        folder: of the results.
        system: in the state the modes belong to.
        serial: serial data of its model.
        shapes: of each mode, complex local twists (n_owned, width) of each part's nodes.
        frequencies: (k,) Hz.
        amplitude: largest displacement relative to the size of the model.
        frames: instants per period.
    """
    size = amplitude * model_extent(serial)
    kept = [part.block.frames.copy() for part in system.parts]
    for number, shape in enumerate(shapes):
        largest = max((_largest(part) for part in shape), default=0.0)
        factor = size / (system.comm.allreduce(largest, op=MPI.MAX) or 1.0)
        period = 1.0 / frequencies[number] if frequencies[number] > 0.0 else 1.0
        output = FieldOutput(folder / f"mode_{number + 1:02d}", system, serial)
        for i in range(frames):
            phase = np.exp(2j * np.pi * i / frames)
            for part, base, local in zip(system.parts, kept, shape, strict=True):
                block = part.block
                block.owned_step[:] = (factor * phase * local).real
                block.spread_step()
                block.frames[:] = se3.retract(base, block.step)
            system.interface.update()
            system.constraints.accept()
            output.write(period * i / frames, i)
        output.close()
    for part, base in zip(system.parts, kept, strict=True):
        part.block.frames[:] = base
    system.interface.update()
    system.constraints.accept()


def _largest(twists: FloatArray) -> float:
    """Largest displacement, or rotation where nothing moves."""
    moved = float(np.linalg.norm(np.abs(twists[:, :3]), axis=1).max(initial=0.0))
    turned = float(np.abs(twists[:, 3:]).max(initial=0.0))
    return moved if moved > 1e-9 * turned else turned
