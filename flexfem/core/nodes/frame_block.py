# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes with a frame each: the unknowns of beams and of rigid bodies."""

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_kernels import (
    Nodes,
    accept,
    correct,
    kick,
    orthonormalise,
    predict,
    shift,
    shifts,
    slow,
    to_inertial,
)
from flexfem.core.nodes.ghosted_rows import GhostedRows
from flexfem.core.nodes.prediction import Misses
from flexfem.core.state import Numbering
from flexfem.lie import se3

__all__ = ["FrameBlock"]

#: law of prediction that stays at the accepted state
_NOTHING = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
#: Largest departure of rotation matrices from orthogonality after a long motion.
_ROUND_OFF = 1e-6


class FrameBlock:
    """One row of the nest: nodes with frames, distributed over the ranks.

    A node has six unknowns, or three: then its axes are only the directions of its translations.

    Arrays hold the owned nodes first, then ghosts. The trial state depends on the accepted state
    and on the increment only, so that a rejected step leaves nothing to undo.

    Attributes:
        name: stable name of the block ("beams", "rigid_bodies").
        width: unknowns of a node, 6 or 3.
        dirichlet: (n, width) fixed unknowns; None if there are none on any rank.
        unturned: (n,) axis, 0 to 2, about which the increments of a node do not rotate, as those
            of directors do not about themselves: the one rotation that is fixed, -1 without one.
        owned: number of nodes of this rank.
        frames, velocity, acceleration: trial state, (n, 12) and (n, 6), local axes.
        increment: (n, 6) increment over the step: on SE(3) a twist; with ``inertial`` the
            translation in inertial axes and a rotation vector in local ones.
        inertial: translations are integrated in inertial axes (R^3 x SO(3)).
        start_frames: (n, 12) frames at t = 0.
        residual, step: (n, 6) right-hand side and Newton step; views into vectors with ghosts. Of
            nodes with three unknowns the last three components have no meaning.
        shifted: True if :meth:`shift` has moved nodes in this step, on any rank.
        nodes: these arrays and those of the integrator, as compiled loops take them.
        node_ids: (n,) index of each node in the model's input order.
        offset: first global node of this rank.
        elements: (m,) numbers of the elements whose places this rank evaluates; None: those whose
            last node it owns.
        amplitudes: (n,) True for nodes without a place, whose translations are amplitudes.
    """

    def __init__(
        self, name: str, comm: MPI.Intracomm, frames: FloatArray, velocity: FloatArray,
        node_ids: IntArray, index_map: Any, inertial: bool, width: int = 6,
        dirichlet: BoolArray | None = None, elements: IntArray | None = None,
        amplitudes: BoolArray | None = None,
    ) -> None:  # fmt: skip
        """Create a block (collective).

        Args:
            name: stable name of the block.
            comm: communicator.
            frames: (n, 12) frames at the start, ghosts included.
            velocity: (n, 6) local velocities at the start.
            node_ids: (n,) index of each node in the input.
            index_map: DOLFINx index map of the nodes.
            inertial: integrate translations in inertial axes (R^3 x SO(3)) instead of on SE(3).
            width: unknowns of a node; 3 needs ``inertial``.
            dirichlet: (n, width) fixed unknowns, on all ranks or none.
            elements: see the attribute.
            amplitudes: see the attribute; None for none.
        """
        self.name, self.comm, self.inertial, self.width = name, comm, inertial, width
        self.node_ids, self.index_map, self.dirichlet = node_ids, index_map, dirichlet
        self.elements = elements
        none = np.zeros(len(frames), dtype=np.bool_)
        self.amplitudes = none if amplitudes is None else amplitudes
        self.unturned = np.full(len(frames), -1)
        if dirichlet is not None and width == 6:
            alone = dirichlet[:, 3:].sum(axis=1) == 1
            self.unturned[alone] = dirichlet[alone, 3:].argmax(axis=1)
        self.owned = int(index_map.size_local)
        self.size_global = int(index_map.size_global)
        self.offset = int(index_map.local_range[0])
        self.has_ghosts = comm.allreduce(int(index_map.num_ghosts), op=MPI.MAX) > 0
        count = len(frames)
        self.start_frames = frames.copy()
        self.frames0, self.frames = frames.copy(), frames.copy()
        self.velocity, self.acceleration = velocity.copy(), np.zeros((count, 6))
        # accepted rates of the increments and the integrator's acceleration-like variable
        self._velocity0, self._acceleration0 = np.zeros((count, 6)), np.zeros((count, 6))
        self._auxiliary0 = np.zeros((count, 6))
        self.increment = np.zeros((count, 6))
        self._velocity_base, self._acceleration_base = np.zeros((count, 6)), np.zeros((count, 6))
        # part of the increments that is not integrated from rates, see shift()
        self._offset: FloatArray | None = None
        self.shifted = False
        self._rates = np.zeros(2)
        self._residual = GhostedRows(comm, index_map, 6)
        self._step = self._residual.beside()
        self.residual, self.step = self._residual.values, self._step.values
        own = np.s_[: self.owned, :width]
        self._owned = self.residual[own], self.step[own]
        self.nodes = Nodes(
            inertial=inertial, unturned=self.unturned, frames=self.frames,
            velocity=self.velocity, acceleration=self.acceleration, increment=self.increment,
            step=self.step, residual=self.residual, frames0=self.frames0, velocity0=self._velocity0,
            auxiliary0=self._auxiliary0, acceleration0=self._acceleration0,
            velocity_base=self._velocity_base, acceleration_base=self._acceleration_base,
            rates=self._rates, offset=np.zeros((0, 6)), turn=np.zeros((count, 6)),
            velocity_change=np.zeros((count, 6)), acceleration_change=np.zeros((count, 6)),
        )  # fmt: skip

    def rigid_twists(self, twist: FloatArray) -> FloatArray:
        """Local twists (n, 6) of the nodes in a rigid motion with a twist (6,) in inertial axes.

        Amplitudes do not change.
        """
        found = se3.adjoint(se3.inverse(self.frames)) @ twist
        found[self.amplitudes] = 0.0
        return found

    @property
    def sizes(self) -> tuple[int, int]:
        """Number of unknowns on this rank and on all."""
        return self.width * self.owned, self.width * self.size_global

    @property
    def global_ids(self) -> IntArray:
        """(n,) global node numbers of the local nodes."""
        local = np.arange(len(self.frames), dtype=np.int32)
        return np.asarray(self.index_map.local_to_global(local), dtype=np.int64)

    @property
    def owned_residual(self) -> FloatArray:
        """(n_owned, width) right-hand side without ghosts, always the same view."""
        return self._owned[0]

    @property
    def owned_step(self) -> FloatArray:
        """(n_owned, width) Newton step without ghosts, always the same view."""
        return self._owned[1]

    def hold(self, forces: FloatArray) -> FloatArray:
        """Set forces (n_owned, width) along fixed unknowns to zero, in place; returns them."""
        if self.dirichlet is not None:
            forces[self.dirichlet[: self.owned]] = 0.0
        return forces

    def owned_index(self, ids: IndexArray) -> IntArray:
        """Local indices of nodes given by their input numbers, -1 where another rank owns them."""
        order = np.argsort(self.node_ids[: self.owned])
        known = self.node_ids[: self.owned][order]
        at = np.minimum(np.searchsorted(known, ids), max(len(known) - 1, 0))
        found = known[at] == ids if len(known) else np.zeros(len(ids), dtype=bool)
        return np.where(found, order[at] if len(known) else 0, -1).astype(np.int64)

    def local_index(self, ids: IndexArray) -> IntArray:
        """Local indices of nodes (any shape) given by their input numbers, ghosts included.

        All of them are on this rank.
        """
        order = np.argsort(self.node_ids)
        found: IntArray = order[np.searchsorted(self.node_ids[order], ids)].astype(np.int64)
        return found

    def predict(self, law: FloatArray, rates: FloatArray) -> None:
        """Start a step; see ``frame_kernels.predict``."""
        self._rates[:] = rates
        self.shifted = False
        if self._offset is not None:
            self._offset[:] = 0.0
        predict(self.nodes.memory, law)

    def inertial_rates(self, shifts: FloatArray) -> bool:
        """True if translations are inertial, and more than the mass matrix is needed.

        ``shifts`` = (dv/dn, dw/dn, k), k the factor of the stiffness.
        """
        return bool(self.inertial and shifts[2] != 0.0)

    def correct(self, sign: float) -> float:
        """Move by the twists ``sign * step``; returns the largest entry of the step."""
        self.spread_step()
        largest: float = correct(self.nodes.memory, sign)
        return largest

    def shift(self, sign: float) -> float:
        """Move by the twists ``sign * step``, at constant velocities and accelerations.

        Returns:
            The largest entry of the step.
        """
        self.spread_step()
        self._have_offset()
        self.shifted = True
        largest: float = shift(self.nodes.memory, sign)
        return largest

    def put_shifts(self) -> None:
        """Write all motions by :meth:`shift` in this step to the steps, as local twists.

        They are those at the trial state, whatever it was when the nodes were moved.
        """
        self._have_offset()
        shifts(self.nodes.memory)

    def _have_offset(self) -> None:
        if self._offset is None:
            self._offset = self.nodes.offset = np.zeros_like(self.increment)

    def kick(self, h: float) -> None:
        """Change the velocities by the twists ``step`` over a step of size ``h`` (s).

        See ``frame_kernels.kick``.
        """
        self.spread_step()
        self._have_offset()
        kick(self.nodes.memory, h)

    def kick_rates(self, h: float, velocity: float, acceleration: float) -> None:
        """The same where trial velocities and accelerations do not follow from the increments.

        Args:
            h: size of the step, s.
            velocity: factor of the twists ``step`` in the change of velocities.
            acceleration: their factor in that of accelerations, 1/s.
        """
        self.spread_step()
        self._have_offset()
        before = np.cross(self.velocity[:, 3:], self.velocity[:, :3])
        self.velocity += velocity * self.step
        self.acceleration += acceleration * self.step
        change = 0.5 * h * self.step
        if self.inertial:
            now = np.cross(self.velocity[:, 3:], self.velocity[:, :3])
            self.acceleration[:, :3] += before - now
            turns = self.frames[:, 3:].reshape(-1, 3, 3)
            change[:, :3] = np.einsum("nij,nj->ni", turns, change[:, :3])
        assert self._offset is not None
        self._offset += change

    def slow(self) -> None:
        """Subtract the twists ``step`` (m/s^2, rad/s^2) from the accepted accelerations."""
        self.spread_step()
        slow(self.nodes.memory)

    def jump_to_step(self, law: FloatArray, factor: float) -> None:
        """Put ``factor`` times the change of the acceleration-like variable into the steps.

        Args:
            law: of acceptance, see ``frame_kernels.accept``.
            factor: s^2.
        """
        increment = self.increment if self._offset is None else self.increment - self._offset
        jump = law[0] * increment + law[1] * self._velocity0 + (law[2] - 1.0) * self._auxiliary0
        self.step[:] = factor * jump
        if self.inertial:
            turns = self.frames[:, 3:].reshape(-1, 3, 3)
            self.step[:, :3] = np.einsum("nji,nj->ni", turns, self.step[:, :3])

    def accept(self, law: FloatArray, h: float) -> Misses:
        """End a step of size ``h`` (s); see ``frame_kernels.accept``.

        Returns:
            Errors of the predictions.
        """
        self.settle()
        misses: Misses = accept(self.nodes.memory, law, h, self.owned)
        return misses

    def settle(self) -> None:
        """Take motions by :meth:`shift` out of the increments before they are accepted."""
        if self._offset is not None:
            self.increment -= self._offset
            self._velocity_base += self._rates[0] * self._offset
            self._acceleration_base += self._rates[1] * self._offset

    def start(self) -> None:
        """Accept the trial velocities and accelerations as those of the start."""
        self._velocity0[:], self._acceleration0[:] = self.velocity, self.acceleration
        if self.inertial:
            to_inertial(self.frames, self._velocity0, self._acceleration0)
        self._auxiliary0[:] = self._acceleration0

    @property
    def accelerations(self) -> FloatArray:
        """(n, 6) accepted ones, rates of the increments' rates."""
        return self._acceleration0

    def lead_auxiliary(self, before: FloatArray, part: float) -> None:
        """Let the acceleration-like variable be ahead of the accelerations.

        Args:
            before: (n, 6) accelerations at the start of the last step.
            part: of their change since then by which it is ahead.
        """
        self._auxiliary0[:] = self._acceleration0 + part * (self._acceleration0 - before)

    def take(self) -> None:
        """Accept the trial state as it stands, with its velocities and accelerations."""
        orthonormalise(self.frames)
        self.frames0[:] = self.frames
        self.increment[:] = 0.0
        self.start()

    def reset(self) -> None:
        """Make the trial state equal to the accepted state."""
        self.predict(_NOTHING, np.zeros(2))

    def numbering(self) -> Numbering:
        """Local nodes in the order of the input."""
        owned = np.arange(len(self.node_ids)) < self.owned
        return Numbering(self.node_ids, owned, self.size_global)

    def state(self) -> dict[str, FloatArray]:
        """Accepted state of the local nodes, from which the next step starts: no copies."""
        return {
            "frames": self.frames0,
            "velocity": self._velocity0,
            "acceleration": self._acceleration0,
            "auxiliary": self._auxiliary0,
        }

    def doubts(self, state: Mapping[str, FloatArray]) -> str:
        """Message about frames that :meth:`state` cannot have returned; empty for others."""
        turns = state["frames"][:, 3:].reshape(-1, 3, 3)
        defect = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
        good = defect < _ROUND_OFF and (np.linalg.det(turns) > 0.0).all()
        return "" if good else f'"{self.name}/frames" contains a matrix that is not a rotation'

    def restore(self, state: Mapping[str, FloatArray]) -> None:
        """Accept a state returned by :meth:`state`, ghosts included."""
        for name, values in self.state().items():
            values[:] = state[name]
        self.reset()

    def trial(self) -> dict[str, FloatArray]:
        """Trial state of the local nodes, from which matrices are computed."""
        return {
            "frames": self.frames,
            "velocity": self.velocity,
            "acceleration": self.acceleration,
            "increment": self.increment,
        }

    def spread_step(self) -> None:
        """Copy the owners' steps to ghosts."""
        if self.has_ghosts:
            self._step.spread()

    def add_ghosts(self) -> None:
        """Add the residual of ghosts to their owners (reverse halo exchange)."""
        if self.has_ghosts:
            self._residual.add_ghosts()
