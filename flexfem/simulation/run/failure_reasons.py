# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reasons of failed computations: the failure, its place in the model, and advice.

A reason is one line: failure, time, place; advice. The guide has a page on them.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from flexfem.constraints.connect import joint_ends
from flexfem.core.status import Status
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.bounding_box import model_extent
from flexfem.system.system import System

__all__ = [
    "EQUATIONS",
    "ITERATED",
    "MOTION",
    "RELAXATION",
    "STABILISED",
    "START",
    "STATICS",
    "modes_hint",
    "moves_most",
    "not_finite",
    "with_hint",
]

#: Failures whose last iteration indicates a place in the model.
ITERATED = (Status.NOT_CONVERGED, Status.DIVERGED)
_STEP = (
    "reduce dt, use smoother drives, loads and contacts, and inspect the last fields to see where "
    "the failure starts"
)
#: Advice after a failure of a motion.
MOTION: Mapping[Status, str] = {
    Status.UNSOLVED: "use linear_solver direct, or reduce dt: the matrix is nearly singular, or "
    "bodies are on the verge of buckling",
    Status.NOT_CONVERGED: _STEP,
    Status.DIVERGED: _STEP,
    Status.INACCURATE: "increase error_tolerance, or smooth the jumps of drives and loads",
    Status.SINGULAR: "check for redundant constraints there (redundant_constraints least_norm "
    "admits them), for bodies without mass, for singular configurations of mechanisms, and "
    "for laws whose derivatives are not finite there, as that of a square root at zero",
}
#: Advice if its equilibrium at the start was not found.
START = (
    "the model may have no static equilibrium near its initial configuration (is a body "
    "unsupported?): run flexfem info, or use start given to begin with the initial velocities"
)
#: Advice for a mechanism of energies, or other equations.
EQUATIONS: Mapping[Status, str] = {
    Status.NOT_CONVERGED: _STEP,
    Status.DIVERGED: _STEP,
    Status.SINGULAR: "check for redundant constraints there, for bodies without mass, and for "
    "singular configurations of mechanisms",
}
_LOAD = (
    "increase load_steps, use arc_length to pass a limit point, or stabilise to find a stable "
    "equilibrium"
)
#: Advice for statics.
STATICS: Mapping[Status, str] = {
    Status.UNSOLVED: "use linear_solver direct, or increase load_steps: bodies are nearly "
    "incompressible or on the verge of buckling, or the matrix is nearly singular",
    Status.NOT_CONVERGED: _LOAD,
    Status.DIVERGED: _LOAD,
    Status.SINGULAR: "constrain motions without stiffness by joints or springs, or use stabilise; "
    "at a limit point use arc_length",
    Status.INSIDE_OUT: "a finite force compresses a linear law to nothing: reduce the loads, or "
    "use a law that resists any compression",
}
_STABLE = (
    "increase load_steps or max_iterations, or reduce the loads: there may be no stable "
    "equilibrium for them"
)
#: Advice for statics that are stabilised already.
STABILISED: Mapping[Status, str] = {
    **STATICS,
    Status.NOT_CONVERGED: _STABLE,
    Status.DIVERGED: _STABLE,
    Status.SINGULAR: "constrain motions without stiffness by joints or springs",
}
#: Advice for a relaxation that has not come to rest, and one that diverged.
RELAXATION = (
    "increase max_iterations, continue with restart, or accept a larger tolerance",
    "increase margin, or reduce the contact stiffness",
)


def with_hint(reason: str, hint: str | None) -> str:
    """A reason and advice, on one line."""
    return f"{reason}; {hint}" if hint else reason


def modes_hint(status: Status, spin: float, touching: bool = False) -> str:
    """Return advice if the state about which modes are requested was not found.

    Args:
        status: reason of the failure.
        spin: speed of the steady rotation, rad/s; only without one there is a choice of states.
        touching: True if there is contact, which may hold what nothing else does.
    """
    if status is Status.SINGULAR:
        text = "check for bodies without mass and for motions without stiffness"
        held = "contact holds bodies that touch: give state, a checkpoint where they do"
        return with_hint(text, held if touching else None)
    loads = "run the analysis statics to find how far its loads can grow"
    if spin:
        return f"reduce spin to find how fast the model can rotate, or {loads}"
    return f"use start rest to linearise about the model as it is given, or {loads}"


def not_finite(serial: NumberedModel, times: Iterable[float]) -> str | None:
    """The first drive that is not finite at one of the times; None if all are."""
    times = list(times)
    for joint in serial.joints:
        if joint.driven:
            poses = joint_ends(serial, joint).poses
            targets = [row.target for t in times for row in joint.rows(poses, t)]
            if not np.isfinite(targets).all():
                return f"{joint.owner}: the motion is not finite"
    return None


def moves_most(serial: NumberedModel, system: System) -> str:
    """Text for the largest Newton increment: its body and place (collective).

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
            # some nodes of floating bodies are amplitudes
            placed = part.family.bodies_have_places
            x = tuple(block.frames0[node, :3].tolist()) if placed else ()
            worst.append((float(sizes[node]), -part.kind, -body, x))
    found = max((each for most in system.comm.allgather(worst) for each in most), default=None)
    if found is None or found[0] in (0.0, np.inf):
        return ""
    _, kind, number, x = found
    owner = serial.body(-kind, -number)
    at = f" at ({', '.join(f'{c:.3g}' for c in x)})" if x else ""
    return f' (largest Newton increment: {type(owner).__name__} "{owner.name}"{at})'
