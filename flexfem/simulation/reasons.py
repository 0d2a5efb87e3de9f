# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reasons of failed computations: what failed, where in the model, and advice.

A reason is one line: what happened, when, where; what to try. The guide has a page on them.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from flexfem.core.status import Status
from flexfem.system.assembly import Assembly
from flexfem.system.connect import joint_ends
from flexfem.system.extent import model_extent
from flexfem.system.system import System

__all__ = [
    "EQUATIONS",
    "ITERATED",
    "MOTION",
    "RELAXATION",
    "START",
    "STATICS",
    "modes_hint",
    "moves_most",
    "not_finite",
    "with_hint",
]

#: Failures whose last iteration tells where in the model they came from.
ITERATED = (Status.NOT_CONVERGED, Status.DIVERGED)
_STEP = (
    "take a smaller dt or smoother drives, loads and contacts, and look at the last fields, "
    "where it starts"
)
#: What to try where a motion failed.
MOTION: Mapping[Status, str] = {
    Status.NOT_CONVERGED: _STEP,
    Status.DIVERGED: _STEP,
    Status.INACCURATE: "take a larger error_tolerance, or smooth what jumps",
    Status.SINGULAR: "look for joints that hold the same motion twice there (redundant_constraints "
    "least_norm carries them), for bodies without mass, and for positions that a mechanism cannot "
    "pass",
}
#: The same where the equilibrium was not found in which it is to start.
START = (
    "the model may have no equilibrium near its start, because nothing holds it up for example: "
    "flexfem info tells what looks wrong, start given begins at rest or with what bodies have"
)
#: The same where a mechanism of energies, or other equations, failed.
EQUATIONS: Mapping[Status, str] = {
    Status.NOT_CONVERGED: _STEP,
    Status.DIVERGED: _STEP,
    Status.SINGULAR: "look for constraints that hold the same motion twice there, for bodies "
    "without mass, and for positions that a mechanism cannot pass",
}
_LOAD = (
    "take more load_steps, arc_length to pass a limit point, or stabilise to find a stable "
    "equilibrium"
)
#: The same for statics.
STATICS: Mapping[Status, str] = {
    Status.NOT_CONVERGED: _LOAD,
    Status.DIVERGED: _LOAD,
    Status.SINGULAR: "hold what moves without stiffness by joints or springs, or stabilise; at a "
    "limit point take arc_length",
    Status.INSIDE_OUT: "linear laws yield to a finite force: take smaller loads, or a law that "
    "resists any compression",
}
#: What to try where a relaxation has not come to rest, and where it diverged.
RELAXATION = (
    "raise max_iterations, go on with restart, or accept a larger tolerance",
    "raise margin, or lower the stiffness of contact",
)


def with_hint(reason: str, hint: str | None) -> str:
    """A reason and what to try, on one line."""
    return f"{reason}; {hint}" if hint else reason


def modes_hint(status: Status, spin: float) -> str:
    """Return advice where the state about which modes are wanted was not found.

    Args:
        status: why not.
        spin: speed of the steady rotation, rad/s; only without one there is a choice of states.
    """
    if status is Status.SINGULAR:
        return "look for bodies without mass and for motions without stiffness"
    loads = "how far its loads can grow"
    if spin:
        return f"a lower spin shows how fast it can turn, the analysis statics {loads}"
    return f"start rest takes the model as it is given; the analysis statics shows {loads}"


def not_finite(serial: Assembly, times: Iterable[float]) -> str | None:
    """The first drive that is not a number at one of the times; None if all are."""
    times = list(times)
    for joint in serial.joints:
        if joint.driven:
            poses = joint_ends(serial, joint).poses
            targets = [row.target for t in times for row in joint.rows(poses, t)]
            if not np.isfinite(targets).all():
                return f"{joint.owner}: the motion is not finite"
    return None


def moves_most(serial: Assembly, system: System) -> str:
    """Words for the body that the last iteration moved most, and where (collective).

    Steps of positions count relative to the size of the model, those of rotations in rad.
    """
    scale, worst = np.array([model_extent(serial), 1.0]).repeat(3), []
    for part in system.parts:
        block = part.block
        steps = np.nan_to_num(np.abs(block.owned_step), nan=np.inf) / scale[: block.width]
        sizes = steps.max(axis=1, initial=0.0)
        if len(sizes):
            node = int(np.argmax(sizes))
            body = int(part.node_body[node])
            # some nodes of floating bodies hold amplitudes
            placed = part.family.bodies_have_places
            x = tuple(block.frames0[node, :3].tolist()) if placed else ()
            worst.append((float(sizes[node]), -part.kind, -body, x))
    found = max((each for most in system.comm.allgather(worst) for each in most), default=None)
    if found is None or found[0] in (0.0, np.inf):
        return ""
    _, kind, number, x = found
    owner = serial.body(-kind, -number)
    at = f" at ({', '.join(f'{c:.3g}' for c in x)})" if x else ""
    return f' (the last iteration moved {type(owner).__name__} "{owner.name}" most{at})'
