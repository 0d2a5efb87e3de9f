# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constraints that say the same thing twice, found before they make a matrix singular.

With a regular mass matrix the multipliers are determined exactly if the gradients of all rigid rows
are linearly independent. Rows without a common node are, so that every connected group of nodes is
looked at by itself: two nodes for joints between beams, whole mechanisms of rigid bodies.
"""

from collections.abc import Iterator

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.system.system import System

__all__ = ["check_independence"]

#: Rows of the largest group that is looked at: the cost grows with the cube.
_LARGEST = 600
#: Singular values below this are zero; the rows have length one. Two pins a micrometre apart on
#: bodies of a metre give 1e-6.
_ZERO = 1e-9
#: Weight of a row in a dependence below which its joint has no part in it.
_PART = 1e-6
_NAMES = 4


def check_independence(system: System) -> None:
    """Raise for joints that constrain the same motion twice (collective).

    The first rank receives twelve numbers a row. Groups of more than 600 rows are left to the
    solver, which notices a singular matrix.

    Raises:
        InputError: rigid rows are linearly dependent; names the joints.
    """
    rows, comm = system.constraints, system.comm
    mine = np.flatnonzero((rows.owned > 0.0) & (rows.elastic[:, 0] == 0.0))
    keys = np.append(2 * system.interface.number + system.interface.block, -1)  # -1: ground
    joints = np.array([joint.index for joint in rows.joints], dtype=np.int64)
    parts = comm.gather(
        (joints[rows.joint_of_row[mine]], keys[rows.row_slots[mine]], rows.force_jacobian[mine])
    )
    found = None
    if parts is not None:
        found = _dependence(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    found = comm.bcast(found)
    if found is None:
        return
    excess, total, guilty = found
    own = {j.index: j.joint.owner for j in rows.joints if j.owned and j.index in guilty}
    names = [name for _, name in sorted(kv for part in comm.allgather(own) for kv in part.items())]
    more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
    raise InputError(
        f"{', '.join(names[:_NAMES])}{more}: {excess} of {total} constraints are redundant "
        "(the joints hold the same motion twice, or the position is singular)"
    )


def _dependence(
    joint: IntArray, nodes: IntArray, gradient: FloatArray
) -> tuple[int, int, list[int]] | None:
    """Excess and number of rows, and the joints of the first group with dependent rows.

    Args:
        joint: (r,) joint of each row.
        nodes: (r, 2) node on either side, -1 for the ground.
        gradient: (r, 2, 6) with respect to the twists of both nodes.
    """
    for group in _groups(nodes):
        if len(group) > _LARGEST:
            continue
        used = np.unique(nodes[group])
        blocks = np.zeros((len(group), len(used), 6))
        for side in range(2):
            at = np.searchsorted(used, nodes[group, side])
            np.add.at(blocks, (np.arange(len(group)), at), gradient[group, side])
        matrix = blocks[:, used >= 0].reshape(len(group), -1)
        length = np.linalg.norm(matrix, axis=1, keepdims=True)
        left, values, _ = np.linalg.svd(matrix / np.where(length > 0.0, length, 1.0))
        rank = int(np.sum(values > _ZERO))
        if rank < len(group):
            part = np.abs(left[:, rank:]).max(axis=1) > _PART
            guilty = np.unique(joint[group[part]]).tolist()
            return len(group) - rank, int(np.isin(joint[group], guilty).sum()), guilty
    return None


def _groups(nodes: IntArray) -> Iterator[IntArray]:
    """Rows of each group of nodes connected by rows; the ground connects nothing."""
    parent: dict[int, int] = {}

    def root(node: int) -> int:
        while parent.setdefault(node, node) != node:
            parent[node] = node = parent[parent[node]]
        return node

    pairs = [(a if a >= 0 else b, b if b >= 0 else a) for a, b in nodes.tolist()]
    for a, b in pairs:
        parent[root(a)] = root(b)
    members: dict[int, list[int]] = {}
    for row, (a, _) in enumerate(pairs):
        members.setdefault(root(a), []).append(row)
    for rows in members.values():
        yield np.array(rows, dtype=np.int64)
