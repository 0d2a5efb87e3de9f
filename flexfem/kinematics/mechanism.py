# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints between rigidly moving bodies: values, gradients, closing of gaps, forces."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.constraints.batch import Constraints
from flexfem.constraints.node_table import NodeTable
from flexfem.constraints.rows.placed_joint import PlacedJoint
from flexfem.core.joint import Joint
from flexfem.core.load import Load
from flexfem.core.marker import Carrier, Ground, Marker
from flexfem.core.pose import Pose
from flexfem.kinematics.rigid_parts import RigidParts
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.loads.point_load import PointLoad

__all__ = ["PlacedLoads", "RigidMechanism", "marker_key", "place_joint", "place_loads"]

#: Rates and forces of rows count as they are.
_UNIT = np.array([1.0, 1.0])
#: Gap that counts as none: rounding.
_CLOSED, _ROUNDING = 1e-15, 1e-11
#: Damping relative to the square of the largest singular value: the first, how it grows and falls,
#: below which it is none, and above which nothing brings the parts nearer.
_FIRST, _MORE, _LESS, _LITTLE, _MOST = 1e-4, 10.0, 0.1, 1e-6, 1e8
#: Singular values below this part of the largest count as zero.
_SINGULAR = 1e-10
#: Largest turn of a part in one step, rad.
_TURN = 0.5

_IDENTITY = se3.frame(np.zeros(3), np.eye(3))

#: Loads with the parts that they act on, and where.
PlacedLoads = list[tuple[Load, list[tuple[int, FloatArray]]]]


def place_joint(parts: RigidParts, joint: Joint, index: int) -> PlacedJoint:
    """A joint between parts.

    Raises:
        ValueError: it slides along a line, or a marker's body or point does not exist.
    """
    places = []
    for marker in joint.markers:
        if isinstance(marker, Carrier):
            raise ValueError(
                f"{joint.owner}: sliding along a line is not supported in rigid-body kinematics"
            )
        try:
            places.append(parts.place(marker))
        except ValueError as error:
            raise ValueError(f"{joint.owner}: {error}") from None
    frames = np.array([parts.frames[i] if i >= 0 else _IDENTITY for i, _ in places])
    offsets = np.array([offset for _, offset in places])
    poses = [
        Pose(se3.position(frame), se3.rotation(frame)) for frame in se3.compose(frames, offsets)
    ]
    return PlacedJoint(
        joint=joint, index=index, poses=tuple(poses), interface_nodes=tuple(i for i, _ in places),
        offsets=offsets, points=(None,) * len(places), owned=True, shared=False,
    )  # fmt: skip


class RigidMechanism:
    """Parts of a model with joints between them; nothing is distributed over ranks.

    Attributes:
        parts: the rigid-body parts.
        rows: the rows of the joints; they are rows of each joint in the order of ``joints``.
        joints: the joints.
    """

    def __init__(self, serial: NumberedModel, parts: RigidParts, joints: Sequence[Joint]) -> None:
        """Place the joints between the parts at their start.

        Raises:
            ValueError: a joint that has no place, see :func:`place_joint`.
        """
        self.parts, self.joints = parts, list(joints)
        self._table = NodeTable.of_bodies(parts.frames.copy())
        placed = [place_joint(parts, joint, i) for i, joint in enumerate(self.joints)]
        # a table of nodes is all that the rows need of an interface
        self.rows = Constraints(MPI.COMM_SELF, placed, self._table)  # type: ignore[arg-type]
        for name in serial.model.released:
            self.rows.set_active(name, False)
        self.gravity: FloatArray = (
            np.zeros(3) if serial.model.gravity is None else serial.model.gravity.acceleration
        )
        self.at(0.0)

    @property
    def size(self) -> int:
        """Number of velocities: six for each part."""
        return 6 * len(self.parts)

    @property
    def frames(self) -> FloatArray:
        """(n, 12) present frames of the parts."""
        return self._table.frames

    @property
    def velocities(self) -> FloatArray:
        """(n, 6) present local twists of the parts."""
        return self._table.velocities

    def at(self, t: float) -> None:
        """Evaluate the rows at the present frames and velocities with the drives of time t (s)."""
        self.rows.set_time(t)
        self.rows.multipliers[:] = 0.0
        self.rows.evaluate(_UNIT)

    def rows_of(self, joints: Sequence[Joint]) -> BoolArray:
        """(r,) mask of the rows of some of the joints."""
        chosen = [any(joint is other for other in joints) for joint in self.joints]
        mask: BoolArray = np.array(chosen, dtype=np.bool_)[self.rows.joint_of_row]
        return mask

    def jacobian(self) -> FloatArray:
        """(r, 6 n) gradients of all rows at the last evaluation."""
        rows = self.rows
        full = np.zeros((rows.size, len(self.parts) + 1, 6))  # the ground comes last
        row = rows.row_of_term[:, np.newaxis]
        np.add.at(full, (row, rows.term_nodes), rows.force_jacobian)
        return full[:, :-1].reshape(rows.size, -1)

    def move(self, step: FloatArray) -> None:
        """Move the parts by local twists (n, 6)."""
        self._table.frames[:] = se3.retract(self.frames, step.reshape(-1, 6))

    def close(
        self, t: float, chosen: BoolArray, weights: FloatArray | None = None,
        moving: BoolArray | None = None, *, iterations: int = 50,
    ) -> float:  # fmt: skip
        """Move the parts onto chosen rows at time t by Gauss-Newton steps of least size.

        Steps that do not bring them nearer are damped (Levenberg, Marquardt).

        Args:
            t: time of the drives, s.
            chosen: (r,) rows.
            weights: (6 n, 6 n) matrix that measures the size of a step, the identity when None.
            moving: (n,) parts that may move, all when None.
            iterations: largest number of steps.

        Returns:
            The largest gap that is left, m or rad.
        """
        free = np.repeat(np.ones(len(self.parts), np.bool_) if moving is None else moving, 6)
        root = None if weights is None else np.linalg.cholesky(weights[np.ix_(free, free)])
        self.at(t)
        damping, gaps = 0.0, self.rows.values[chosen]
        for _ in range(iterations):
            gap = float(np.abs(gaps).max(initial=0.0))
            if gap <= _CLOSED or not np.isfinite(gap):
                break
            G = self.jacobian()[chosen][:, free]
            if root is not None:
                G = np.linalg.solve(root, G.T).T
            left, sizes, right = np.linalg.svd(G, full_matrices=False)
            start, before = self.frames.copy(), float(np.linalg.norm(gaps))
            while True:
                change = -right.T @ (_damped(sizes, damping) * (left.T @ gaps))
                step = np.zeros(self.size)
                step[free] = change if root is None else np.linalg.solve(root.T, change)
                turn = float(np.abs(step.reshape(-1, 6)[:, 3:]).max(initial=0.0))
                self.move(step * min(1.0, _TURN / turn) if turn > 0.0 else step)
                self.at(t)
                gaps = self.rows.values[chosen]
                if float(np.linalg.norm(gaps)) < before:
                    damping = _LESS * damping if damping > _LITTLE else 0.0
                    break
                self.frames[:] = start
                self.at(t)
                gaps = self.rows.values[chosen]
                if gap < _ROUNDING or damping > _MOST:
                    return gap
                damping = max(_MORE * damping, _FIRST)
        return float(np.abs(gaps).max(initial=0.0))

    def inertial_forces(self, accelerations: FloatArray) -> FloatArray:
        """(n, 6) forces of inertia, gravity included, for local accelerations (n, 6).

        ``M a - ad_v^T M v - M (R^T g, 0)``: the wrench that must act on the parts.
        """
        M, v = self.parts.inertia, self.velocities
        fall = np.zeros_like(accelerations)
        turns = se3.rotation(self.frames)
        fall[:, :3] = np.einsum("nji,j->ni", turns, self.gravity)
        force: FloatArray = np.einsum("nij,nj->ni", M, accelerations - fall)
        p = np.einsum("nij,nj->ni", M, v)
        force[:, :3] += np.cross(v[:, 3:], p[:, :3])
        force[:, 3:] += np.cross(v[:, 3:], p[:, 3:]) + np.cross(v[:, :3], p[:, :3])
        return force

    def law_forces(self, left_out: BoolArray) -> FloatArray:
        """(n, 6) forces by which springs, dampers and actuators resist, but for some rows (r,)."""
        rows = self.rows
        forces = np.where(rows.rigid | left_out, 0.0, rows.values / _nonzero(rows.compliance))
        out: FloatArray = (forces @ self.jacobian()).reshape(-1, 6)
        return out

    def load_forces(self, loads: PlacedLoads, t: float) -> FloatArray:
        """(n, 6) forces of loads on the parts at time t; see :func:`place_loads`."""
        out = np.zeros((len(self.parts), 6))
        for load, places in loads:
            force, moment = (load.factor(t) * np.asarray(part) for part in load.wrench)
            for part, offset in places:
                turn = se3.rotation(offset)  # marker to part
                if not load.follower:
                    turn = se3.rotation(self.frames[part]).T
                out[part, :3] += turn @ force
                out[part, 3:] += turn @ moment + np.cross(offset[:3], turn @ force)
        return out


def place_loads(parts: RigidParts, loads: Sequence[Load]) -> PlacedLoads:
    """Parts and relative frames at which loads act.

    Raises:
        ValueError: a load that does not act at markers.
    """
    found: PlacedLoads = []
    for load in loads:
        if not isinstance(load, PointLoad):
            raise ValueError(
                f'{type(load).__name__} "{load.name}": rigid-body kinematics takes loads at '
                "markers only"
            )
        found.append((load, [parts.place(marker) for marker in load.markers]))
    return found


def marker_key(marker: Marker | Ground) -> tuple[object, ...]:
    """Return a key that is equal for markers at one place of a body."""
    if isinstance(marker, Ground):
        return ("", tuple(marker.position.tolist()))
    return (marker.body, marker.point, tuple(marker.offset.tolist()))


def _damped(sizes: FloatArray, damping: float) -> FloatArray:
    """Inverse singular values, damped; none for those that are zero."""
    largest = float(sizes.max(initial=0.0))
    kept = sizes > _SINGULAR * largest
    out: FloatArray = np.where(kept, sizes / (sizes**2 + damping * largest**2 + ~kept), 0.0)
    return out


def _nonzero(values: FloatArray) -> FloatArray:
    return np.where(values == 0.0, 1.0, values)
