# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static equations of a model at rest, and detection of motions without stiffness."""

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem.core.status import Status
from flexfem.integrators.start import check_start
from flexfem.layout.numbered_model import NumberedModel
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.statics.equilibrium import Equilibrium, Limits, Loading, settle
from flexfem.solvers.statics.stability import softest_motion
from flexfem.solvers.statics.stabilized_steps import HeldEquilibrium
from flexfem.system.bounding_box import model_extent
from flexfem.system.mechanics import END_POINT
from flexfem.system.system import System

__all__ = ["check_held", "rest", "start_in_equilibrium"]

#: Stiffness of a motion relative to that of the nodes below which it is round-off.
_NOTHING = 1e-13
#: Relative participation of a body in such a motion above which it is named.
_PART = 1e-3
_NAMES = 4


def rest(
    serial: NumberedModel, system: System, tangent: TangentSolver, limits: Limits, *, span: float,
    grow: bool, gravity_grows: bool, stabilise: bool,
) -> Equilibrium:  # fmt: skip
    """Static equations of a system at its start (collective).

    Args:
        serial: serial data of the model.
        system: the system, at its start.
        tangent: its exact matrix.
        limits: stopping criteria of iterations.
        span: end of the load parameter.
        grow: loads without amplitude grow in proportion to the load parameter.
        gravity_grows: gravity is in proportion to it, too.
        stabilise: regularise motions without stiffness and descend in energy only.

    Raises:
        InputError: a joint is not satisfied at the start, or constraints are redundant; named.
    """
    loads = serial.model.loads
    rows = system.constraints
    system.set_time(0.0)
    check_start(system)
    growing = np.array([grow and load.amplitude is None for load in loads], dtype=np.bool_)
    # a force by the value of its own row has a potential, those of an element together need not
    alone = not rows.of_elements.any()
    conservative = bool(system.comm.allreduce(alone, op=MPI.LAND)) and not any(
        load.follower or load.has_moment for load in loads
    )
    loading = Loading(system, growing, gravity_grows, span)
    kind = HeldEquilibrium if stabilise else Equilibrium
    return kind(
        system, tangent, loading, model_extent(serial), limits, conservative=conservative,
    )  # fmt: skip


def start_in_equilibrium(serial: NumberedModel, system: System, tangent: TangentSolver) -> Status:
    """Bring a system to rest under gravity and the loads at t = 0 (collective).

    Raises:
        InputError: a joint is not satisfied at the start, or constraints are redundant; named.
    """
    limits = Limits(max_iterations=200)
    equilibrium = rest(
        serial, system, tangent, limits, span=1.0, grow=False, gravity_grows=False, stabilise=True
    )
    status = settle(equilibrium)
    equilibrium.release()
    return status


def check_held(serial: NumberedModel, equilibrium: Equilibrium) -> None:
    """Raise for bodies that can move without any stiffness, as in a mechanism (collective).

    Raises:
        InputError: names the bodies.
    """
    system, tangent = equilibrium.system, equilibrium.tangent
    equilibrium.loading.set(0.0)
    END_POINT.evaluate(system, equilibrium.shifts)
    equilibrium.assemble()
    # unbalanced loads would couple motions without stiffness
    tangent.add_at_nodes(equilibrium.turning())
    stiffness, motion = softest_motion(tangent, equilibrium.weights)
    if not abs(stiffness) <= _NOTHING:  # nor where it is unknown: the run's own solves tell
        return
    sizes = []
    for steps in motion:
        scale = np.repeat([equilibrium.size, 1.0], 3)[: steps.shape[1]]
        sizes.append(np.abs(steps / scale).max(axis=1, initial=0.0))
    largest = max((float(s.max(initial=0.0)) for s in sizes), default=0.0)
    largest = system.comm.allreduce(largest, op=MPI.MAX)
    mine = set()
    for part, size in zip(system.parts, sizes, strict=True):
        for body in np.unique(part.node_body[: part.block.owned][size > _PART * largest]):
            mine.add((part.kind, int(body)))
    moving = sorted(set().union(*system.comm.allgather(mine)))
    owners = [serial.body(kind, number) for kind, number in moving]
    names = [f'{type(body).__name__} "{body.name}"' for body in owners]
    more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
    raise InputError(
        f"{', '.join(names[:_NAMES])}{more}: can move without any stiffness at the start (a "
        "mechanism, or a body that is free to rotate); constrain it by joints or springs, or use "
        "stabilise"
    )
