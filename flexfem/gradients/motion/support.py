# SPDX-License-Identifier: LGPL-3.0-or-later
"""What can be differentiated: everything else is refused by name."""

from collections.abc import Iterable

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem.analyses.dynamics import RunOptions
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.contact.contacts import Contacts
from flexfem.control.fmu import FmuLaw
from flexfem.core.marker import Observed, SlidingMarker
from flexfem.gradients.equations.node_maps import twists
from flexfem.gradients.motion.functionals import TIME
from flexfem.model.event import LockJoint, Rebound, ReleaseJoint, Stop
from flexfem.model.model import Model
from flexfem.model.probes.cable import CableProbe
from flexfem.model.probes.measured import ReactionProbe
from flexfem.options import meant
from flexfem.simulation.motion.breakpoints import Breakpoints
from flexfem.system.system import System

__all__ = [
    "check_alike", "check_columns", "check_contacts", "check_fixed", "check_layout",
    "check_sliding", "check_supported", "check_times", "differentiable",
]  # fmt: skip

#: Integrators whose steps have derivatives.
_INTEGRATORS = ("generalized_alpha", "energy_momentum", "stabilized_index2")
#: Motion of fixed nodes, m and rad, up to which it is none.
_ROUNDING = 1e-13


def differentiable(model: Model) -> list[str]:
    """Columns that have derivatives."""
    return [name for probe in model.probes for name in probe.differentiable]


def check_columns(model: Model, names: Iterable[str]) -> None:
    """Check that columns have derivatives; times of a motion that an event ends do.

    Raises:
        InputError: there is no such column, or it has none.
    """
    probe_of = {column: probe for probe in model.probes for column in probe.columns}
    for name in names:
        if name == TIME:
            continue
        probe = probe_of.get(name)
        if probe is None:
            hint = meant(name, probe_of) or f"the history has {', '.join(probe_of) or 'none'}"
            raise InputError(f'gradient: there is no column "{name}", {hint}')
        if name not in probe.differentiable:
            raise InputError(
                f'gradient: column "{name}" of {type(probe).__name__} "{probe.name}" has no '
                "derivatives yet"
            )


def check_supported(model: Model, options: RunOptions) -> None:
    """Refuse models and options of which the adjoint would miss a part.

    Raises:
        InputError: naming it.
    """
    for controller in model.controllers:
        if isinstance(controller.law, FmuLaw):
            raise InputError(
                f'gradient: FmuController "{controller.name}" has no derivatives, as its FMU keeps '
                "its states to itself; leave it out"
            )
        measured = controller.measured(model)
        check_columns(model, [probe.columns[k] for probe, k in measured])
        for probe, k in measured:
            check_sliding(f'Controller "{controller.name}"', probe.markers)
            if isinstance(probe, (ReactionProbe, CableProbe)):
                raise InputError(
                    f'gradient: Controller "{controller.name}" measures "{probe.columns[k]}", a '
                    "force of a joint, which has no derivatives in controllers yet"
                )
    for event in model.events:
        for action in event.actions:
            if not isinstance(action, (LockJoint, Rebound, ReleaseJoint, Stop)):
                name = getattr(type(action), "__name__", "function")
                raise InputError(
                    f'gradient: Event "{event.name}" has an action {name}, which has no '
                    "derivatives yet; leave it out"
                )
    chosen = {"integrator": _INTEGRATORS, "linear_solver": ("direct", "auto")}
    for name, values in chosen.items():
        if (given := getattr(options, name)) not in values:
            raise InputError(
                f"gradient: {name} must be {' or '.join(map(repr, values))}, got {given!r}"
            )
    if options.restart is not None:
        raise InputError("gradient: a motion is differentiated from its start, without restart")


def check_sliding(owner: str, markers: Iterable[Observed]) -> None:
    """Refuse markers that slide, for other things than columns.

    Raises:
        InputError: one does.
    """
    if any(isinstance(marker, SlidingMarker) for marker in markers):
        raise InputError(f"gradient: {owner} has a SlidingMarker, which has no derivatives yet")


def check_contacts(every: Iterable[Contacts | BarrierContacts]) -> None:
    """Refuse contacts of which the adjoint would miss a part.

    Raises:
        InputError: naming it.
    """
    for contacts in every:
        if isinstance(contacts, BarrierContacts):
            for own in contacts.contacts:
                if own.contact.restitution < 1.0:
                    raise InputError(
                        f'gradient: Contact "{own.contact.name}": restitution has no derivatives '
                        "yet; leave it out"
                    )


def check_alike(model: Model, other: Model, name: str) -> None:
    """Raise unless another model has the probes, controllers and events of the model, in order.

    They are known by their numbers, and are not in the equations that :func:`check_layout` and
    differences of these compare.
    """
    for what in ("probes", "controllers", "events"):
        own, others = (
            [(type(one), one.name, getattr(one, "columns", ())) for one in getattr(each, what)]
            for each in (model, other)
        )
        if own != others:
            raise InputError(
                f'gradient: "{name}" changes which {what} there are, or their order; keep them'
            )


def check_layout(system: System, other: System, name: str) -> None:
    """Raise unless blocks, rows and contacts of another model are those of the motion's.

    Collective.
    """
    same = len(other.parts) == len(system.parts)
    same = same and other.constraints.size == system.constraints.size
    same = same and _states(other) == _states(system)
    same = same and all(
        np.array_equal(a.block.node_ids, b.block.node_ids) and a.block.width == b.block.width
        for a, b in zip(other.parts, system.parts, strict=True)
    )
    if not system.comm.allreduce(same, op=MPI.LAND):
        raise InputError(
            f'gradient: "{name}" changes the number of nodes, joints or states of forces, and has '
            "no derivative"
        )
    # those of the whole model, on all ranks
    if _contact_names(other) != _contact_names(system):
        raise InputError(f'gradient: "{name}" changes which contacts there are; keep them all')


def _states(system: System) -> list[int]:
    """Number of states of an element of each force law on this rank."""
    return [group.law.states for group in system.constraints.elements.groups]


def _contact_names(system: System) -> list[tuple[type, list[str]]]:
    """Names of contacts by each law, in the order of the model."""
    found: list[tuple[type, list[str]]] = []
    for contacts in system.contacts:
        if isinstance(contacts, BarrierContacts):
            every = [own.contact for own in contacts.contacts]
        else:
            every = [group.surfaces.contact for group in contacts.groups]
        found.append((type(contacts), [own.name for own in every]))
    return found


def check_times(own: Breakpoints, other: Breakpoints, name: str) -> None:
    """Refuse parameters that move jumps and kinks at which steps end (same on all ranks)."""
    if not other.same(own):
        raise InputError(
            f'gradient: "{name}" moves the time of a jump or kink of a load or drive, at which a '
            "step ends, and has no derivative yet"
        )


def check_fixed(system: System, other: System, name: str) -> None:
    """Refuse parameters that move nodes with rotations that are fixed in part (collective)."""
    partly = False
    for part, moved in zip(system.parts, other.parts, strict=True):
        if (fixed := part.block.dirichlet) is not None and part.block.width == 6:
            frames = part.block.start_frames, moved.block.start_frames
            change = np.abs(twists(*frames, inertial=part.block.inertial)) * fixed
            some = change.max(axis=1, initial=0.0) > _ROUNDING
            partly = partly or bool((some & ~fixed.all(axis=1)).any())
    if system.comm.allreduce(partly, op=MPI.LOR):
        raise InputError(
            f'gradient: "{name}" moves nodes that are fixed in part, and has no derivative yet'
        )
