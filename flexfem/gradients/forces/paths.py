# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of second rates of rows by positions and velocities of the nodes with joints.

Along ``q exp(t v + t^2/2 a)`` the second rate of a row at constant local velocities v, with local
accelerations a, is the second derivative of its value at ``t = 0``. Differences of eighth order of
the values turn its derivatives by q and v into gradients of the row at a few places.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.gradients.equations.node_maps import transposed
from flexfem.gradients.equations.step_tangent import forces_at_interface
from flexfem.lie import se3
from flexfem.system.system import System

__all__ = ["second_rates_transposed"]

#: Weights of differences of the second order, at 0 and at 1 to 4 steps on either side.
_SECOND = (-205.0 / 72.0, 8.0 / 5.0, -1.0 / 5.0, 8.0 / 315.0, -1.0 / 560.0)
#: Motions over a step of the differences, m or rad, of which the best is taken.
_MOTIONS = (0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4)
#: Error of differences, relative to the largest second rate, up to which no better step is sought,
#: and up to which the best one will do: sliders pass from one element to the next at kinks.
_ENOUGH, _MISSED = 1e-10, 1e-6
#: Size of second rates whose parts cancel, over the square of the size of the motion: about that of
#: mechanisms of a millimetre.
_CANCELLED = 1e-3
#: Factors with which rows are evaluated at a state, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])


def second_rates_transposed(
    system: System, factors: FloatArray, velocities: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Factors (r,) of rows times derivatives of their second rates (collective).

    Args:
        system: at its state, to which it returns; its rows are evaluated there.
        factors: zero for rows that are no constraint equations.
        velocities: (n, 6) local twists of the interface nodes.
        accelerations: (n, 6) their rates.

    Returns:
        (n, 6) by local twists of the interface nodes, and by their velocities.
    """
    face, rows = system.interface, system.constraints
    frames, before = face.frames.copy(), face.velocities.copy()
    face.velocities[:] = velocities
    turning, along = rows.second_rates() * rows.rigid, rows.changes(accelerations) * rows.rigid
    largest = [float(np.abs(x).max(initial=0.0)) for x in (velocities, accelerations, turning)]
    sizes = np.array([max(1e-3, largest[0], largest[1] ** 0.5), max(largest[1:])])
    system.comm.Allreduce(MPI.IN_PLACE, sizes, op=MPI.MAX)
    size, scale = sizes[0], sizes[1] + _CANCELLED * sizes[0] ** 2
    least, best = np.inf, np.zeros((2, *velocities.shape))
    for motion in _MOTIONS:
        step, values = motion / size, np.zeros(rows.size)
        found = np.zeros_like(best)
        for k in range(-4, 5):
            t, weight = k * step, _SECOND[abs(k)] / step**2
            way = t * velocities + 0.5 * t * t * accelerations
            face.frames[:] = se3.retract(frames, way)
            rows.evaluate(_UNSCALED)
            values += weight * rows.sums()
            forces = weight * forces_at_interface(system, rows.force_jacobian, factors)
            found[0] += transposed(se3.adjoint(se3.exp(-way)), forces)
            found[1] += t * transposed(se3.tangent(way), forces)
        off = float(np.abs(values * rows.rigid - turning - along).max(initial=0.0))
        off = system.comm.allreduce(off, op=MPI.MAX)
        if off < least:
            least, best = off, found
        if off <= _ENOUGH * scale or least < _MISSED * scale < off:
            break
    face.frames[:], face.velocities[:] = frames, before
    rows.evaluate(_UNSCALED)
    if least > _MISSED * scale:
        raise InputError(
            f"gradient: forces of joints have no derivatives at t = {system.time:.6g} s, where a "
            "joint is at a kink, as a slider is between two elements"
        )
    return best[0], best[1]
