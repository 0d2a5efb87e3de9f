# SPDX-License-Identifier: LGPL-3.0-or-later
"""Consistent start: positions are checked, velocities and accelerations are solved for."""

from collections.abc import Sequence
from dataclasses import replace

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray
from flexfem.constraints.batch import Constraints
from flexfem.core.row import START_GAP
from flexfem.core.status import Status
from flexfem.integrators.ended_accelerations import keep_ended
from flexfem.integrators.redundancy import check_independence
from flexfem.integrators.stiff_dampers import StiffDampers
from flexfem.solvers.frozen.solver import FrozenSolver
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.system.mechanics import END_POINT, VISCOUS
from flexfem.system.system import GYROSCOPIC, MASS, System

__all__ = [
    "accelerate",
    "check_gaps",
    "check_start",
    "drives",
    "laws_settled",
    "make_consistent",
    "project_velocities",
    "second_rates",
    "start_consistently",
]

#: Factors with which rates of elastic rows are not scaled.
_RATES = np.array([1.0, 1.0])
#: Compliance of rigid rows that may be redundant, relative to that of the whole model's mass. A
#: constraint is violated by this part of the displacement of the model by its force in a step;
#: rounding of positions, divided by it, perturbs the part of the multipliers that does no work.
_COMPLIANCE = 1e-5
#: Span over which drives are differentiated, in time steps. A drive that begins with the third
#: power of time must give zero velocity, which would cause a force by stiffness-proportional
#: damping. A much shorter span would magnify the rounding of measured drives.
_SPAN = 0.125
#: Exponent n with which velocities are ended by dampers, or given by forces.
_PASSES = 4
#: Largest number of iterations for friction at the start.
_SWEEPS = 25


def check_start(system: System) -> None:
    """Check that the joints are satisfied at the start and independent (collective).

    Raises:
        InputError: a joint is not satisfied at the start, or constraints are redundant; named.
    """
    system.constraints.multipliers[:] = 0.0
    _evaluate(system)
    check_gaps(system)
    check_independence(system)


def start_consistently(
    system: System, tangent: TangentSolver, dt: float, least_norm: bool = False
) -> Status:
    """Check the positions, then make the other variables consistent (collective).

    With ``least_norm`` rigid rows get a tiny compliance c, ``Phi = c L``, which makes multipliers
    of dependent rows unique: the smallest of those with the same forces.

    Raises:
        InputError: a joint is not satisfied at the start, or constraints are redundant; named.
    """
    rows = system.constraints
    rows.multipliers[:] = 0.0
    _evaluate(system)
    check_gaps(system)
    if least_norm:
        _relax(system, tangent)
    else:
        check_independence(system)
    return make_consistent(system, tangent, dt, starting=True)


def make_consistent(
    system: System, tangent: TangentSolver, dt: float, *, starting: bool = False
) -> Status:
    """Make velocities, accelerations and multipliers satisfy the constraints (collective).

    Velocities are projected onto the constraints by the least kinetic energy (unchanged if they
    satisfy them already); accelerations and multipliers follow from ``[[M, G^T], [G, 0]] (w,
    lambda) = (f, -d(G v)/dt)``. Drives are differentiated by one-sided differences over a part of
    ``dt`` (s), as a motion need not be defined before the start. When a motion is ``starting``,
    dampers of joints end velocities, and light nodes get those, that they would have within much
    less than ``dt``.
    """
    rows = system.constraints
    for contacts in system.contacts:
        contacts.start(dt)
    failed = system.linear.counts.failed
    status = project_velocities(system, tangent, dt, np.zeros(rows.size))
    if status is not Status.OK:
        return status
    if starting and not _slow_down(system, tangent, dt):
        return _unsolved(system, failed)
    if not accelerate(system, tangent, dt):
        return _unsolved(system, failed)
    rows.forces[:], rows.impulses[:], rows.settled[:] = tangent.multiplier_step, 0.0, 0.0
    if not _decay(system, tangent, dt, starting=starting):
        return _unsolved(system, failed)
    for part in system.parts:
        part.block.spread_step()
        part.block.acceleration[:] = part.block.step
        part.block.start()
    rows.consistent, rows.slack = True, False
    rows.elements.start(rows)
    return Status.OK


def accelerate(system: System, tangent: TangentSolver, dt: float) -> bool:
    """Accelerations into the blocks' steps, forces of rows in the solver (collective).

    Accelerations of the trial state are zero, and its masses are factorised. Without success the
    result is False.
    """
    values, _ = drives(system, dt)
    _evaluate(system)
    accelerations = second_rates(system, dt, values)
    blocks = [-p.block.owned_residual for p in system.parts]
    for _ in range(_SWEEPS):
        if not tangent.solve(blocks, -_rigid(system, accelerations) - _compliant(system)):
            return False
        if not _update_laws(system, tangent):
            break
    return True


def _decay(system: System, tangent: TangentSolver, dt: float, *, starting: bool) -> bool:
    """Replace accelerations that damping ends within much less than ``dt`` (s) (collective).

    The accelerations are the blocks' steps a, which satisfy the constraints. A motion with masses M
    and damping C that is let go has lost those with ``dt C >> M`` before a step is over, whereas
    the scheme would go on with them: ``dt a``, were it the velocity of stiff membranes after the
    step, had them strained by the damping times it, and even the rounding of their forces does so
    for directors of thin shells. Dampers of joints do the same to light nodes.

    With ``F = (M + dt C)^-1 M`` on the constraints, ``(2 F - F^2) a`` hardly has them and is off by
    the order of ``dt^2`` only where a step resolves the damping. Where a motion is ``starting``
    with dampers of joints that it is far from resolving, velocities become those that forces have
    given it by then, see :func:`_give_rates`: the force over c at a light node, which would be late
    by half a step without that. C is that of linear damping, without users' laws of sections, and
    of dampers of joints that a step does not resolve. Bodies are factorised one by one: with the
    rows between them factors of large shells would take several times the memory.
    """
    rows, given = system.constraints, _steps(system)
    dampers = StiffDampers.of(system, tangent, dt)
    system.decayed = dampers.any or system.viscous()
    system.ended = []
    _set_steps(system, given)
    if not system.decayed:
        return True
    found = [np.zeros_like(step) for step in given]
    system.interface.update_steps()
    gaps = _rigid(system, rows.changes(system.interface.steps))
    dampers.use(rows, dt)
    damped = _damped_solver(system, tangent, dt)
    for values in (gaps, np.zeros_like(gaps)):
        for part, first, last in zip(system.parts, given, found, strict=True):
            part.block.owned_step[:] = first - last
        END_POINT.multiply_mass(system, 1.0)
        if damped is None or not damped.again(values)[0]:
            return False
        found = [last + step for last, step in zip(found, _steps(system), strict=True)]
    assert damped is not None
    gained = [np.zeros_like(step) for step in given]
    if starting and dampers.far:
        if not _give_rates(system, damped, dt):
            return False
        # velocities that are given have forces of elements which the accelerations do not know
        VISCOUS.multiply_mass(system, dt, GYROSCOPIC)
        gained = [part.block.owned_residual.copy() for part in system.parts]
    for part, first, last in zip(system.parts, given, found, strict=True):
        part.block.owned_step[:] = last - first
    END_POINT.multiply_mass(system, 1.0)
    lacking = zip(system.parts, gained, strict=True)
    keep_ended(system, [part.block.owned_residual + own for part, own in lacking])
    rows.evaluate(_RATES)
    for part, last in zip(system.parts, found, strict=True):
        part.block.owned_step[:] = last
    finite = all(bool(np.isfinite(last).all()) for last in found)
    return bool(system.comm.allreduce(finite, op=MPI.LAND))


def _give_rates(system: System, damped: FrozenSolver | TangentSolver, dt: float) -> bool:
    """Add ``dt (F - F^2) (1 - F)^n a`` to velocities, see :func:`_decay` (collective).

    The blocks' steps are ``(F - F^2) a``. Without success the result is False.
    """
    rates, zeros = _steps(system), np.zeros(system.constraints.size)
    for _ in range(_PASSES):
        END_POINT.multiply_mass(system, 1.0)
        if not damped.again(zeros)[0]:
            return False
        rates = [own - step for own, step in zip(rates, _steps(system), strict=True)]
        _set_steps(system, rates)
    for part in system.parts:
        part.block.velocity += dt * part.block.step
    return True


def _slow_down(system: System, tangent: TangentSolver, dt: float) -> bool:
    """End velocities that dampers of joints would end within much less than ``dt`` (collective).

    A step that begins with such a velocity v would move by half of ``dt v``, and its damper would
    dissipate more than there is. With F of :func:`_decay`, for the dampers alone, they become
    ``v - (1 - F)^n v``, where a drive of the damper moves as it says. Constraints, the limit of
    large dampers, do the same. The masses of the trial state are factorised, also after it.
    """
    rows, dampers = system.constraints, StiffDampers.of(system, tangent, dt)
    missed = (rows.rates() - rows.target_rates) * dampers.chosen
    if not system.comm.allreduce(bool(missed.any()), op=MPI.LOR):
        return True
    dampers.use(rows, dt)
    tangent.assemble(MASS, mechanics=VISCOUS)
    if not tangent.factor():
        return False
    zeros = [np.zeros_like(part.block.owned_residual) for part in system.parts]
    for _ in range(_PASSES):
        if not tangent.solve(zeros, -missed):
            return False
        for part in system.parts:
            part.block.spread_step()
        system.interface.update_steps()
        missed = -rows.changes(system.interface.steps) * dampers.chosen
    for part in system.parts:
        part.block.velocity += part.block.step
    system.slowed = True
    _evaluate(system)
    tangent.assemble(MASS)
    return tangent.factor()


def _damped_solver(
    system: System, tangent: TangentSolver, dt: float
) -> FrozenSolver | TangentSolver | None:
    """Solver with the factors of :func:`_decay`, None if these are singular (collective).

    Bodies without masses, which cannot be factorised one by one, are factorised with the rows.
    """
    shifts = replace(MASS, velocity=dt)
    damped = FrozenSolver(system, VISCOUS)
    damped.factor(shifts)
    if damped.prepare(shifts):
        return damped
    tangent.assemble(shifts, mechanics=VISCOUS)
    return tangent if tangent.factor() else None


def _set_steps(system: System, steps: Sequence[FloatArray]) -> None:
    """Set the steps of all blocks, those of ghosts as well (collective)."""
    for part, step in zip(system.parts, steps, strict=True):
        part.block.owned_step[:] = step
        part.block.spread_step()


def _steps(system: System) -> list[FloatArray]:
    return [part.block.owned_step.copy() for part in system.parts]


def project_velocities(
    system: System, tangent: TangentSolver, dt: float, restitution: FloatArray
) -> Status:
    """Project the velocities onto the constraints by the least kinetic energy (collective).

    Accelerations are set to zero; the matrix stays factorised.

    Args:
        system: at its trial state.
        tangent: solver of the exact matrix.
        dt: span over which drives are differentiated, s.
        restitution: (r,) rates of the rows are reversed by this factor; 0 makes them zero.
    """
    system.constraints.multipliers[:] = 0.0
    for part in system.parts:
        part.block.acceleration[:] = 0.0
    _evaluate(system)
    tangent.assemble(MASS)
    system.counters.mass_factorizations += 1
    failed = system.linear.counts.failed
    if not tangent.factor():
        return _unsolved(system, failed)
    zeros = [np.zeros_like(p.block.owned_residual) for p in system.parts]
    _, rates = drives(system, dt)
    if not tangent.solve(zeros, -_rigid(system, (1.0 + restitution) * rates)):
        return _unsolved(system, failed)
    for part in system.parts:
        part.block.spread_step()
        part.block.velocity += part.block.step
    return Status.OK


def _unsolved(system: System, failed: int) -> Status:
    """Reason of a linear solve without success, before which so many had failed."""
    return Status.UNSOLVED if system.linear.counts.failed > failed else Status.SINGULAR


def _evaluate(system: System) -> None:
    for part, own in zip(system.parts, system.damped(system.present), strict=True):
        part.add_residual(system.gravity, system.factors, 1.0, own)
    system.interface.update()
    system.constraints.evaluate(_RATES)


def _rigid(system: System, values: FloatArray) -> FloatArray:
    return values * system.constraints.rigid


def _relax(system: System, tangent: TangentSolver) -> None:
    """Compliance of rigid rows relative to the model's mass, and targets without rounding."""
    rows, mass = system.constraints, 0.0
    tangent.assemble(MASS)
    for i, part in enumerate(system.parts):
        diagonal = tangent.matrix.getNestSubMatrix(i, i).getDiagonal().getArray(readonly=True)
        mass += float(diagonal.reshape(part.block.owned, part.block.width)[:, :3].sum()) / 3.0
    rows.relaxation = _COMPLIANCE / system.comm.allreduce(mass)
    # gaps within rounding would cause opposite forces of dependent rows
    driven = np.array([placed.joint.driven for placed in rows.joints], dtype=np.bool_)
    held = rows.rigid & ~driven[rows.joint_of_row]
    rows.targets[held] += rows.values[held]
    rows.evaluate(_RATES)


def _compliant(system: System) -> FloatArray:
    """Equations of the rows with force laws, linearised, at zero multipliers."""
    rows = system.constraints
    return (rows.values + rows.yielding(rows.multipliers)) * ~rows.rigid


def _update_laws(system: System, tangent: TangentSolver) -> bool:
    """Linearise friction at the multipliers found; False when they have settled (collective).

    Forces of other laws are explicit, since they do not depend on multipliers.
    """
    rows, found = system.constraints, tangent.multiplier_step
    if laws_settled(system, found):
        return False
    rows.multipliers[:] = found
    rows.evaluate(_RATES)
    tangent.assemble(MASS)
    return tangent.factor()


def laws_settled(system: System, found: FloatArray) -> bool:
    """True if the multipliers (r,) of friction are those of its linearisation (collective).

    It is also true without friction.
    """
    rows = system.constraints
    rubbing = _rubbing(rows)
    change = np.max(np.abs(found - rows.multipliers)[rubbing], initial=0.0)
    size = np.max(np.abs(found)[rubbing], initial=0.0)
    largest = np.array([change, size])
    system.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
    return not bool(largest[0] > 1e-12 * largest[1])


def _rubbing(rows: Constraints) -> BoolArray:
    """(r,) rows with friction and rows of their normal forces."""
    chosen = rows.frictional
    chosen[rows.coupled[:, 1]] = True
    return chosen


def check_gaps(system: System) -> None:
    """Raise for a rigid joint that is violated by its markers (collective; rows are evaluated).

    Raises:
        InputError: names the first such joint.
    """
    rows = system.constraints
    gaps = np.abs(_rigid(system, rows.values))
    worst = {
        joint.index: (joint.joint, float(gaps[a:b].max(initial=0.0)))
        for joint, a, b in zip(rows.joints, rows.start[:-1], rows.start[1:], strict=True)
    }
    bad = sorted(index for index, (_, gap) in worst.items() if not gap <= START_GAP)
    first = system.comm.allreduce(bad[0] if bad else np.iinfo(np.int64).max, op=MPI.MIN)
    if first == np.iinfo(np.int64).max:
        return
    text = None
    if first in worst:
        joint, gap = worst[first]
        text = (
            f"{joint.owner}: the markers violate the joint at the start by {gap:.6g} (m or rad); "
            "place the bodies so that it holds, or let flexfem.assemble move them"
        )
    texts = [t for t in system.comm.allgather(text) if t is not None]
    raise InputError(texts[0])


def drives(system: System, dt: float) -> tuple[list[FloatArray], FloatArray]:
    """Row values at t, t + h, t + 2 h, t + 3 h at fixed positions, and total rates at t.

    The span h is a part of ``dt``; rates are exact for motions of third degree.
    """
    rows, start, h = system.constraints, system.instant, _SPAN * dt
    values = []
    for k in range(4):
        rows.set_time(start + k * h)
        rows.evaluate(_RATES)
        values.append(rows.values.copy())
    rows.set_time(start)
    rows.evaluate(_RATES)
    by_time = (-11.0 * values[0] + 18.0 * values[1] - 9.0 * values[2] + 2.0 * values[3]) / (6.0 * h)
    return values, rows.rates() + by_time


def second_rates(system: System, dt: float, values: list[FloatArray]) -> FloatArray:
    """Second time derivative of the rows at zero accelerations."""
    rows, start, h = system.constraints, system.instant, _SPAN * dt
    rates = []
    for k in range(3):
        rows.set_time(start + k * h)
        rows.evaluate(_RATES)
        rates.append(rows.rates())
    rows.set_time(start)
    rows.evaluate(_RATES)
    turning = (-3.0 * rates[0] + 4.0 * rates[1] - rates[2]) / (2.0 * h)
    by_time = (2.0 * values[0] - 5.0 * values[1] + 4.0 * values[2] - values[3]) / (h * h)
    return rows.second_rates() + 2.0 * turning + by_time
