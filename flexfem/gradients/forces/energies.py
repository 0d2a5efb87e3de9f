# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of energies and momenta of bodies.

With the masses M, local velocities V and the local twists ``t`` of rigid motions, the kinetic
energy is ``V . M V / 2`` and momenta are ``t . M V``: their derivatives by velocities are products
with masses, those by positions are the derivatives of ``M a`` with accelerations ``a = V`` (see
``gradients.equations``). First moments of mass change by the forces of a unit gravity, strain
energies by the elastic forces of elements and rows, and those of contacts in equilibria.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray
from flexfem.core.differences import STENCIL
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.gradients.equations.node_maps import RateMaps, moved, rotations, transposed
from flexfem.gradients.equations.step_tangent import (
    POSITIONS,
    BlockVectors,
    StepTangent,
    collected,
    forces_at_interface,
    forces_on_blocks,
    put_steps,
)
from flexfem.gradients.memory.lagged_contacts import lagging
from flexfem.layout.tangent_request import EXACT
from flexfem.system.measure.energies import EnergyMeter, refresh_rows
from flexfem.system.measure.momenta import MomentumMeter
from flexfem.system.mechanics import END_POINT
from flexfem.system.system import Shifts, System

__all__ = ["BodyDerivatives"]

#: Equations at a state, not scaled.
_AT_STATE = Shifts(velocity=1.0, acceleration=1.0, scale=1.0)
#: Accelerations with which forces of masses are seen beside those of stiff bodies: these are linear
#: in them.
_LARGE = 1e6
#: Steps of differences along a direction at random, and their deviation up to which derivatives are
#: those of the columns.
_STEPS, _EXACT = (1e-3, 1e-4, 1e-5, 1e-6), 1e-6
#: Step where surfaces have just come within reach of each other.
_NEAR = 1e-7
#: Rounding of values; number of states at which a column is compared: one at rest shows little.
_ROUNDED, _COMPARED = 1e-13, 3


class BodyDerivatives:
    """The columns of a meter of energies or of momenta."""

    def __init__(
        self, owner: str, system: System, meter: EnergyMeter | MomentumMeter,
        bodies: Sequence[str] | None,
    ) -> None:  # fmt: skip
        """Find the nodes of the bodies (collective).

        Args:
            owner: name in messages.
            system: the system.
            meter: of some bodies.
            bodies: their names, None for all.
        """
        self._owner, self._system, self._meter = owner, system, meter
        self._chosen: list[BoolArray] = []
        for part in system.parts:
            names = [body.name for body in part.family.bodies]
            member = np.array([bodies is None or name in bodies for name in names], dtype=np.bool_)
            self._chosen.append(member[part.node_body[: part.block.owned]])
        self._compared: Counter[int] = Counter()

    def back(self, weights: FloatArray) -> tuple[BlockVectors, BlockVectors]:
        """Derivatives of weighted columns by local twists and local velocities (collective).

        Args:
            weights: (c,) of the columns, of which work and dissipation have none.

        Raises:
            InputError: the bodies share nodes with others, or their masses do not say what they do.
        """
        for k in np.flatnonzero(weights).tolist():
            if self._compared[k] < _COMPARED:
                self._compared[k] += 1
                self._check(np.eye(len(weights))[k])
        return self._back(weights)

    def _back(self, weights: FloatArray) -> tuple[BlockVectors, BlockVectors]:
        """The same."""
        system = self._system
        energy, linear, angular, first = 0.0, np.zeros(3), np.zeros(3), np.zeros(3)
        if isinstance(self._meter, EnergyMeter):
            energy, first = weights[0], -weights[2] * system.gravity
        else:
            linear, angular = weights[:3], weights[3:6]
            first = weights[6:9] / self._meter.mass
        q = [np.zeros_like(part.block.owned_step) for part in system.parts]
        v = [np.zeros_like(own) for own in q]
        if energy or linear.any() or angular.any():
            self._add_momenta(energy, (linear, angular), (q, v))
        if first.any():
            q = [a + b for a, b in zip(q, self._weight(first), strict=True)]
        if isinstance(self._meter, EnergyMeter) and weights[1]:
            q = [a + weights[1] * b for a, b in zip(q, self._elastic(), strict=True)]
        for blocks in (q, v):
            for own, chosen in zip(blocks, self._chosen, strict=True):
                own[~chosen] = 0.0
        return q, v

    def _add_momenta(
        self, energy: float, momenta: tuple[FloatArray, FloatArray],
        sums: tuple[BlockVectors, BlockVectors],
    ) -> None:  # fmt: skip
        """Add derivatives of a part of the kinetic energy and of momenta along directions."""
        system = self._system
        V = [
            part.block.velocity[: part.block.owned, : part.block.width] * chosen[:, np.newaxis]
            for part, chosen in zip(system.parts, self._chosen, strict=True)
        ]
        t = [
            _rigid(part.block.frames[: part.block.owned], momenta, own)
            for part, own in zip(system.parts, V, strict=True)
        ]
        by_velocity = self._masses([energy * a + b for a, b in zip(V, t, strict=True)])
        along = [0.5 * energy * a + b for a, b in zip(V, t, strict=True)]
        turned, p, momentum = self._turned(along, V), self._masses(V), self._masses(along)
        for k, part in enumerate(system.parts):
            block, width = part.block, part.block.width
            sums[1][k][:] += by_velocity[k]
            # accelerations turned with the nodes, if they are inertial
            turning = RateMaps.of(block).turning[:, :width, :width]
            sums[0][k][:] += turned[k] - transposed(turning, momentum[k])
            R = rotations(block.frames[: block.owned])
            axis = transposed(R, np.broadcast_to(momenta[1], (block.owned, 3)))
            sums[0][k][:, :3] += np.cross(p[k][:, :3], axis)
            if width == 6:
                sums[0][k][:, 3:] -= np.cross(t[k][:, :3], p[k][:, :3])
                sums[0][k][:, 3:] -= np.cross(t[k][:, 3:], p[k][:, 3:])

    def _masses(self, vectors: BlockVectors) -> BlockVectors:
        """Masses times local vectors of each block (collective)."""
        for part, own in zip(self._system.parts, vectors, strict=True):
            part.block.owned_step[:] = own  # momenta have those of fixed nodes
            part.block.spread_step()
        END_POINT.multiply_mass(self._system, 1.0)
        return collected(self._system)

    def _turned(self, factors: BlockVectors, accelerations: BlockVectors) -> BlockVectors:
        """Factors times derivatives of masses times accelerations by positions (collective)."""
        system, nothing = self._system, np.zeros(self._system.constraints.size)
        sizes = [float(np.abs(own).max(initial=0.0)) for own in accelerations]
        size = system.comm.allreduce(max(sizes), op=MPI.MAX)
        scale, sides = _LARGE / (size or 1.0), []
        with self._still():
            system.constraints.multipliers[:] = 0.0
            for factor in (0.0, scale):
                put_steps(system, [factor * own for own in accelerations])
                for part in system.parts:
                    part.block.acceleration[:] = part.block.step
                tangent = StepTangent(system)
                tangent.take(_AT_STATE)
                sides.append(tangent.apply_transposed(factors, nothing, POSITIONS)[0])
        return [(a - b) / scale for b, a in zip(*sides, strict=True)]

    def _weight(self, gravity: FloatArray) -> BlockVectors:
        """Derivatives of first moments of mass along a direction by positions (collective)."""
        system, sides = self._system, []
        for own in (0.0 * gravity, gravity):
            for part in system.parts:
                part.add_residual(own, system.factors, 1.0)
            sides.append(collected(system))
        return [a - b for a, b in zip(*sides, strict=True)]

    def _elastic(self) -> BlockVectors:
        """Derivatives of the strain energy by positions (collective)."""
        assert isinstance(self._meter, EnergyMeter)
        system, rows = self._system, self._system.constraints
        found = {
            "internal variables": system.remembering,
            "friction and damping of contacts by the penalty": bool(lagging(system)),
        }
        for name, present in found.items():
            if system.comm.allreduce(present, op=MPI.LOR):
                raise InputError(
                    f"gradient: {self._owner}: there are no derivatives of strain energies with "
                    f"{name} yet; take other columns"
                )
        refresh_rows(system)
        pulls = rows.stored()[1] * self._meter.inside
        sprung = forces_on_blocks(system, forces_at_interface(system, rows.force_jacobian, pulls))
        with self._still():
            for part in system.parts:
                part.block.residual[:] = 0.0
                if part.elements is not None:
                    part.elements.add_residual(part.block, np.zeros(3), 1.0, EXACT)
                    part.block.add_ghosts()
        elastic = [a + b for a, b in zip(sprung, collected(system), strict=True)]
        return self._with_contacts(elastic) if self._meter.whole else elastic

    def _with_contacts(self, sums: BlockVectors) -> BlockVectors:
        """With the forces of contacts in equilibria, whose potentials they store (collective)."""
        for contacts in self._system.contacts:
            known = contacts.state()
            contacts.update()
            contacts.collect(1.0)
            for part in self._system.parts:
                part.block.residual[:] = 0.0
                if part.kind in contacts.kinds:
                    contacts.hand_out(part.kind, 1.0)
                part.block.add_ghosts()
            contacts.restore(known)
            sums = [a + b for a, b in zip(sums, collected(self._system), strict=True)]
        return sums

    @contextmanager
    def _still(self) -> Iterator[None]:
        """Without velocities and accelerations (collective)."""
        system, kept = self._system, []
        for part in system.parts:
            block = part.block
            kept.append((block.velocity.copy(), block.acceleration.copy()))
            block.velocity[:] = block.acceleration[:] = 0.0
        multipliers = system.constraints.multipliers.copy()
        system.interface.update()
        yield
        for part, (velocity, acceleration) in zip(system.parts, kept, strict=True):
            part.block.velocity[:], part.block.acceleration[:] = velocity, acceleration
        system.constraints.multipliers[:] = multipliers
        system.interface.update()

    def _value(self, weights: FloatArray) -> float:
        """The weighted columns at the trial state (collective)."""
        _refresh(self._system)
        if isinstance(self._meter, EnergyMeter):
            values = np.append(self._meter.stored(), np.zeros(3))
        else:
            values = self._meter.update()
        used = weights != 0.0  # others may be infinite, where surfaces have passed each other
        return float(self._system.comm.allreduce(weights[used] @ values[used]))

    def _check(self, weights: FloatArray) -> None:
        """Compare with differences along a direction at random, at such velocities (collective)."""
        system, parts = self._system, self._system.parts
        ways = [_at_random(part.block, k) for k, part in enumerate(parts)]
        before = [(part.block.frames.copy(), part.block.velocity.copy()) for part in parts]

        def move(size: float) -> None:
            for part, (turns, rates, speeds), (frames, velocity) in zip(
                parts, ways, before, strict=True
            ):
                inertial = part.block.inertial
                part.block.frames[:] = moved(frames, size * turns, inertial=inertial)
                part.block.velocity[:] = velocity + speeds + size * rates
            system.interface.update()

        move(0.0)
        own = np.zeros(2)
        for part, (turns, rates, _), by_q, by_v in zip(
            parts, ways, *self._back(weights), strict=True
        ):
            at = np.s_[: part.block.owned, : part.block.width]
            products = by_q * turns[at] + by_v * rates[at]
            own += products.sum(), np.abs(products).sum()
        system.comm.Allreduce(MPI.IN_PLACE, own)
        off, rounding = np.inf, 0.0
        for step in (*_STEPS, _NEAR) if system.contacts else _STEPS:
            values = []
            for place, _ in STENCIL:
                move(place * step)
                values.append(self._value(weights))
            found = sum(w * x for (_, w), x in zip(STENCIL, values, strict=True)) / step
            rounding = max(rounding, _ROUNDED * max(map(abs, values)) / step)
            off = min(off, abs(found - own[0]))
        for part, (frames, velocity) in zip(parts, before, strict=True):
            part.block.frames[:], part.block.velocity[:] = frames, velocity
        system.interface.update()
        _refresh(system)
        if not off <= _EXACT * own[1] + rounding:
            raise InputError(
                f"gradient: {self._owner} of these bodies has no derivatives yet, as where some "
                "share nodes with others; take other columns"
            )


def _refresh(system: System) -> None:
    """Let rows and contacts be those of the trial state (collective)."""
    refresh_rows(system)
    for contacts in system.contacts:
        contacts.forget()


def _at_random(block: FrameBlock, number: int) -> FloatArray:
    """(3, n, 6) vectors of the nodes of a block, none along fixed unknowns, on any ranks alike."""
    random = np.random.default_rng(number)
    found = random.standard_normal((3, block.size_global, 6))[:, block.global_ids]
    found[:, :, block.width :] = 0.0
    if block.dirichlet is not None:
        found[:, :, : block.width][:, block.dirichlet] = 0.0
    return found


def _rigid(
    frames: FloatArray, momenta: tuple[FloatArray, FloatArray], like: FloatArray
) -> FloatArray:
    """Local twists (n, w) of a rigid motion along factors of linear and angular momenta."""
    R, (linear, angular) = rotations(frames), momenta
    found = np.zeros_like(like)
    found[:, :3] = transposed(R, linear + np.cross(angular, frames[:, :3]))
    if found.shape[1] == 6:
        found[:, 3:] = transposed(R, np.broadcast_to(angular, (len(R), 3)))
    return found
