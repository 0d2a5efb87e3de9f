# SPDX-License-Identifier: LGPL-3.0-or-later
"""All joints of this rank as one batch of rows."""

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.joint import Joint, Row, RowKind
from flexfem.core.pose import Pose
from flexfem.system.interface import Interface
from flexfem.system.row_hessians import add_dampers, add_hessians, second_rates
from flexfem.system.row_kernels import (
    add_forces,
    evaluate_rows,
    marker_poses,
    update_angles,
)

__all__ = ["Constraints", "PlacedJoint"]


@dataclass(frozen=True)
class PlacedJoint:
    """A joint that this rank evaluates.

    Attributes:
        joint: its declaration.
        index: number of the joint in the model.
        poses: poses of both markers at the start.
        slots: interface slots of the nodes that carry its markers, -1 for ground.
        offsets: (2, 12) markers relative to their nodes (absolute frames for ground).
        owned: this rank owns its multipliers.
        shared: another rank evaluates it too.
    """

    joint: Joint
    index: int
    poses: tuple[Pose, Pose]
    slots: tuple[int, int]
    offsets: FloatArray
    owned: bool
    shared: bool

    def rows(self, t: float) -> tuple[Row, ...]:
        """Rows at time t."""
        return self.joint.rows(*self.poses, t)


class Constraints:
    """Rows of all joints of this rank: rows of one rank only first, shared rows last.

    Attributes:
        joints: the joints in the order of their rows.
        start: (n_joints + 1,) first row of each joint.
        interior: number of rows that only this rank evaluates.
        owned: (r,) 1 for rows whose multipliers this rank owns.
        multipliers: (r,) trial values, scaled by ``beta h^2``.
        forces: (r,) accepted multipliers, not scaled (N or N m for rows in m or rad).
        elastic: (r, 3) flag, stiffness and damping of rows with compliance.
        values, compliance: (r,) residuals and compliances of the last evaluation.
        force_jacobian: (r, 2, 6) gradients with respect to the nodes' local twists.
        step_jacobian: (r, 2, 6) derivatives of ``values`` along these twists.
        row_slots: (r, 2) interface slots of both sides.
        numbers: (r,) global numbers of the multipliers, ``size_global`` in all.
        shared_numbers: numbers of the shared rows among those of all ranks, ``shared_size`` in all.
    """

    def __init__(
        self, comm: MPI.Intracomm, joints: Sequence[PlacedJoint], interface: Interface
    ) -> None:
        """Collect the rows (collective: numbers the multipliers)."""
        self.joints = sorted(joints, key=lambda j: (j.shared, j.index))
        self.interface = interface
        rows = [j.rows(0.0) for j in self.joints]
        counts = np.array([len(r) for r in rows], dtype=np.int64)
        self.start: IntArray = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        total = int(self.start[-1])
        shared = np.repeat([j.shared for j in self.joints], counts)
        self.interior = total - int(shared.sum())
        self.owned = np.repeat([float(j.owned) for j in self.joints], counts)
        self.joint_of_row = np.repeat(np.arange(len(self.joints)), counts)
        self._markers(counts)
        self._kinds = np.zeros(total, dtype=np.int64)
        self._directions = np.zeros((total, 3, 3))
        self._targets, self._memory = np.zeros(total), np.zeros(total)
        self.elastic = np.zeros((total, 3))
        for at, joint_rows in zip(self.start, rows, strict=False):
            self._write_rows(int(at), joint_rows)
        self._driven = [(i, j) for i, j in enumerate(self.joints) if j.joint.driven]
        self.multipliers, self.forces = np.zeros(total), np.zeros(total)
        self.values, self.compliance = np.zeros(total), np.zeros(total)
        self.force_jacobian, self.step_jacobian = np.zeros((total, 2, 6)), np.zeros((total, 2, 6))
        self._poses = np.zeros((2 * len(self.joints), 12))
        self._damped = bool(np.any(self.elastic[:, 2] > 0.0))
        self._number(comm)

    def _markers(self, counts: IntArray) -> None:
        slots = np.array([j.slots for j in self.joints], dtype=np.int64).reshape(-1, 2)
        self._marker_slot = slots.ravel()
        self._marker_offset = np.array([j.offsets for j in self.joints]).reshape(-1, 12)
        pairs = np.arange(2 * len(self.joints)).reshape(-1, 2)
        self._row_marker = np.repeat(pairs, counts, axis=0)
        self.row_slots: IntArray = np.repeat(slots, counts, axis=0)

    def _write_rows(self, at: int, rows: Sequence[Row]) -> None:
        for i, row in enumerate(rows, start=at):
            self._kinds[i] = row.kind
            self._directions[i] = row.u, row.v, row.p
            self._targets[i] = row.target
            if row.stiffness is not None:
                self.elastic[i] = 1.0, row.stiffness, row.damping

    def _number(self, comm: MPI.Intracomm) -> None:
        """Global numbers of the multipliers: owners number their rows, the others ask by joint."""
        count = int(self.owned.sum())
        offset = comm.scan(count) - count
        self.owned_count = count
        self.size_global: int = comm.allreduce(count)
        first = {}
        at = offset
        for i, joint in enumerate(self.joints):
            if joint.owned:
                first[joint.index] = at
                at += int(self.start[i + 1] - self.start[i])
        shared = [j.index for j in self.joints if j.owned and j.shared]
        merged = dict(first)
        for part in comm.allgather({index: first[index] for index in shared}):
            merged.update(part)
        numbers = [
            merged[j.index] + np.arange(self.start[i + 1] - self.start[i])
            for i, j in enumerate(self.joints)
        ]
        self.numbers: IntArray = np.concatenate([np.empty(0, dtype=np.int64), *numbers])
        # rows that several ranks evaluate, numbered among themselves in the order of the joints
        everywhere = np.unique(np.concatenate(comm.allgather(self.numbers[self.interior :])))
        self.shared_size = len(everywhere)
        self.shared_numbers: IntArray = np.searchsorted(everywhere, self.numbers[self.interior :])

    def active_components(self) -> IntArray:
        """(n_slots,) 3 where joints only ever pull at the node's origin, else 6."""
        active = np.full(len(self.interface.keys), 3, dtype=np.int64)
        for side in range(2):
            marker = self._row_marker[:, side]
            slot = self._marker_slot[marker]
            turning = (self._kinds == RowKind.AXES) | (self._kinds == RowKind.ANGLE)
            if side == 0:
                turning |= self._kinds == RowKind.ALONG
            turning |= np.any(self._marker_offset[marker, :3] != 0.0, axis=1)
            active[slot[turning & (slot >= 0)]] = 6
        return active

    def marker_frames(self) -> FloatArray:
        """(2 n_joints, 12) frames of the markers at the last evaluation."""
        return self._poses

    def kind_and_direction(self, row: int) -> tuple[RowKind, FloatArray]:
        """Kind of a row and its direction u."""
        direction: FloatArray = self._directions[row, 0]
        return RowKind(self._kinds[row]), direction

    @property
    def size(self) -> int:
        """Number of rows of this rank, shared ones included."""
        return len(self.values)

    @property
    def owned_rows(self) -> IntArray:
        """Rows whose multipliers this rank owns, in the order of their global numbers."""
        return np.flatnonzero(self.owned).astype(np.int64)

    def set_time(self, t: float) -> None:
        """Update the rows of driven joints to time ``t``."""
        for i, joint in self._driven:
            self._write_rows(int(self.start[i]), joint.rows(t))

    def evaluate(self, dynamics: FloatArray) -> None:
        """Evaluate all rows at the interface's state; ``dynamics`` = (gamma/(beta h), beta h^2)."""
        face = self.interface
        evaluate_rows(
            face.frames, face.velocities, self._marker_slot, self._marker_offset,
            self._row_marker, self._kinds, self._directions, self._targets, self._memory,
            self.elastic, dynamics, self.multipliers, self._poses, self.force_jacobian,
            self.step_jacobian, self.values, self.compliance,
        )  # fmt: skip
        if self._damped:
            add_dampers(
                self._poses, face.increments, face.velocities, self._marker_slot,
                self._marker_offset, self._row_marker, self._kinds, self._directions,
                self.elastic, face.inertial, dynamics, self.step_jacobian,
            )  # fmt: skip

    def add_forces(self, multipliers: FloatArray, local: IntArray, residual: FloatArray) -> None:
        """Add ``G^T multipliers`` to the owned nodes of one block; ``local`` node of each slot."""
        add_forces(self.row_slots, self.force_jacobian, multipliers, local, residual)

    def accept(self) -> None:
        """Remember the angles reached, so that they stay continuous."""
        face = self.interface
        marker_poses(face.frames, self._marker_slot, self._marker_offset, self._poses)
        update_angles(self._poses, self._row_marker, self._kinds, self._directions, self._memory)

    def hessians(self, factor: FloatArray) -> FloatArray:
        """``sum_rows factor d(gradient)`` along local twists of the nodes, (n_joints, 12, 12)."""
        out = np.zeros((len(self.joints), 12, 12))
        add_hessians(
            self._poses, self._marker_slot, self._marker_offset, self._row_marker, self._kinds,
            self._directions, self.joint_of_row, factor, out,
        )  # fmt: skip
        return out

    def turning_forces(self, steps: FloatArray) -> FloatArray:
        """(n_slots, 6) change of the constraint forces on the nodes along steps of the slots."""
        slots = self._marker_slot
        padded = np.concatenate([steps, np.zeros((1, 6))])
        along = padded[slots].reshape(-1, 12, 1)
        change = (self.hessians(self.multipliers) @ along).reshape(-1, 6)
        out = np.zeros((len(steps) + 1, 6))
        np.add.at(out, slots, change)
        return out[:-1]

    def second_rates(self) -> FloatArray:
        """(r,) second time derivative of every row at constant local velocities."""
        out = np.zeros(self.size)
        second_rates(
            self._poses, self.interface.velocities, self._marker_slot, self._marker_offset,
            self._row_marker, self._kinds, self._directions, out,
        )  # fmt: skip
        return out

    def rigid_jacobian(self) -> FloatArray:
        """(r, 2, 6) gradients of the rigid rows with respect to local twists, zero for others."""
        rigid = 1.0 - self.elastic[:, 0]
        return self.force_jacobian * rigid[:, np.newaxis, np.newaxis]

    def rates(self) -> FloatArray:
        """(r,) time derivative of every row at the interface's velocities, drives held."""
        out = np.zeros(self.size)
        for side in range(2):
            slot = self.row_slots[:, side]
            held = slot >= 0
            out[held] += np.einsum(
                "ri,ri->r", self.force_jacobian[held, side], self.interface.velocities[slot[held]]
            )
        return out
